"""A disjunction of conditions."""

from __future__ import annotations

from typing import TYPE_CHECKING, Self, TypeGuard

from skiros2_common.core.condition import ConditionBase, ConditionRecord, Cost, condition_from
from skiros2_common.core.explanation import Finding
from skiros2_common.core.params import ParamHandler
from skiros2_common.core.world_element import Element

if TYPE_CHECKING:
    from skiros2_common.core.world_model_port import WorldModelPort


class ConditionOr(ConditionBase):
    """True if one of its parts holds."""

    def __init__(self, desired_state: bool) -> None:
        super().__init__("or", "", desired_state)
        self._conditions: list[ConditionBase] = []

    @property
    def parts(self) -> list[ConditionBase]:
        return self._conditions

    @property
    def conditions(self) -> list[ConditionBase]:
        """Same as `parts`."""
        return self._conditions

    @property
    def volatile(self) -> bool:  # type: ignore[override]
        return any(c.volatile for c in self._conditions)

    @property
    def cost(self) -> Cost:  # type: ignore[override]
        return max((c.cost for c in self._conditions), default=Cost.ELEMENT) or Cost.ELEMENT

    def addCondition(self, condition: ConditionBase) -> None:
        """Adds a part."""
        self._conditions.append(condition)

    def element_ids(self, ph: ParamHandler) -> set[str] | None:
        ids: set[str] = set()
        for condition in self._conditions:
            found = condition.element_ids(ph)
            if found is not None:
                ids |= found
            elif not condition.volatile:
                return None
        return ids

    @classmethod
    def from_record(cls, record: ConditionRecord) -> Self | None:
        either = cls(record.state)
        for part in record.parts:
            condition = condition_from(part)
            if condition is None:
                return None
            either.addCondition(condition)
        return either

    def remap(self, initial_key: str, target_key: str) -> None:
        for condition in self._conditions:
            condition.remap(initial_key, target_key)

    def getKeys(self) -> list[str]:
        return list(dict.fromkeys(key for c in self._conditions for key in c.getKeys()))

    def holds(self, ph: ParamHandler, wmi: WorldModelPort) -> bool:
        results = [c.evaluate(ph, wmi) for c in self._conditions]  # all of them, for the description
        return any(results)

    def fact(self) -> str:
        return "(" + " or ".join(c.getDescription() for c in self._conditions) + ")"

    def explain(self, ph: ParamHandler, wmi: WorldModelPort) -> Finding:
        finding = super().explain(ph, wmi)
        if self._desired_state:
            finding.parts = [c.explain(ph, wmi) for c in self._conditions]
        return finding

    def expected(self) -> str:
        if not self._desired_state:
            return "none of them"
        return " or ".join(f"[{c.label}] {c.expected()}" for c in self._conditions)

    def found(self, ph: ParamHandler, wmi: WorldModelPort) -> str:
        if self._desired_state:
            return "; ".join(c.found(ph, wmi) for c in self._conditions)
        return "; ".join(c.getDescription() for c in self._conditions if c.evaluate(ph, wmi))

    def setTrue(self, ph: ParamHandler, wmi: WorldModelPort) -> bool:
        if self.evaluate(ph, wmi):
            return True
        return self._desired_state and any(c.setTrue(ph, wmi) for c in self._conditions)

    def revert(self, ph: ParamHandler | None = None, wmi: WorldModelPort | None = None) -> None:
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

    def copy(self) -> Self:
        copy = super().copy()
        copy._conditions = [c.copy() for c in self._conditions]
        return copy

    def _same_fact(self, other: object) -> TypeGuard[Self]:
        return (
            isinstance(other, ConditionOr)
            and len(self._conditions) == len(other._conditions)
            and all(a.isEqual(b) for a, b in zip(self._conditions, other._conditions, strict=True))
        )
