"""The presenter of goals: completion, diagnostics, planning, execution."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from skiros2_common.core.world_element import Element
from skiros2_gui.app.events import GoalFeedback
from skiros2_gui.app.window import Window
from skiros2_gui.goal.plan import GoalExecution
from skiros2_gui.goal.presenter import GoalPresenter
from skiros2_task.core import goal_text
from skiros2_task.core.engines import EngineProcesses, Limits
from skiros2_task.core.goal_checker import check_syntax
from skiros2_task.core.goal_completion import Completion, GoalVocabulary, complete
from skiros2_task.core.planners import planner_named
from skiros2_task.core.planning import TaskPlanner, report_of
from skiros2_task.core.preview import preview
from skiros2_world_model.core.preview_copy import PreviewCopy
from support.fuzz import examples
from support.planning_world import DRIVE, PlanningWorld
from support.window.local_system import LocalSystem
from support.window.synchronous import SynchronousJobs, make_window


@dataclass
class Feedback:
    phase: str = "running"
    message: str = ""
    plan: str = ""
    steps: str = ""


@dataclass
class Result:
    state: str = "succeeded"
    message: str = ""
    done: str = ""
    explanations: str = ""


def _step(number: int, **more: Any) -> dict[str, Any]:
    planned = {"number": number, "skill": "skiros:Drive", "label": "drive", "robot": "/alpha", "start": 0.0, "end": 2.0}
    return {**planned, "after": [], "arguments": {"To": "skiros:Nowhere-3", "Robot": "cora:Robot-1"}, **more}


class TaskManager:
    """Plans, and sends the given feedback and result of an execution."""

    def __init__(self, planner: TaskPlanner) -> None:
        self.planner = planner
        self.feedback: list[Any] = []
        self.result: Any = Result()
        self.cancelled = 0

    def achieve(self, goals: str, on_feedback: Callable[[Any], None], quality: str = "", seconds: float = 0.0) -> Any:
        for feedback in self.feedback:
            on_feedback(feedback)
        if isinstance(self.result, Exception):
            raise self.result
        return self.result

    def plan(self, goals: str) -> Any:
        report = report_of(self.planner.plan(goals), lambda plan: preview(PreviewCopy(self.planner.wm), plan))
        return SimpleNamespace(**report)

    def cancel(self) -> None:
        self.cancelled += 1


@dataclass
class Lab:
    window: Window
    goals: GoalPresenter
    tasks: TaskManager
    ids: dict[str, str]


@pytest.fixture
def lab() -> Iterator[Lab]:
    world = PlanningWorld()
    robot = world.robot("alpha", DRIVE)
    ids = {name: world.thing("skiros:Location", name) for name in ("dock", "bench 1", "shelf")}
    world.relate(robot, "skiros:at", ids["dock"])
    window = make_window(lambda event_queue: LocalSystem(event_queue, world.wm))
    system: Any = window.system
    processes = EngineProcesses()
    tasks = TaskManager(TaskPlanner(world.wm, planner_named(processes), Limits()))
    system.planner = tasks
    goals = GoalPresenter(window)
    goals.refresh()
    yield Lab(window, goals, tasks, {"alpha": robot, **ids})
    processes.close()


def _suggested(lab: Lab, text: str) -> list[str]:
    lab.goals.write(text)
    return [word.text for word in lab.goals.completions(len(text)).items]


# -- completion ----------------------------------------------------------------------------------------------------


def test_effects_of_skills_are_completed_first(lab: Lab) -> None:
    assert _suggested(lab, "(")[0] == "skiros:at"
    assert _suggested(lab, "(not (")[0] == "skiros:at"


def test_completion_matches_local_name_in_any_case(lab: Lab) -> None:
    assert "skiros:contain" in _suggested(lab, "(CONT")
    assert lab.goals.completions(5).start == 1


def test_elements_are_completed_by_label_and_inserted_as_ids(lab: Lab) -> None:
    assert _suggested(lab, "(skiros:at alpha ben") == [lab.ids["bench 1"]]
    assert lab.goals.completions(20).items[0].label == "bench 1"


def test_quantifier_completes_variables_and_classes(lab: Lab) -> None:
    assert _suggested(lab, "(forall (") == ["?x"]
    assert _suggested(lab, "(forall (?x ") == ["-"]
    assert "skiros:Location" in _suggested(lab, "(forall (?x - Loc")
    assert _suggested(lab, "(forall (?x - skiros:Location) (skiros:at ")[0] == "?x"


def test_operators_of_other_packages_are_completed(lab: Lab, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(goal_text, "_operators", {"unless": lambda parts: parts[0]})
    assert _suggested(lab, "(unl") == ["unless"]
    assert _suggested(lab, "(unless ") == ["("]


def test_elements_that_skills_can_change_come_first(lab: Lab) -> None:
    tool = Element("sumo:Object", "a tool")
    tool.addRelation("skiros:Scene-0", "skiros:contain", "-1")
    lab.window.system.world.add_element(tool)
    goals = GoalPresenter(lab.window)
    goals.refresh()
    elements = goals.vocabulary.elements
    reachable = {element.text for element in elements if element.rank == 0}
    assert reachable == set(lab.ids.values())
    assert {element.text for element in elements[: len(reachable)]} == reachable
    assert tool.id in {element.text for element in elements}


def test_unknown_text_has_no_completions(lab: Lab) -> None:
    assert _suggested(lab, "(skiros:at zzzzzz") == []
    assert _suggested(lab, ")))") == ["("]
    assert lab.goals.completions(9_999).items


_PIECES = st.sampled_from(["(", ")", "forall", "=", "?x", "-", " ", "\n", '"', ";", ",", "a:b", "and", "é"])


@given(st.lists(_PIECES, max_size=12).map("".join), st.integers(-3, 40))
@settings(max_examples=examples(40))
def test_completion_and_syntax_check_accept_any_text(text: str, cursor: int) -> None:
    word = Completion("skiros:at", "at", "relation")
    found = complete(text, max(cursor, 0), GoalVocabulary((word,), (word,), (word,), (word,), (word,)))
    assert 0 <= found.start <= len(text)
    mistake = check_syntax(text)
    assert mistake is None or 0 <= mistake.position(text) <= len(text)


# -- mistakes ------------------------------------------------------------------------------------------------------


def test_syntax_error_has_line_and_column(lab: Lab) -> None:
    lab.goals.write("(skiros:at alpha\n  (x))")
    mistake = lab.goals.diagnostic
    assert mistake is not None
    assert (mistake.line, mistake.column) == (2, 3)
    assert lab.goals.text[mistake.position(lab.goals.text) :] == "(x))"
    assert not lab.goals.can_plan


def test_goal_of_a_megabyte_is_refused_at_once(lab: Lab) -> None:
    lab.goals.write("(a b)\n" * 150_000)
    mistake = lab.goals.diagnostic
    assert mistake is not None
    assert mistake.reason == "expected at most 20000 characters, got 900000"
    assert lab.goals.lines is None and not lab.goals.can_plan


def test_unknown_name_is_reported(lab: Lab) -> None:
    lab.goals.write("(skiros:at alpha shlef)")
    assert lab.goals.diagnostic is not None
    assert "shelf" in lab.goals.diagnostic.reason
    lab.goals.write("(skiros:at alpha shelf)")
    assert lab.goals.diagnostic is None
    assert lab.goals.can_plan


@pytest.mark.parametrize(
    ("goal", "reason"),
    [
        ("(= (skiros:Missing alpha) my_robot)", "Missing: expected = with true or false, got = my_robot"),
        ("(= (skiros:Weight alpha) -2)", "Weight: expected at least 0 kg, got -2"),
        ("(cora:robotPart shelf alpha)", "shelf: the subject of cora:robotPart is a sumo:Device"),
    ],
)
def test_goal_that_the_ontologies_exclude_is_refused(lab: Lab, goal: str, reason: str) -> None:
    lab.goals.write(goal)
    assert lab.goals.diagnostic is not None
    assert lab.goals.diagnostic.reason.startswith(reason)
    lab.goals.make_plan()
    assert not lab.goals.can_plan and lab.goals.plan is None


def test_empty_goal_has_no_diagnostic(lab: Lab) -> None:
    lab.goals.write("(")
    lab.goals.write(" ")
    assert (lab.goals.diagnostic, lab.goals.can_plan) == (None, False)
    assert check_syntax("(a b)") is None


# -- planning ------------------------------------------------------------------------------------------------------


def test_plan_has_steps_changes_and_reasons(lab: Lab) -> None:
    lab.goals.write(f"(skiros:at alpha {lab.ids['shelf']})")
    lab.goals.make_plan()
    plan = lab.goals.plan
    assert plan is not None
    assert (plan.state, plan.works, [row.skill for row in plan.rows]) == ("planned", True, ["drive"])
    assert plan.changes == (
        "1. drive of alpha",
        "     alpha is no longer at dock",
        "     alpha is at shelf",
        "The goal holds at the end.",
    )
    assert plan.why[:2] == ("1. drive of alpha", "     so that alpha is at shelf, for the goal")
    assert lab.goals.history == [lab.goals.text]
    lab.goals.write("(skiros:at alpha dock)")
    lab.goals.make_plan()
    assert lab.goals.plan is not None
    assert (lab.goals.plan.state, lab.goals.plan.head) == ("nothing_to_do", "the goal holds already")
    lab.goals.write("(skiros:contain dock shelf)")
    lab.goals.make_plan()
    assert lab.goals.plan is not None
    assert lab.goals.plan.state == "impossible"
    assert lab.goals.plan.rows == ()


def test_goal_is_not_planned_without_task_manager(lab: Lab) -> None:
    system: Any = lab.window.system
    system.planner = None
    lab.goals.write("(skiros:at alpha shelf)")
    assert not lab.goals.can_plan
    lab.goals.make_plan()
    assert (lab.goals.plan, lab.goals.is_busy) == (None, False)


# -- achieving -----------------------------------------------------------------------------------------------------


def test_goal_execution_follows_feedback_to_result(lab: Lab) -> None:
    plan = json.dumps([_step(1), _step(2, after=[1])])
    states = [{"number": 1, "state": "succeeded", "message": ""}, {"number": 2, "state": "running", "message": "on"}]
    lab.tasks.feedback = [Feedback("planning", "planning"), Feedback("running", "", plan, json.dumps(states))]
    jobs: Any = lab.window.jobs
    assert isinstance(jobs, SynchronousJobs)
    lab.goals.write("(skiros:at alpha shelf)")
    jobs.deferred = True
    lab.goals.achieve()
    assert (lab.goals.is_busy, lab.goals.can_plan) == (True, False)
    execution = lab.goals.execution
    assert execution is not None
    for feedback in lab.tasks.feedback:
        lab.window.publish(GoalFeedback(execution.goal, feedback))
    assert lab.goals.execution is not None
    assert [(row.skill, row.state, row.parameters) for row in lab.goals.execution.rows] == [
        ("drive", "succeeded", "To: Nowhere-3"),
        ("drive", "running", "To: Nowhere-3"),
    ]
    assert lab.goals.execution.progress_text == "1 of 2 steps are done; now step 2 drive of alpha"
    lab.goals.cancel()
    lab.tasks.result = Result(done=json.dumps([{**_step(1), **states[0]}, {**_step(2), "state": "succeeded"}]))
    jobs.release()
    lab.window.process_events()
    execution = lab.goals.execution
    assert (execution.is_finished, execution.reached, execution.text) == (True, True, "The goal is reached.")
    assert [row.state for row in execution.rows] == ["succeeded", "succeeded"]
    assert (lab.tasks.cancelled, lab.goals.is_busy) == (1, False)


def test_goal_that_is_not_reached_has_reason(lab: Lab) -> None:
    lab.tasks.result = Result("impossible", "there is no plan\n  (skiros:at a b) cannot be reached")
    lab.goals.write("(skiros:at alpha shelf)")
    lab.goals.achieve()
    execution = lab.goals.execution
    assert execution is not None
    assert (execution.reached, execution.text) == (False, "there is no plan")
    assert execution.why == ("  (skiros:at a b) cannot be reached",)


@pytest.mark.parametrize("nonsense", [Feedback(plan="{"), Feedback(plan='[{"number": "x"}]'), Feedback(steps="[3]")])
def test_unreadable_feedback_is_reported(lab: Lab, nonsense: Feedback) -> None:
    lab.goals.execution = GoalExecution("goal")
    lab.window.publish(GoalFeedback("goal", nonsense))
    assert "cannot be read" in lab.window.problems.history[0].text


def test_timeout_of_task_manager_is_reported(lab: Lab) -> None:
    lab.tasks.result = TimeoutError("no status for 5 s")
    lab.goals.write("(skiros:at alpha shelf)")
    lab.goals.achieve()
    assert lab.goals.execution is not None
    assert "no status for 5 s" in lab.goals.execution.text
    assert not lab.goals.is_busy
    assert lab.window.problems.history


def test_restore_skips_invalid_goals(lab: Lab) -> None:
    lab.goals.restore({"goal": "(skiros:at alpha dock)", "goals": [3, "", "(a b)"]})
    assert lab.goals.settings() == {"goal": "(skiros:at alpha dock)", "goals": ["(a b)"]}
