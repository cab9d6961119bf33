"""Clusters and the objects they belong to."""

from __future__ import annotations

import math

import numpy as np
import pytest

from skiros2_motion.core.geometry import Vector, to_euler
from skiros2_perception.core.association import Cluster, associated, cluster_of, least_rectangle, recognised
from skiros2_perception.core.objects import KnownObject
from skiros2_perception.core.segmentation import clusters, find_support
from skiros2_perception.core.shape import box_shape
from skiros2_perception.core.view import Cloud
from support.simulated_cell import at

BRICK: Vector = (0.12, 0.06, 0.05)
RED, BLUE = np.array((200.0, 30.0, 30.0)), np.array((30.0, 30.0, 200.0))


def known(
    eid: str, x: float, size: Vector = BRICK, deviation: float = 0.02, colour: np.ndarray | None = None
) -> KnownObject:
    covariance = np.diag((deviation**2,) * 3 + (0.1,) * 3)
    return KnownObject(eid, "skiros:Product", eid, "map", box_shape(size), at(x, 0.0, 0.0), covariance, 1.0, colour)


def cluster(x: float, size: Vector = BRICK, colour: np.ndarray | None = None) -> Cluster:
    return Cluster(at(x, 0.0, 0.0), size, colour, cloud(np.empty((0, 3))))


def cloud(points: np.ndarray) -> Cloud:
    return Cloud(points, np.tile((0.0, 0.0, 1.0), (len(points), 1)), np.full(len(points), 0.001))


def test_near_cluster_of_the_same_size_is_associated() -> None:
    assert associated([cluster(0.02)], [known("a", 0.0)]) == {0: 0}


def test_distance_is_measured_in_standard_deviations() -> None:
    assert associated([cluster(0.05)], [known("sure", 0.0, deviation=0.002)]) == {}
    assert associated([cluster(0.05)], [known("unsure", 0.0, deviation=0.03)]) == {0: 0}


def test_cluster_of_another_size_is_not_associated() -> None:
    assert associated([cluster(0.0, (0.12, 0.06, 0.12))], [known("a", 0.0)]) == {}


def test_turned_object_has_the_same_size() -> None:
    assert associated([cluster(0.0, (0.06, 0.12, 0.05))], [known("a", 0.0)]) == {0: 0}


def test_colours_decide_between_equal_objects() -> None:
    objects = [known("red", 0.0, colour=RED), known("blue", 0.01, colour=BLUE)]
    assert associated([cluster(0.0, colour=BLUE), cluster(0.01, colour=RED)], objects) == {0: 1, 1: 0}


def test_sum_of_distances_is_least() -> None:
    """The nearest object of the first cluster is left to the second one, which no other object is near to."""
    objects = [known("a", 0.0, deviation=0.01), known("b", 0.04, deviation=0.01)]
    assert associated([cluster(0.018), cluster(-0.02)], objects) == {0: 1, 1: 0}


def test_object_is_recognised_elsewhere_only_if_its_appearance_is_unique() -> None:
    assert recognised([cluster(3.0)], [known("a", 0.0)]) == {0: 0}
    assert recognised([cluster(3.0), cluster(4.0)], [known("a", 0.0)]) == {}
    assert recognised([cluster(3.0)], [known("a", 0.0), known("b", 1.0)]) == {}
    colours = [known("a", 0.0, colour=RED), known("b", 1.0, colour=BLUE)]
    assert recognised([cluster(3.0, colour=BLUE)], colours) == {0: 1}


def test_smallest_box_around_points_has_their_orientation() -> None:
    yaw = 0.4
    local = np.random.default_rng(0).uniform(-0.5, 0.5, (4000, 3)) * BRICK
    turn = np.array(((math.cos(yaw), -math.sin(yaw)), (math.sin(yaw), math.cos(yaw))))
    points = np.column_stack((local[:, :2] @ turn.T + (1.0, 2.0), local[:, 2]))
    found = cluster_of(cloud(points), None)
    assert found.pose.position == pytest.approx((1.0, 2.0, 0.0), abs=0.002)
    assert found.size == pytest.approx(BRICK, abs=0.003)
    assert to_euler(found.pose.orientation)[2] == pytest.approx(yaw, abs=0.03)


def test_points_on_a_line_have_a_rectangle_without_width() -> None:
    points = np.column_stack((np.linspace(0.0, 1.0, 20),) * 2)
    assert min(least_rectangle(points)[2]) == pytest.approx(0.0, abs=1e-9)


def test_points_apart_are_clusters_and_few_points_are_none() -> None:
    random = np.random.default_rng(0)
    here = random.uniform(-0.01, 0.01, (200, 3))
    there = random.uniform(-0.01, 0.01, (100, 3)) + np.array((0.1, 0.0, 0.0))
    found = clusters(np.vstack((here, there, [[1.0, 1.0, 1.0]] * 5)))
    assert [len(indices) for indices in found] == [200, 100]
    assert clusters(np.empty((0, 3))) == []


def test_support_is_the_level_plane_at_the_expected_height() -> None:
    random = np.random.default_rng(0)
    floor = np.column_stack((random.uniform(-1, 1, (500, 2)), random.normal(0.0, 0.001, 500)))
    top = np.column_stack((random.uniform(-1, 1, (900, 2)), random.normal(0.3, 0.001, 900)))
    plane = find_support(cloud(np.vstack((floor, top))), 0.01, 0.05)
    assert plane is not None
    assert plane[:3] == pytest.approx((0.0, 0.0, 1.0), abs=0.002) and plane[3] == pytest.approx(0.0, abs=0.001)
    assert find_support(cloud(top), 0.0, 0.05) is None
