"""A disjunction of conditions."""

from __future__ import annotations

from typing import Any

from skiros2_common.core.condition import ConditionBase
from skiros2_common.core.explanation import Finding
from skiros2_common.core.params import ParamHandler
from skiros2_common.core.world_element import Element


class ConditionOr(ConditionBase):
    """True if one of its parts holds."""

    def __init__(self, desired_state: bool) -> None:
        super().__init__("or", "", desired_state)
        self._conditions: list[Any] = []

    @property
    def conditions(self) -> list[Any]:
        return self._conditions

    @property
    def volatile(self) -> bool:  # type: ignore[override]
        return any(c.volatile for c in self._conditions)

    def addCondition(self, condition: Any) -> None:
        """Adds a part."""
        self._conditions.append(condition)

    def remap(self, initial_key: str, target_key: str) -> None:
        for condition in self._conditions:
            condition.remap(initial_key, target_key)

    def getKeys(self) -> list[str]:
        return list(dict.fromkeys(key for c in self._conditions for key in c.getKeys()))

    def isEqual(self, other: Any) -> bool:
        return self._matches(other) and bool(self._desired_state == other._desired_state)

    def hasConflict(self, other: Any) -> bool:
        return self._matches(other) and bool(self._desired_state != other._desired_state)

    def holds(self, ph: ParamHandler, wmi: Any) -> bool:
        results = [c.evaluate(ph, wmi) for c in self._conditions]  # all of them, for the description
        return any(results)

    def fact(self) -> str:
        return "(" + " or ".join(c.getDescription() for c in self._conditions) + ")"

    def explain(self, ph: ParamHandler, wmi: Any) -> Finding:
        finding = super().explain(ph, wmi)
        if self._desired_state:
            finding.parts = [c.explain(ph, wmi) for c in self._conditions]
        return finding

    def expected(self) -> str:
        if not self._desired_state:
            return "none of them"
        return " or ".join(f"[{c.label}] {c.expected()}" for c in self._conditions)

    def found(self, ph: ParamHandler, wmi: Any) -> str:
        if self._desired_state:
            return "; ".join(c.found(ph, wmi) for c in self._conditions)
        return "; ".join(c.getDescription() for c in self._conditions if c.evaluate(ph, wmi))

    def setTrue(self, ph: ParamHandler, wmi: Any) -> bool:
        if self.evaluate(ph, wmi):
            return True
        return self._desired_state and any(c.setTrue(ph, wmi) for c in self._conditions)

    def revert(self, ph: ParamHandler | None = None, wmi: Any = None) -> None:
        for condition in reversed(self._conditions):
            condition.revert(ph, wmi)

    def setDesiredState(self, ph: ParamHandler) -> bool:
        return self._desired_state and any(c.setDesiredState(ph) for c in self._conditions)

    def toElement(self) -> Element:
        element = super().toElement()
        element.removeProperty("skiros:hasSubject")
        for condition in self._conditions:
            element.addRelation("-1", "skiros:hasCondition", condition.toElement())
        return element

    def copy(self) -> Any:
        copy = super().copy()
        copy._conditions = [c.copy() for c in self._conditions]
        return copy

    def _matches(self, other: Any) -> bool:
        return (
            isinstance(other, ConditionOr)
            and len(self._conditions) == len(other._conditions)
            and all(a.isEqual(b) for a, b in zip(self._conditions, other._conditions, strict=True))
        )
