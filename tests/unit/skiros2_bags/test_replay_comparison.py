"""What counts as the same in two runs, and how differences are told."""

from __future__ import annotations

from skiros2_bags.core.normal import NARROW, Tolerance, same_text
from skiros2_bags.testing.divergence import Divergence
from skiros2_bags.testing.recording import Events, Seen, Told
from skiros2_bags.testing.run_comparison import compare_runs


def test_measured_numbers_have_a_tolerance_and_names_none() -> None:
    loose = Tolerance(0.02, 0.02)
    assert same_text("at 1.00 m", "at 1.01 m", loose)
    assert same_text("50% done", "51% done", NARROW)
    assert not same_text("at 1.00 m", "at 1.10 m", loose)
    assert not same_text("Tray-12 is full", "Tray-13 is full", loose)
    assert not same_text("at 1.00 m", "near 1.00 m", loose)


def test_of_a_traceback_the_last_line_counts() -> None:
    trace = 'Traceback (most recent call last):\n  File "a.py", line {}, in f\nValueError: {}'
    assert same_text(trace.format(1, "no"), trace.format(7, "no"), NARROW)
    assert not same_text(trace.format(1, "no"), trace.format(1, "yes"), NARROW)
    before = "Work-work: ValueError: no (a.py, line {}, in f)\n"
    assert same_text(before.format(1) + trace.format(1, "no"), before.format(2) + trace.format(2, "no"), NARROW)


def run(processor: str, *ticks: str) -> Events:
    """A task with a root and two children below one node; of each tick the states of these four."""
    places = [(), (0,), (0, 0), (0, 1)]
    told = []
    for number, states in enumerate(ticks):
        code = {"S": 1, "F": -1}.get(states[0], 0)
        nodes = tuple(
            Seen(place, f":{name}", name, processor if place == (0,) else "", state, code if not place else 0, "", 0.0)
            for place, name, state in zip(places, ("root", "both", "left", "right"), states, strict=True)
        )
        told.append(Told(number, float(number), "/robot", 0, nodes))
    return Events(told)


def test_side_by_side_any_child_may_end_first_and_one_after_the_other_not() -> None:
    left_first, right_first = ("RRRR", "RRSR", "SSSS"), ("RRRR", "RRRS", "SSSS")
    assert compare_runs(run("|ff|", *left_first), run("|ff|", *right_first), NARROW, ["/robot"]) is None
    found = compare_runs(run("->", *left_first), run("->", *right_first), NARROW, ["/robot"])
    assert found is not None
    assert found.what == "root / both / left"
    assert "root / both / right succeeds" in found.got


def test_a_task_that_is_missing_is_told() -> None:
    found = compare_runs(run("->", "RRRR", "SSSS"), Events([]), NARROW, ["/robot"])
    assert found is not None
    assert found.got == "no such task"


def test_a_divergence_is_told_with_all_its_lines() -> None:
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
