"""What may differ between two runs, and how values are compared. All rules are here.

- Ids of tasks and goals, times and time stamps: not compared.
- Measured numbers, in texts and properties: within a tolerance. A number in a text counts as measured if it has a
  decimal point or a per cent sign; other numbers, such as those in ids, are compared exactly.
- The labels of groups, and of the root of a task, which contains the id of the task: not compared.
- The success message of a root or compound without its own messages: any of `DEFAULT_SUCCESS`.
- The leading slash of a skill manager's name in the scene: ignored.
- Tracebacks: only the last line is compared.
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Any

from skiros2_common.core.world_element import Element
from skiros2_world_model.core.changes import Change

#: The types of a task's root, and of nodes that only group others.
ROOT_TYPE, GROUP_TYPE = ":Root", ":Skill"

#: The property with the name of a robot's skill manager; with a leading slash in older bags.
_MANAGER = "skiros:SkillMgr"

#: Codes and messages with which nodes with children report success, in bags of any version.
DEFAULT_SUCCESS = frozenset({(0, ""), (1, "Success"), (1, "End")})

#: Properties that differ in every run.
STAMPS = frozenset({"skiros:TfTimeStamp"})

_MEASURED = re.compile(r"(?<![\w.-])-?\d+\.\d+(?:e[-+]?\d+)?|(?<![\w.-])-?\d+(?=\s?%)", re.IGNORECASE)
_TRACEBACK = "Traceback (most recent call last):"


@dataclass(frozen=True)
class Tolerance:
    """Largest difference between measured numbers that count as equal.

    :param relative: as a fraction of the larger number.
    :param absolute: in the unit of the numbers: metres, radians, per cent.
    """

    relative: float = 0.02
    absolute: float = 0.02

    def close(self, one: float, other: float) -> bool:
        """Whether two numbers count as equal."""
        return one == other or math.isclose(one, other, rel_tol=self.relative, abs_tol=self.absolute)


#: For runs without physics.
NARROW = Tolerance(0.001, 0.001)


def same_text(one: str, other: str, tolerance: Tolerance) -> bool:
    """Whether two texts are equal within the tolerance."""
    if one == other:
        return True
    one, other = _without_trace(one), _without_trace(other)
    if _MEASURED.sub("#", one) != _MEASURED.sub("#", other):
        return False
    pairs = zip(_MEASURED.finditer(one), _MEASURED.finditer(other), strict=True)
    return all(_same_number(a.group(), b.group(), tolerance) for a, b in pairs)


def same_values(one: Sequence[Any], other: Sequence[Any], tolerance: Tolerance) -> bool:
    """Whether the values of two properties are equal within the tolerance."""
    return len(one) == len(other) and all(_same_value(a, b, tolerance) for a, b in zip(one, other, strict=True))


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


def _without_trace(text: str) -> str:
    if _TRACEBACK not in text:
        return text
    before, _, after = text.partition(_TRACEBACK)
    raised = after.rstrip().rpartition("\n")[2]
    return before.partition(raised)[0] + raised  # the part before repeats the message, with its source line


def _same_number(one: str, other: str, tolerance: Tolerance) -> bool:
    a, b = float(one), float(other)
    last_digit = max(10.0 ** -len(text.partition(".")[2]) for text in (one, other))
    return tolerance.close(a, b) or abs(a - b) <= last_digit * 1.001


def _same_value(one: Any, other: Any, tolerance: Tolerance) -> bool:
    if isinstance(one, float) or isinstance(other, float):
        try:
            return tolerance.close(float(one), float(other)) or (math.isnan(float(one)) and math.isnan(float(other)))
        except (TypeError, ValueError):
            return False
    if isinstance(one, str) and isinstance(other, str):
        return same_text(one, other, tolerance)
    return bool(one == other)


def _relations(element: Element) -> set[tuple[str, str, str]]:
    facts = _facts(element._rels)
    return {tuple(element.id if end == "-1" else end for end in fact) for fact in facts}  # type: ignore[misc]


def _facts(relations: Sequence[Any]) -> set[tuple[str, str, str]]:
    return {(r["src"], r["type"], r["dst"]) for r in relations}


def _format_values(values: Sequence[Any]) -> str:
    return ", ".join(f"{value:g}" if isinstance(value, float) else str(value) for value in values) or "not there"
