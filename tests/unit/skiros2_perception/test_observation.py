"""Views of a table compared with the world model: seen, absent, hidden and unknown objects."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import pytest

from skiros2_common.core.world_element import Element
from skiros2_motion.core.geometry import Pose, Vector, from_euler
from skiros2_perception.core import confidence
from skiros2_perception.core.observation import observe
from skiros2_perception.core.scene_update import UNKNOWN, SceneUpdate, scene_objects, update_scene
from skiros2_sim.core.scene_spec import BodySpec, SceneSpec
from skiros2_sim.core.world import World
from skiros2_std_reasoners.core import spatial_data as space
from skiros2_std_reasoners.core.scene_poses import pose_in_scene
from skiros2_world_model.core.local_world_model import LocalWorldModel
from support import depth_scene as scene
from support.simulated_cell import at

RED, GREEN = (0.8, 0.1, 0.1, 1.0), (0.1, 0.7, 0.1, 1.0)
EYE = (0.1, -0.1, 0.85)
TARGET = (0.5, 0.0, 0.4)
ROOT = "skiros:Scene-0"


class Table:
    """A table in physics and in a world model, whose ids are the same for known objects.

    :param bodies: label -> position of the centre, size, colour, and whether the world model knows it.
    """

    def __init__(self, **bodies: tuple[Pose, Vector, tuple[float, ...], bool]) -> None:
        self.wmi = LocalWorldModel("perception")
        self.add("skiros:Location", "table", at(0.5, 0.0, scene.TOP / 2), (0.8, 1.0, scene.TOP))
        specs = [BodySpec("table", pose=at(0.5, 0.0, scene.TOP / 2), size=(0.8, 1.0, scene.TOP))]
        for label, (pose, size, colour, is_known) in bodies.items():
            if is_known:
                self.add("skiros:Product", label, pose, size)
            specs.append(BodySpec(label, pose=pose, size=size, colour=colour))
        self.world = World(SceneSpec(tuple(specs)))
        self._random = np.random.default_rng(0)

    def add(self, kind: str, label: str, pose: Pose, size: Vector) -> None:
        element = Element(kind, label)
        element.addRelation(ROOT, "skiros:contain", "-1")
        space.set_pose(element, pose)
        space.set_numbers(element, space.SIZE, size)
        self.wmi.add_element(element)

    def look(self, eye: Vector = EYE) -> SceneUpdate:
        objects = scene_objects(self.wmi)
        assert objects.problems == []
        view = scene.take(self.world, eye, self._random, target=TARGET)
        seen = observe(view, scene.SENSOR, objects.known, objects.fixed, objects.measured)
        return update_scene(self.wmi, seen, objects, ROOT)

    def element(self, label: str) -> Element:
        found = self.wmi.resolve_elements(Element("", label))
        assert len(found) == 1, label
        return found[0]

    def unknown(self) -> list[Element]:
        return self.wmi.resolve_elements(Element(UNKNOWN))

    def confidence(self, label: str) -> float | None:
        return self.element(label).value_of("skiros:Confidence")

    def error(self, label: str) -> float:
        """How far the world model is from the truth (m)."""
        return math.dist(pose_in_scene(self.wmi, self.element(label))[1].position, self.world.pose_of(label).position)


def on_table(x: float, y: float, size: Vector, yaw: float = 0.0) -> Pose:
    return Pose((x, y, scene.TOP + size[2] / 2), from_euler(0.0, 0.0, yaw))


CUBE: Vector = (0.06, 0.06, 0.06)
BRICK: Vector = (0.12, 0.06, 0.05)


@pytest.fixture
def table() -> Iterator[Table]:
    made = Table(
        cube=(on_table(0.45, 0.1, CUBE), CUBE, RED, True), brick=(on_table(0.5, -0.12, BRICK), BRICK, GREEN, True)
    )
    yield made
    made.world.close()


def test_objects_at_their_places_are_seen_and_nothing_is_new(table: Table) -> None:
    update = table.look()
    assert sorted(update.seen) == ["brick", "cube"]
    assert not (update.missed or update.missing or update.added or update.removed)
    assert table.confidence("cube") == 1.0
    assert table.error("cube") < 0.002 and table.error("brick") < 0.002


def test_displaced_object_gets_its_new_pose_with_covariance(table: Table) -> None:
    table.world.set_pose("brick", on_table(0.52, -0.1, BRICK, 0.15))
    update = table.look()
    assert "brick" in update.seen and not update.added
    assert table.error("brick") < 0.002
    assert table.element("brick").value_of("skiros:PoseCovariance")


def test_removed_object_loses_confidence_and_is_marked_as_missing_but_kept(table: Table) -> None:
    table.look()
    table.world.set_pose("cube", at(5.0, 5.0, 0.5))
    values = []
    for _ in range(4):
        update = table.look()
        values.append(table.confidence("cube"))
    assert values == sorted(values, reverse=True) and values[0] < 0.7 and values[-1] < confidence.MISSING_BELOW
    assert update.missing == ["cube"]
    assert table.element("cube").value_of("skiros:Missing") is True
    assert table.element("brick").value_of("skiros:Missing") is False


def test_returned_object_regains_confidence(table: Table) -> None:
    there = table.world.pose_of("cube")
    table.world.set_pose("cube", at(5.0, 5.0, 0.5))
    for _ in range(4):
        table.look()
    table.world.set_pose("cube", there)
    table.look()
    assert table.confidence("cube") > 0.5
    assert table.element("cube").value_of("skiros:Missing") is False


def test_hidden_object_keeps_its_confidence() -> None:
    wall: Vector = (0.02, 0.3, 0.25)
    table = Table(
        cube=(on_table(0.45, 0.1, CUBE), CUBE, RED, True), wall=(on_table(0.35, 0.1, wall), wall, GREEN, True)
    )
    with table.world:
        update = table.look()
        assert update.seen == ["wall"] and not update.missed
        assert table.confidence("cube") is None


def test_object_out_of_view_keeps_its_confidence(table: Table) -> None:
    table.world.set_pose("cube", at(5.0, 5.0, 0.5))
    view = scene.take(table.world, EYE, target=(-1.0, -0.1, 0.5))
    objects = scene_objects(table.wmi)
    found = observe(view, scene.SENSOR, objects.known, objects.fixed)
    assert len(found.hidden) == 2 and not (found.seen or found.absent)


def test_unknown_box_becomes_one_element_and_stays_one() -> None:
    size: Vector = (0.1, 0.05, 0.07)
    table = Table(
        cube=(on_table(0.45, 0.12, CUBE), CUBE, RED, True),
        found=(on_table(0.5, -0.1, size, 0.3), size, GREEN, False),
    )
    with table.world:
        first = table.look()
        assert len(first.added) == 1 and first.seen == ["cube"]
        for eye in (EYE, (0.2, -0.3, 0.85), (0.9, 0.0, 0.85)):
            update = table.look(eye)
            assert not update.added, eye
            assert len(table.unknown()) == 1
        (element,) = table.unknown()
        pose = pose_in_scene(table.wmi, element)[1]
        assert math.dist(pose.position, table.world.pose_of("found").position) < 0.01
        edges = sorted(float(value or 0.0) for value in space.numbers(element, space.SIZE))
        assert edges == pytest.approx(sorted(size), abs=0.012)
        assert element.value_of("skiros:Confidence") > 0.8


def test_unknown_box_that_is_taken_away_is_removed_in_the_end() -> None:
    size: Vector = (0.1, 0.05, 0.07)
    table = Table(found=(on_table(0.5, -0.1, size), size, GREEN, False))
    with table.world:
        table.look()
        table.world.set_pose("found", at(5.0, 5.0, 0.5))
        looks = 0
        while table.unknown() and looks < 10:
            table.look()
            looks += 1
        assert 4 <= looks < 10


def test_object_that_was_carried_away_is_recognised_by_size_and_colour(table: Table) -> None:
    table.look()
    table.world.set_pose("brick", on_table(0.6, 0.25, BRICK, 1.0))
    update = table.look()
    assert not update.added and "brick" in update.seen
    assert table.error("brick") < 0.003


def test_thing_of_another_size_at_the_place_of_an_object_is_new() -> None:
    other: Vector = (0.05, 0.16, 0.11)
    table = Table(
        cube=(on_table(0.45, 0.1, CUBE), CUBE, RED, True), other=(on_table(0.55, -0.1, other), other, GREEN, False)
    )
    with table.world:
        table.world.set_pose("cube", at(5.0, 5.0, 0.5))
        update = table.look()
        assert update.missed == ["cube"] and len(update.added) == 1


def test_object_with_a_model_is_known_by_its_outline_and_keeps_its_pose() -> None:
    size: Vector = (0.06, 0.06, 0.1)
    table = Table(piston=(on_table(0.45, 0.1, size), size, RED, True))
    element = table.element("piston")
    element.setProperty("skiros:CadModel", "piston.urdf", "xsd:string")
    table.wmi.update_element_properties(element)
    with table.world:
        update = table.look()
        assert update.seen == ["piston"] and not (update.added or update.missed)
        assert not table.element("piston").value_of("skiros:PoseCovariance")
        table.world.set_pose("piston", at(5.0, 5.0, 0.5))
        assert table.look().missed == ["piston"]


def test_ring_in_its_box_is_not_absent() -> None:
    """Most of the box of a ring is empty."""
    size: Vector = (0.2, 0.2, 0.06)
    bar: Vector = (0.2, 0.015, 0.06)
    side: Vector = (0.015, 0.17, 0.06)
    walls = {f"wall{n}": (on_table(0.5, y, bar), bar, RED, False) for n, y in enumerate((-0.0925, 0.0925))}
    walls |= {f"side{n}": (on_table(x, 0.0, side), side, RED, False) for n, x in enumerate((0.4075, 0.5925))}
    table = Table(**walls)
    table.add("skiros:Product", "ring", on_table(0.5, 0.0, size), size)
    element = table.element("ring")
    element.setProperty("skiros:CadModel", "ring.urdf", "xsd:string")
    table.wmi.update_element_properties(element)
    with table.world:
        update = table.look()
        assert update.seen == ["ring"] and not (update.added or update.missed)


def test_object_of_a_class_that_is_not_looked_for_is_not_compared(table: Table) -> None:
    assert scene_objects(table.wmi, "skiros:Starter").known == []


def test_object_with_an_unusable_estimate_is_reported_with_all_problems(table: Table) -> None:
    element = table.element("cube")
    element.setProperty("skiros:PoseCovariance", "[1, 2]", "xsd:string")
    table.wmi.update_element_properties(element)
    objects = scene_objects(table.wmi)
    assert len(objects.known) == 1 and "expected a JSON list of 36 finite numbers" in objects.problems[0]


@pytest.mark.parametrize("part", [0.3, 1.0])
def test_confidence_changes_exponentially(part: float) -> None:
    value = 1.0
    for _ in range(3):
        value = confidence.not_seen(value, part)
    assert value == pytest.approx(2.0 ** (-3 * part))
    assert confidence.seen(0.0, part) == pytest.approx(1 - 2.0**-part)
