"""Reading a recorded run."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

from skiros2_bags.core.bag_file import BagError
from skiros2_bags.core.run import Run
from skiros2_runs.core.history import node_histories
from skiros2_runs.core.states import TaskState
from support.recorded_run import (
    FAILURE,
    GOAL,
    IDLE,
    PRODUCT,
    RUNNING,
    SUCCESS,
    TRAY_A,
    TRAY_B,
    Monitor,
    element,
    good_run,
    moved,
    node,
    relation,
    scene,
    write_bag,
)
from support.ros import ROOT

LABELS = ("pick", "place")


def tree(*states: int, root: int = SUCCESS, ended: bool = True) -> Any:
    """The progress of a task of two skills."""
    code = {SUCCESS: 1, FAILURE: -1}.get(root, 0) if ended else 0
    skills = [
        node(7, number, 7, f"skiros:{label.title()}", label, state, 1, "says so")
        for number, (label, state) in enumerate(zip(LABELS, states, strict=True), 1)
    ]
    return [node(7, 7, -1, ":Root", "root", root, code, "Success"), *skills]


NS = 1e-9  #: time between messages of `write_bag` (s)


@pytest.fixture
def run(tmp_path: Path) -> Run:
    return Run.open(write_bag(tmp_path / "run.bag", good_run()))


def test_final_world_includes_all_changes(run: Run) -> None:
    world = run.world()
    assert world.related(TRAY_B, "skiros:contain", PRODUCT)
    assert not world.related(TRAY_A, "skiros:contain", PRODUCT)
    assert world.element(PRODUCT).getProperty("skiros:PositionX").value == 0.5


def test_world_at_a_time_includes_earlier_changes_only(run: Run) -> None:
    change = run.changes()[-1]
    before, after = run.world(change.time - NS), run.world(change.time)
    assert before.related(TRAY_A, "skiros:contain", PRODUCT)
    assert after.related(TRAY_B, "skiros:contain", PRODUCT)


def test_each_world_is_a_copy(run: Run) -> None:
    run.world().drop(PRODUCT)
    assert PRODUCT in run.world()


def test_world_before_the_first_change_is_unknown(run: Run) -> None:
    with pytest.raises(BagError, match="no change of the world model until -1"):
        run.world(-1.0)


def test_removed_elements_and_relations_are_missing(tmp_path: Path) -> None:
    monitor = Monitor()
    tray = element(TRAY_A, "Tray A")
    contains = relation(TRAY_A, "skiros:contain", PRODUCT)
    run = Run.open(write_bag(tmp_path / "run.bag", [
        ("change", monitor("reset", *scene())),
        ("change", monitor("remove", relation=[contains])),
        ("change", monitor("add", relation=[contains])),
        ("change", monitor("remove_recursive", tray)),
    ]))  # fmt: skip
    times = [timed.time for timed in run.changes()]
    assert [run.world(t).related(TRAY_A, "skiros:contain", PRODUCT) for t in times] == [True, False, True, False]
    assert TRAY_A not in run.world()


def test_changes_are_sorted_by_snapshot_id(tmp_path: Path) -> None:
    monitor = Monitor()
    first, second, third = (monitor("reset", *scene()), monitor("update", *moved()), monitor("update", *scene()[2:]))
    run = Run.open(write_bag(tmp_path / "run.bag", [("change", m) for m in (first, third, second)]))
    assert [timed.change.snapshot_id for timed in run.changes()] == ["s1", "s2", "s3"]
    assert not any(timed.gap for timed in run.changes())
    assert run.world().related(TRAY_A, "skiros:contain", PRODUCT)


def test_world_after_a_gap_is_unknown(tmp_path: Path) -> None:
    monitor = Monitor()
    whole = monitor("reset", *scene())
    monitor("update")  # is lost
    run = Run.open(write_bag(tmp_path / "run.bag", [("change", whole), ("change", monitor("update", *moved()))]))
    with pytest.raises(BagError, match="missing between 's1' and 's2', before the update 's3' of 'test'"):
        run.world()
    assert TRAY_A in run.world(0.0)
    assert run.world(partial=True).related(TRAY_B, "skiros:contain", PRODUCT)


def test_reset_after_a_gap_restores_the_world(tmp_path: Path) -> None:
    monitor = Monitor()
    whole = monitor("reset", *scene())
    monitor("update")
    messages = [("change", m) for m in (whole, monitor("update", *moved()), monitor("reset", *scene()))]
    assert Run.open(write_bag(tmp_path / "run.bag", messages)).world().related(TRAY_A, "skiros:contain", PRODUCT)


def test_bag_without_initial_scene_is_rejected(tmp_path: Path) -> None:
    monitor = Monitor()
    monitor("reset", *scene())  # before the recorder was there
    run = Run.open(write_bag(tmp_path / "run.bag", [("change", monitor("update", *moved()))]))
    with pytest.raises(BagError, match="does not begin with the whole scene"):
        run.world()
    assert PRODUCT in run.world(partial=True)


def test_invalid_property_is_named(tmp_path: Path) -> None:
    broken = element(PRODUCT, "Product A", Size=[1])
    broken.properties[0].dataValue = "[1"
    run = Run.open(write_bag(tmp_path / "run.bag", [("change", Monitor()("reset", broken))]))
    with pytest.raises(
        BagError, match=r"/wm/monitor at 0.000 s: the change cannot be read: property 'skiros:Size': '\[1' is not"
    ):
        run.changes()


def test_task_run_contains_states_of_each_node(tmp_path: Path) -> None:
    progress = [tree(RUNNING, IDLE, root=RUNNING, ended=False), tree(SUCCESS, SUCCESS)]
    (task,) = Run.open(write_bag(tmp_path / "run.bag", [("progress", nodes) for nodes in progress])).tasks()
    assert (task.robot, task.task_id, task.state) == ("/robot", 7, TaskState.SUCCEEDED)
    assert task.latest.message(0) == "Success"
    nodes = node_histories(task)
    assert {node.name: [s.state for s in node.reports] for node in nodes.values()} == {
        "root": [RUNNING, SUCCESS],
        "pick": [RUNNING, SUCCESS],
        "place": [IDLE, SUCCESS],
    }
    assert [node.depth for node in nodes.values()] == [0, 1, 1]


def test_reused_task_number_is_a_new_task(tmp_path: Path) -> None:
    progress = [tree(RUNNING, IDLE, root=RUNNING, ended=False), tree(SUCCESS, SUCCESS)] * 2
    run = Run.open(write_bag(tmp_path / "run.bag", [("progress", nodes) for nodes in progress]))
    assert [task.latest.has_ended for task in run.tasks()] == [True, True]


def test_skill_runs_have_start_and_end(tmp_path: Path) -> None:
    progress = [
        tree(RUNNING, IDLE, root=RUNNING, ended=False),
        tree(SUCCESS, RUNNING, root=RUNNING, ended=False),
        tree(SUCCESS, FAILURE, root=FAILURE),
    ]
    run = Run.open(write_bag(tmp_path / "run.bag", [("progress", nodes) for nodes in progress]))
    assert [(s.label, round(s.start / NS), round(s.end / NS), s.state) for s in run.skills()] == [
        ("pick", 0, 1, SUCCESS),
        ("place", 1, 2, FAILURE),
    ]


def test_repeated_skill_has_several_runs(tmp_path: Path) -> None:
    states = [RUNNING, FAILURE, RUNNING, SUCCESS]
    progress = [tree(state, IDLE, root=RUNNING, ended=False) for state in states]
    run = Run.open(write_bag(tmp_path / "run.bag", [("progress", nodes) for nodes in progress]))
    assert [(s.label, s.state) for s in run.skills()] == [("pick", FAILURE), ("pick", SUCCESS)]


def test_unfinished_skill_ends_with_the_last_message(tmp_path: Path) -> None:
    progress = [tree(RUNNING, IDLE, root=RUNNING, ended=False)] * 3
    run = Run.open(write_bag(tmp_path / "run.bag", [("progress", nodes) for nodes in progress]))
    (skill,) = run.skills()
    assert (skill.state, round(skill.end / NS)) == (RUNNING, 2)


def test_actions_and_goals_have_results(run: Run) -> None:
    (call,) = run.actions()
    assert (call.name, call.type, call.goal_id, call.status_name) == (
        "/tm/achieve", "skiros2_msgs/Achieve", "goal-1", "succeeded",
    )  # fmt: skip
    (goal,) = run.goals()
    assert (goal.goals, goal.state) == (GOAL, "succeeded")
    assert goal.end == call.end == call.result.time


def test_goal_without_result_is_unanswered(tmp_path: Path) -> None:
    (goal,) = Run.open(write_bag(tmp_path / "run.bag", [("goal", ("goal-1", GOAL))])).goals()
    assert (goal.state, goal.end, goal.call.status_name) == ("", None, "unanswered")


def test_missing_topics_are_reported(tmp_path: Path) -> None:
    run = Run.open(write_bag(tmp_path / "run.bag", [], without=("change", "progress")))
    with pytest.raises(
        BagError, match=r"run.bag: the bag holds no changes of the world model: .* skiros2_msgs/WmMonitor"
    ):
        run.world()
    with pytest.raises(BagError, match="no progress of tasks"):
        run.tasks()
    assert run.actions() == []


def test_documented_example_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = (ROOT / "docs" / "bags.md").read_text()
    (example,) = re.findall(r"^## In Python\n\n```python\n(.*?)^```$", text, re.M | re.S)
    (tmp_path / "run.bag").symlink_to(ROOT / "tests" / "bags" / "timed_pick_place.bag")
    monkeypatch.chdir(tmp_path)
    exec(example, {})
