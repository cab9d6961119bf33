"""Compares a recording with its trace: tasks, changes of the world model, and the final scene."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import replace

from skiros2_bags.core.world_diff import diff_changes, diff_elements, summary
from skiros2_bags.testing.recorded_task import RecordedTask, recorded_tasks, task_changes
from skiros2_bags.testing.recording import Events, TaskProgress, WorldChange
from skiros2_common.core.world_element import Element
from skiros2_runs.core.compare import Divergence, compare_task_runs
from skiros2_runs.core.tolerance import Tolerance
from skiros2_world_model.core.changes import Change
from skiros2_world_model.core.scene import Scene

#: Largest difference of the duration of a task: a fraction of it, plus seconds.
SLOWDOWN, SECONDS = 1.0, 3.0

#: Relations from a robot to its registered skills and their parts.
_HAS_SKILL = "skiros:hasSkill"
_REGISTERED = (_HAS_SKILL, "skiros:hasParam", "skiros:hasPreCondition", "skiros:hasHoldCondition",
               "skiros:hasPostCondition")  # fmt: skip


def compare_runs(expected: Events, got: Events, tolerance: Tolerance, managers: Sequence[str]) -> Divergence | None:
    """Returns the first divergence between two runs of some managers; None without one."""
    for manager in managers:
        wanted = [r for r in recorded_tasks(expected) if r.manager == manager]
        found = [r for r in recorded_tasks(got) if r.manager == manager]
        for number, run in enumerate(wanted):
            if number >= len(found):
                time = _time_text(expected, run.progress[0])
                return Divergence(time, f"{manager}, task {number + 1}", str(run), "no such task")
            time = _time_text(expected, run.progress[0])
            divergence = _compare_tasks(run, found[number], number, time, tolerance)
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
    """Returns the first divergence between two scenes, ignoring registered skills; None without one."""
    skipped = _registered(expected) | _registered(got)
    for node in expected:
        if node.id in skipped:
            continue
        wanted, found = _outgoing(expected, node.id, skipped), _outgoing(got, node.id, skipped)
        assert wanted is not None
        if found is None:
            return Divergence("at the end", node.id, "an element of the scene", "no such element")
        differences = diff_elements(wanted, found, tolerance)
        if differences:
            return Divergence("at the end", node.id, "as recorded", "\n".join(differences))
    extra = [node.id for node in got if node.id not in expected and node.id not in skipped]
    return Divergence("at the end", "the scene", "no further element", ", ".join(extra)) if extra else None


def _compare_tasks(
    task: RecordedTask, other: RecordedTask, number: int, at: str, tolerance: Tolerance
) -> Divergence | None:
    where = f"{at}, task {number + 1}: {task}"
    found = compare_task_runs(task.run, other.run, tolerance, compares_successes=True)
    if found is not None:
        return replace(found, where=f"{where}, {found.where}")
    seconds, now_seconds = (t.progress[-1].time - t.progress[0].time for t in (task, other))
    if abs(seconds - now_seconds) > SLOWDOWN * seconds + SECONDS:
        return Divergence(where, "how long it takes", f"{seconds:.1f} s", f"{now_seconds:.1f} s")
    return None


# -- the world -------------------------------------------------------------------------------------------------------


def _compare_changes(expected: Events, got: Events, manager: str, tolerance: Tolerance) -> Divergence | None:
    """Compares the changes that a manager's tasks made to each element, in order."""
    wanted, found = _changes_by_element(expected, manager), _changes_by_element(got, manager)
    first: tuple[int, Divergence] | None = None
    for key in {*wanted, *found}:
        one, two = wanted.get(key, []), found.get(key, [])
        for index, event in enumerate(one):
            now = two[index].change if index < len(two) else None
            differences = diff_changes(event.change, now, tolerance) if now is not None else ["nothing"]
            if differences and (first is None or event.order < first[0]):
                what = f"the world model, {key}, by {manager}"
                text = "\n".join(differences)
                first = event.order, Divergence(_time_text(expected, event), what, summary(event.change), text)
        if len(two) > len(one) and first is None:
            extra = two[len(one)].change
            first = two[len(one)].order, Divergence("later", f"the world model, {key}", "nothing", summary(extra))
    return first[1] if first is not None else None


def _changes_by_element(events: Events, manager: str) -> dict[str, list[WorldChange]]:
    found: dict[str, list[WorldChange]] = defaultdict(list)
    for event in task_changes(events, [r for r in recorded_tasks(events) if r.manager == manager]):
        change = event.change
        ids = [e.id for e in change.elements] or [f"{r['src']} {r['type']} {r['dst']}" for r in change.relations]
        found[", ".join(ids)].append(replace(event, change=_without_skills(change)))
    return found


def _without_skills(change: Change) -> Change:
    """Removes the relations of robots to their skills, whose ids depend on the order of registration."""

    def stripped(element: Element) -> Element:
        relations = [r for r in element._rels if r["type"] != _HAS_SKILL]
        return Element.shared(element.type, element.label, element.id, element._props, relations)

    return replace(change, elements=tuple(map(stripped, change.elements)))


def _registered(scene: Scene) -> set[str]:
    """Returns the skills in a scene, with their parameters and conditions."""
    found: set[str] = set()
    waiting = [dst for _, _, dst in scene.relations(preds=[_HAS_SKILL])]
    while waiting:
        eid = waiting.pop()
        if eid not in found:
            found.add(eid)
            waiting += [dst for _, pred, dst in scene.relations(eid) if pred in _REGISTERED]
    return found


def _outgoing(scene: Scene, eid: str, skipped: set[str]) -> Element | None:
    """Returns an element with its outgoing relations, without those to skipped elements."""
    node = scene.record(eid)
    if node is None:
        return None
    relations = [
        {"src": "-1", "type": pred, "dst": dst, "state": True, "abstract": False}
        for _, pred, dst in scene.relations(eid)
        if dst not in skipped
    ]
    return Element.shared(node.type, node.label, node.id, node.properties, relations)


def _time_text(events: Events, event: WorldChange | TaskProgress) -> str:
    return f"{event.time - events.events[0].time:.3f} s"
