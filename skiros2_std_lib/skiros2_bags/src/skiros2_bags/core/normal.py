"""What of a run may be otherwise each time, and is compared accordingly. All of it is here.

- Ids of tasks and of goals, stamps, times and the frames' time stamps: not compared.
- Numbers that were measured, in texts and in properties: within a tolerance. A number in a text counts as measured when
  it has a decimal point or a per cent sign; other numbers, such as those in ids, are compared as they are.
- The labels of a task's root, which has the task's id, and of groups.
- How a root or a compound without messages of its own reports success: any of `PLAIN_ENDS`.
- The leading slash of a skill manager's name in the scene.
- Of a traceback, the last line: where in a file the error was raised is not compared.
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

#: The property with the name of a robot's skill manager, with a slash in older bags.
_MANAGER = "skiros:SkillMgr"

#: The codes and messages with which nodes that have children report success, in bags of any age.
PLAIN_ENDS = frozenset({(0, ""), (1, "Success"), (1, "End")})

#: Properties that are other ones at each run.
STAMPS = frozenset({"skiros:TfTimeStamp"})

_MEASURED = re.compile(r"(?<![\w.-])-?\d+\.\d+(?:e[-+]?\d+)?|(?<![\w.-])-?\d+(?=\s?%)", re.IGNORECASE)
_TRACEBACK = "Traceback (most recent call last):"


@dataclass(frozen=True)
class Tolerance:
    """How far measured numbers may be apart.

    :param relative: of the larger of two numbers.
    :param absolute: whatever their size: metres, radians, per cent as they are written.
    """

    relative: float = 0.02
    absolute: float = 0.02

    def close(self, one: float, other: float) -> bool:
        """Whether two numbers count as equal."""
        return one == other or math.isclose(one, other, rel_tol=self.relative, abs_tol=self.absolute)


#: Where nothing is measured by physics.
NARROW = Tolerance(0.001, 0.001)


def same_text(one: str, other: str, tolerance: Tolerance) -> bool:
    """Whether two texts say the same."""
    if one == other:
        return True
    one, other = _shortened(one), _shortened(other)
    if _MEASURED.sub("#", one) != _MEASURED.sub("#", other):
        return False
    pairs = zip(_MEASURED.finditer(one), _MEASURED.finditer(other), strict=True)
    return all(_same_number(a.group(), b.group(), tolerance) for a, b in pairs)


def same_values(one: Sequence[Any], other: Sequence[Any], tolerance: Tolerance) -> bool:
    """Whether two properties have the same values."""
    return len(one) == len(other) and all(_same_value(a, b, tolerance) for a, b in zip(one, other, strict=True))


def element_differences(
    expected: Element, got: Element, tolerance: Tolerance, ignored: Collection[str] = STAMPS
) -> list[str]:
    """What is otherwise in an element, a line each.

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
            lines.append(f"{key} is {_shown(found)}, expected {_shown(wanted)}")
    wanted_relations, found_relations = _relations(expected), _relations(got)
    lines += [f"lacks {' '.join(relation)}" for relation in sorted(wanted_relations - found_relations)]
    return lines + [f"has {' '.join(relation)}" for relation in sorted(found_relations - wanted_relations)]


def change_differences(expected: Change, got: Change, tolerance: Tolerance) -> list[str]:
    """What is otherwise in a change, a line each."""
    wanted, found = {e.id: e for e in expected.elements}, {e.id: e for e in got.elements}
    if (expected.action, wanted.keys()) != (got.action, found.keys()):
        return [f"{summary(got)}, expected {summary(expected)}"]
    lines = [f"{eid} {line}" for eid in wanted for line in element_differences(wanted[eid], found[eid], tolerance)]
    if _facts(expected.relations) != _facts(got.relations):
        lines.append(f"{summary(got)}, expected {summary(expected)}")
    return lines


def summary(change: Change) -> str:
    """A change in a few words."""
    parts = [e.id for e in change.elements] + [" ".join(fact) for fact in sorted(_facts(change.relations))]
    return f"{change.action} {', '.join(parts) or 'of the ontologies'}"


def _shortened(text: str) -> str:
    if _TRACEBACK not in text:
        return text
    before, _, after = text.partition(_TRACEBACK)
    raised = after.rstrip().rpartition("\n")[2]
    return before.partition(raised)[0] + raised  # before it stands the same, with the line that raised it


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


def _shown(values: Sequence[Any]) -> str:
    return ", ".join(f"{value:g}" if isinstance(value, float) else str(value) for value in values) or "not there"
