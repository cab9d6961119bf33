"""The recorded ticks of a task."""

from __future__ import annotations

import random
from types import SimpleNamespace

import pytest

from skiros2_runs.core.frame import Frame
from skiros2_runs.core.message_log import MAX_LINES
from skiros2_runs.core.runs import RETURN_TIME, Runs
from skiros2_runs.core.task_run import MAX_PARAMS, TaskRun
from support.progress import FAILURE, IDLE, RUNNING, SUCCESS, ProgressNode, fresh, pick_and_place, random_tree


def seen(frame: Frame) -> list[tuple[int, int, int, str]]:
    places = range(len(frame.shape))
    return [(frame.shape.id(p), frame.state(p), frame.code(p), frame.message(p)) for p in places]


def test_every_tick_can_be_restored() -> None:
    """Also over changes of the tree's shape, and over those that are kept whole."""
    chance, run, told = random.Random(7), TaskRun("/robot", 5), []
    nodes = random_tree(12)
    for number in range(300):
        if number % 90 == 89:
            nodes.append(ProgressNode(5000 + number, nodes[chance.randrange(len(nodes))].id, "new"))
        for node in chance.sample(nodes, 3):
            node.state, node.progress_code = chance.choice([1, 2, 3, 4]), chance.randrange(2, 9)
            node.progress_message = chance.choice(["", f"at {number}"])
        if run.record(fresh(nodes), 1000.0 + number).is_new_tick:
            told.append((1000.0 + number, [(n.id, n.state, n.progress_code, n.progress_message) for n in nodes]))
    assert len(run) == len(told) > 250
    for tick in (0, 1, 62, 63, 64, 65, 88, 89, 90, len(told) - 1, *chance.sample(range(len(told)), 30)):
        frame = run.frame(tick)
        assert (frame.time, seen(frame)) == told[tick]
    with pytest.raises(IndexError, match="tick 999"):
        run.frame(999)


def test_unchanged_tick_is_not_stored() -> None:
    run = TaskRun("/robot", 5)
    for number in range(50):
        run.record(pick_and_place(), 1000.0 + number)
    assert len(run) == 1
    assert run.latest.time == 1049.0


@pytest.mark.parametrize(("age", "is_complete"), [(0.1, True), (4.0, True), (40.0, False)])
def test_first_message_may_be_late_if_its_manager_was_heard_before_the_task(age: float, is_complete: bool) -> None:
    runs = Runs()
    runs.record("/robot", pick_and_place(), 1000.0)
    nodes = [ProgressNode(6, -1, "task_6"), ProgressNode(7, 6, "pick")]
    nodes[0].task_id, nodes[0].progress_time = 6, age
    assert runs.record("/robot", nodes, 1010.0) is not None
    assert [run.is_complete for run in runs] == [True, is_complete]


def test_identical_node_objects_count_as_unchanged() -> None:
    """As `QuickTreeProgress` tells those of which nothing is new."""
    run, nodes = TaskRun("/robot", 5), pick_and_place()
    run.record(nodes, 1000.0)
    other = fresh(nodes)[4]
    other.state, other.progress_message = RUNNING, "placing"
    assert not run.record([*nodes[:4], other], 1001.0).is_new_shape
    assert [run.latest.state(place) for place in range(5)] == [RUNNING, RUNNING, RUNNING, IDLE, RUNNING]
    assert (run.latest.message(4), run.latest.duration(4), run.latest.duration(1)) == ("placing", 0.0, 1.0)
    assert run.frame(0).messages == {}
    assert run.record([*nodes[:4], ProgressNode(300, 5, "other")], 1002.0).is_new_shape


def test_durations_are_known_at_every_tick() -> None:
    run = TaskRun("/robot", 5)
    run.record(pick_and_place(IDLE), 1000.0)
    run.record(pick_and_place(RUNNING), 1001.0)
    run.record(pick_and_place(RUNNING, RUNNING), 1003.0)
    run.record(pick_and_place(SUCCESS, RUNNING), 1004.0)
    run.record(pick_and_place(SUCCESS, FAILURE), 1006.5)
    pick, place = run.latest.shape.index_by_id[100], run.latest.shape.index_by_id[200]
    assert (run.latest.duration(pick), run.latest.duration(place)) == (3.0, 3.5)
    assert [run.latest.durations()[p] for p in (pick, place)] == [3.0, 3.5]
    assert run.frame(2).duration(pick) == 2.0
    assert run.frame(0).duration(pick) is None
    assert run.latest.began(pick) == 1001.0


def test_duration_restarts_with_the_node() -> None:
    run = TaskRun("/robot", 5)
    for second, state in enumerate([RUNNING, SUCCESS, IDLE, RUNNING, RUNNING]):
        run.record(pick_and_place(state), 1000.0 + second)
    assert run.latest.duration(1) == 1.0


def test_first_message_uses_run_times_of_the_manager() -> None:
    nodes = pick_and_place()
    nodes[2].progress_time = 30.0
    nodes[1].progress_time = float("nan")
    run = TaskRun("/robot", 5)
    run.record(fresh(nodes), 1000.0)
    assert run.latest.duration(2) == 30.0
    assert run.latest.duration(1) == 0.0


def test_running_returns_leaf_nodes() -> None:
    run = TaskRun("/robot", 5)
    run.record(pick_and_place(), 1000.0)
    assert [run.latest.shape.name(p) for p in run.latest.running()] == ["move_arm"]


def test_reused_id_is_a_new_run() -> None:
    runs = Runs()
    runs.record("/robot", pick_and_place(), 1.0)
    runs.record("/robot", pick_and_place(SUCCESS, SUCCESS, state=SUCCESS, code=1), 2.0)
    runs.record("/robot", pick_and_place(SUCCESS, SUCCESS, state=SUCCESS, code=1), 3.0)  # told again at the end
    runs.record("/robot", pick_and_place(), 4.0)
    runs.record("/other", pick_and_place(), 5.0)
    assert [(run.robot, run.start) for run in runs] == [("/robot", 1.0), ("/robot", 4.0), ("/other", 5.0)]
    assert runs.record("/robot", [], 6.0) is None


def test_restarted_manager_gets_new_runs() -> None:
    runs = Runs()
    runs.record("/robot", pick_and_place(), 1.0)
    runs.record("/other", pick_and_place(), 1.0)
    runs.mark_lost("/robot")
    assert [run.is_lost for run in runs] == [True, False]
    runs.record("/robot", pick_and_place(), 2.0)  # the same skill again, with the same number
    assert [(run.start, run.is_lost) for run in runs] == [(1.0, True), (1.0, False), (2.0, False)]
    runs.clear_ended()
    assert [run.start for run in runs] == [1.0, 2.0]


def test_oldest_ticks_are_dropped_and_counted() -> None:
    runs, nodes = Runs(most_bytes=200_000), random_tree(50)
    for number in range(2000):
        for node in nodes[1:20]:
            node.progress_code += 1
        recorded = runs.record("/robot", fresh(nodes), 1000.0 + number)
    assert recorded is not None
    run = recorded.run
    assert run.size <= 200_000
    assert run.dropped > 0 and run.dropped + len(run) == 2000
    assert run.frame(0).code(1) == run.dropped + 1
    assert run.tick_at(0.0) == 0 and run.tick_at(9e9) == len(run) - 1


def test_oldest_ended_tasks_are_evicted() -> None:
    runs = Runs(most_tasks=3)
    for number in range(6):
        runs.record("/robot", pick_and_place(task_id=number, state=SUCCESS, code=1), float(number))
    assert [run.task_id for run in runs] == [2, 3, 4, 5]


@pytest.mark.parametrize("may_return", [True, False])
def test_lost_tasks_are_evicted_as_ended_ones_but_not_while_they_may_return(may_return: bool) -> None:
    runs = Runs(most_tasks=2)
    for number in range(6):
        runs.record("/robot", pick_and_place(task_id=number), float(number))
        runs.mark_lost("/robot", may_return=may_return)
    assert len(runs) == 6
    late = RETURN_TIME + 4.5
    for number in range(6, 9):
        runs.record("/other", pick_and_place(task_id=number), late)
    assert [run.task_id for run in runs] == [3, 4, 5, 6, 7, 8]
    assert [run.is_lost for run in runs] == [True] * 3 + [False] * 3
    returned = pick_and_place(task_id=5)
    returned[0].progress_time = late
    recorded = runs.record("/robot", returned, late)
    assert recorded is not None and recorded.run.start == 5.0 and not recorded.run.is_lost


def test_message_log_is_limited_to_one_line_per_second() -> None:
    run, nodes = TaskRun("/robot", 5), pick_and_place()
    for number in range(50):
        nodes[2].progress_message = f"{number} mm"
        run.record(fresh(nodes), 1000.0 + number * 0.04)
    nodes[2].state, nodes[2].progress_message = FAILURE, "it slipped"
    run.record(fresh(nodes), 1002.0)
    of_arm = [(line.state, line.message) for line in run.log.lines if line.name == "move_arm"]
    assert of_arm == [(RUNNING, "0 mm"), (RUNNING, "25 mm"), (FAILURE, "it slipped")]
    assert [line.name for line in run.log.lines if line.message == ""] == ["task 5", "pick"]


def test_message_log_is_bounded() -> None:
    run, nodes = TaskRun("/robot", 5), pick_and_place()
    for number in range(MAX_LINES):
        nodes[2].state, nodes[2].progress_message = (FAILURE, "x" * 5000) if number % 2 else (RUNNING, "")
        run.record(fresh(nodes), 1000.0 + number)
    assert len(run.log) == MAX_LINES
    assert run.log.dropped == run.log.count - MAX_LINES
    assert max(len(line.message) for line in run.log.lines) == 500


def test_parameters_of_nodes_are_bounded() -> None:
    run, nodes = TaskRun("/robot", 5), pick_and_place()
    for number in range(1000):
        nodes[2].params = [SimpleNamespace(param=f"{number}")]
        run.record(fresh(nodes), 1000.0 + number)
    known = run.params[nodes[2].id]
    assert [texts for _, texts in known] == [("0",), *((f"{n}",) for n in range(1000 - MAX_PARAMS, 1000))]
