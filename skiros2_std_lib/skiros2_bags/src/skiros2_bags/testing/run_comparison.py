"""Two runs of the same tasks compared: what each node went through, in what order, and what became of the world.

The order of things is compared where the tree fixes it: of what is below a node that runs its children side by side,
only the order within each child. Times may differ, within bounds.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from skiros2_bags.core.normal import Tolerance, change_differences, element_differences, same_text, summary
from skiros2_bags.testing.divergence import CONTEXT, Divergence, both_end_plainly, path_of
from skiros2_bags.testing.recording import Changed, Events, Seen, Told
from skiros2_bags.testing.task_runs import TaskRun, changes_of_tasks, task_runs
from skiros2_common.core.world_element import Element
from skiros2_world_model.core.changes import Change
from skiros2_world_model.core.scene import Scene

#: A task may take so much longer or less long: a part of its time, and seconds beside it.
SLOWER, SECONDS = 1.0, 3.0

#: What processors print that run their children side by side.
_PARALLEL = ("|",)

#: Relations from a robot to what its manager has registered.
_HAS_SKILL = "skiros:hasSkill"
_REGISTERED = (_HAS_SKILL, "skiros:hasParam", "skiros:hasPreCondition", "skiros:hasHoldCondition",
               "skiros:hasPostCondition")  # fmt: skip


@dataclass(frozen=True)
class Step:
    """A node that came into another state.

    :param time: from the start of the task (s).
    """

    time: float
    path: str
    node: Seen

    def __str__(self) -> str:
        words = {"R": "runs", "S": "succeeds", "F": "fails", ".": "is idle again"}
        text = f"{self.path} {words.get(self.node.state, self.node.state)}"
        return f"{text}: {self.node.message}" if self.node.state in "SF" and self.node.message else text


def compare_runs(expected: Events, got: Events, tolerance: Tolerance, managers: Sequence[str]) -> Divergence | None:
    """The first difference between what some managers did in two runs; None when there is none."""
    for manager in managers:
        wanted = [r for r in task_runs(expected) if r.manager == manager]
        found = [r for r in task_runs(got) if r.manager == manager]
        for number, run in enumerate(wanted):
            if number >= len(found):
                return Divergence(_at(expected, run.told[0]), f"{manager}, task {number + 1}", str(run), "no such task")
            divergence = _compare_tasks(run, found[number], number, _at(expected, run.told[0]), tolerance)
            if divergence is not None:
                return divergence
        if len(found) > len(wanted):
            extra = found[len(wanted)]
            return Divergence("at the end", f"{manager}, task {len(wanted) + 1}", "no further task", str(extra))
    for manager in managers:
        divergence = _compare_changes(expected, got, manager, tolerance)
        if divergence is not None:
            return divergence
    return None


def compare_scenes(expected: Scene, got: Scene, tolerance: Tolerance) -> Divergence | None:
    """What is otherwise in two scenes, but for the skills that managers have registered."""
    skipped = _registered(expected) | _registered(got)
    for node in expected:
        if node.id in skipped:
            continue
        wanted, found = _outgoing(expected, node.id, skipped), _outgoing(got, node.id, skipped)
        assert wanted is not None
        if found is None:
            return Divergence("at the end", node.id, "an element of the scene", "no such element")
        differences = element_differences(wanted, found, tolerance)
        if differences:
            return Divergence("at the end", node.id, "as recorded", "\n".join(differences))
    extra = [node.id for node in got if node.id not in expected and node.id not in skipped]
    return Divergence("at the end", "the scene", "no further element", ", ".join(extra)) if extra else None


def steps_of(run: TaskRun) -> list[Step]:
    """The changes of the states of a task's nodes, in order; of those in one tick, the ends come from the leaves up."""
    steps: list[Step] = []
    before: dict[tuple[int, ...], str] = {}
    for message in run.told:
        time = message.time - run.told[0].time
        changed = [node for node in message.nodes if node.state != before.get(node.place, ".")]
        changed.sort(key=lambda node: (1, -len(node.place)) if node.state in "SF" else (0, 0))
        steps += [Step(time, path_of(message.nodes, node.place), node) for node in changed]
        before.update({node.place: node.state for node in message.nodes})
    return steps


# -- tasks -----------------------------------------------------------------------------------------------------------


def _compare_tasks(run: TaskRun, other: TaskRun, number: int, at: str, tolerance: Tolerance) -> Divergence | None:
    wanted, found = steps_of(run), steps_of(other)
    where = f"{at}, task {number + 1}: {run}"
    for one, two in _sequences(run, other, wanted, found):
        for index, step in enumerate(one):
            now = two[index] if index < len(two) else None
            if now is None or not _same(step, now, tolerance):
                context = tuple(f"{s.time:.2f} s: {s}" for s in one[max(0, index - CONTEXT) : index])
                moment = f"{where}, {step.time:.2f} s after its start"
                return Divergence(moment, step.path, str(step), str(now) if now else "nothing more", context)
        if len(two) > len(one):
            return Divergence(where, two[len(one)].path, "nothing more", str(two[len(one)]))
    seconds, now_seconds = (r.told[-1].time - r.told[0].time for r in (run, other))
    if abs(seconds - now_seconds) > SLOWER * seconds + SECONDS:
        return Divergence(where, "how long it takes", f"{seconds:.1f} s", f"{now_seconds:.1f} s")
    return None


def _same(one: Step, other: Step, tolerance: Tolerance) -> bool:
    a, b = one.node, other.node
    if (one.path, a.place, a.type, a.state) != (other.path, b.place, b.type, b.state):
        return False
    if a.state not in "SF" or both_end_plainly(a, b):
        return True
    return (a.code == b.code or a.code >= 0 <= b.code) and same_text(a.message, b.message, tolerance)


def _sequences(
    run: TaskRun, other: TaskRun, wanted: list[Step], found: list[Step]
) -> Iterator[tuple[list[Step], list[Step]]]:
    """Parts of the two runs whose order is fixed: all, or where nodes are run side by side, what is in each of them."""
    parallel = {n.place for r in (run, other) for m in r.told for n in m.nodes if _is_parallel(n.processor)}
    if not parallel:
        yield wanted, found
        return
    places = sorted({s.node.place for s in [*wanted, *found]})
    for place in places:
        yield [s for s in wanted if s.node.place == place], [s for s in found if s.node.place == place]
    for parts in {_branches(place, parallel) for place in places}:
        yield (
            [s for s in wanted if _branches(s.node.place, parallel) == parts],
            [s for s in found if _branches(s.node.place, parallel) == parts],
        )


def _branches(place: tuple[int, ...], parallel: set[tuple[int, ...]]) -> tuple[tuple[int, ...], ...]:
    """The children of nodes that run them side by side which a node is in."""
    return tuple(place[: depth + 1] for depth in range(len(place)) if place[:depth] in parallel)


def _is_parallel(processor: str) -> bool:
    return any(mark in processor for mark in _PARALLEL)


# -- the world -------------------------------------------------------------------------------------------------------


def _compare_changes(expected: Events, got: Events, manager: str, tolerance: Tolerance) -> Divergence | None:
    """The changes that a manager's tasks made of each element, in their order."""
    wanted, found = _by_element(expected, manager), _by_element(got, manager)
    first: tuple[int, Divergence] | None = None
    for key in {*wanted, *found}:
        one, two = wanted.get(key, []), found.get(key, [])
        for index, event in enumerate(one):
            now = two[index].change if index < len(two) else None
            differences = change_differences(event.change, now, tolerance) if now is not None else ["nothing"]
            if differences and (first is None or event.order < first[0]):
                what = f"the world model, {key}, by {manager}"
                text = "\n".join(differences)
                first = event.order, Divergence(_at(expected, event), what, summary(event.change), text)
        if len(two) > len(one) and first is None:
            extra = two[len(one)].change
            first = two[len(one)].order, Divergence("later", f"the world model, {key}", "nothing", summary(extra))
    return first[1] if first is not None else None


def _by_element(events: Events, manager: str) -> dict[str, list[Changed]]:
    found: dict[str, list[Changed]] = defaultdict(list)
    for event in changes_of_tasks(events, [r for r in task_runs(events) if r.manager == manager]):
        change = event.change
        ids = [e.id for e in change.elements] or [f"{r['src']} {r['type']} {r['dst']}" for r in change.relations]
        found[", ".join(ids)].append(replace(event, change=_without_skills(change)))
    return found


def _without_skills(change: Change) -> Change:
    """A change without the relations of robots to their skills, whose ids depend on when they were registered."""

    def kept(element: Element) -> Element:
        relations = [r for r in element._rels if r["type"] != _HAS_SKILL]
        return Element.shared(element.type, element.label, element.id, element._props, relations)

    return replace(change, elements=tuple(map(kept, change.elements)))


def _registered(scene: Scene) -> set[str]:
    """The skills in a scene, with their parameters and conditions."""
    found: set[str] = set()
    waiting = [dst for _, _, dst in scene.relations(preds=[_HAS_SKILL])]
    while waiting:
        eid = waiting.pop()
        if eid not in found:
            found.add(eid)
            waiting += [dst for _, pred, dst in scene.relations(eid) if pred in _REGISTERED]
    return found


def _outgoing(scene: Scene, eid: str, skipped: set[str]) -> Element | None:
    """An element with its relations to others, without those to what is skipped."""
    node = scene.record(eid)
    if node is None:
        return None
    relations = [
        {"src": "-1", "type": pred, "dst": dst, "state": True, "abstract": False}
        for _, pred, dst in scene.relations(eid)
        if dst not in skipped
    ]
    return Element.shared(node.type, node.label, node.id, node.properties, relations)


def _at(events: Events, event: Changed | Told) -> str:
    return f"{event.time - events.events[0].time:.3f} s"
