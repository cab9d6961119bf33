"""What was otherwise in one run than in another: goals, tasks, states of nodes, changes of the world, the end.

Runs are matched by order: the first task of a robot with the first one of that robot, the first change by an author
with the first one by that author. What several robots do at the same time may come in any order. Behind its first
difference, a sequence is not compared further: one thing that is missing would shift all the rest. Changes that only
move something are not compared one by one; where things are at the end is.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum

from skiros2_bags.core.contract_types import MONITOR, PROGRESS
from skiros2_bags.core.moving import without_moves
from skiros2_bags.core.normal import NARROW, Tolerance, change_differences, element_differences, same_text, summary
from skiros2_bags.core.run import Run
from skiros2_bags.core.task_trace import FAILURE, STATES, SUCCESS, NodeState, NodeTrace, TaskTrace
from skiros2_bags.core.world_changes import TimedChange
from skiros2_common.core.names import id_order

_NOTHING = "nothing more"


class Kind(StrEnum):
    """What a difference is about."""

    GOAL = "goal"
    TASK = "task"
    NODE = "node"
    CHANGE = "change"
    SCENE = "scene at the end"


#: Of differences that showed at the same time, what tells most comes first.
_ORDER = {kind: number for number, kind in enumerate((Kind.NODE, Kind.CHANGE, Kind.TASK, Kind.GOAL, Kind.SCENE))}


@dataclass(frozen=True)
class Difference:
    """Something that was otherwise.

    :param time: when it showed first, in whichever run that was earlier (s since the start of that run).
    :param where: the goal, task, node, author or element.
    :param expected: as it was in the first run.
    :param got: as it was in the other.
    """

    kind: Kind
    time: float
    where: str
    expected: str
    got: str


def differences(run: Run, other: Run, tolerance: Tolerance = NARROW) -> list[Difference]:
    """What is otherwise, the first divergence first; empty when the runs are alike.

    :param run: what is expected.
    :param tolerance: how far measured numbers may be apart.
    :raises BagError: one of the bags cannot be read, or changes of the world model are missing in it.
    """
    found = [*_goals(run, other), *_tasks(run, other), *_changes(run, other, tolerance)]
    return sorted(found, key=lambda d: (d.time, _ORDER[d.kind])) + list(_scene(run, other, tolerance))


# -- goals ------------------------------------------------------------------------------------------------------------


def _goals(run: Run, other: Run) -> Iterator[Difference]:
    """The first goal that is another one, and the first outcome."""
    for tell in (_goal_texts, _outcomes):
        expected, got = tell(run), tell(other)
        found = _first_otherwise([text for _, text in expected], [text for _, text in got])
        if found is not None:
            yield _difference(Kind.GOAL, f"goal {found + 1}", found, expected, got)
            return


def _goal_texts(run: Run) -> list[tuple[float, str]]:
    return [(goal.time - run.start, goal.goals) for goal in run.goals()]


def _outcomes(run: Run) -> list[tuple[float, str]]:
    ends = [(goal, run.end if goal.end is None else goal.end) for goal in run.goals()]
    return [(end - run.start, f"{goal.goals}: {goal.state or 'no answer'}") for goal, end in ends]


# -- tasks ------------------------------------------------------------------------------------------------------------


def _tasks(run: Run, other: Run) -> Iterator[Difference]:
    expected, got = (_by_robot(r) for r in (run, other))
    for robot in sorted({*expected, *got}):
        tasks = [[(t.start - r.start, _task_text(t)) for t in found[robot]] for r, found in
                 ((run, expected), (other, got))]  # fmt: skip
        parted = _first_otherwise([text for _, text in tasks[0]], [text for _, text in tasks[1]])
        for number, (one, two) in enumerate(zip(expected[robot][:parted], got[robot][:parted], strict=False), 1):
            yield from _nodes(f"{robot}, task {number}", one, two, run.start, other.start)
        if parted is not None:
            yield _difference(Kind.TASK, f"{robot}, task {parted + 1}", parted, *tasks)


def _by_robot(run: Run) -> dict[str, list[TaskTrace]]:
    tasks = defaultdict(list)
    for task in run.tasks() if PROGRESS in run.topics.values() else []:
        tasks[task.robot].append(task)
    return tasks


def _task_text(task: TaskTrace) -> str:
    return ", ".join(node.name for node in task.nodes.values() if node.depth == 1) or "an empty task"


def _nodes(where: str, one: TaskTrace, two: TaskTrace, start: float, other_start: float) -> Iterator[Difference]:
    """The first node, in time, whose states went another way; the deepest of those that did at that time."""
    expected, got = _places(one), _places(two)
    found = []
    for place in dict.fromkeys([*expected, *got]):
        sides = [
            [(s.time - begin, _state_text(s)) for s in _ends(nodes.get(place))]
            for nodes, begin in ((expected, start), (got, other_start))
        ]
        number = _first_end_otherwise(_ends(expected.get(place)), _ends(got.get(place)))
        if number is not None:
            path = " / ".join(place)
            found.append((len(place), _difference(Kind.NODE, f"{where}: {path}", number, *sides)))
    if found:
        yield min(found, key=lambda entry: (round(entry[1].time, 3), -entry[0]))[1]


def _places(task: TaskTrace) -> dict[tuple[str, ...], NodeTrace]:
    """The nodes by the names on the way to them; those of one name are numbered."""
    places: dict[int, tuple[str, ...]] = {}
    found: dict[tuple[str, ...], NodeTrace] = {}
    for node in task.nodes.values():
        above = places.get(node.parent_id, ()) if node.depth else ()
        place, number = (*above, node.name), 1
        while place in found:
            number += 1
            place = (*above, f"{node.name} ({number})")
        places[node.id] = place
        found[place] = node
    return found


def _ends(node: NodeTrace | None) -> list[NodeState]:
    """How each run of a node ended, and what it was at last; whether it was seen running before is a matter of time."""
    if node is None:
        return []
    states = node.state_changes()
    return [s for s in states if s.state in (SUCCESS, FAILURE) or s is states[-1]]


def _first_end_otherwise(expected: Sequence[NodeState], got: Sequence[NodeState]) -> int | None:
    for number, (one, two) in enumerate(zip(expected, got, strict=False)):
        if one.state != two.state or (one.state == FAILURE and not same_text(one.message, two.message, NARROW)):
            return number
    return None if len(expected) == len(got) else min(len(expected), len(got))


def _state_text(state: NodeState) -> str:
    text = STATES.get(state.state, str(state.state))
    return f"{text}: {state.message}" if state.message else text


# -- the world --------------------------------------------------------------------------------------------------------


def _changes(run: Run, other: Run, tolerance: Tolerance) -> Iterator[Difference]:
    expected, got = (_by_author(r) for r in (run, other))
    for author in sorted({*expected, *got}):
        one, two = expected[author], got[author]
        for number in range(max(len(one), len(two))):
            both = number < len(one) and number < len(two)
            otherwise = change_differences(one[number].change, two[number].change, tolerance) if both else []
            if both and not otherwise:
                continue
            sides = [[(t.time - r.start, summary(t.change)) for t in side] for r, side in ((run, one), (other, two))]
            difference = _difference(Kind.CHANGE, f"change {number + 1} by {author}", number, *sides)
            if otherwise and difference.expected == difference.got:
                got_text = "; ".join(otherwise)
                difference = Difference(
                    difference.kind, difference.time, difference.where, difference.expected, got_text
                )
            yield difference
            break


def _by_author(run: Run) -> dict[str, list[TimedChange]]:
    changes = defaultdict(list)
    for timed in without_moves(run.changes()) if MONITOR in run.topics.values() else []:
        changes[timed.change.author].append(timed)
    return changes


def _scene(run: Run, other: Run, tolerance: Tolerance) -> Iterator[Difference]:
    if MONITOR not in run.topics.values() or MONITOR not in other.topics.values():
        return
    expected, got = run.world(), other.world()
    for eid in sorted({node.id for scene in (expected, got) for node in scene}, key=id_order):
        one, two = expected.element(eid), got.element(eid)
        if one is None or two is None:
            there = [f'there, "{e.label}"' if e is not None else "not there" for e in (one, two)]
            yield Difference(Kind.SCENE, run.end - run.start, eid, *there)
        else:
            for text in element_differences(one, two, tolerance):
                yield Difference(Kind.SCENE, run.end - run.start, f'{eid} "{one.label}"', "", text)


# -- sequences --------------------------------------------------------------------------------------------------------


def _first_otherwise(expected: Sequence[str], got: Sequence[str]) -> int | None:
    for number, (one, two) in enumerate(zip(expected, got, strict=False)):
        if one != two:
            return number
    return None if len(expected) == len(got) else min(len(expected), len(got))


def _difference(
    kind: Kind, where: str, number: int, expected: Sequence[tuple[float, str]], got: Sequence[tuple[float, str]]
) -> Difference:
    """The difference of two sequences of (time, text) at a place."""
    one, two = (side[number] if number < len(side) else None for side in (expected, got))
    time = min(entry[0] for entry in (one, two) if entry is not None)
    return Difference(kind, time, where, *(entry[1] if entry is not None else _NOTHING for entry in (one, two)))
