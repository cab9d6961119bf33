"""Errors of poses that were estimated."""

from __future__ import annotations

import math

import numpy as np

from skiros2_common.core.world_element import Element
from skiros2_common.core.world_model_port import WorldModelPort
from skiros2_motion.core.geometry import IDENTITY, composed, rotated
from skiros2_perception.core.fusion import covariance_from
from skiros2_perception.core.objects import COVARIANCE
from skiros2_std_reasoners.core import spatial_data as space
from skiros2_std_reasoners.core.scene_poses import ancestors


def position_deviation(wmi: WorldModelPort, element: Element) -> float | None:
    """Returns the largest standard deviation of the position of an element (m), from the covariance of its own pose or
    that of the object that it is a part of; None if neither was estimated.

    :raises WrongValue: the covariance is invalid.
    """
    offset = IDENTITY
    for above in ancestors(wmi, element):
        own = space.pose_of(above) or IDENTITY
        if text := above.value_of(COVARIANCE):
            x, y, z = rotated(own.orientation, offset.position)
            # of p + r x R's error, with the vector r from the object's origin to the element
            lever = np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]])
            moves = np.hstack((np.eye(3), lever))
            return math.sqrt(float(np.linalg.eigvalsh(moves @ covariance_from(str(text)) @ moves.T)[-1]))
        offset = composed(own, offset)
    return None
