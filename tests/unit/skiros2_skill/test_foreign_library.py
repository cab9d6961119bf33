"""A library as others write it, from the published API alone and in the idioms of older versions, runs unchanged.

It lies in tests/libraries/foreign_cell_skills; nothing of it is made for these tests but the fake motions.
"""

import logging
from pathlib import Path

import pytest

from skiros2_common.core.abstract_skill import State
from skiros2_skill.core.tree.node import all_nodes

LIBRARIES = Path(__file__).parents[2] / "libraries"

pytestmark = pytest.mark.usefixtures("path")


@pytest.fixture
def path(monkeypatch):
    monkeypatch.syspath_prepend(LIBRARIES)


@pytest.fixture
def cell(skill_bench):
    """A robot with an arm and a gripper at a shelf with a product; a table."""
    bench = skill_bench.import_libraries("foreign_cell_skills", "skiros2_std_skills")
    arm = bench.add("rparts:ArmDevice", "arm", bench.robot, "skiros:hasA", StateProperty="Idle")
    bench.add("rparts:GripperEffector", "gripper", arm, "skiros:hasA", ContainerState="Empty")
    shelf, _, _ = (bench.add("skiros:Location", name) for name in ("shelf", "table", "dock"))
    bench.add("skiros:Product", "bolt", shelf, Weight=0.2)
    bench.add("skiros:Starter", "starter", shelf, Weight=3.0)
    bench.wmi.set_relation(bench.robot.id, "skiros:at", shelf.id)
    return bench


def run(cell, stype, **params):
    """The node of a skill that has run to its end."""
    return cell.command(stype, **params).run(100_000).skill


def drive(cell, label):
    """Puts the robot somewhere else."""
    robot = cell.wmi.get_element(cell.robot.id)
    robot.setRelation("-1", "skiros:at", cell.element(label).id)
    cell.wmi.update_element(robot)


def labels(node):
    """The labels of a tree's skills in the order of the nodes."""
    return [n.label for n in all_nodes(node) if n.type not in (":Root", ":Skill")]


def test_each_skill_is_loaded(cell):
    names = ["approach_fake", "go_fake", "grab_fake", "drop_fake", "look_fake", "scrap_fake", "check_value"]
    cell.load(*names, "Check_Value", "go_around", "grab_light", "bring", "bring_all")
    assert len(cell.library.implementations()) == 12


def test_tree_of_all_node_kinds_moves_an_element(cell):
    drive(cell, "dock")
    bring = run(cell, "Bring", Object=cell.element("bolt"), To=cell.element("table"))
    assert bring.state is State.Success
    assert cell.holder("bolt") == "table"
    assert cell.related(cell.robot.label, "skiros:at") == ["table"]
    assert cell.element("arm").getProperty("skiros:StateProperty").value == "Idle"
    assert labels(bring) == [
        "bring", "approach_fake", "wait", "go_fake", "grab_fake", "go_fake", "wait", "drop_fake", "grab_fake"
    ]  # fmt: skip


def test_output_of_a_child_reaches_the_task(cell):
    assert cell.command("Grab", Object=cell.element("bolt")).run().blackboard["Grasped"] == "bolt"


def test_implementation_with_a_narrower_class_gets_its_elements(cell):
    cell.load("grab_light", "grab_fake")
    assert run(cell, "Grab", Object=cell.element("bolt")).label == "grab_fake"
    cell.wmi.set_relation(cell.element("gripper").id, "skiros:contain", cell.element("bolt").id, False)
    gripper = cell.element("gripper")
    gripper.setProperty("skiros:ContainerState", "Empty")
    cell.wmi.update_element_properties(gripper)
    grab = run(cell, "Grab", Object=cell.element("starter"))
    assert (grab.label, grab.state) == ("grab_light", State.Success), grab.printProgress()
    assert cell.holder("starter") == "gripper"


def test_own_pre_condition_selects_the_implementation(cell):
    cell.load("go_around", "go_fake")
    assert run(cell, "Go", TargetLocation=cell.element("table")).label == "go_fake"
    robot = cell.wmi.get_element(cell.robot.id)
    robot.setProperty("skiros:ContainerState", "Shy")
    cell.wmi.update_element_properties(robot)
    around = run(cell, "Go", TargetLocation=cell.element("shelf"))
    assert (around.label, around.state) == ("go_around", State.Success), around.printProgress()
    assert cell.related(cell.robot.label, "skiros:at") == ["shelf"]


def test_compound_runs_one_skill_several_times_in_parallel(cell):
    drive(cell, "dock")
    node = run(cell, "BringAll", First=cell.element("bolt"), Goal=cell.element("table"))
    assert node.state is State.Success, node.printProgress()
    assert cell.holder("bolt") == "table"
    assert [n.progress_code for n in node.children[:2]] == [3, 3]


def test_added_element_is_the_output(cell):
    look = run(cell, "Look", Place=cell.element("table"))
    assert look.state is State.Success, look.printProgress()
    assert look.params["Seen"].value.label == "seen thing"
    assert cell.holder("seen thing") == "table"


def test_consumed_element_is_removed_and_unspecified_parameter_unset(cell):
    task = cell.command("Scrap", Object=cell.element("bolt"))
    assert task.tick() is State.Success, task.why
    assert "bolt" not in [e.label for e in cell.wmi.get_scene_elements()]


def test_labels_differ_in_case_only(cell):
    cell.load("check_value", "Check_Value")
    low, high = run(cell, "Check", Value=5.0), run(cell, "Check", Value=50.0)
    assert (low.label, low.progress_msg) == ("check_value", "5.0 m")
    assert (high.label, high.state) == ("Check_Value", State.Success)


def test_value_rejected_by_all_implementations_is_reported_for_each(cell):
    cell.load("check_value", "Check_Value")
    check = run(cell, "Check", Value=500.0)
    assert check.state is State.Failure
    for label in ("check_value", "Check_Value"):
        assert f"{label}: Pre-condition failed: [BelowLimit]" in check.progress_msg


def test_preempted_compound_ends_running_children(cell):
    task = cell.command("Bring", Object=cell.element("bolt"), To=cell.element("table"))
    task.tick()
    task.preempt()
    assert task.tick() is State.Failure
    assert State.Running not in [n.state for n in task.nodes()]


def test_skill_logs_through_python_logging(cell, caplog):
    with caplog.at_level(logging.INFO):
        run(cell, "Grab", Object=cell.element("bolt"))
    assert "Grasped bolt" in caplog.text
