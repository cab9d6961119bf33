"""Comparison of runs within a tolerance, and the text of a divergence."""

from __future__ import annotations

from skiros2_bags.core.tolerance import NARROW, Tolerance, same_text
from skiros2_bags.testing.divergence import Divergence
from skiros2_bags.testing.recording import Events, NodeProgress, TaskProgress
from skiros2_bags.testing.run_comparison import compare_runs


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


def run(processor: str, *ticks: str) -> Events:
    """A task with a root, one child and two grandchildren; one text with their four states per tick."""
    paths = [(), (0,), (0, 0), (0, 1)]
    progress = []
    for number, states in enumerate(ticks):
        code = {"S": 1, "F": -1}.get(states[0], 0)
        nodes = tuple(
            NodeProgress(p, f":{name}", name, processor if p == (0,) else "", state, 0 if p else code, "", 0.0)
            for p, name, state in zip(paths, ("root", "both", "left", "right"), states, strict=True)
        )
        progress.append(TaskProgress(number, float(number), "/robot", 0, nodes))
    return Events(progress)


def test_order_of_children_is_compared_in_sequences_only() -> None:
    left_first, right_first = ("RRRR", "RRSR", "SSSS"), ("RRRR", "RRRS", "SSSS")
    assert compare_runs(run("|ff|", *left_first), run("|ff|", *right_first), NARROW, ["/robot"]) is None
    found = compare_runs(run("->", *left_first), run("->", *right_first), NARROW, ["/robot"])
    assert found is not None
    assert found.what == "root / both / left"
    assert "root / both / right succeeds" in found.got


def test_missing_task_is_a_divergence() -> None:
    found = compare_runs(run("->", "RRRR", "SSSS"), Events([]), NARROW, ["/robot"])
    assert found is not None
    assert found.got == "no such task"


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
