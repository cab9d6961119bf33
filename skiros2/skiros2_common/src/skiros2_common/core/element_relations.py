"""Comparison and lookup of relation dicts. Names are kept as written and compared by their full form."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from skiros2_common.core.names import full_name

#: A relation in the contract's form: src, type, dst (str; "-1" is the element itself), state, abstract (bool).
RelationDict = dict[str, Any]

#: Ids that denote the element itself in a lookup.
_SELF = ("-1", "")


def relation_key(relation: RelationDict) -> tuple[Any, ...]:
    """A key that is equal for equal relations, in any spelling and with or without the optional parts."""
    return (
        relation["src"],
        full_name(relation["type"]),
        relation["dst"],
        bool(relation.get("state", True)),
        bool(relation.get("abstract", False)),
    )


def is_fact(relation: RelationDict) -> bool:
    """Whether the relation holds in a scene: its state is True and it is not abstract."""
    return bool(relation.get("state", True)) and not relation.get("abstract", False)


def selected(relations: Iterable[RelationDict], subj: str, pred: str | Sequence[str], obj: str) -> list[RelationDict]:
    """The relations with that subject, predicate (one or several) and object; an empty one matches any."""
    names = {full_name(p) for p in ([pred] if isinstance(pred, str) else pred) if p}
    return [
        r
        for r in relations
        if (not subj or r["src"] == subj)
        and (not obj or r["dst"] == obj)
        and (not names or full_name(r["type"]) in names)
    ]


def holds(
    relations: Iterable[RelationDict], eid: str, subj: str, pred: str, obj: str, value: bool, abstract: bool
) -> bool:
    """Whether exactly that relation exists; "-1" or "" as subject, otherwise as object, denotes the element.

    :param eid: the element's id.
    """
    subjects, objects = {subj}, {obj}
    own_ids = {"-1", eid} if eid else {"-1"}
    if subj in _SELF:
        subjects |= own_ids
    elif obj in _SELF:
        objects |= own_ids
    wanted = {(s, full_name(pred), o, bool(value), bool(abstract)) for s in subjects for o in objects}
    return any(relation_key(r) in wanted for r in relations)
