"""Differences between elements and changes of the world model in two runs.

- Time stamps are not compared; measured numbers within a tolerance.
- The leading slash of a skill manager's name is ignored.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Any

from skiros2_common.core.world_element import Element
from skiros2_runs.core.tolerance import Tolerance, same_values
from skiros2_world_model.core.changes import Change

#: The property with the name of a robot's skill manager; with a leading slash in older bags.
_MANAGER = "skiros:SkillMgr"

#: Properties that differ in every run.
STAMPS = frozenset({"skiros:TfTimeStamp"})


def diff_elements(
    expected: Element, got: Element, tolerance: Tolerance, ignored: Collection[str] = STAMPS
) -> list[str]:
    """Returns the differences between two elements, one line each.

    :param ignored: keys of properties that are not compared.
    """
    lines = []
    if (expected.type, expected.label) != (got.type, got.label):
        lines.append(f"is {got.type} {got.label!r}, expected {expected.type} {expected.label!r}")
    for key in sorted({*expected._props, *got._props} - set(ignored)):
        wanted, found = (e._props[key].values if key in e._props else [] for e in (expected, got))
        if key == _MANAGER:
            wanted, found = ([str(v).lstrip("/") for v in values] for values in (wanted, found))
        if not same_values(wanted, found, tolerance):
            lines.append(f"{key} is {_format_values(found)}, expected {_format_values(wanted)}")
    wanted_relations, found_relations = _relations(expected), _relations(got)
    lines += [f"lacks {' '.join(relation)}" for relation in sorted(wanted_relations - found_relations)]
    return lines + [f"has {' '.join(relation)}" for relation in sorted(found_relations - wanted_relations)]


def diff_changes(expected: Change, got: Change, tolerance: Tolerance) -> list[str]:
    """Returns the differences between two changes, one line each."""
    wanted, found = {e.id: e for e in expected.elements}, {e.id: e for e in got.elements}
    if (expected.action, wanted.keys()) != (got.action, found.keys()):
        return [f"{summary(got)}, expected {summary(expected)}"]
    lines = [f"{eid} {line}" for eid in wanted for line in diff_elements(wanted[eid], found[eid], tolerance)]
    if _facts(expected.relations) != _facts(got.relations):
        lines.append(f"{summary(got)}, expected {summary(expected)}")
    return lines


def summary(change: Change) -> str:
    """Returns the action of a change and the ids of its elements, in one line."""
    parts = [e.id for e in change.elements] + [" ".join(fact) for fact in sorted(_facts(change.relations))]
    return f"{change.action} {', '.join(parts) or 'of the ontologies'}"


def _relations(element: Element) -> set[tuple[str, str, str]]:
    facts = _facts(element._rels)
    return {tuple(element.id if end == "-1" else end for end in fact) for fact in facts}  # type: ignore[misc]


def _facts(relations: Sequence[Any]) -> set[tuple[str, str, str]]:
    return {(r["src"], r["type"], r["dst"]) for r in relations}


def _format_values(values: Sequence[Any]) -> str:
    return ", ".join(f"{value:g}" if isinstance(value, float) else str(value) for value in values) or "not there"
