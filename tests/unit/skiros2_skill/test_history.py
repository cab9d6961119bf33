"""The history of a manager's tasks."""

import pytest

from skiros2_common.core.abstract_skill import State
from skiros2_common.core.errors import UnknownName
from skiros2_common.core.explanation import EXECUTE
from skiros2_skill.core.runtime.history import REFUSED, History, Record, one_line
from unit.skiros2_skill.skills import Work, primitive


@pytest.fixture
def history():
    return History()


def ended(bench, task_id, execute=State.Success):
    """An ended task with that id."""
    bench.load(primitive(Work, f"work {task_id}", execute=execute))
    task = bench.task(bench.node(f"work {task_id}"))
    task.id = task_id
    return task.run(1)


def refused(message):
    return Record(REFUSED, "tests", State.Idle, -1, message)


def test_record_of_failed_task_has_code_message_and_explanations(bench, history):
    record = history.end(ended(bench, 3, lambda s: s.fail("no grip", 7)))
    assert (record.state, record.code, record.preempted) == (State.Failure, -7, False)
    assert record.message == "skiros:Work-work 3(Failure): no grip"
    assert [(e.stage, e.code, e.message) for e in record.explanations] == [(EXECUTE, -7, "no grip")]
    assert history.get(3) is record
    assert str(record).splitlines()[0] == "work 3 failed: no grip."


def test_record_of_succeeded_task_has_code_1(bench, history):
    record = history.end(ended(bench, 3))
    assert (record.state, record.code, record.message, record.explanations) == (State.Success, 1, "End", [])
    assert str(record).endswith("has succeeded: End")


def test_record_of_preempted_task_is_marked_preempted(bench, history):
    bench.load(primitive(Work, "work", execute=State.Running))
    task = bench.task(bench.node("work"))
    task.tick()
    task.preempt()
    record = history.end(task.run())
    assert (record.code, record.message, record.preempted) == (-1, "Preempted", True)


def test_record_of_running_task_is_current(bench, history):
    bench.load(primitive(Work, "work", execute=State.Running))
    task = bench.task(bench.node("work"))
    history.begin(task)
    task.tick()
    assert history.get(task.id).state is State.Running
    assert str(history.get(task.id)).endswith("runs: nothing has failed")
    task.preempt()
    task.run()
    assert history.get(task.id).preempted, "also between its end and the call of `end`"


def test_minus_1_finds_last_failed_or_refused_task(bench, history):
    with pytest.raises(UnknownName, match="no task has failed or was refused"):
        history.get(-1)
    failed = history.end(ended(bench, 1, lambda s: s.fail("no grip", 7)))
    history.end(ended(bench, 2))
    assert history.get(-1) is failed
    history.refuse(refused("no such skill"))
    history.end(ended(bench, 3))
    assert history.get(-1).message == "no such skill"
    assert str(history.get(-1)) == "a task by tests was refused: no such skill"


def test_last_task_with_reused_id_is_returned(bench, history):
    history.end(ended(bench, 1, lambda s: s.fail("no grip", 7)))
    bench.load(primitive(Work, "another", execute=State.Success))
    again = bench.task(bench.node("another"))
    again.id = 1
    history.end(again.run())
    assert history.get(1).state is State.Success


def test_only_last_records_are_kept(bench):
    history = History(size=2)
    for task_id in range(3):
        history.end(ended(bench, task_id))
    assert [history.get(task_id).task_id for task_id in (1, 2)] == [1, 2]
    with pytest.raises(UnknownName, match="task 0 neither runs nor is it among the last 2 that have ended"):
        history.get(0)


def test_one_line_returns_first_line_that_is_not_blank():
    raised = "ValueError: broken (skills.py, line 3, in execute)\nTraceback (most recent call last):\n  File ...\n"
    assert one_line(raised) == "ValueError: broken (skills.py, line 3, in execute)"
    assert one_line("plain") == "plain"
    assert one_line(" \n") == ""
