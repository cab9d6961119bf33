"""Reassigns the steps of a plan to robots, so that its makespan shrinks.

A planner without a notion of time gives all work to one robot. Here the plan is split into parts: steps that one robot
has to execute, such as picking an object up and placing it. Moves belong to no part, as they depend on where the robot
was before. The parts are assigned in several ways, and the shortest schedule is taken: each to the robot that ends it
first, in plan order and by critical path; and to one robot after the other, in plan order, up to a time limit that is
found by bisection. Functionally determined parameters, such as a robot's gripper, follow the assigned robot.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import product
from typing import Any

from skiros2_task.core.formula import Atom, Kind, Predicate
from skiros2_task.core.makespan_bound import makespan_bound
from skiros2_task.core.partial_order import PartialOrder
from skiros2_task.core.plan_parts import Part, Roles, Target, find_moves, split_plan
from skiros2_task.core.semantics import Facts, GroundStep, Literal, support
from skiros2_task.core.store import Durations
from skiros2_task.core.task import PlanningTask, PlanStep

#: Iterations of the bisection of the time limit.
BISECTIONS = 6

_Choose = Callable[[int], float | None]


class RobotAssigner:
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
        self._fastest: dict[str, float] = {}
        for (name, _), seconds in self._seconds.items():
            self._fastest[name] = min(seconds, self._fastest.get(name, seconds))
        self._moves = find_moves(self._actions.values())
        self._parts = split_plan(task, order, self._actions, self._moves)
        indexed = {pair for roles in self._actions.values() for pair in roles.determined.values()}
        self._timeline = _Timeline(task.init, indexed)
        self._tried: list[PlanStep] = []  # the steps of the part that was tried last
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

    def assign(self, makespan: float) -> tuple[PlanStep, ...] | None:
        """Returns the plan with its parts reassigned; None if no assignment is shorter. The result is not validated.

        :param makespan: of the plan as it is (s).
        """
        if not self._parts or not self._robots:
            return None
        least = [sum(self._fastest.get(self._order.steps[i].action, 0.0) for i in part.steps) for part in self._parts]
        queue = self._topological_order([0.0] * len(self._parts))
        if queue is None:
            return None
        best: list[PlanStep] | None = None
        low, high = sum(least) / len(self._robots), makespan
        urgent = self._topological_order(self._critical_paths(least, queue))
        for order in dict.fromkeys((queue, urgent or queue)):
            balanced = self._assign(order, self._end_first)
            if balanced is not None and balanced[1] < high:
                best, high = balanced
        for _ in range(BISECTIONS):
            limit = (low + high) / 2
            filled = self._assign(queue, partial(self._fill, least, limit))
            if filled is None:
                low = limit
            else:
                best, high = filled
        return tuple(best) if best is not None else None

    def bound(self) -> float:
        """Returns a time that no schedule of the parts is shorter than (s); 0 if it is not known."""
        of_skill: dict[tuple[str, str], float] = {}  # robots with different durations have different actions of a skill
        for name, action in self._actions.items():
            skill, seconds = action.action.skill, self._fastest.get(name, 0.0)
            of_skill[skill.type, skill.label] = min(seconds, of_skill.get((skill.type, skill.label), seconds))
        fastest = {n: of_skill[a.action.skill.type, a.action.skill.label] for n, a in self._actions.items()}
        return makespan_bound(self._task, self._parts, self._order.steps, self._moves, fastest, self._robots)

    def _critical_paths(self, least: Sequence[float], order: Sequence[int]) -> list[float]:
        """Returns the shortest time from the start of each part to the end of all parts that depend on it (s).

        :param order: an executable order of the parts.
        """
        found = list(least)
        for number in reversed(order):
            for before in self._parts[number].after:
                found[before] = max(found[before], least[before] + found[number])
        return found

    def _topological_order(self, urgency: Sequence[float]) -> tuple[int, ...] | None:
        """Returns the indices of the parts in an executable order, the most urgent of the ready ones first; equally
        urgent ones in the plan's order. Parts that the goal needs for facts about their robot are last.
        None if parts depend on each other in a circle.
        """
        waiting = dict(enumerate(self._parts))
        found = []
        while waiting:
            ready = [n for n, part in waiting.items() if not part.after & waiting.keys()]
            if not ready:  # steps of two robots alternate: as whole parts, each would have to be first
                return None
            found.append(min(ready, key=lambda n: (self._parts[n].final, -urgency[n])))
            del waiting[found[-1]]
        return tuple(found)

    def _assign(self, queue: Sequence[int], choose: _Choose) -> tuple[list[PlanStep], float] | None:
        """Assigns the parts in order. Returns the plan and its makespan (s); None if there is no robot for a part.

        :param choose: adds a part to the timeline. Returns when it ends (s); None if there is no robot for it.
        """
        self._timeline.reset()
        plan: list[PlanStep] = []
        makespan = 0.0
        for number in queue:
            end = choose(number)
            if end is None:
                return None
            plan += self._tried
            makespan = max(makespan, end)
            self._timeline.commit()
        return plan, makespan

    def _end_first(self, number: int) -> float | None:
        """Gives a part to the robot that ends it first."""
        ends: list[tuple[float, str]] = []
        for robot in self._candidates(self._parts[number]):
            end = self._try(self._parts[number], robot)
            if end is not None:
                ends.append((end, robot))
            self._timeline.rollback()
        return self._try(self._parts[number], min(ends)[1]) if ends else None

    def _fill(self, least: Sequence[float], limit: float, number: int) -> float | None:
        """Gives a part to the first robot that executes it within the limit.

        :param least: the shortest duration of each part (s).
        :param limit: of the makespan (s).
        """
        for robot in self._candidates(self._parts[number]):
            if self._timeline.free_at(robot) + least[number] <= limit:
                end = self._try(self._parts[number], robot)
                if end is not None and end <= limit:
                    return end
                self._timeline.rollback()
        return None

    def _candidates(self, part: Part) -> list[str]:
        """Returns the robots that may execute a part, always in the same order."""
        first = self._order.steps[part.steps[0]]
        return [first.arguments[self._actions[first.action].robot]] if part.pinned else sorted(self._robots)

    def _try(self, part: Part, robot: str) -> float | None:
        """Adds a part to the timeline. Returns when it ends (s); None if the robot cannot execute it."""
        self._tried = []
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


#: Marks an entry that a mapping did not have.
_MISSING = object()


class _Timeline:
    """The facts after the added steps, and the times that constrain further steps, with commit and rollback.

    The constraints are those of `partial_order`: a step starts after the producers of its facts, after the consumers
    and producers of facts that it deletes, after steps that lock the same device, and after its robot's last step.
    """

    def __init__(self, init: Facts, indexed: Iterable[tuple[Predicate, int]]) -> None:
        """
        :param indexed: the (predicate, position) pairs that `facts_with` supports.
        """
        self._init = init
        self._indexed: dict[Predicate, list[int]] = {}
        for predicate, position in indexed:
            self._indexed.setdefault(predicate, []).append(position)
        self._start = sorted(atom for atom in init if atom.predicate in self._indexed)
        self.reset()

    def reset(self) -> None:
        """Removes all steps."""
        self._now: dict[Atom, bool] = {}
        self._since: dict[Atom, float] = {}  # the end of the step that gave the fact its current value
        #: The end of the last step with this effect, and with this precondition, by the value of the fact.
        self._written: tuple[dict[Atom, float], dict[Atom, float]] = {}, {}
        self._needed: tuple[dict[Atom, float], dict[Atom, float]] = {}, {}
        self._free: dict[str, float] = {}  # the end of each robot's last step
        self._undo: list[tuple[dict[Any, Any], object, object]] = []  # changed entries of the mappings above
        self._index: dict[tuple[Predicate, int, str], dict[Atom, bool]] = {}
        for atom in self._start:
            self._update_index(atom, True)
        self.commit()

    def holds(self, atom: Atom) -> bool:
        """Whether a fact holds after all added steps."""
        known = self._now.get(atom)
        return atom in self._init if known is None else known

    def facts_with(self, predicate: Predicate, position: int, term: str) -> list[Atom]:
        """Returns the current facts of a predicate that have a term at a position."""
        return [atom for atom, is_current in self._index.get((predicate, position, term), {}).items() if is_current]

    def free_at(self, robot: str) -> float:
        """Returns when a robot's last step ends (s)."""
        return self._free.get(robot, 0.0)

    def add(self, step: GroundStep, seconds: float) -> bool:
        """Adds a step at the earliest time. Returns False, and adds nothing, if it cannot start."""
        now, init, since = self._now, self._init, self._since
        for atom, state in step.needs:
            known = now.get(atom)
            if (atom in init if known is None else known) != state:
                return False
        needs: Iterable[Literal] = step.needs
        for choice in step.choices:
            chosen = support(choice, self.holds, self._held_since)
            if chosen is None:
                return False
            needs = (*needs, *chosen)
        written, needed = self._written, self._needed
        start = self.free_at(step.robot)
        for atom, _ in needs:
            start = max(start, since.get(atom, 0.0))
        changes = step.changes
        for atom, state in changes:
            start = max(start, written[not state].get(atom, 0.0), needed[not state].get(atom, 0.0))
        end = start + seconds
        undo = self._undo
        for both, literals in ((needed, needs), (written, changes)):
            for atom, state in literals:
                times = both[state]
                before = times.get(atom, 0.0)
                if end > before:
                    undo.append((times, atom, before))
                    times[atom] = end
        for atom in step.during:
            self._set(since, atom, end)
        for atom, state in step.effects.items():
            if self.holds(atom) != state:
                self._set(now, atom, state)
                self._set(since, atom, end)
                if atom.predicate in self._indexed:
                    self._update_index(atom, state)
        self._set(self._free, step.robot, end)
        return True

    def commit(self) -> None:
        """Keeps the steps since the last commit."""
        self._undo.clear()

    def rollback(self) -> None:
        """Removes the steps since the last commit."""
        while self._undo:
            mapping, key, old = self._undo.pop()
            if old is _MISSING:
                del mapping[key]
            else:
                mapping[key] = old

    def _held_since(self, atom: Atom) -> float:
        return self._since.get(atom, 0.0)

    def _set(self, mapping: dict[Any, Any], key: object, value: object) -> None:
        self._undo.append((mapping, key, mapping.get(key, _MISSING)))
        mapping[key] = value

    def _update_index(self, atom: Atom, state: bool) -> None:
        for position in self._indexed[atom.predicate]:
            facts = self._index.setdefault((atom.predicate, position, atom.terms[position]), {})
            if state:
                self._set(facts, atom, True)
            elif atom in facts:
                self._undo.append((facts, atom, facts.pop(atom)))
