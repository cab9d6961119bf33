"""Plans and their PDDL, checked by means that planning itself does not use.

A plan is checked by unified-planning's validator, on the problem and on the PDDL files as another program reads them;
and it is carried out on a copy of the world model, with the conditions of the skills as the managers evaluate them.
"""

from __future__ import annotations

import re
import threading
import warnings
from collections.abc import Iterable, Sequence
from typing import Any

from unified_planning.engines import SequentialPlanValidator
from unified_planning.io import PDDLReader
from unified_planning.model import Problem
from unified_planning.plans import ActionInstance, SequentialPlan

from skiros2_common.core.abstract_skill import SkillCore
from skiros2_common.core.conditions import ConditionGenerate
from skiros2_common.core.params import ParamHandler
from skiros2_common.core.world_element import Element
from skiros2_task.core.engines import Limits, Outcome, PlannerAnswer
from skiros2_task.core.plan import SkillCall
from skiros2_task.core.planners import Planner
from skiros2_task.core.task import PlanningTask, PlanStep
from skiros2_task.core.up_model import UpProblem
from skiros2_world_model.core.local_world_model import LocalWorldModel
from support.planning_world import SCENE, PlanningWorld


class CheckedPlanner:
    """A planner whose PDDL and plans are checked."""

    def __init__(self, planner: Planner, goal_action: bool = False) -> None:
        """
        :param goal_action: its PDDL has the goal as the pre-condition of actions at the end.
        """
        self._planner = planner
        self._goal_action = goal_action

    @property
    def name(self) -> str:
        return self._planner.name

    def solve(self, task: PlanningTask, limits: Limits, cancelled: threading.Event | None = None) -> PlannerAnswer:
        answer = self._planner.solve(task, limits, cancelled)
        problem = UpProblem(task, goal_action=self._goal_action).problem
        files = dict(answer.files)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DeprecationWarning)  # the reader's own, of its parser
            read = PDDLReader(problem.environment).parse_problem_string(files["domain.pddl"], files["p01.pddl"])
        written, meant = _content(read), _content(problem)
        for part in meant:
            assert written[part] == meant[part], f"{part}: {written[part]} instead of {meant[part]}"
        if answer.outcome is Outcome.SOLVED:
            assert len(answer.plans[0].text.splitlines()) == len(answer.plan)
            check_plan(task, answer.plan, UpProblem(task, sparse=False).problem)
            if not self._goal_action:
                check_plan(task, answer.plan, read)
        return answer


def check_plan(task: PlanningTask, plan: Iterable[PlanStep], problem: Problem) -> None:
    """Asks unified-planning whether a plan solves a problem whose names are those of the task's problem."""
    named = UpProblem(task)
    instances = []
    for step in plan:
        action, *arguments = named.names_of(step)
        objects = tuple(problem.environment.expression_manager.ObjectExp(problem.object(a)) for a in arguments)
        instances.append(ActionInstance(problem.action(action), objects))
    result = SequentialPlanValidator().validate(problem, SequentialPlan(instances, problem.environment))
    assert bool(result), f"{result.reason}: {[str(i) for i in instances]}"


def _content(problem: Problem) -> dict[str, Any]:
    """What a problem says, without the order in which it says it."""
    return {
        "objects": {o.name: o.type.name for o in problem.all_objects},
        "fluents": {f.name: [p.type.name for p in f.signature] for f in problem.fluents},
        "actions": {a.name: _action(a) for a in problem.actions},
        "init": {str(f) for f, value in problem.initial_values.items() if value.is_true()},
        "goals": {str(g) for goal in problem.goals for g in _conjuncts(goal)},
    }


def _action(action: Any) -> tuple[Any, ...]:
    """An action with numbered parameters, because PDDL may rename them."""
    numbers = {p.name: f"?{number}" for number, p in enumerate(action.parameters)}

    def numbered(item: Any) -> str:
        return re.sub(r"[\w-]+", lambda word: numbers.get(word[0], word[0]), str(item))

    conditions = {numbered(c) for condition in action.preconditions for c in _conjuncts(condition)}
    return [p.type.name for p in action.parameters], conditions, {numbered(e) for e in action.effects}


def _conjuncts(expression: Any) -> list[Any]:
    return [c for arg in expression.args for c in _conjuncts(arg)] if expression.is_and() else [expression]


# -- on the world model -------------------------------------------------------------------------------------------


def is_known(world: PlanningWorld, calls: Sequence[SkillCall]) -> bool:
    """Whether all elements that these calls need and change are there now: none is made, removed or a template."""
    changing = (
        isinstance(condition, ConditionGenerate)
        for call in calls
        for condition in world.offered[call.manager, call.type, call.label]._post_conditions
    )
    return not any(changing) and all(e.id for call in calls for _, e in call.arguments)


def carry_out(world: PlanningWorld, calls: Iterable[SkillCall]) -> PlanningWorld:
    """A copy of the world after these calls. Each skill's conditions are checked as its manager would.

    :param calls: whose elements are known.
    """
    copy = copy_of(world)
    for call in calls:
        do(copy, call)
    return copy


def do(world: PlanningWorld, call: SkillCall) -> None:
    """Does in a world what a skill does. Its conditions are checked as its manager would."""
    core = world.offered[call.manager, call.type, call.label]
    params = _params(core, call, world.wm)
    pre = core._pre_conditions
    for condition in [*pre, *(h for h in core._hold_conditions if not any(h.hasConflict(c) for c in pre))]:
        assert condition.evaluate(params, world.wm), f"{call}: {condition.getDescription()}"
    for condition in core._post_conditions:
        _make_true(condition, params, world.wm)


def copy_of(world: PlanningWorld) -> PlanningWorld:
    """The same scene in a world model of its own."""
    copy = PlanningWorld(LocalWorldModel())
    copy.offered = dict(world.offered)
    scene = world.wm.resolve_elements(Element())
    copy.wm.add_elements([_as_new(e) for e in scene if e.id != SCENE])
    return copy


def _as_new(element: Element) -> Element:
    new = Element(element.type, element.label, element.id)
    for prop in element.properties:
        new.setProperty(prop.key, prop.dataType())
        new.getProperty(prop.key).assign(prop.values)
    for relation in element.getRelations():
        new.addRelation(relation["src"], relation["type"], relation["dst"])
    return new


def _params(core: SkillCore, call: SkillCall, wm: Any) -> ParamHandler:
    params = ParamHandler(core._params.getCopy())
    for key, element in call.arguments:
        params.specify(key, wm.get_element(element.id))
    return params


def _make_true(condition: Any, params: ParamHandler, wm: Any) -> None:
    """The effect of a condition, with a value for those from which none follows."""
    for key in condition.getKeys():
        if params.is_bound(key):  # as it is now
            params.specify(key, wm.get_element(params.getParamValue(key).id))
    if condition.evaluate(params, wm) or condition.setTrue(params, wm):
        return
    described = condition.toElement()
    key, operator = described.value_of("skiros:appliedOnType"), described.value_of("skiros:operator")
    element = wm.get_element(params.getParamValue(condition.getKeys()[0]).id)
    if operator is None:
        element.setProperty(key, 1.0)
    else:
        wanted = float(described.value_of("skiros:desiredValue"))
        up = (operator == ">") == condition.desired_state
        element.setProperty(key, wanted + (1.0 if up else -1.0))
    wm.update_element_properties(element)
    assert condition.evaluate(params, wm), condition.getDescription()
