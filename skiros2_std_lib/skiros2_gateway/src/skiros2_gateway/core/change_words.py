"""Changes of the world model as sentences."""

from __future__ import annotations

from collections.abc import Iterator

from skiros2_common.core.property import Property
from skiros2_common.core.wording import visible
from skiros2_task.core.preview import FactChange, change_sentences
from skiros2_world_model.core.formatting import format_value
from skiros2_world_model.core.history import HistoryEntry, changed_properties


def entry_sentences(entry: HistoryEntry) -> list[str]:
    """Returns the changes of an entry, such as "state of demo:Tray-11 is Full (was Empty)". They have ids: a label may
    be misleading.
    """
    statements = [f"the world model does not state {text} any more" for text in entry.unstated]
    statements += [f"the world model states {text}" for text in entry.stated]
    return [visible(text) for text in (*change_sentences(_facts(entry), str), *statements)]


def _facts(entry: HistoryEntry) -> Iterator[FactChange]:
    for eid, (before, after) in entry.changes.records.items():
        if before is None or after is None:
            yield FactChange(eid, "", "", state=before is None)
            continue
        for name, was, now in (("type", before.type, after.type), ("label", before.label, after.label)):
            if was != now:
                yield from (FactChange(eid, name, was, False), FactChange(eid, name, now, True))
        for key, old, new in changed_properties(before, after):
            yield from (FactChange(eid, key, text, False) for text in _texts(old))
            yield from (FactChange(eid, key, text, True) for text in _texts(new))
    for (subject, relation, other), is_added in entry.changes.relations.items():
        yield FactChange(subject, relation, other, is_added, is_relation=True)


def _texts(prop: Property | None) -> list[str]:
    return [format_value(value) for value in prop.values] if prop is not None else []
