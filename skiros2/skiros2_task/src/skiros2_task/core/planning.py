"""Plans for goals: reads the goal, compiles the task, runs a planner, validates and schedules the plan."""

from __future__ import annotations

import json
import logging
import shlex
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from typing import Any

from skiros2_common.core.errors import SkirosError, WrongValue
from skiros2_common.core.manager_names import same_node
from skiros2_common.core.world_model_port import WorldModelPort
from skiros2_skill.core.engine.devices import DEVICE_HOLDER
from skiros2_task.core.actions import condition_predicates, make_actions
from skiros2_task.core.compiler import make_task, note_of_empty_class
from skiros2_task.core.engines import LOG_FILE, PLAN_FILE, FoundPlan, Limits, Outcome, PlannerAnswer
from skiros2_task.core.explain_no_plan import NoPlan, explain_no_plan
from skiros2_task.core.explain_plan import explain_plan
from skiros2_task.core.formula import FALSE, Formula
from skiros2_task.core.given_plan import GivenPlan, plan_data
from skiros2_task.core.goal_reader import GoalReader
from skiros2_task.core.plan import Plan, SkillCall, make_plan
from skiros2_task.core.planners import EnginePlanner, Planner
from skiros2_task.core.preview import Preview
from skiros2_task.core.reachability import Deadline
from skiros2_task.core.skills import Robot, RunningManagers, assume_values, no_managers
from skiros2_task.core.store import Archive, Durations
from skiros2_task.core.task import PlanningTask
from skiros2_task.core.unusable_skills import unusable_skills
from skiros2_task.core.world import WorldView, WorldViews

log = logging.getLogger(__name__)


class Verdict(Enum):
    """The outcome of planning or achieving a goal."""

    PLANNED = "planned"
    NOTHING_TO_DO = "nothing to do"
    IMPOSSIBLE = "impossible"
    TIMED_OUT = "timed out"
    CANCELLED = "cancelled"
    FAILED = "failed"

    @property
    def state(self) -> str:
        """The verdict in results of actions, with `_` for spaces."""
        return self.value.replace(" ", "_")


#: Timeout of the explanation why there is no plan (s).
_EXPLANATION_TIMEOUT = 5.0

NO_ROBOT = "no robot in the world model offers skills"

_VERDICTS = {
    Outcome.SOLVED: Verdict.PLANNED,
    Outcome.IMPOSSIBLE: Verdict.IMPOSSIBLE,
    Outcome.TIMED_OUT: Verdict.TIMED_OUT,
    Outcome.CANCELLED: Verdict.CANCELLED,
    Outcome.FAILED: Verdict.FAILED,
}


@dataclass(frozen=True)
class PlanningResult:
    """The result of planning.

    :param message: for the client.
    :param notes: messages about skills and elements that were left out.
    :param task: the planning task; None if the goal could not be read.
    :param why: the explanation, if there is no plan.
    :param managers: of the robots whose skills the world model had.
    """

    verdict: Verdict
    message: str = ""
    notes: tuple[str, ...] = ()
    task: PlanningTask | None = None
    plan: Plan | None = None
    why: NoPlan | None = None
    managers: frozenset[str] = frozenset()

    @property
    def missing(self) -> tuple[str, ...]:
        """Parameters as SKILL.PARAMETER: with values for them there would be a plan."""
        return tuple(self.why.missing_values) if self.why is not None else ()

    @property
    def warning(self) -> str:
        """The warning for clients that run the plan; "" for none."""
        if self.plan is None or not self.plan.missing:
            return ""
        return f"warning: the plan lacks values, to be specified when its skills start: {', '.join(self.plan.missing)}"

    @property
    def calls(self) -> tuple[SkillCall, ...]:
        """The skills to run, in order."""
        return self.plan.calls if self.plan is not None else ()


def report_of(result: PlanningResult, simulate: Callable[[Plan], Preview]) -> dict[str, Any]:
    """Returns a planning result as the fields of the action `MakePlan`'s result.

    :param simulate: simulates a plan on a copy of the scene.
    """
    plan = result.plan
    return {
        "state": result.verdict.state,
        "message": plan.summary if plan else result.message,
        "plan": json.dumps(plan_data(plan) if plan else []),
        "makespan": plan.makespan if plan else 0.0,
        "why": explain_plan(plan).to_json() if plan else result.why.to_json() if result.why else "",
        "preview": simulate(plan).to_json() if plan else "",
        "notes": result.notes,
    }


class TaskPlanner:
    """Plans for goals with the scene and the skills of a world model. Thread-safe."""

    def __init__(
        self,
        wm: WorldModelPort,
        planner: Planner,
        limits: Limits,
        archive: Archive | None = None,
        durations: Durations | None = None,
        running: RunningManagers = no_managers,
    ) -> None:
        """
        :param archive: stores the files of each request.
        :param durations: of the skills, for schedules.
        :param running: only robots that a running manager has registered take steps.
        """
        #: The world model.
        self.wm = wm
        self._planner = planner
        self._limits = limits
        self._archive = archive
        self._durations = durations or Durations()
        self._views = WorldViews(wm, running)

    def plan(
        self,
        goal: str,
        cancelled: threading.Event | None = None,
        progress: Callable[[str], None] | None = None,
        asked_by: str = "",
        limits: Limits | None = None,
        planner: Planner | GivenPlan | None = None,
        adapt: Callable[[PlanningTask], PlanningTask] | None = None,
        assume: bool = False,
        leave_open: bool = False,
    ) -> PlanningResult:
        """Returns the plan for a goal, or why there is none. Blocks until the limits are reached at most.

        If it is impossible only because parameters have no values, their names are in `missing`.

        :param goal: its text, see `skiros2_task.core.goal_reader`.
        :param progress: called with progress messages.
        :param asked_by: the node name of the client, with or without slash. The plan for a skill manager is for its
            robot only.
        :param limits, planner: override those of the constructor. A given plan is returned as it is, or the reason why
            it does not work.
        :param adapt: changes the task before planning.
        :param assume: whether parameters without a value are assumed to have one; see `Plan.missing`.
        :param leave_open: the same, if there is no plan otherwise; the message then warns that the client has to
            specify the values.
        :raises WmException: the world model does not answer.
        """
        report = progress or log.info
        report("reading the world model")
        try:
            self.wm.catch_up()  # a skill may have changed it just before its end
        except SkirosError as error:
            log.warning("planning with the last known state of the world model: %s", error)
        world = self._view(asked_by)
        robots = world.robots
        if assume:
            world.robots = assume_values(robots)
        result = self._search(goal, world, cancelled, report, limits, planner, adapt)
        result = replace(result, managers=frozenset(robot.manager for robot in robots))
        if result.verdict is not Verdict.IMPOSSIBLE or assume or not _lacks_values(robots):
            return result
        world = self._view(asked_by)
        world.robots = assume_values(world.robots)
        report("planning as if all parameters had values")
        possible = self._search(goal, world, cancelled, report, limits, planner, adapt)
        if possible.plan is None or not possible.plan.missing:
            return result
        if leave_open:
            return replace(possible, message=f"{possible.message}\n{possible.warning}")
        message = _how_to_learn(goal, possible.plan.missing, robots)
        why = result.why or NoPlan(Outcome.IMPOSSIBLE.value, result.message)
        why = replace(why, missing_values=list(possible.plan.missing))
        return replace(result, message=f"{message}\n{result.message}", why=why)

    def _search(
        self,
        goal: str,
        world: WorldView,
        cancelled: threading.Event | None,
        report: Callable[[str], None],
        limits: Limits | None,
        planner: Planner | GivenPlan | None,
        adapt: Callable[[PlanningTask], PlanningTask] | None,
    ) -> PlanningResult:
        """Plans with the robots of a snapshot; see `plan`."""
        try:
            task = make_task(world, _read(goal, world))
        except WrongValue as error:
            # Unusable skills may explain an unknown name.
            return PlanningResult(Verdict.FAILED, message=str(error), notes=tuple(make_actions(world.robots)[1]))
        if cancelled is not None and cancelled.is_set():
            return PlanningResult(Verdict.CANCELLED, message="cancelled before the planner was asked", task=task)
        task = adapt(task) if adapt is not None else task
        if task.satisfied:
            done = PlanningResult(Verdict.NOTHING_TO_DO, message="the goal holds already", task=task)
            return self._store(goal, task, done)
        if isinstance(planner, GivenPlan):
            return self._store(goal, task, self._given(planner, task, world))
        reason = _why_impossible(task, world)
        if reason:
            return self._store(goal, task, _without_plan(Outcome.IMPOSSIBLE, reason, task, world, cancelled))
        planner = planner or self._planner
        report(f"planning with {len(task.actions)} skills and {len(task.objects)} elements ({planner.name})")
        answer = planner.solve(task, limits or self._limits, cancelled)
        result, files = self._result(answer, task, world, cancelled)
        return self._store(goal, task, result, {LOG_FILE: answer.log, **dict(answer.files), **files})

    def plan_ahead(
        self,
        goal: str,
        cancelled: threading.Event,
        adapt: Callable[[PlanningTask], PlanningTask] | None,
        limits: Limits | None = None,
        planner: Planner | GivenPlan | None = None,
    ) -> None:
        """Starts the search that `plan` may be asked for soon with these arguments. Does not block.

        Planners other than `EnginePlanner` do not search ahead.

        :param adapt: None: ends such a search.
        :raises SkirosError: the world model does not answer, or the goal cannot be read.
        """
        engine = planner or self._planner
        if not isinstance(engine, EnginePlanner):
            return
        if adapt is None:
            engine.discard(cancelled)
            return
        world = self._view()
        task = adapt(make_task(world, _read(goal, world)))
        if not task.satisfied and not _why_impossible(task, world):
            engine.solve_ahead(task, limits or self._limits, cancelled)

    def has_locked_devices(self) -> bool:
        """Whether a robot holds a device.

        :raises WmException: the world model does not answer.
        """
        return any(each.hasProperty(DEVICE_HOLDER) for each in self._view().objects.values())

    def read_task(self, goal: str) -> PlanningTask:
        """Returns the planning task for a goal in the current world.

        :raises WrongValue: the goal cannot be read in the current world.
        :raises WmException: the world model does not answer.
        """
        world = self._view()
        return make_task(world, _read(goal, world))

    def _view(self, asked_by: str = "") -> WorldView:
        world = self._views.current()
        world.robots = tuple(r for r in world.robots if same_node(r.manager, asked_by)) or world.robots
        return world

    def _given(self, given: GivenPlan, task: PlanningTask, world: WorldView) -> PlanningResult:
        try:
            plan = given.plan(task, self._durations, world.objects)
        except WrongValue as error:
            return PlanningResult(Verdict.FAILED, str(error), task.notes, task)
        return PlanningResult(Verdict.PLANNED, "\n".join(map(str, plan.calls)), task.notes, task, plan)

    def _result(
        self, answer: PlannerAnswer, task: PlanningTask, world: WorldView, cancelled: threading.Event | None
    ) -> tuple[PlanningResult, dict[str, str]]:
        """Returns the result with the shortest of the planner's plans, and files about the plans."""
        if answer.outcome is not Outcome.SOLVED:
            return _without_plan(answer.outcome, answer.reason, task, world, cancelled), {}
        best: tuple[Plan, FoundPlan] | None = None
        reason, report = "", answer.log
        for found in answer.plans:
            try:
                plan = make_plan(task, found.steps, self._durations, world.objects)
            except WrongValue as error:
                reason = str(error)
                report += f"{found.by}, after {found.seconds:.2f} s: {reason}\n"
                continue
            report += f"{found.by}, after {found.seconds:.2f} s: {plan.summary}\n"
            if best is None or plan.makespan < best[0].makespan:
                best = plan, found
        if best is None:
            message = f"the planner gave a plan that does not work: {reason}"
            return PlanningResult(Verdict.FAILED, message, task.notes, task), {LOG_FILE: report}
        message = "\n".join(map(str, best[0].calls))
        files = {LOG_FILE: report, **({PLAN_FILE: best[1].text} if best[1].text else {})}
        return PlanningResult(Verdict.PLANNED, message, task.notes, task, best[0]), files

    def _store(
        self, goal: str, task: PlanningTask, result: PlanningResult, files: Mapping[str, str] | None = None
    ) -> PlanningResult:
        level = logging.DEBUG if result.verdict in (Verdict.PLANNED, Verdict.NOTHING_TO_DO) else logging.INFO
        for note in task.notes:
            log.log(level, "%s", note)
        if self._archive is not None:
            texts = {
                **(files or {}),
                "goal.txt": goal,
                "result.txt": "\n".join([result.verdict.value, result.message, *task.notes]),
            }
            self._archive.keep(texts)
        return result


def _read(goal: str, world: WorldView) -> Formula:
    return GoalReader(world, condition_predicates(world.robots)).read(goal)


def _lacks_values(robots: Sequence[Robot]) -> bool:
    """Whether a skill of a robot has a parameter without a value."""
    return any(p.missing for robot in robots for skill in robot.skills for p in skill.parameters)


def _how_to_learn(goal: str, missing: Sequence[str], robots: Sequence[Robot]) -> str:
    """Returns the message of a goal whose plan lacks values, with the command that makes a learning scenario."""
    libraries = ",".join(sorted({name for robot in robots for name in robot.libraries}))
    command = ["rosrun", "skiros2_learning", "learn", "scenario", "--goal", " ".join(goal.split())]
    text = shlex.join([*command, "--libraries", libraries, "--scene", "SCENE.ttl"])
    return f"a plan needs values for: {', '.join(missing)}; they can be learned: {text}"


def _why_impossible(task: PlanningTask, world: WorldView) -> str:
    """Returns why the goal is impossible without asking a planner; "" if a planner has to decide."""
    if task.goal == FALSE:
        return "; ".join(["the goal can never hold", *map(note_of_empty_class, task.empty_classes)])
    if task.actions:
        return ""
    return "none of the robots' skills can help" if world.robots else NO_ROBOT


def _without_plan(
    outcome: Outcome, reason: str, task: PlanningTask, world: WorldView, cancelled: threading.Event | None
) -> PlanningResult:
    """Explains why there is no plan. The explanation may prove the goal impossible after the planner timed out.

    :param cancelled: ends the search for an explanation.
    """
    if outcome in (Outcome.CANCELLED, Outcome.FAILED):
        why = NoPlan(outcome.value, reason)
        return PlanningResult(_VERDICTS[outcome], why.headline, task.notes, task, why=why)
    deadline = Deadline(_EXPLANATION_TIMEOUT, cancelled)
    why = explain_no_plan(task, outcome, reason, unusable_skills(world, task), deadline, world)
    if reason == NO_ROBOT or task.goal == FALSE:
        why = replace(why, sentence=reason)
    return PlanningResult(_VERDICTS[Outcome(why.verdict)], str(why), task.notes, task, why=why)
