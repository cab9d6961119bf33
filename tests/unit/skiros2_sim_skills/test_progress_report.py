"""The report of a goal: plans, reasons for new plans, step states."""

import io
import json
from types import SimpleNamespace
from typing import Any

import pytest

from skiros2_demo.progress_report import ProgressReport
from support.recorded_run import FAILURE, PLAN, PRODUCT, RUNNING, TRAY_B, tree
from support.terminal import Terminal

NAMES = {PRODUCT: "Product A", TRAY_B: "Tray B"}
AGAIN = json.dumps([{**step, "number": step["number"] + 2} for step in json.loads(PLAN)])


def feedback(phase: str, message: str = "", plan: str = "", *states: str) -> Any:
    steps = [{"number": step["number"], "state": s} for step, s in zip(json.loads(plan or "[]"), states, strict=False)]
    return SimpleNamespace(phase=phase, message=message, plan=plan, steps=json.dumps(steps), PLANNING="planning")


@pytest.fixture(autouse=True)
def _xterm(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TERM", "xterm")


@pytest.fixture
def out() -> io.StringIO:
    return io.StringIO()


@pytest.fixture
def report(out: io.StringIO) -> ProgressReport:
    return ProgressReport(out, lambda thing: NAMES.get(thing, thing))


def test_plan_is_printed_once(report: ProgressReport, out: io.StringIO) -> None:
    report.feedback(feedback("planning"))
    for states in (("waiting", "waiting"), ("running", "waiting")):
        report.feedback(feedback("running", "a plan of 2 steps", PLAN, *states))
    assert out.getvalue().count("1. pick     Object: Product A") == 1
    assert "New plan" not in out.getvalue()
    assert report.reasons == []


def test_feedback_returns_step_states(report: ProgressReport) -> None:
    steps = report.feedback(feedback("running", "", PLAN, "running"))
    assert [(step["label"], step["state"]) for step in steps] == [("pick", "running"), ("place", "waiting")]


def test_new_plan_is_printed_with_its_reason(report: ProgressReport, out: io.StringIO) -> None:
    report.feedback(feedback("running", "", PLAN))
    report.feedback(feedback("planning", "the world has become such that the plan does not lead to the goal", PLAN))
    report.feedback(feedback("running", "a plan of 2 steps", AGAIN))
    assert report.reasons == ["the world has become such that the plan does not lead to the goal"]
    assert "\nNew plan: the world has become such" in out.getvalue()
    assert out.getvalue().count("1. pick") == 2


def test_reason_has_names_instead_of_ids(report: ProgressReport) -> None:
    report.feedback(feedback("running", "", PLAN, "running"))
    failed = feedback("planning", "step 1 (much text) has failed", PLAN, "failed")
    message = f"skiros:Pick-pick(Failure): {TRAY_B}-Tray B holds no {PRODUCT}"
    failed.steps = json.dumps([{"number": 1, "state": "failed", "message": message}])
    report.feedback(failed)
    report.feedback(feedback("running", "a plan of 2 steps", AGAIN))
    assert report.reasons == ["Tray B holds no Product A"]


def test_terminal_texts_wait_for_the_tree() -> None:
    out = Terminal()
    report = ProgressReport(out, str)
    report.tree(tree("pick", RUNNING, ended=False))
    report.say("  ! a hand comes")
    assert report.runs
    assert "a hand comes" not in out.getvalue()
    report.tree(tree("pick", FAILURE))
    assert not report.runs
    shown = out.getvalue()
    assert shown.index("failed") < shown.index("  ! a hand comes")


def test_waiting_texts_are_printed_at_the_end() -> None:
    out = Terminal()
    report = ProgressReport(out, str)
    report.tree(tree("pick", RUNNING, ended=False))
    report.say("  ! a hand comes")
    report.end()
    assert "  ! a hand comes" in out.getvalue()
