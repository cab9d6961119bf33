"""Parts of a scene that have changed since a change, so that it cannot be applied."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator

from skiros2_common.core.changeset import ChangeSet, ElementRecord, Relation, changed_keys, same_values
from skiros2_common.core.names import id_number, local_name
from skiros2_common.core.property import Property
from skiros2_world_model.core.formatting import format_values
from skiros2_world_model.core.scene import Scene


def changed_parts(change_set: ChangeSet, scene: Scene) -> list[str]:
    """Describes the parts of a scene that have changed since, so that the change set cannot be applied.

    :returns: a text for each part, with the author and time of the last change of its element.
    """
    parts: dict[str, list[str]] = {}
    for eid, reason in (*_elements(change_set, scene), *_relations(change_set, scene)):
        parts.setdefault(eid, []).append(reason)
    return [f"{eid} was changed{_author(scene, eid)}: {', '.join(reasons)}" for eid, reasons in parts.items()]


def _elements(change_set: ChangeSet, scene: Scene) -> Iterator[tuple[str, str]]:
    for eid, (before, after) in change_set.records.items():
        current = scene.record(eid)
        if before is None:
            if current is not None:
                yield eid, "an element with its id exists again"
        elif current is None:
            yield eid, "it no longer exists"
        elif after is None:
            keys = {*before.properties, *current.properties}
            yield from ((eid, reason) for reason in _content(current, before, None, keys))
            for relation in [*scene.relations(eid), *scene.relations(dst=eid)]:
                if change_set.relations.get(relation) is not False:
                    yield eid, f"relation added: {_text(relation)}"
        else:
            keys = changed_keys(before, after)
            yield from ((eid, reason) for reason in _content(current, before, after, keys))


def _content(
    current: ElementRecord, before: ElementRecord, after: ElementRecord | None, keys: Iterable[str]
) -> Iterator[str]:
    """The differences of an element from its expected state `before`, in what changes to `after` (None: in all)."""
    for key in sorted(keys):
        expected, found = before.properties.get(key), current.properties.get(key)
        if not same_values(expected, found):
            yield f"{local_name(key)} is now {_value_text(found)}, expected {_value_text(expected)}"
    if current.label != before.label and (after is None or after.label != before.label):
        yield f"its label is now {current.label or '(none)'}, expected {before.label or '(none)'}"
    if current.type != before.type and (after is None or after.type != before.type):
        yield f"its class is now {current.type}, expected {before.type}"


def _relations(change_set: ChangeSet, scene: Scene) -> Iterator[tuple[str, str]]:
    for relation, added in change_set.relations.items():
        ends = [eid for eid in (relation[0], relation[2]) if id_number(eid) >= 0]
        missing = [eid for eid in ends if not _exists(change_set, scene, eid)]
        for eid in missing if added else ():
            yield eid, f"it no longer exists; cannot restore {_text(relation)!r}"
        if not missing and scene.related(*relation) == added:
            yield relation[0], f"the relation {_text(relation)!r} was {'added again' if added else 'removed'}"


def _exists(change_set: ChangeSet, scene: Scene, eid: str) -> bool:
    """Whether an element exists, or is added by the change set."""
    return eid in scene or (eid in change_set.records and change_set.records[eid][1] is not None)


def _author(scene: Scene, eid: str) -> str:
    record = scene.record(eid)
    last = record.change_info if record is not None else scene.removal(eid)
    if last is None or not last.author:
        return ""
    return f" by {last.author.strip('/')} at {time.strftime('%H:%M:%S', time.localtime(last.stamp))}"


def _text(relation: Relation) -> str:
    return f"{relation[0]} {local_name(relation[1])} {relation[2]}"


def _value_text(prop: Property | None) -> str:
    if prop is None:
        return "not there"
    return format_values(prop.values) if prop.values else "empty"
