"""Reassigns the steps of a plan to robots, so that its makespan shrinks.

A planner without a notion of time gives all work to one robot. Here the plan is split into parts: steps that one robot
has to execute, such as picking an object up and placing it. Moves belong to no part, as they depend on where the robot
was before. The parts are assigned in two ways, and the shorter schedule is taken: by list scheduling (the part and the
robot that end first are next), and by filling one robot after the other, in plan order, up to a time limit that is
found by bisection. Functionally determined parameters, such as a robot's gripper, follow the assigned robot.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product

from skiros2_task.core.formula import Atom, Kind, Predicate
from skiros2_task.core.partial_order import PartialOrder
from skiros2_task.core.plan_parts import Part, Roles, Target, find_moves, split_plan
from skiros2_task.core.semantics import GroundStep
from skiros2_task.core.store import Durations
from skiros2_task.core.task import PlanningTask, PlanStep
from skiros2_task.core.timeline import Timeline

#: List scheduling tries the first `MAX_TRIALS` / (number of parts) of the ready parts, and at least `MIN_WINDOW`.
MIN_WINDOW, MAX_TRIALS = 4, 240
#: Iterations of the bisection of the time limit.
BISECTIONS = 6


def reassign_robots(task: PlanningTask, order: PartialOrder, durations: Durations) -> tuple[PlanStep, ...] | None:
    """Returns the plan with its parts reassigned; None if there is no assignment.

    The result is not validated, and may be longer than the plan.
    """
    return _RobotAssigner(task, order, durations).assign()


@dataclass
class _Assignment:
    """A plan with its parts assigned, and its makespan (s)."""

    plan: list[PlanStep] = field(default_factory=list)
    makespan: float = 0.0


class _RobotAssigner:
    """Assigns the parts of one plan to robots."""

    def __init__(self, task: PlanningTask, order: PartialOrder, durations: Durations) -> None:
        self._task = task
        self._order = order
        self._actions = {action.name: Roles(task, action) for action in task.actions}
        self._robots = self._capable_robots()
        self._seconds = {
            (roles.action.name, robot): durations.seconds(roles.action.skill, roles.action.manager_of(robot))
            for robot, actions in self._robots.items()
            for roles in actions
        }
        self._min_seconds: dict[str, float] = {}
        for (name, _), seconds in self._seconds.items():
            self._min_seconds[name] = min(seconds, self._min_seconds.get(name, seconds))
        self._moves = find_moves(self._actions.values())
        indexed = {pair for roles in self._actions.values() for pair in roles.determined.values()}
        self._timeline = Timeline(task.init, indexed)
        self._grounded: dict[tuple[str, tuple[str, ...]], GroundStep | None] = {}

    def _capable_robots(self) -> dict[str, list[Roles]]:
        """Returns the actions that each robot has the skills for."""
        found: dict[str, list[Roles]] = {}
        for roles in self._actions.values():
            can = Predicate(Kind.CAN, roles.action.name)
            for robot in self._task.candidates(roles.action.variables[roles.robot].classes):
                if Atom(can, (robot,)) in self._task.init:
                    found.setdefault(robot, []).append(roles)
        return found

    # -- assignment --------------------------------------------------------------------------------------------

    def assign(self) -> tuple[PlanStep, ...] | None:
        """See `reassign_robots`."""
        parts = split_plan(self._task, self._order, self._actions, self._moves)
        best = self._list_schedule(parts) if parts else None
        if best is None or not self._robots:
            return None
        actions = [step.action for step in self._order.steps]
        seconds = {n: sum(self._min_seconds.get(actions[i], 0.0) for i in part.steps) for n, part in enumerate(parts)}
        queue = self._topological_order(parts)
        low, high = sum(seconds.values()) / len(self._robots), best.makespan
        for _ in range(BISECTIONS):
            limit = (low + high) / 2
            filled = self._fill_robots(queue, parts, seconds, limit)
            if filled is None:
                low = limit
            else:
                best, high = filled, filled.makespan
        return tuple(best.plan)

    def _topological_order(self, parts: Sequence[Part]) -> list[int]:
        """Returns the indices of the parts in an executable order, as close to the plan's as possible."""
        waiting = dict(enumerate(parts))
        found = []
        while waiting:
            found.append(self._ready(waiting)[0])
            del waiting[found[-1]]
        return found

    def _fill_robots(
        self, queue: Sequence[int], parts: Sequence[Part], min_seconds: Mapping[int, float], limit: float
    ) -> _Assignment | None:
        """Gives each part to the first robot that executes it within the limit; None if there is none for a part.

        :param queue: the indices of the parts, in order.
        :param min_seconds: the shortest duration of each part.
        :param limit: of the makespan (s).
        """
        self._timeline.reset()
        assignment = _Assignment()
        for number in queue:
            for robot in sorted(self._candidates(parts[number])):
                if self._timeline.free_at(robot) + min_seconds[number] > limit:
                    continue
                end = self._try(parts[number], robot)
                if end is not None and end <= limit:
                    self._accept(assignment, end)
                    break
                self._timeline.rollback()
            else:
                return None
        return assignment

    def _list_schedule(self, parts: Sequence[Part]) -> _Assignment | None:
        """Assigns repeatedly the part and the robot that end first; None if no robot can execute a part."""
        self._timeline.reset()
        assignment = _Assignment()
        waiting = dict(enumerate(parts))
        window = max(MIN_WINDOW, MAX_TRIALS // max(1, len(parts)))
        tried: dict[tuple[int, str], tuple[float | None, set[Atom]]] = {}
        while waiting:
            best: tuple[float, int, str] | None = None
            for number in self._ready(waiting)[:window]:
                for robot in self._candidates(parts[number]):
                    if (number, robot) not in tried:
                        end = self._try(parts[number], robot)
                        tried[number, robot] = end, self._timeline.used
                        self._timeline.rollback()
                    end = tried[number, robot][0]
                    if end is not None and (best is None or end < best[0]):
                        best = end, number, robot
            if best is None:
                return None
            end, number, robot = best
            self._try(parts[number], robot)
            changed = self._timeline.used
            self._accept(assignment, end)
            del waiting[number]
            tried = {
                key: (end, used)
                for key, (end, used) in tried.items()
                if key[1] != robot and end is not None and used.isdisjoint(changed)
            }
        return assignment

    def _ready(self, waiting: Mapping[int, Part]) -> list[int]:
        """Returns the parts that may be next; final ones only if there are no others."""
        ready = [n for n, part in waiting.items() if not part.after & waiting.keys()]
        return [n for n in ready if not waiting[n].final] or ready

    def _accept(self, assignment: _Assignment, end: float) -> None:
        """Keeps the part that was tried last.

        :param end: when it ends (s).
        """
        assignment.plan += self._tried
        assignment.makespan = max(assignment.makespan, end)
        self._timeline.commit()

    def _candidates(self, part: Part) -> list[str]:
        """Returns the robots that may execute a part, the robot of the plan first."""
        first = self._order.steps[part.steps[0]]
        own = first.arguments[self._actions[first.action].robot]
        return [own] if part.pinned else [own, *(r for r in self._robots if r != own)]

    def _try(self, part: Part, robot: str) -> float | None:
        """Adds a part to the timeline. Returns when it ends (s); None if the robot cannot execute it."""
        self._tried: list[PlanStep] = []
        for index in part.steps:
            for target in part.targets.get(index, ()):
                if not self._move(target, robot):
                    return None
            step = self._order.steps[index]
            if not self._add_step(self._variants(self._actions[step.action], robot), step.arguments, robot):
                return None
        return self._timeline.free_at(robot)

    def _variants(self, action: Roles, robot: str) -> Iterator[Roles]:
        """Yields a robot's actions of the same skill: robots with different durations have different actions."""
        for other in self._robots.get(robot, ()):
            one, two = action.action, other.action
            if (one.skill.type, one.skill.label, one.variables) == (two.skill.type, two.skill.label, two.variables):
                yield other

    def _move(self, target: Target, robot: str) -> bool:
        """Moves a robot to a target, if it is not there. Returns whether it is there then."""
        terms = [robot if i == target.position else t for i, t in enumerate(target.terms)]
        if self._timeline.holds(Atom(target.predicate, tuple(terms))):
            return True
        for action, variables in self._moves[target.predicate, target.position]:
            if action in self._robots.get(robot, ()):
                values = [""] * len(action.action.variables)
                for variable, term in zip(variables, terms, strict=True):
                    values[variable] = term
                if self._add_step([action], values, robot):
                    return True
        return False

    def _add_step(self, actions: Iterable[Roles], values: Sequence[str], robot: str) -> bool:
        """Adds a step with the first action and functionally determined parameters for which it is applicable."""
        for action in actions:
            seconds = self._seconds[action.action.name, robot]
            for complete in self._determine(action, values, robot):
                step = self._ground(action.action.name, complete)
                if step is not None and self._timeline.add(step, seconds):
                    self._tried.append(PlanStep(action.action.name, complete))
                    return True
        return False

    def _determine(self, action: Roles, values: Sequence[str], robot: str) -> Iterator[tuple[str, ...]]:
        """Yields the values with the robot and the parameters that it determines; the given values first."""
        complete = list(values)
        complete[action.robot] = robot
        choices = []
        for variable, (predicate, position) in action.determined.items():
            facts = self._timeline.facts_with(predicate, position, robot)
            found = [fact.terms[1 - position] for fact in facts]
            choices.append([*(t for t in found if t == values[variable]), *(t for t in found if t != values[variable])])
        for choice in product(*choices):
            for variable, value in zip(action.determined, choice, strict=True):
                complete[variable] = value
            yield tuple(complete)

    def _ground(self, action: str, values: tuple[str, ...]) -> GroundStep | None:
        """Returns a step without the needs that no step changes; None if one of these does not hold."""
        key = action, values
        if key not in self._grounded:
            grounder, changed, init = self._task.grounder(action), self._task.changed, self._task.init
            step: GroundStep | None = None
            if all(value in objects for value, objects in zip(values, grounder.objects, strict=True)):
                step = grounder.ground(values)
                if all((atom in init) == state for atom, state in step.needs if atom.predicate not in changed):
                    step = replace(step, needs=tuple(need for need in step.needs if need[0].predicate in changed))
                else:
                    step = None
            self._grounded[key] = step
        return self._grounded[key]
