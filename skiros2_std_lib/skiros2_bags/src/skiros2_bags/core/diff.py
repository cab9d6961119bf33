"""Differences between two runs: goals, tasks, node states, changes of the world model, final scene.

Runs are matched by order: the n-th task of a robot with the n-th task of that robot, the n-th change by an author with
the n-th change by that author. The order between robots is not compared. A sequence is compared up to its first
difference, since one missing entry shifts the rest. Pose updates are not compared one by one, only the final poses.
Registered skills are matched by label; their comments are not compared.

Time stamps are not compared, measured numbers within a tolerance, and names of skill managers without the leading
slash.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from skiros2_bags.core.bag_file import MONITOR, PROGRESS
from skiros2_bags.core.registered_skills import RegisteredSkills
from skiros2_bags.core.run import Run
from skiros2_bags.core.world_history import TimedChange
from skiros2_common.core.names import id_order
from skiros2_common.core.operations import UPDATE, Change
from skiros2_common.core.world_element import Element
from skiros2_runs.core.compare import compare_task_runs
from skiros2_runs.core.task_run import TaskRun
from skiros2_runs.core.tolerance import NARROW, Tolerance, same_values
from skiros2_world_model.core.replica import apply_change
from skiros2_world_model.core.scene import Scene

_NOTHING = "nothing more"


class Kind(StrEnum):
    """The subject of a difference."""

    GOAL = "goal"
    TASK = "task"
    NODE = "node"
    CHANGE = "change"
    SCENE = "scene at the end"


#: Order of differences at the same time: the most specific subject first.
_ORDER = {kind: number for number, kind in enumerate((Kind.NODE, Kind.CHANGE, Kind.TASK, Kind.GOAL, Kind.SCENE))}


@dataclass(frozen=True)
class Difference:
    """One difference.

    :param time: when it first occurred, in the earlier of the two runs (s since the start of that run).
    :param where: the goal, task, node, author or element.
    :param expected: the value in the first run.
    :param got: the value in the second run.
    """

    kind: Kind
    time: float
    where: str
    expected: str
    got: str


def diff_runs(run: Run, other: Run, tolerance: Tolerance = NARROW) -> list[Difference]:
    """Returns the differences of two runs, the first divergence first.

    :param run: the expected run.
    :param tolerance: of measured numbers.
    :raises BagError: a bag cannot be read, or lacks changes of the world model.
    """
    found = [*_goals(run, other), *_tasks(run, other, tolerance), *_changes(run, other, tolerance)]
    return sorted(found, key=lambda d: (d.time, _ORDER[d.kind])) + list(_scene(run, other, tolerance))


# -- goals ------------------------------------------------------------------------------------------------------------


def _goals(run: Run, other: Run) -> Iterator[Difference]:
    """Yields the first different goal; else the first different outcome."""
    for texts_of in (_goal_texts, _outcomes):
        expected, got = texts_of(run), texts_of(other)
        found = _first_difference([text for _, text in expected], [text for _, text in got])
        if found is not None:
            yield _difference(Kind.GOAL, f"goal {found + 1}", found, expected, got)
            return


def _goal_texts(run: Run) -> list[tuple[float, str]]:
    return [(goal.time - run.start, goal.goals) for goal in run.goals()]


def _outcomes(run: Run) -> list[tuple[float, str]]:
    ends = [(goal, run.end if goal.end is None else goal.end) for goal in run.goals()]
    return [(end - run.start, f"{goal.goals}: {goal.state or 'no answer'}") for goal, end in ends]


# -- tasks ------------------------------------------------------------------------------------------------------------


def _tasks(run: Run, other: Run, tolerance: Tolerance) -> Iterator[Difference]:
    expected, got = (_by_robot(r) for r in (run, other))
    for robot in sorted({*expected, *got}):
        tasks = [[(t.start - r.start, t.latest.shape.skills_text()) for t in found[robot]] for r, found in
                 ((run, expected), (other, got))]  # fmt: skip
        first = _first_difference([text for _, text in tasks[0]], [text for _, text in tasks[1]])
        for number, (one, two) in enumerate(zip(expected[robot][:first], got[robot][:first], strict=False), 1):
            found = compare_task_runs(one, two, tolerance)
            if found is not None:
                where = f"{robot}, task {number}: {found.what}"
                yield Difference(Kind.NODE, one.start - run.start + found.time, where, found.expected, found.got)
        if first is not None:
            yield _difference(Kind.TASK, f"{robot}, task {first + 1}", first, *tasks)


def _by_robot(run: Run) -> dict[str, list[TaskRun]]:
    tasks = defaultdict(list)
    for task in run.tasks() if PROGRESS in run.topics.values() else []:
        tasks[task.robot].append(task)
    return tasks


# -- the world --------------------------------------------------------------------------------------------------------


def _changes(run: Run, other: Run, tolerance: Tolerance) -> Iterator[Difference]:
    expected, got = (_by_author(r) for r in (run, other))
    names = _names(run), _names(other)
    for author in sorted({*expected, *got}):
        one, two = expected[author], got[author]
        for number in range(max(len(one), len(two))):
            both = number < len(one) and number < len(two)
            lines = diff_changes(one[number].change, two[number].change, tolerance, names=names) if both else []
            if both and not lines:
                continue
            sides = [[(t.time - r.start, summary(t.change)) for t in side] for r, side in ((run, one), (other, two))]
            difference = _difference(Kind.CHANGE, f"change {number + 1} by {author}", number, *sides)
            if lines and difference.expected == difference.got:
                got_text = "; ".join(lines)
                difference = Difference(
                    difference.kind, difference.time, difference.where, difference.expected, got_text
                )
            yield difference
            break


def _names(run: Run) -> Mapping[str, str]:
    return RegisteredSkills(run.changes()).names if MONITOR in run.topics.values() else {}


def _by_author(run: Run) -> dict[str, list[TimedChange]]:
    changes = defaultdict(list)
    if MONITOR in run.topics.values():
        skills = RegisteredSkills(run.changes())
        for timed in without_moves(run.changes()):
            if not skills.concerns(timed.change):
                changes[timed.change.author].append(timed)
    return changes


def _scene(run: Run, other: Run, tolerance: Tolerance) -> Iterator[Difference]:
    if MONITOR not in run.topics.values() or MONITOR not in other.topics.values():
        return
    expected, got = run.world(), other.world()
    skills = [RegisteredSkills(r.changes()) for r in (run, other)]
    names = skills[0].names, skills[1].names
    yield from _skills(run, skills[0], skills[1], tolerance)
    ids = [{node.id for node in scene} - known.keys() for scene, known in zip((expected, got), names, strict=True)]
    for eid in sorted(ids[0] | ids[1], key=id_order):
        one, two = expected.element(eid), got.element(eid)
        if one is None or two is None:
            there = [f'there, "{e.label}"' if e is not None else "not there" for e in (one, two)]
            yield Difference(Kind.SCENE, run.end - run.start, eid, *there)
        else:
            for text in diff_elements(one, two, tolerance, names=names):
                yield Difference(Kind.SCENE, run.end - run.start, f'{eid} "{one.label}"', "", text)


def _skills(run: Run, one: RegisteredSkills, two: RegisteredSkills, tolerance: Tolerance) -> Iterator[Difference]:
    for name in sorted({*one.elements, *two.elements}):
        expected, got = one.elements.get(name), two.elements.get(name)
        if expected is None or got is None:
            there = ["registered" if e is not None else "not registered" for e in (expected, got)]
            yield Difference(Kind.SCENE, run.end - run.start, name, *there)
        else:
            for text in diff_elements(expected, got, tolerance, STAMPS | COMMENTS, names=(one.names, two.names)):
                yield Difference(Kind.SCENE, run.end - run.start, name, "", text)


# -- sequences --------------------------------------------------------------------------------------------------------


def _first_difference(expected: Sequence[str], got: Sequence[str]) -> int | None:
    for number, (one, two) in enumerate(zip(expected, got, strict=False)):
        if one != two:
            return number
    return None if len(expected) == len(got) else min(len(expected), len(got))


def _difference(
    kind: Kind, where: str, number: int, expected: Sequence[tuple[float, str]], got: Sequence[tuple[float, str]]
) -> Difference:
    """Returns the difference of two sequences of (time, text) at an index."""
    one, two = (side[number] if number < len(side) else None for side in (expected, got))
    time = min(entry[0] for entry in (one, two) if entry is not None)
    return Difference(kind, time, where, *(entry[1] if entry is not None else _NOTHING for entry in (one, two)))


#: The properties of a pose, and its stamp.
POSE = re.compile(r"skiros:(Position[XYZ]|Orientation[XYZW]|TfTimeStamp)")


def without_moves(changes: Iterable[TimedChange]) -> list[TimedChange]:
    """Returns the changes that are not pose updates.

    :param changes: all changes of a run, in order.
    """
    scene = Scene()
    kept = []
    for timed in changes:
        if not _only_moves(scene, timed.change):
            kept.append(timed)
        apply_change(scene, timed.change)
    return kept


def _only_moves(scene: Scene, change: Change) -> bool:
    if change.action != UPDATE or change.relations or not change.elements:
        return False
    return all(_is_moved(scene.element(element.id), element) for element in change.elements)


def _is_moved(before: Element | None, after: Element) -> bool:
    """Whether two versions of an element differ in nothing but the pose."""
    if before is None or (before.type, before.label) != (after.type, after.label):
        return False
    if _facts(before.relation_view) != _facts(after.relation_view):
        return False
    keys = {*before.property_view, *after.property_view}
    return all(POSE.fullmatch(key) for key in keys if _values(before, key) != _values(after, key))


def _values(element: Element, key: str) -> list[object] | None:
    prop = element.property_view.get(key)
    return prop.values if prop is not None else None


#: The property with the name of a robot's skill manager; with a leading slash in older bags.
_MANAGER = "skiros:SkillMgr"

#: Returns the tolerance of a property by its key.
ToleranceOf = Callable[[str], Tolerance]

#: Properties that differ in every run.
STAMPS = frozenset({"skiros:TfTimeStamp"})

#: Properties for people.
COMMENTS = frozenset({"rdfs:comment"})

#: The names of registered skills and their parts by id, in each of two runs.
Names = tuple[Mapping[str, str], Mapping[str, str]]


def diff_elements(
    expected: Element,
    got: Element,
    tolerance: Tolerance | ToleranceOf,
    ignored: Collection[str] = STAMPS,
    names: Names = ({}, {}),
) -> list[str]:
    """Returns the differences between two elements, one line each.

    :param ignored: keys of properties that are not compared.
    :param tolerance: of all values, or what returns that of a property by its key.
    :param names: replace ids in relations, in the first and in the second run.
    """
    lines = []
    if (expected.type, expected.label) != (got.type, got.label):
        lines.append(f"is {got.type} {got.label!r}, expected {expected.type} {expected.label!r}")
    for key in sorted({*expected.property_view, *got.property_view} - set(ignored)):
        wanted, found = (e.property_view[key].values if key in e.property_view else [] for e in (expected, got))
        if key == _MANAGER:
            wanted, found = ([str(v).lstrip("/") for v in values] for values in (wanted, found))
        if not same_values(wanted, found, tolerance if isinstance(tolerance, Tolerance) else tolerance(key)):
            lines.append(f"{key} is {_format_values(found)}, expected {_format_values(wanted)}")
    wanted_relations, found_relations = _relations(expected, names[0]), _relations(got, names[1])
    lines += [f"lacks {' '.join(relation)}" for relation in sorted(wanted_relations - found_relations)]
    return lines + [f"has {' '.join(relation)}" for relation in sorted(found_relations - wanted_relations)]


def diff_changes(
    expected: Change,
    got: Change,
    tolerance: Tolerance | ToleranceOf,
    unchanged: Mapping[str, Collection[str]] | None = None,
    names: Names = ({}, {}),
) -> list[str]:
    """Returns the differences between two changes, one line each.

    :param unchanged: the keys of properties that neither change has written, by element: they are not compared.
    :param tolerance, names: see `diff_elements`.
    """
    ignored = {eid: STAMPS.union(keys) for eid, keys in (unchanged or {}).items()}
    wanted, found = {e.id: e for e in expected.elements}, {e.id: e for e in got.elements}
    if (expected.action, wanted.keys()) != (got.action, found.keys()):
        return [f"{summary(got)}, expected {summary(expected)}"]
    lines = [
        f"{eid} {line}"
        for eid in wanted
        for line in diff_elements(wanted[eid], found[eid], tolerance, ignored.get(eid, STAMPS), names)
    ]
    if _facts(expected.relations) != _facts(got.relations):
        lines.append(f"{summary(got)}, expected {summary(expected)}")
    return lines


def unchanged_keys(change: Change, scene: Scene) -> dict[str, set[str]]:
    """Returns the keys of properties that a change has not written, by element: a change has whole elements.

    :param scene: the scene before the change.
    """
    found = {}
    for element in change.elements:
        before = scene.element(element.id)
        if before is not None:
            keys = before.property_view.keys() & element.property_view.keys()
            found[element.id] = {key for key in keys if _values(before, key) == _values(element, key)}
    return found


def summary(change: Change) -> str:
    """Returns the action of a change and the ids of its elements, in one line."""
    parts = [e.id for e in change.elements] + [" ".join(fact) for fact in sorted(_facts(change.relations))]
    return f"{change.action} {', '.join(parts) or 'of the ontologies'}"


def _relations(element: Element, names: Mapping[str, str]) -> set[tuple[str, str, str]]:
    own = {"-1": names.get(element.id, element.id), **names}
    facts = _facts(element.relation_view)
    return {tuple(own.get(end, end) for end in fact) for fact in facts}  # type: ignore[misc]


def _facts(relations: Sequence[Any]) -> set[tuple[str, str, str]]:
    return {(r["src"], r["type"], r["dst"]) for r in relations}


def _format_values(values: Sequence[Any]) -> str:
    return ", ".join(f"{value:g}" if isinstance(value, float) else str(value) for value in values) or "not there"
