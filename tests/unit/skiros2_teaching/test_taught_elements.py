"""Taught poses and paths in the world model: added, read, renamed, moved, removed, undone."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from skiros2_common.core.errors import Refused, UnknownName, WrongValue
from skiros2_common.core.world_element import Element
from skiros2_motion.core.geometry import IDENTITY, Pose, composed, from_euler
from skiros2_motion.core.gripper import GripperEvent
from skiros2_std_reasoners.core import spatial_data as space
from skiros2_std_reasoners.core.scene_poses import pose_in_scene
from skiros2_teaching.core import taught_elements as taught
from skiros2_teaching.core.taught_path import Sample, TaughtPath
from skiros2_world_model.core.local_world_model import LocalWorldModel

GRASP = Pose((0.05, 0.0, 0.1), from_euler(math.pi, 0.0, 0.2))
ABOVE = Pose((0.0, 0.0, -0.12), IDENTITY.orientation)
LINE = TaughtPath.from_samples(
    [Sample(0.1 * i, Pose((0.1, 0.01 * i, 0.2), GRASP.orientation)) for i in range(11)], [GripperEvent(0.5, 0.04, 20.0)]
)


def approx(pose: Pose) -> object:
    return pytest.approx(np.concatenate(pose), abs=1e-5)


def teach(wmi: LocalWorldModel, block: Element, name: str = "grasp") -> Element:
    wmi.transact(taught.new_pose(wmi, block, name, GRASP))
    return taught.find_taught(wmi, block, name)


def test_taught_pose_is_a_part_of_its_object_and_moves_with_it(wmi: LocalWorldModel, block: Element) -> None:
    grasp = teach(wmi, block)
    assert grasp.type == "skiros:TaughtPose"
    assert taught.owner_of(wmi, grasp).id == block.id
    moved = Pose((0.2, -0.3, 0.5), from_euler(0.0, 0.0, 1.0))
    element = wmi.get_element(block.id)
    space.set_pose(element, moved)
    wmi.update_element(element)
    assert np.concatenate(pose_in_scene(wmi, grasp)[1]) == approx(composed(moved, GRASP))


def test_lifting_pose_is_a_part_of_its_taught_pose_which_has_one_at_most(wmi: LocalWorldModel, block: Element) -> None:
    grasp = teach(wmi, block)
    assert taught.lifting_pose_of(wmi, grasp) is None
    wmi.transact(taught.with_lifting_pose(wmi, grasp, IDENTITY))
    wmi.transact(taught.with_lifting_pose(wmi, grasp, ABOVE))
    lifting = taught.lifting_pose_of(wmi, grasp)
    assert lifting is not None
    assert (lifting.type, lifting.label, space.pose_of(lifting)) == ("skiros:LiftingPose", "grasp lifting", ABOVE)
    assert taught.owner_of(wmi, lifting).id == block.id
    assert [e.label for e in taught.taught_elements(wmi, block)] == ["grasp"]


def test_path_is_stored_from_its_start_with_its_events(wmi: LocalWorldModel, block: Element) -> None:
    wmi.transact(taught.new_path(wmi, block, "insert", LINE))
    element = taught.find_taught(wmi, block, "insert")
    start = space.pose_of(element)
    assert start is not None
    path = taught.path_of(element)
    assert np.concatenate(path.pose(0.0)) == approx(IDENTITY)
    assert np.concatenate(composed(start, path.pose(0.73))) == approx(LINE.pose(0.73))
    assert path.events == (GripperEvent(0.5, 0.04, 20.0),)


def test_elements_are_listed_by_name(wmi: LocalWorldModel, block: Element) -> None:
    for name in ("b", "a"):
        teach(wmi, block, name)
    wmi.transact(taught.new_path(wmi, block, "c", LINE))
    assert [e.label for e in taught.taught_elements(wmi, block)] == ["a", "b", "c"]
    with pytest.raises(UnknownName, match="'block' has no taught pose or path 'grab'; it has: a, b, c"):
        taught.find_taught(wmi, block, "grab")


def test_unusable_name_and_pose_are_refused_with_all_problems(wmi: LocalWorldModel, block: Element) -> None:
    teach(wmi, block)
    pose = Pose((math.nan, 0.0, 0.0), (0.0, 0.0, 0.0, 3.0))
    with pytest.raises(WrongValue, match=r"'grasp'.*has a taught element of this name.*position.*finite.*quaternion"):
        taught.new_pose(wmi, block, "grasp", pose)
    for name in ("", "  ", " a", "a\n", "x" * 81):
        with pytest.raises(WrongValue, match="name"):
            taught.new_pose(wmi, block, name, GRASP)
    assert [e.label for e in taught.taught_elements(wmi, block)] == ["grasp"]


def test_renamed_element_keeps_its_content_and_names_stay_unique(wmi: LocalWorldModel, block: Element) -> None:
    grasp = teach(wmi, block)
    teach(wmi, block, "other")
    wmi.transact(taught.renamed(wmi, grasp, "pick"))
    assert space.pose_of(taught.find_taught(wmi, block, "pick")) == GRASP
    with pytest.raises(WrongValue, match="has a taught element of this name: skiros:TaughtPose-"):
        taught.renamed(wmi, grasp, "other")
    assert taught.renamed(wmi, grasp, "pick") == []


def test_removed_pose_takes_its_lifting_pose_along(wmi: LocalWorldModel, block: Element) -> None:
    grasp = teach(wmi, block)
    wmi.transact(taught.with_lifting_pose(wmi, grasp, ABOVE))
    wmi.transact(taught.removed(wmi, grasp))
    assert taught.taught_elements(wmi, block) == []
    assert wmi.resolve_elements(Element("skiros:LiftingPose")) == []
    with pytest.raises(WrongValue, match="expected a skiros:TaughtPose"):
        taught.removed(wmi, block)


EDITS: list[Callable[[LocalWorldModel, Element], object]] = [
    lambda wmi, grasp: taught.renamed(wmi, grasp, "other"),
    lambda wmi, grasp: taught.with_pose(wmi, grasp, ABOVE),
    lambda wmi, grasp: taught.with_lifting_pose(wmi, grasp, ABOVE),
    lambda wmi, grasp: taught.with_path(wmi, grasp, LINE),
    lambda wmi, grasp: taught.removed(wmi, grasp),
    lambda wmi, grasp: taught.owner_of(wmi, grasp),
]


@pytest.mark.parametrize("edit", EDITS)
def test_element_that_was_removed_with_its_object_is_refused(
    wmi: LocalWorldModel, block: Element, edit: Callable[[LocalWorldModel, Element], object]
) -> None:
    grasp = teach(wmi, block)
    wmi.remove_element(block.id)
    with pytest.raises(UnknownName, match=r"'grasp' \(skiros:TaughtPose-\d+\) is not in the scene"):
        edit(wmi, grasp)


def test_element_whose_object_is_gone_is_refused(wmi: LocalWorldModel, block: Element) -> None:
    grasp = teach(wmi, block)
    wmi.remove_element(block.id, recursive=False)
    with pytest.raises(Refused, match=r"the object of 'grasp' is gone: skiros:TaughtPose-.* is not a part of anything"):
        taught.owner_of(wmi, grasp)


def test_last_edits_are_undone_one_after_the_other(wmi: LocalWorldModel, block: Element) -> None:
    with pytest.raises(Refused, match="nothing to undo"):
        taught.last_edit(wmi)
    grasp = teach(wmi, block)
    wmi.transact(taught.with_lifting_pose(wmi, grasp, ABOVE))
    wmi.transact(taught.renamed(wmi, grasp, "pick"))
    wmi.transact(taught.removed(wmi, grasp))
    other = wmi.get_element(block.id)
    other.setProperty("skiros:Weight", 3.0)
    wmi.update_element(other)

    def undo() -> list[str]:
        wmi.revert(taught.last_edit(wmi))
        return [e.label for e in taught.taught_elements(wmi, block)]

    assert undo() == ["pick"]
    assert space.pose_of(taught.find_taught(wmi, block, "pick")) == GRASP
    assert undo() == ["grasp"]
    assert taught.lifting_pose_of(wmi, grasp) is not None
    assert undo() == ["grasp"]
    assert taught.lifting_pose_of(wmi, grasp) is None
    assert undo() == []
    with pytest.raises(Refused, match="nothing to undo"):
        taught.last_edit(wmi)
    assert wmi.get_element(block.id).value_of("skiros:Weight") == 3.0


def test_new_edit_after_an_undo_is_undone_next(wmi: LocalWorldModel, block: Element) -> None:
    teach(wmi, block, "a")
    teach(wmi, block, "b")
    wmi.revert(taught.last_edit(wmi))
    teach(wmi, block, "c")
    wmi.revert(taught.last_edit(wmi))
    assert [e.label for e in taught.taught_elements(wmi, block)] == ["a"]


def test_path_with_invalid_samples_in_the_scene_is_refused(wmi: LocalWorldModel, block: Element) -> None:
    wmi.transact(taught.new_path(wmi, block, "insert", LINE))
    element = taught.find_taught(wmi, block, "insert")
    element.setProperty(taught.SAMPLES, "[[0,1,2]]")
    wmi.update_element(element)
    with pytest.raises(WrongValue, match="path 'insert': samples: expected 8 numbers in each list, got 3 in 0"):
        taught.path_of(wmi.get_element(element.id))
