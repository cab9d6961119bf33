"""A condition."""

from skiros2_common.core.conditions import ConditionBase


class ConditionDry(ConditionBase):
    """True if the glue on an element has dried."""

    def holds(self, ph, wmi):
        element = self._element(self.getKeys()[0], ph, wmi)
        return element is not None and element.value_of("glue:Wet") is not True

    def fact(self):
        return f"{self._name(self.getKeys()[0])} is dry"
