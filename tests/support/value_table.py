"""The ways in which an element reaches a parameter, and the ways in which it may have changed before the skill starts.

In each run of the table a task waits at a gate while somebody else changes the element `part`; then a skill starts that
uses it. `expected` is what the skill must see, from `docs/compatibility.md`.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from skiros2_common.core.params import Param, ParamTypes
from skiros2_common.core.world_element import Element
from skiros2_skill.ros.utils import SkillHolder

#: A skill to start: its type, and its parameters.
Call = tuple[str, dict[str, Any]]


def _plan(user: str, ptype: ParamTypes) -> Callable[[Element], list[Call]]:
    """A plan as a task manager writes it, with the element as it is then."""

    def calls(part: Element) -> list[Call]:
        label = {"UseRequired": "use_required", "UseInferred": "use_inferred"}[user]
        planned = Param("Object", "", part, ptype)
        steps = [SkillHolder("", "Gate", "gate"), SkillHolder("", user, label, {"Object": planned})]
        return [("RunPlan", {"Plan": SkillHolder("", "Processor", "Sequential", children=steps).toJson()})]

    return calls


#: Ways in which the value is given, or another skill has found it for a Required parameter: the skill uses it,
#: or fails.
GIVEN: dict[str, Callable[[Element], list[Call]]] = {
    "a command": lambda part: [("Gate", {}), ("UseRequired", {"Object": part})],
    "a command, for an Inferred parameter": lambda part: [("Gate", {}), ("UseInferred", {"Object": part})],
    "`specify` in a tree": lambda part: [("Specified", {"Thing": part})],
    "a plan": _plan("UseRequired", ParamTypes.Required),
    "the skill before": lambda part: [("HoldGiven", {"Object": part}), ("Gate", {}), ("UseRequired", {})],
    "the skill above": lambda part: [("Above", {"Object": part})],
    "the skill above, by a remap": lambda part: [("Remapped", {"Thing": part})],
    "an assignment of the skill before": lambda part: [("Find", {}), ("Gate", {}), ("UseRequired", {})],
    "an assignment of a child": lambda part: [("FindBelow", {})],
}

#: Ways in which it is found: where it is gone, another element is found.
FOUND: dict[str, Callable[[Element], list[Call]]] = {
    "inference": lambda part: [("Gate", {}), ("UseInferred", {})],
    "inference of the skill before": lambda part: [("HoldInferred", {}), ("Gate", {}), ("UseInferred", {})],
    "inference of the skill above": lambda part: [("AboveInferred", {})],
    "inference at a second start": lambda part: [("Again", {})],
    "a plan, for an Inferred parameter": _plan("UseInferred", ParamTypes.Inferred),
    "an assignment in place of an inferred element": lambda part: [("Rework", {}), ("Gate", {}), ("UseInferred", {})],
}

#: Ways to an Optional parameter: where the element is gone, it has no value.
OPTIONAL: dict[str, Callable[[Element], list[Call]]] = {
    "the skill before, for an Optional parameter": lambda part: [
        ("HoldGiven", {"Object": part}), ("Gate", {}), ("UseOptional", {}),
    ],
    "inference of the skill before, for an Optional parameter": lambda part: [
        ("HoldInferred", {}), ("Gate", {}), ("UseOptional", {}),
    ],
}  # fmt: skip

WAYS = GIVEN | FOUND | OPTIONAL


class Editor(Protocol):
    """The world model as another author edits it."""

    def get_element(self, eid: str) -> Element: ...
    def update_element(self, e: Element) -> Any: ...
    def add_element(self, e: Element) -> Any: ...
    def remove_element(self, e: str) -> Any: ...
    def set_relation(self, subj: str, pred: str, obj: str, value: bool = True) -> Any: ...


@dataclass
class Stage:
    """The scene of a run: `part` on `shelf`, `spare` beside it, a `table`, and a closed `gate`."""

    part: str
    spare: str
    shelf: str
    table: str
    gate: str


def furnish(wmi: Any) -> Stage:
    """Adds the elements of a run to the scene."""

    def add(etype: str, label: str, holder: str = "skiros:Scene-0", **properties: Any) -> str:
        element = Element(etype, label)
        for key, value in properties.items():
            element.setProperty(f"skiros:{key}", value)
        element.addRelation(holder, "skiros:contain", "-1")
        return str(wmi.add_element(element).id)

    gate, shelf, table = (add("skiros:Location", label) for label in ("gate", "shelf", "table"))
    part, spare = (add("skiros:Product", label, shelf, Weight=1.0) for label in ("part", "spare"))
    return Stage(part, spare, shelf, table, gate)


def _reweigh(wmi: Editor, stage: Stage) -> None:
    part = wmi.get_element(stage.part)
    part.setProperty("skiros:Weight", 2.0)
    wmi.update_element(part)


def _move(wmi: Editor, stage: Stage) -> None:
    wmi.set_relation(stage.shelf, "skiros:contain", stage.part, False)
    wmi.set_relation(stage.table, "skiros:contain", stage.part)


def _remove(wmi: Editor, stage: Stage) -> None:
    wmi.remove_element(stage.part)


def _replace(wmi: Editor, stage: Stage) -> None:
    """Another element with the same class and label, on the table."""
    wmi.remove_element(stage.part)
    element = Element("skiros:Product", "part")
    element.setProperty("skiros:Weight", 9.0)
    element.addRelation(stage.table, "skiros:contain", "-1")
    wmi.add_element(element)


CHANGES: dict[str, Callable[[Editor, Stage], None]] = {
    "nothing": lambda wmi, stage: None,
    "a property": _reweigh,
    "a relation": _move,
    "removed": _remove,
    "replaced": _replace,
}


@dataclass
class Outcome:
    """The end of a run.

    :param seen: the element as the skill saw it; None: no element; "": no skill has used one.
    :param message: of the task.
    """

    succeeded: bool
    seen: Any
    message: str


def seen_by(messages: Sequence[tuple[str, str]]) -> Any:
    """What the skill that uses the element reports, from the (label, message) of all nodes."""
    reports = [json.loads(text) for label, text in messages if label.startswith("use_") and text[:1] in ("{", "n")]
    return reports[-1] if reports else ""


def check(way: str, change: str, stage: Stage, outcome: Outcome, wmi: Any) -> None:
    """Asserts what the skill has seen, and that its write has changed nothing else."""
    if change in ("removed", "replaced"):
        if way in GIVEN:
            assert not outcome.succeeded and outcome.seen == ""
            assert stage.part in outcome.message
        elif way in OPTIONAL:
            assert outcome.succeeded and outcome.seen is None
        else:
            assert outcome.succeeded and outcome.seen["id"] == stage.spare
        return
    assert outcome.succeeded, outcome.message
    holder = stage.table if change == "a relation" else stage.shelf
    weight = 2.0 if change == "a property" else 1.0
    assert outcome.seen == {"id": stage.part, "weight": weight, "holders": [holder]}
    part = wmi.get_element(stage.part)
    assert part.value_of("skiros:CadModel") == "used"
    assert part.value_of("skiros:Weight") == weight
    assert [r["src"] for r in part.getRelations("", "skiros:contain", "-1")] == [holder]
