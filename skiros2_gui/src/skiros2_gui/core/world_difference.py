"""What a change has made other in the scene."""

from __future__ import annotations

from collections.abc import Mapping, Set

from skiros2_common.core.world_element import Element
from skiros2_world_model.core.changes import Change, relation_dict
from skiros2_world_model.core.history_entry import HistoryEntry
from skiros2_world_model.core.scene import ElementRecord

_Relation = tuple[str, str, str]


def made_other(
    change: Change,
    before: Mapping[str, ElementRecord | None],
    after: Mapping[str, ElementRecord | None],
    related_before: Set[_Relation],
    related_after: Set[_Relation],
) -> HistoryEntry:
    """What is other after a change.

    :param before, after: the elements that it was about, None where there was or is none.
    :param related_before, related_after: the relations from and to these.
    """
    entry = HistoryEntry(change.number, change.stamp, change.author, "change")
    for eid, was in before.items():
        now = after[eid]
        if was is not None and now is not None and _same_content(was, now):
            continue
        entry.before += [_element(was)] if was is not None else []
        entry.after += [_element(now)] if now is not None else []
    entry.related = [relation_dict(*r) for r in sorted(related_after - related_before)]
    entry.unrelated = [relation_dict(*r) for r in sorted(related_before - related_after)]
    return entry


def _same_content(one: ElementRecord, other: ElementRecord) -> bool:
    if (one.type, one.label, one.properties.keys()) != (other.type, other.label, other.properties.keys()):
        return False
    return one.properties is other.properties or all(
        prop is other.properties[key] or prop.values == other.properties[key].values
        for key, prop in one.properties.items()
    )


def _element(node: ElementRecord) -> Element:
    return Element.shared(node.type, node.label, node.id, node.properties, (), node.version)
