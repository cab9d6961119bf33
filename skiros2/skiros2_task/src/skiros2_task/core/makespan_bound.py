"""A lower bound of the makespan of a plan's parts, in any order and on any robots.

A relaxation: robots and durations are the fastest ones, parts may run in any order, and a move takes the shortest
time of any. What remains is work, moves between parts at different places, and the first moves: a robot that works
has to get to the first of its parts. It takes one pass over pairs of parts; schedules of transports are 0 to 9 %
above it. An exact search (CP-SAT) would prove more, and needs a large library.

It holds for the parts of the plan: a plan with other parts may be shorter.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

from skiros2_task.core.formula import Predicate
from skiros2_task.core.plan_parts import Moves, Part, Target
from skiros2_task.core.semantics import Facts
from skiros2_task.core.task import PlanningTask, PlanStep

_Key = tuple[Predicate, int]
_Place = tuple[str, ...]


@dataclass
class _Work:
    """The work of a part.

    :param seconds: the shortest duration, with the moves within the part.
    :param first, last: where the robot has to be, at first and at last.
    """

    seconds: float
    first: dict[_Key, _Place]
    last: dict[_Key, _Place]


def makespan_bound(
    task: PlanningTask,
    parts: Sequence[Part],
    steps: Sequence[PlanStep],
    moves: Moves,
    seconds: Mapping[str, float],
    robots: Collection[str],
) -> float:
    """Returns a time that no schedule of the parts is shorter than (s).

    :param steps: those of the plan.
    :param seconds: the shortest duration of each action's skill on any robot.
    :param robots: those that may execute parts.
    """
    names = {key: {roles.action.name for roles, _ in some} for key, some in moves.items()}
    moving = set().union(*names.values())
    times = {key: min(map(seconds.__getitem__, some)) for key, some in names.items() if _is_exclusive(task, key, some)}
    work = [_work(part, steps, moving, seconds, times) for part in parts]
    if not work or not robots:
        return 0.0
    starts = [min(_way(_places(task.init, times, robot), part, times) for robot in robots) for part in work]
    ways = [
        min((_way(other.last, part, times) for other in work if other is not part), default=starts[number])
        for number, part in enumerate(work)
    ]
    # Each part is the first one of its robot, or is reached from another part.
    first = sorted(start - way for start, way in zip(starts, ways, strict=True))
    least = sorted(part.seconds + way for part, way in zip(work, ways, strict=True))
    bounds = []
    for count in range(1, min(len(robots), len(work)) + 1):  # robots that work
        all_together = (sum(least) + sum(first[:count])) / count
        some_robot = sum(least[: -(-len(work) // count)]) + first[0]
        bounds.append(max(all_together, some_robot))
    return max(min(bounds), max(part.seconds for part in work))


def _work(
    part: Part,
    steps: Sequence[PlanStep],
    moving: Collection[str],
    seconds: Mapping[str, float],
    times: Mapping[_Key, float],
) -> _Work:
    found, has_moved = _Work(0.0, {}, {}), False
    for index in part.steps:
        name = steps[index].action
        for target in part.targets.get(index, ()):
            key, place = (target.predicate, target.position), _place(target)
            if key in times:
                found.seconds += times[key] if found.last.get(key, place) != place else 0.0
                found.last[key] = place
                if not has_moved:
                    found.first.setdefault(key, place)
        found.seconds += seconds[name]
        if name in moving:  # where the robot is then is not looked up
            has_moved = True
            found.last.clear()
    return found


def _place(target: Target) -> _Place:
    return target.terms[: target.position] + target.terms[target.position + 1 :]


def _places(init: Facts, times: Mapping[_Key, float], robot: str) -> dict[_Key, _Place]:
    """Returns where a robot is at the start."""
    return {
        (atom.predicate, position): atom.terms[:position] + atom.terms[position + 1 :]
        for atom in init
        for position, term in enumerate(atom.terms)
        if term == robot and (atom.predicate, position) in times
    }


def _way(before: Mapping[_Key, _Place], part: _Work, times: Mapping[_Key, float]) -> float:
    """Returns the shortest time of the moves that a robot needs to begin a part (s)."""
    return max((times[key] for key, place in part.first.items() if before.get(key, place) != place), default=0.0)


def _is_exclusive(task: PlanningTask, key: _Key, moves: set[str]) -> bool:
    """Whether a robot is at one place at most: only moves bring it to another one, and take it away from the first."""
    predicate, position = key
    robots = [atom.terms[position] for atom in task.init if atom.predicate == predicate]
    for action in task.actions:
        changes = [(e.atom.terms[position], e.state) for e in action.effects if e.atom.predicate == predicate]
        if changes and not (action.name in moves and sorted(changes) == [(action.robot, False), (action.robot, True)]):
            return False
    return len(robots) == len(set(robots))
