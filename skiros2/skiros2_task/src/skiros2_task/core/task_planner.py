"""From a goal to a plan that is checked: the whole of planning, without ROS."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Collection
from dataclasses import dataclass
from enum import Enum

from skiros2_common.core.errors import WrongType, WrongValue
from skiros2_common.core.names import same_node
from skiros2_task.core.actions import condition_predicates, make_actions
from skiros2_task.core.archive import Archive
from skiros2_task.core.durations import Durations
from skiros2_task.core.formula import FALSE, Formula
from skiros2_task.core.goal import GoalReader
from skiros2_task.core.left_out import skills_left_out
from skiros2_task.core.plan import SkillCall, skill_calls
from skiros2_task.core.planner import Limits, Outcome, Planner, PlannerAnswer
from skiros2_task.core.problem import make_task
from skiros2_task.core.reachability import Patience
from skiros2_task.core.schedule import Schedule, schedule_plan
from skiros2_task.core.simulation import flaw
from skiros2_task.core.task import PlanningTask, PlanStep
from skiros2_task.core.why import NoPlan, no_plan
from skiros2_task.core.world_view import WorldView
from skiros2_world_model.core.world_model_abstract_interface import WorldModelPort

log = logging.getLogger(__name__)


class Verdict(Enum):
    """What came of a goal."""

    PLANNED = "planned"
    NOTHING_TO_DO = "nothing to do"
    IMPOSSIBLE = "impossible"
    TIMED_OUT = "timed out"
    CANCELLED = "cancelled"
    FAILED = "failed"


#: How long to look for the reasons why there is no plan (s).
_REASONING_SECONDS = 5.0

#: Why nothing can be planned in a world without robots.
NO_ROBOT = "no robot in the world model offers skills"

#: What is to be done where steps would have to run at the same time.
TOO_CLOSE = "plans start no step during another one that it depends on; a skill that runs both can"

_VERDICTS = {
    Outcome.SOLVED: Verdict.PLANNED,
    Outcome.IMPOSSIBLE: Verdict.IMPOSSIBLE,
    Outcome.TIMED_OUT: Verdict.TIMED_OUT,
    Outcome.CANCELLED: Verdict.CANCELLED,
    Outcome.FAILED: Verdict.FAILED,
}


@dataclass(frozen=True)
class PlanningResult:
    """What came of a goal.

    :param calls: what to run, in order, when planned.
    :param message: in words, for the one who asked.
    :param notes: what was left out of the domain, and why.
    :param task: what was planned with; None when the goal could not be read.
    :param steps: the plan, a step for each of the calls.
    :param schedule: the plan in time: what may be done side by side.
    :param why: why there is no plan, when a planner, or what comes before it, found none.
    """

    verdict: Verdict
    calls: tuple[SkillCall, ...] = ()
    message: str = ""
    notes: tuple[str, ...] = ()
    task: PlanningTask | None = None
    steps: tuple[PlanStep, ...] = ()
    schedule: Schedule | None = None
    why: NoPlan | None = None


class TaskPlanner:
    """Makes plans for goals from a world model and the skills in it. Any thread may call it, several at once."""

    def __init__(
        self,
        wm: WorldModelPort,
        planner: Planner,
        limits: Limits,
        archive: Archive | None = None,
        durations: Durations | None = None,
        managers: Callable[[], Collection[str]] = tuple,
    ) -> None:
        """
        :param archive: keeps what was made for each goal.
        :param durations: of the skills, which schedules go by.
        :param managers: gives the node names of the skill managers that run.
        """
        self._wm = wm
        self._planner = planner
        self._limits = limits
        self._archive = archive
        self._durations = durations or Durations()
        self._managers = managers

    def plan(
        self,
        goal: str | Formula,
        cancelled: threading.Event | None = None,
        progress: Callable[[str], None] | None = None,
        asked_by: str = "",
        limits: Limits | None = None,
        planner: Planner | None = None,
        adapt: Callable[[PlanningTask], PlanningTask] | None = None,
    ) -> PlanningResult:
        """The plan for a goal, or why there is none. Blocks as long as the limits allow.

        :param goal: its text, or a formula as `skiros2_task.core.goals` makes them.
        :param progress: told in words what is being done.
        :param asked_by: the node that asks, with or without slash. A skill manager runs the plan itself, so it gets
            one for its own robot alone.
        :param limits: others than those of all requests.
        :param planner: another than that of all requests.
        :param adapt: changes what is planned with, before the planner sees it.
        :raises WmException: the world model does not answer.
        :raises WrongType: the goal is neither.
        """
        tell = progress or log.info
        tell("reading the world model")
        world = self._view(asked_by)
        try:
            task = make_task(world, self._formula(goal, world))
        except WrongValue as error:
            # What a goal speaks of may be known only to skills that planning cannot use.
            return PlanningResult(Verdict.FAILED, message=str(error), notes=tuple(make_actions(world.robots)[1]))
        if cancelled is not None and cancelled.is_set():
            return PlanningResult(Verdict.CANCELLED, message="cancelled before the planner was asked", task=task)
        task = adapt(task) if adapt is not None else task
        if task.satisfied:
            done = PlanningResult(Verdict.NOTHING_TO_DO, message="the goal holds already", task=task)
            return self._kept(goal, task, done)
        reason = _hopeless(task, world)
        if reason:
            return self._kept(goal, task, _without_plan(Outcome.IMPOSSIBLE, reason, task, world, cancelled))
        planner = planner or self._planner
        tell(f"planning with {len(task.actions)} skills and {len(task.objects)} elements ({planner.name})")
        answer = planner.solve(task, limits or self._limits, cancelled)
        return self._kept(goal, task, self._result(answer, task, world, cancelled), answer)

    def look(self, goal: str | Formula) -> PlanningTask:
        """What would be planned with for a goal, as the world is now.

        :raises WrongValue: the goal cannot be read in the world as it is.
        :raises WmException: the world model does not answer.
        """
        world = self._view()
        return make_task(world, self._formula(goal, world))

    def _view(self, asked_by: str = "") -> WorldView:
        world = WorldView(self._wm, self._managers())
        world.robots = tuple(r for r in world.robots if same_node(r.manager, asked_by)) or world.robots
        return world

    def _formula(self, goal: str | Formula, world: WorldView) -> Formula:
        if not isinstance(goal, str | Formula):
            raise WrongType(f"goal {goal!r}: expected its text or a formula, found {type(goal).__name__}")
        # A formula is read as its text, so that all its names are looked up.
        return GoalReader(world, condition_predicates(world.robots)).read(str(goal))

    def _result(
        self, answer: PlannerAnswer, task: PlanningTask, world: WorldView, cancelled: threading.Event | None
    ) -> PlanningResult:
        if answer.outcome is Outcome.SOLVED:
            wrong = flaw(task, answer.plan)
            if wrong:
                message = f"the planner gave a plan that does not work: {wrong}"
                return PlanningResult(Verdict.FAILED, message=message, notes=task.notes)
            plan = schedule_plan(task, answer.plan, self._durations)
            steps = plan.order.steps
            calls = skill_calls(task, steps, world.objects)
            return PlanningResult(
                Verdict.PLANNED, calls, "\n".join(map(str, calls)), task.notes, task=task, steps=steps, schedule=plan
            )
        return _without_plan(answer.outcome, answer.reason, task, world, cancelled)

    def _kept(
        self, goal: str | Formula, task: PlanningTask, result: PlanningResult, answer: PlannerAnswer | None = None
    ) -> PlanningResult:
        level = logging.DEBUG if result.verdict in (Verdict.PLANNED, Verdict.NOTHING_TO_DO) else logging.INFO
        for note in task.notes:
            log.log(level, "%s", note)
        if self._archive is not None:
            texts = dict(answer.files) if answer is not None else {}
            texts["goal.txt"] = str(goal)
            texts["result.txt"] = "\n".join([result.verdict.value, result.message, *task.notes])
            if answer is not None:
                texts["planner.log"] = answer.log
            self._archive.keep(texts)
        return result


def _hopeless(task: PlanningTask, world: WorldView) -> str:
    """Why no planner need be asked; "" when one has to be."""
    if task.goal == FALSE:
        return "; ".join(["the goal can never hold", *(note for note in task.notes if "the goal speaks" in note)])
    if task.actions:
        return ""
    return "none of the robots' skills can help" if world.robots else NO_ROBOT


def _without_plan(
    outcome: Outcome, reason: str, task: PlanningTask, world: WorldView, cancelled: threading.Event | None
) -> PlanningResult:
    """Says why there is no plan. A planner that was too slow may still have had no chance.

    :param cancelled: leaves out what is not known yet.
    """
    if outcome in (Outcome.CANCELLED, Outcome.FAILED):
        why = NoPlan(outcome.value, reason)
        return PlanningResult(_VERDICTS[outcome], message=reason, notes=task.notes, task=task, why=why)
    if task.concurrent:
        reason = "; ".join([reason or outcome.value, *task.concurrent, TOO_CLOSE])
    patience = Patience(_REASONING_SECONDS, cancelled)
    why = no_plan(task, outcome.value, reason, skills_left_out(world, task), patience)
    verdict = next(_VERDICTS[o] for o in Outcome if o.value == why.verdict)
    return PlanningResult(verdict, message=str(why), notes=task.notes, task=task, why=why)
