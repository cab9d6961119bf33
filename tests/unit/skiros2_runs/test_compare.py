"""Comparison of runs within a tolerance, and the text of a divergence."""

from __future__ import annotations

from skiros2_runs.core.compare import Divergence, compare_task_runs
from skiros2_runs.core.task_run import TaskRun
from skiros2_runs.core.tolerance import NARROW, Tolerance, same_text
from support.progress import FAILURE, IDLE, RUNNING, SUCCESS, ProgressNode, root


def test_tolerance_applies_to_measured_numbers_only() -> None:
    loose = Tolerance(0.02, 0.02)
    assert same_text("at 1.00 m", "at 1.01 m", loose)
    assert same_text("50% done", "51% done", NARROW)
    assert not same_text("at 1.00 m", "at 1.10 m", loose)
    assert not same_text("Tray-12 is full", "Tray-13 is full", loose)
    assert not same_text("at 1.00 m", "near 1.00 m", loose)


def test_tracebacks_are_compared_by_their_last_line() -> None:
    trace = 'Traceback (most recent call last):\n  File "a.py", line {}, in f\nValueError: {}'
    assert same_text(trace.format(1, "no"), trace.format(7, "no"), NARROW)
    assert not same_text(trace.format(1, "no"), trace.format(1, "yes"), NARROW)
    before = "Work-work: ValueError: no (a.py, line {}, in f)\n"
    assert same_text(before.format(1) + trace.format(1, "no"), before.format(2) + trace.format(2, "no"), NARROW)


def run(processor: str, *ticks: str) -> TaskRun:
    """A task with a root, one child and two grandchildren; one text with the initials of their states per tick."""
    task = TaskRun("/robot", 5)
    initials = {"S": SUCCESS, "F": FAILURE, "R": RUNNING, ".": IDLE}
    for number, states in enumerate(ticks):
        of_root, both, left, right = (initials[state] for state in states)
        code = {SUCCESS: 1, FAILURE: -1}.get(of_root, 0)
        nodes = [
            root(state=of_root, code=code),
            ProgressNode(1, 5, "both", processor=processor, state=both),
            ProgressNode(2, 1, "left", state=left),
            ProgressNode(3, 1, "right", state=right),
        ]
        task.record(nodes, float(number))
    return task


def test_order_of_children_is_compared_in_sequences_only() -> None:
    left_first, right_first = ("RRRR", "RRSR", "SSSS"), ("RRRR", "RRRS", "SSSS")
    assert compare_task_runs(run("|ff|", *left_first), run("|ff|", *right_first), NARROW) is None
    found = compare_task_runs(run("->", *left_first), run("->", *right_first), NARROW)
    assert found is not None
    assert found.what == "root / both / left"
    assert "root / both / right: succeeded" in found.got


def test_ticks_in_which_nodes_run_are_not_compared() -> None:
    assert compare_task_runs(run("->", "RR..", "RRR.", "RRSR", "SSSS"), run("->", "RRSR", "SSSS"), NARROW) is None


def test_different_end_is_a_divergence_with_its_time() -> None:
    found = compare_task_runs(run("->", "RRR.", "RRSR", "SSSS"), run("->", "RRR.", "FFF."), NARROW)
    assert found is not None
    assert (found.what, found.expected, found.got, found.time) == ("root / both / left", "succeeded", "failed", 1.0)


def test_messages_of_successes_are_compared_on_request() -> None:
    tasks = [TaskRun("/robot", 5), TaskRun("/robot", 5)]
    for task, message in zip(tasks, ("at 1.00 m", "at 1.10 m"), strict=True):
        nodes = [root(state=SUCCESS, code=1), ProgressNode(1, 5, "drive", state=SUCCESS, progress_message=message)]
        task.record(nodes, 0.0)
    assert compare_task_runs(*tasks, NARROW) is None
    found = compare_task_runs(*tasks, NARROW, compares_successes=True)
    assert found is not None and found.got == "succeeded: at 1.10 m"


def test_missing_end_is_a_divergence() -> None:
    found = compare_task_runs(run("->", "RRR.", "SSSS"), run("->", "RRR.", "RRRR"), NARROW)
    assert found is not None
    assert (found.expected, found.got) == ("succeeded", "running")


def test_divergence_prints_context_and_all_lines() -> None:
    text = str(Divergence("1.0 s, tick 2", "root / pick", "success", "failure\nbecause", ("tick 1: runs",)))
    assert text.splitlines() == [
        "first divergence: 1.0 s, tick 2",
        "  root / pick",
        "  expected: success",
        "  got     : failure",
        "              because",
        "  before that:",
        "    tick 1: runs",
    ]
