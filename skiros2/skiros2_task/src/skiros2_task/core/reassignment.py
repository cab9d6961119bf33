"""The steps of a plan dealt out anew to the robots, so that it takes less time.

A planner that does not know of time gives all work to one robot. Here the plan is cut into jobs: steps that only one
robot can do together, such as picking something up and putting it down. What merely brings a robot where it has to be
is no part of a job, for it depends on where the robot was before. Then jobs are dealt out by list scheduling: again and
again the job and the robot that are done first. What follows from the robot, such as its gripper, is chosen with it.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product

from skiros2_task.core.durations import Durations
from skiros2_task.core.formula import Atom
from skiros2_task.core.ground_actions import Fact, Facts, GroundAction, ground_actions
from skiros2_task.core.partial_order import GOAL, INIT, CausalLink, PartialOrder, changes_of, reasons
from skiros2_task.core.task import PlanningTask, PlanStep
from skiros2_task.core.timeline import Timeline

#: Each time the best of the jobs that could be next is chosen: in small plans of all, in large ones of the first so
#: many in the order of the plan that in all about `TRIALS` are tried.
LEAST_WINDOW, TRIALS = 4, 240
#: How often the makespan is halved up to which robots are filled with jobs.
HALVINGS = 6


@dataclass(frozen=True)
class _Place:
    """A fact about the robot that a step needs, and that the robot can bring about by moving.

    :param number: of its predicate.
    :param place: of the robot among the terms.
    """

    number: int
    place: int
    terms: tuple[str, ...]


@dataclass
class _Job:
    """Steps that one robot has to do together.

    :param steps: their indices in the plan.
    :param after: the jobs that have to be done before.
    :param pinned: it has to be done by the robot that the plan gave it to.
    :param last: it says where its robot has to be in the end.
    """

    steps: list[int]
    after: set[int] = field(default_factory=set)
    pinned: bool = False
    last: bool = False


def reassigned(task: PlanningTask, order: PartialOrder, durations: Durations) -> tuple[PlanStep, ...] | None:
    """The plan with its jobs dealt out anew; None where that is not possible.

    It is likely to work, and to be shorter: both are for the caller to check.
    """
    return _Dealer(task, order, durations).deal()


@dataclass
class _Dealt:
    """A plan with its jobs dealt out."""

    plan: list[PlanStep] = field(default_factory=list)
    makespan: float = 0.0


class _Dealer:
    """Deals out the jobs of one plan."""

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
        self._moves = _moves(self._actions.values(), facts)
        indexed = {
            (pattern.number, pattern.terms.index(ground.robot))
            for ground in self._actions.values()
            for pattern in (*ground.tools.values(), *ground.states.values())
        }
        self._timeline = Timeline(facts.init, sorted(indexed))
        self._places: dict[int, list[_Place]] = {}

    def _able_robots(self) -> dict[str, list[GroundAction]]:
        """The robots, each with the actions it has the skills for."""
        found: dict[str, list[GroundAction]] = {}
        for action in self._actions.values():
            for robot in self._task.candidates(action.action.variables[action.robot].classes):
                if action.can(robot, self._task.init):
                    found.setdefault(robot, []).append(action)
        return found

    # -- jobs --------------------------------------------------------------------------------------------------

    def _jobs(self) -> list[_Job]:
        steps, links = self._order.steps, self._order.links
        ground = [self._actions[step.action] for step in steps]
        robots = [step.arguments[g.robot] for step, g in zip(steps, ground, strict=True)]
        own = [{r, *(step.arguments[i] for i in g.tools)} for r, step, g in zip(robots, steps, ground, strict=True)]

        def private(index: int, atom: Atom) -> bool:
            return not own[index].isdisjoint(atom.terms)

        def pinning(link: CausalLink) -> bool:
            i, j = link.producer, link.consumer
            return i != INIT and (j == GOAL or robots[i] != robots[j]) and private(i, link.atom)

        pinned = {link.producer for link in links if pinning(link)}
        last = {link.producer for link in links if pinning(link) and link.consumer == GOAL}
        work = [i for i, g in enumerate(ground) if i in pinned or not self._is_move(g)]
        group = {i: i for i in work}
        for link in links:
            i, j = link.producer, link.consumer
            if j in group and link.state and robots[j] in link.atom.terms and (i == INIT or i not in group):
                self._note_place(j, link.atom, ground[j], robots[j])
            both = i in group and j in group and robots[i] == robots[j]
            if both and private(j, link.atom) and self._binds(link, ground[j], steps[j]):
                old, new = group[j], group[i]
                group = {k: new if g == old else g for k, g in group.items()}
        jobs = {g: _Job([]) for g in dict.fromkeys(group.values())}
        for i in work:
            job = jobs[group[i]]
            job.steps.append(i)
            job.pinned |= i in pinned
            job.last |= i in last
        numbers = {g: number for number, g in enumerate(jobs)}
        touched: dict[Atom, list[tuple[int, bool]]] = {}
        for i in work:
            changes = changes_of(self._task, steps[i])
            for some in (changes.during, changes.made):
                for atom, state in some.items():
                    touched.setdefault(atom, []).append((i, state))
        for i, j, atom in reasons(links, touched):
            if i not in group or j not in group or group[i] == group[j]:
                continue
            if robots[i] != robots[j] or not private(j, atom):
                jobs[group[j]].after.add(numbers[group[i]])
        return list(jobs.values())

    def _is_move(self, action: GroundAction) -> bool:
        return any(action is move for moves in self._moves.values() for move, _ in moves)

    def _note_place(self, index: int, atom: Atom, action: GroundAction, robot: str) -> None:
        place = atom.terms.index(robot)
        values = self._order.steps[index].arguments
        essential = {values[i] for i in action.essential}
        number = self._facts.number(atom.predicate)
        if (number, place) in self._moves and all(t in essential for t in atom.terms if t != robot):
            self._places.setdefault(index, []).append(_Place(number, place, atom.terms))

    def _binds(self, link: CausalLink, action: GroundAction, step: PlanStep) -> bool:
        """Whether the consumer of a link about its robot or tools has to be done by the robot of its producer."""
        if any(step.arguments[i] in link.atom.terms for i in action.states):
            return False
        if any(step.arguments[i] in link.atom.terms for i in action.essential):
            return True
        return (link.atom in self._task.init) != link.state  # else other robots are likely to be so, too

    # -- dealing -----------------------------------------------------------------------------------------------

    def deal(self) -> tuple[PlanStep, ...] | None:
        """See `reassigned`."""
        jobs = self._jobs()
        best = self._first_done(jobs) if jobs else None
        if best is None or not self._robots:  # nobody can do anything but what is begun
            return None
        actions = [step.action for step in self._order.steps]
        least = {n: sum(self._least.get(actions[i], 0.0) for i in job.steps) for n, job in enumerate(jobs)}
        queue = self._in_order(jobs)
        low, high = sum(least.values()) / len(self._robots), best.makespan
        for _ in range(HALVINGS):
            limit = (low + high) / 2
            dealt = self._filled(queue, jobs, least, limit)
            if dealt is None:
                low = limit
            else:
                best, high = dealt, dealt.makespan
        return tuple(best.plan)

    def _in_order(self, jobs: Sequence[_Job]) -> list[int]:
        """The jobs, one after the other, in the order of the plan as far as they may be."""
        waiting = dict(enumerate(jobs))
        found = []
        while waiting:
            found.append(self._ready(waiting)[0])
            del waiting[found[-1]]
        return found

    def _filled(
        self, queue: Sequence[int], jobs: Sequence[_Job], least: Mapping[int, float], limit: float
    ) -> _Dealt | None:
        """Robots filled with jobs, one robot after the other; None where time is too short.

        :param queue: the jobs in order.
        :param least: the seconds that each job takes at least.
        :param limit: s for each robot.
        """
        self._timeline.reset()
        dealt = _Dealt()
        for number in queue:
            for robot in sorted(self._candidates(jobs[number])):
                if self._timeline.free(robot) + least[number] > limit:
                    continue
                end = self._try(jobs[number], robot)
                if end is not None and end <= limit:
                    self._keep(dealt, end)
                    break
                self._timeline.take_back()
            else:
                return None
        return dealt

    def _first_done(self, jobs: Sequence[_Job]) -> _Dealt | None:
        """Again and again the job and the robot that are done first."""
        self._timeline.reset()
        dealt = _Dealt()
        waiting = dict(enumerate(jobs))
        window = max(LEAST_WINDOW, TRIALS // max(1, len(jobs)))
        tried: dict[tuple[int, str], tuple[float | None, set[Fact]]] = {}
        while waiting:
            best: tuple[float, int, str] | None = None
            for number in self._ready(waiting)[:window]:
                for robot in self._candidates(jobs[number]):
                    if (number, robot) not in tried:
                        end = self._try(jobs[number], robot)
                        tried[number, robot] = end, self._timeline.used
                        self._timeline.take_back()
                    end = tried[number, robot][0]
                    if end is not None and (best is None or end < best[0]):
                        best = end, number, robot
            if best is None:
                return None
            end, number, robot = best
            self._try(jobs[number], robot)
            changed = self._timeline.used
            self._keep(dealt, end)
            del waiting[number]
            tried = {key: value for key, value in tried.items() if key[1] != robot and value[1].isdisjoint(changed)}
        return dealt

    def _ready(self, waiting: Mapping[int, _Job]) -> list[int]:
        """The jobs that may be next, those that say where robots have to be in the end when there are no others."""
        ready = [n for n, job in waiting.items() if not job.after & waiting.keys()]
        return [n for n in ready if not waiting[n].last] or ready

    def _keep(self, dealt: _Dealt, end: float) -> None:
        """Keeps the job that was tried last.

        :param end: when it ends (s).
        """
        dealt.plan += self._tried
        dealt.makespan = max(dealt.makespan, end)
        self._timeline.commit()

    def _candidates(self, job: _Job) -> list[str]:
        """The robots that may do a job, the one of the plan first."""
        first = self._order.steps[job.steps[0]]
        own = first.arguments[self._actions[first.action].robot]
        return [own] if job.pinned else [own, *(r for r in self._robots if r != own)]

    def _try(self, job: _Job, robot: str) -> float | None:
        """Does a job on the timeline and tells when it ends (s); None: the robot cannot do it."""
        self._tried: list[PlanStep] = []
        for index in job.steps:
            for place in self._places.get(index, ()):
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

    def _move(self, place: _Place, robot: str) -> bool:
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


_Moves = Mapping[tuple[int, int], list[tuple[GroundAction, list[int]]]]


def _moves(actions: Collection[GroundAction], facts: Facts) -> _Moves:
    """The actions that change nothing but the robot's state, by the predicate that they make true and the robot's place
    in it, with the variables of its terms. What else they need follows from the robot."""
    found: dict[tuple[int, int], list[tuple[GroundAction, list[int]]]] = {}
    for ground in actions:
        action = ground.action
        index = {v.name: i for i, v in enumerate(action.variables)}
        for effect in action.effects if ground.moves else ():
            terms = [index.get(t, -1) for t in effect.atom.terms]
            if effect.state and -1 not in terms and set(ground.essential) <= set(terms):
                key = facts.number(effect.atom.predicate), terms.index(ground.robot)
                found.setdefault(key, []).append((ground, terms))
    return found
