"""The steps of a plan dealt out anew to the robots, so that it takes less time.

A planner that does not know of time gives all work to one robot. Here the plan is cut into parts: steps that only one
robot can do together, such as picking something up and putting it down. What merely brings a robot where it has to be
belongs to none, for it depends on where the robot was before. Then the parts are dealt out in two ways, and the better
one is taken: by list scheduling, again and again the part and the robot that are done first; and by filling one robot
after the other, in the order of the plan, up to a time that is made smaller by halves. What follows from the robot,
such as its gripper, is chosen with it.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product

from skiros2_task.core.durations import Durations
from skiros2_task.core.ground_actions import Fact, Facts, GroundAction, ground_actions
from skiros2_task.core.partial_order import PartialOrder
from skiros2_task.core.plan_parts import Part, Place, cut, moves_of
from skiros2_task.core.task import PlanningTask, PlanStep
from skiros2_task.core.timeline import Timeline

#: Each time the best of the parts that could be next is chosen: in small plans of all, in large ones of the first so
#: many in the order of the plan that in all about `TRIALS` are tried.
LEAST_WINDOW, TRIALS = 4, 240
#: How often the makespan is halved up to which robots are filled with parts.
HALVINGS = 6


def reassigned(task: PlanningTask, order: PartialOrder, durations: Durations) -> tuple[PlanStep, ...] | None:
    """The plan with its parts dealt out anew; None where that is not possible.

    It is likely to work, and to be shorter: both are for the caller to check.
    """
    return _Dealer(task, order, durations).deal()


@dataclass
class _Dealt:
    """A plan with its parts dealt out."""

    plan: list[PlanStep] = field(default_factory=list)
    makespan: float = 0.0


class _Dealer:
    """Deals out the parts of one plan."""

    def __init__(self, task: PlanningTask, order: PartialOrder, durations: Durations) -> None:
        self._task = task
        self._order = order
        facts = Facts(task.init)
        self._facts = facts
        self._actions = ground_actions(task, facts)
        self._robots = self._able_robots()
        self._seconds = {
            (a.action.name, robot): durations.seconds(a.action.skill, dict(a.action.managers).get(robot, ""))
            for robot, actions in self._robots.items()
            for a in actions
        }
        self._least: dict[str, float] = {}
        for (name, _), seconds in self._seconds.items():
            self._least[name] = min(seconds, self._least.get(name, seconds))
        self._moves = moves_of(self._actions.values(), facts)
        indexed = {
            (pattern.number, pattern.terms.index(ground.robot))
            for ground in self._actions.values()
            for pattern in (*ground.tools.values(), *ground.states.values())
        }
        self._timeline = Timeline(facts.init, sorted(indexed))

    def _able_robots(self) -> dict[str, list[GroundAction]]:
        """The robots, each with the actions it has the skills for."""
        found: dict[str, list[GroundAction]] = {}
        for action in self._actions.values():
            for robot in self._task.candidates(action.action.variables[action.robot].classes):
                if action.can(robot, self._task.init):
                    found.setdefault(robot, []).append(action)
        return found

    # -- dealing -----------------------------------------------------------------------------------------------

    def deal(self) -> tuple[PlanStep, ...] | None:
        """See `reassigned`."""
        parts = cut(self._task, self._order, self._actions, self._moves, self._facts)
        best = self._first_done(parts) if parts else None
        if best is None or not self._robots:  # nobody can do anything but what is begun
            return None
        actions = [step.action for step in self._order.steps]
        least = {n: sum(self._least.get(actions[i], 0.0) for i in part.steps) for n, part in enumerate(parts)}
        queue = self._in_order(parts)
        low, high = sum(least.values()) / len(self._robots), best.makespan
        for _ in range(HALVINGS):
            limit = (low + high) / 2
            dealt = self._filled(queue, parts, least, limit)
            if dealt is None:
                low = limit
            else:
                best, high = dealt, dealt.makespan
        return tuple(best.plan)

    def _in_order(self, parts: Sequence[Part]) -> list[int]:
        """The parts, one after the other, in the order of the plan as far as they may be."""
        waiting = dict(enumerate(parts))
        found = []
        while waiting:
            found.append(self._ready(waiting)[0])
            del waiting[found[-1]]
        return found

    def _filled(
        self, queue: Sequence[int], parts: Sequence[Part], least: Mapping[int, float], limit: float
    ) -> _Dealt | None:
        """Robots filled with parts, one robot after the other; None where time is too short.

        :param queue: the parts in order.
        :param least: the seconds that each part takes at least.
        :param limit: s for each robot.
        """
        self._timeline.reset()
        dealt = _Dealt()
        for number in queue:
            for robot in sorted(self._candidates(parts[number])):
                if self._timeline.free(robot) + least[number] > limit:
                    continue
                end = self._try(parts[number], robot)
                if end is not None and end <= limit:
                    self._keep(dealt, end)
                    break
                self._timeline.take_back()
            else:
                return None
        return dealt

    def _first_done(self, parts: Sequence[Part]) -> _Dealt | None:
        """Again and again the part and the robot that are done first."""
        self._timeline.reset()
        dealt = _Dealt()
        waiting = dict(enumerate(parts))
        window = max(LEAST_WINDOW, TRIALS // max(1, len(parts)))
        tried: dict[tuple[int, str], tuple[float | None, set[Fact]]] = {}
        while waiting:
            best: tuple[float, int, str] | None = None
            for number in self._ready(waiting)[:window]:
                for robot in self._candidates(parts[number]):
                    if (number, robot) not in tried:
                        end = self._try(parts[number], robot)
                        tried[number, robot] = end, self._timeline.used
                        self._timeline.take_back()
                    end = tried[number, robot][0]
                    if end is not None and (best is None or end < best[0]):
                        best = end, number, robot
            if best is None:
                return None
            end, number, robot = best
            self._try(parts[number], robot)
            changed = self._timeline.used
            self._keep(dealt, end)
            del waiting[number]
            tried = {
                key: (end, used)
                for key, (end, used) in tried.items()
                if key[1] != robot and end is not None and used.isdisjoint(changed)
            }
        return dealt

    def _ready(self, waiting: Mapping[int, Part]) -> list[int]:
        """The parts that may be next, those that say where robots have to be in the end when there are no others."""
        ready = [n for n, part in waiting.items() if not part.after & waiting.keys()]
        return [n for n in ready if not waiting[n].last] or ready

    def _keep(self, dealt: _Dealt, end: float) -> None:
        """Keeps the part that was tried last.

        :param end: when it ends (s).
        """
        dealt.plan += self._tried
        dealt.makespan = max(dealt.makespan, end)
        self._timeline.commit()

    def _candidates(self, part: Part) -> list[str]:
        """The robots that may do a part, the one of the plan first."""
        first = self._order.steps[part.steps[0]]
        own = first.arguments[self._actions[first.action].robot]
        return [own] if part.pinned else [own, *(r for r in self._robots if r != own)]

    def _try(self, part: Part, robot: str) -> float | None:
        """Does a part on the timeline and tells when it ends (s); None: the robot cannot do it."""
        self._tried: list[PlanStep] = []
        for index in part.steps:
            for place in part.places.get(index, ()):
                if not self._move(place, robot):
                    return None
            step = self._order.steps[index]
            if not self._do(self._for_robot(self._actions[step.action], robot), step.arguments, robot):
                return None
        return self._timeline.free(robot)

    def _for_robot(self, action: GroundAction, robot: str) -> Iterator[GroundAction]:
        """The actions of one skill that a robot has: robots on which it takes different times have one each."""
        for other in self._robots.get(robot, ()):
            one, two = action.action, other.action
            if (one.skill.type, one.skill.label, one.variables) == (two.skill.type, two.skill.label, two.variables):
                yield other

    def _move(self, place: Place, robot: str) -> bool:
        """Brings a robot where it has to be, if it is not there."""
        terms = [robot if i == place.place else t for i, t in enumerate(place.terms)]
        if self._timeline.holds((place.number, *terms)):
            return True
        for action, pattern in self._moves[place.number, place.place]:
            if action in self._robots.get(robot, ()):
                values = [""] * len(action.action.variables)
                for variable, term in zip(pattern, terms, strict=True):
                    values[variable] = term
                if self._do([action], values, robot):
                    return True
        return False

    def _do(self, actions: Iterable[GroundAction], values: Sequence[str], robot: str) -> bool:
        """Does a step with the first action, tools and state of the robot with which it can be done."""
        for action in actions:
            seconds = self._seconds[action.action.name, robot]
            for some in self._follow(action, values, robot):
                step = action.grounded(some)
                if step is not None and self._timeline.add(step, robot, seconds):
                    self._tried.append(PlanStep(action.action.name, some))
                    return True
        return False

    def _follow(self, action: GroundAction, values: Sequence[str], robot: str) -> Iterator[tuple[str, ...]]:
        """The values for a robot, with what follows from the robot; where there are several, first what was there."""
        filled = list(values)
        filled[action.robot] = robot
        choices = []
        for variable, pattern in action.of_robot:
            facts = self._timeline.partners(pattern.number, pattern.terms.index(action.robot), robot)
            place = pattern.terms.index(variable) + 1
            there = [str(fact[place]) for fact in facts]
            choices.append([*(t for t in there if t == values[variable]), *(t for t in there if t != values[variable])])
        for choice in product(*choices):
            for (variable, _), value in zip(action.of_robot, choice, strict=True):
                filled[variable] = value
            yield tuple(filled)
