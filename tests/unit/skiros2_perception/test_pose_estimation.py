"""The estimated pose of an engine block compared with its true pose."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import pytest
from scipy.stats import chi2

from skiros2_common.core.errors import WrongValue
from skiros2_motion.core.geometry import Pose, composed, from_euler
from skiros2_perception.core.fusion import Estimate, covariance_from, covariance_text, in_frame
from skiros2_perception.core.pose_estimation import estimate_pose, registered
from skiros2_perception.core.problems import Code, Rejected
from skiros2_perception.core.shape import Shape, box_shape
from skiros2_perception.core.transforms import difference, moved
from skiros2_perception.core.view import Sensor, View
from skiros2_sim.core.scene_spec import BodySpec, SceneSpec
from skiros2_sim.core.world import World
from support import depth_scene as scene
from support.simulated_cell import at

pytestmark = pytest.mark.timeout(300)  # sixty views are rendered and registered for the first tests

SEEDS = 8


class Run(NamedTuple):
    estimate: Estimate
    error: np.ndarray


@pytest.fixture(scope="module")
def runs(shared_table: World, block: Shape) -> list[Run]:
    """The block displaced by up to 3 cm and 10 degrees, seen from three sides with 1 mm of noise and an inexact pose of
    the camera."""
    shared_table.reset()
    found = []
    for seed in range(SEEDS):
        random = np.random.default_rng(seed)
        true = scene.displaced(random)
        shared_table.set_pose(scene.BLOCK, true)
        views = [scene.take(shared_table, eye, random) for eye in scene.EYES]
        estimate = estimate_pose(block, views, scene.SENSOR, scene.EXPECTED)
        found.append(Run(estimate, difference(estimate.pose, true)))
    return found


@pytest.mark.long
def test_displaced_block_is_located_to_half_a_millimetre_and_a_tenth_of_a_degree(runs: list[Run]) -> None:
    assert max(np.linalg.norm(run.error[:3]) for run in runs) < 0.0005
    assert max(math.degrees(np.linalg.norm(run.error[3:])) for run in runs) < 0.1


@pytest.mark.long
def test_errors_agree_with_their_covariance(runs: list[Run]) -> None:
    """The normalised squared errors sum up to a chi-squared variable with 6 degrees of freedom for each run (Y.
    Bar-Shalom et al., "Estimation with Applications to Tracking and Navigation", 2001, section 5.4)."""
    squared = [run.error @ np.linalg.solve(run.estimate.covariance, run.error) for run in runs]
    assert chi2.ppf(0.005, 6 * SEEDS) < sum(squared) < chi2.ppf(0.995, 6 * SEEDS)


@pytest.mark.long
def test_quality_of_an_estimate_is_reported(runs: list[Run]) -> None:
    assert all(run.estimate.fitness > 0.95 and run.estimate.views == 3 for run in runs)
    assert all(0.0003 < run.estimate.residual < 0.001 for run in runs)


def test_more_views_make_the_covariance_smaller(table: World, block: Shape) -> None:
    random = np.random.default_rng(1)
    views = [scene.take(table, eye, random) for eye in scene.EYES]
    sizes = [np.linalg.det(estimate_pose(block, views[:n], scene.SENSOR, scene.EXPECTED).covariance) for n in (1, 2, 3)]
    assert sizes == sorted(sizes, reverse=True)


def test_view_of_one_face_leaves_the_other_directions_to_other_views() -> None:
    table = scene.scene().bodies[0]
    part = BodySpec(scene.PART, pose=at(0.5, 0.0, 0.43), size=(0.2, 0.15, 0.06))
    with World(SceneSpec((table, part))) as plain:
        shape = box_shape((0.2, 0.15, 0.06))
        above = scene.take(plain, (0.5, 0.0, 0.85), np.random.default_rng(0))
        with pytest.raises(Rejected) as error:
            estimate_pose(shape, [above], scene.SENSOR, at(0.5, 0.0, 0.43))
        assert error.value.codes == {Code.NOT_DETERMINED}
        sides = [scene.take(plain, eye, np.random.default_rng(0)) for eye in scene.EYES[:2]]
        found = estimate_pose(shape, [above, *sides], scene.SENSOR, at(0.5, 0.0, 0.43))
        assert np.linalg.norm(difference(found.pose, at(0.5, 0.0, 0.43))[:3]) < 0.001


def test_equal_side_nearest_to_the_expected_pose_is_chosen(table: World, block: Shape) -> None:
    half_turn = Pose(scene.EXPECTED.position, from_euler(0.0, 0.0, math.pi - 0.1))
    table.set_pose(scene.BLOCK, half_turn)
    found = estimate_pose(block, [scene.take(table, scene.EYES[0])], scene.SENSOR, scene.EXPECTED)
    assert math.degrees(difference(found.pose, scene.EXPECTED)[5]) == pytest.approx(-math.degrees(0.1), abs=0.2)


def test_partly_hidden_block_is_located(block: Shape) -> None:
    wall = BodySpec(scene.PART, pose=at(0.28, -0.15, 0.55), size=(0.06, 0.02, 0.3))
    with World(scene.scene(wall)) as world:
        view = scene.take(world, scene.EYES[0], np.random.default_rng(0))
        found = registered(block, view, scene.SENSOR, scene.EXPECTED)
        assert 0.02 < found.visibility.hidden < 0.5
        error = difference(found.pose, scene.EXPECTED)
        assert np.linalg.norm(error[:3]) < 0.002 and math.degrees(np.linalg.norm(error[3:])) < 0.3


def test_other_object_in_the_same_place_is_refused_with_reasons(table: World) -> None:
    other = box_shape((0.2, 0.2, 0.14))
    with pytest.raises(Rejected) as error:
        estimate_pose(other, [scene.take(table, scene.EYES[0])], scene.SENSOR, at(0.5, 0.0, 0.47))
    assert Code.LOW_FITNESS in error.value.codes
    assert "of the points match the shape: expected at least 80%" in str(error.value)


def test_object_that_is_not_there_is_refused(table: World, block: Shape) -> None:
    table.set_pose(scene.BLOCK, at(0.5, 3.0, 0.5))
    with pytest.raises(Rejected) as error:
        estimate_pose(block, [scene.take(table, scene.EYES[0])], scene.SENSOR, scene.EXPECTED)
    assert error.value.codes == {Code.TOO_FEW_POINTS}


def test_object_outside_of_the_image_is_refused(table: World, block: Shape) -> None:
    away = scene.take(table, scene.EYES[0], target=(-2.0, -0.25, 0.4))
    with pytest.raises(Rejected) as error:
        estimate_pose(block, [away], scene.SENSOR, scene.EXPECTED)
    assert error.value.codes == {Code.OUT_OF_VIEW}


def test_block_that_moves_between_two_views_is_refused(table: World, block: Shape) -> None:
    first = scene.take(table, scene.EYES[0])
    table.set_pose(scene.BLOCK, at(0.52, 0.0, scene.EXPECTED.position[2]))
    with pytest.raises(Rejected) as error:
        estimate_pose(block, [first, scene.take(table, scene.EYES[1])], scene.SENSOR, scene.EXPECTED)
    assert error.value.codes == {Code.INCONSISTENT}


def test_views_in_different_frames_are_refused(table: World, block: Shape) -> None:
    view = scene.take(table, scene.EYES[0])
    other = View(view.depth, view.focal, view.centre, view.pose, "odom")
    with pytest.raises(WrongValue, match="views in the frames map, odom: expected at least one view, in one frame"):
        estimate_pose(block, [view, other], scene.SENSOR, scene.EXPECTED)


def test_unusable_image_is_refused_with_all_problems() -> None:
    with pytest.raises(WrongValue) as error:
        View(np.full((20, 30), np.nan), (math.nan, 100.0), (15.0, 10.0), Pose((0, 0, 0), (0, 0, 0, 2)), "map", math.inf)
    for part in ("no pixel has a depth", "camera matrix", "unit quaternion", "time inf"):
        assert part in str(error.value)


def test_unusable_sensor_is_refused_with_all_problems() -> None:
    with pytest.raises(WrongValue, match=r"noise nan: .*; angle -1: "):
        Sensor(noise=math.nan, angle=-1)


def test_pixels_without_depth_are_ignored(table: World, block: Shape) -> None:
    view = scene.take(table, scene.EYES[0])
    depth = view.depth.copy()
    depth[np.random.default_rng(0).uniform(size=depth.shape) < 0.3] = np.nan
    found = estimate_pose(block, [View(depth, view.focal, view.centre, view.pose)], scene.SENSOR, scene.EXPECTED)
    assert np.linalg.norm(difference(found.pose, scene.EXPECTED)[:3]) < 0.001


def test_covariance_follows_the_axes_of_the_frame(table: World, block: Shape) -> None:
    found = estimate_pose(block, [scene.take(table, scene.EYES[0])], scene.SENSOR, scene.EXPECTED)
    frame = Pose((1.0, 2.0, 3.0), from_euler(0.3, -0.2, 1.0))
    turned = in_frame(found, frame)
    error = np.array((1e-3, 2e-3, -1e-3, 1e-3, 0.0, 2e-3))
    other = difference(composed(frame, moved(found.pose, error)), turned.pose)
    assert other @ turned.information @ other == pytest.approx(error @ found.information @ error, rel=1e-6)


def test_covariance_is_kept_as_text(runs: list[Run]) -> None:
    covariance = runs[0].estimate.covariance
    assert covariance_from(covariance_text(covariance)) == pytest.approx(covariance, rel=1e-4, abs=1e-15)
    for text in ("", "[1, 2]", str([0.0] * 36), str([float(i) for i in range(36)])):
        with pytest.raises(WrongValue, match="covariance"):
            covariance_from(text)
