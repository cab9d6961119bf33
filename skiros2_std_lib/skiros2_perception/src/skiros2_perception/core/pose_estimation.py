"""The pose of a known object from one view or several."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial import Delaunay

from skiros2_common.core.errors import WrongValue
from skiros2_motion.core.geometry import Pose
from skiros2_perception.core.fusion import Estimate, check_determined, estimate_of, fused
from skiros2_perception.core.problems import Code, Problem, Rejected
from skiros2_perception.core.registration import DEFAULT, Limits, Registration, register
from skiros2_perception.core.segmentation import clusters, find_support, heights_above
from skiros2_perception.core.shape import Shape
from skiros2_perception.core.view import Cloud, Sensor, View, cloud_of

#: Points closer to the supporting plane belong to it (m), or three standard deviations.
_ABOVE = 0.003
#: Minimum fraction of a smaller cluster within the outline of the object.
_WITHIN = 0.9


def estimate_pose(
    shape: Shape, views: Sequence[View], sensor: Sensor, prior: Pose, limits: Limits = DEFAULT
) -> Estimate:
    """Returns the pose of an object from views, fused.

    :param prior: expected pose, in the reference frame of the views.
    :raises WrongValue: there is no view, or their reference frames differ.
    :raises Rejected: a view does not fit, views disagree, or they do not determine the pose.
    """
    frames = sorted({view.frame for view in views})
    if len(frames) != 1:
        raise WrongValue(f"views in the frames {', '.join(frames) or 'none'}: expected at least one view, in one frame")
    total: Estimate | None = None
    for view in views:
        found = estimate_of(registered(shape, view, sensor, prior if total is None else total.pose, limits))
        total = found if total is None else fused(total, found)
    assert total is not None
    check_determined(total)
    return total


def registered(shape: Shape, view: View, sensor: Sensor, prior: Pose, limits: Limits = DEFAULT) -> Registration:
    """Returns the pose of an object in one view, which may leave directions undetermined.

    :raises Rejected: the object is not in view, or no pose fits.
    """
    return register(shape, object_points(shape, view, sensor, prior, limits.shift), view, sensor, prior, limits)


def object_points(shape: Shape, view: View, sensor: Sensor, prior: Pose, shift: float) -> Cloud:
    """Returns the points of an object: the largest cluster around the expected pose, above the supporting plane.

    :param shift: maximum distance from the expected position (m).
    :raises Rejected: nothing is measured there.
    """
    cloud = cloud_of(view, sensor, prior.position, shape.radius + shift)
    if len(cloud) == 0:
        raise Rejected(Problem(Code.OUT_OF_VIEW, "nothing is measured where the object is expected"))
    bottom = prior.position[2] + shape.lowest(prior.orientation)
    plane = find_support(cloud, bottom, shift)
    if plane is not None:
        margin = np.maximum(_ABOVE, 3 * cloud.deviations)
        cloud = cloud.part(heights_above(plane, cloud.points) > margin)
    found = clusters(cloud.points)
    if not found:
        raise Rejected(Problem(Code.TOO_FEW_POINTS, "nothing above the supporting plane where the object is expected"))
    # the floor of a bore may be a cluster of its own, within the outline of the object
    outline = Delaunay(cloud.points[found[0], :2])
    parts = [part for part in found[1:] if (outline.find_simplex(cloud.points[part, :2]) >= 0).mean() > _WITHIN]
    return cloud.part(np.sort(np.concatenate([found[0], *parts])))
