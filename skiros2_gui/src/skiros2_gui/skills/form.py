"""The start form of a skill."""

from __future__ import annotations

from typing import Any

from skiros2_gui.skills.catalogue import Offer
from skiros2_gui.skills.fields import Field
from skiros2_skill.client.description import Step
from skiros2_task.core.actions import ROBOT_KEY

#: The display order of parameters.
_ORDER = ("required", "optional", "inferred")


class Form:
    """:param offer: the skill."""

    def __init__(self, offer: Offer) -> None:
        self.offer = offer
        fields = [Field(parameter) for parameter in offer.parameters.values()]
        # The robot comes last, as it is rarely changed.
        fields.sort(key=lambda f: (f.key == ROBOT_KEY, _ORDER.index(f.declared.kind)))
        self.fields: dict[str, Field] = {field.key: field for field in fields}

    @property
    def errors(self) -> dict[str, str]:
        """The invalid fields: error by key."""
        return {field.key: field.error for field in self.fields.values() if field.error}

    @property
    def classes(self) -> list[str]:
        """The classes of the element parameters; "" for any."""
        return sorted({field.element_class for field in self.fields.values() if field.declared.is_element})

    def given(self) -> dict[str, list[Any]]:
        """Returns the valid values that are not defaults, as JSON values by key."""
        return {key: f.values() for key, f in self.fields.items() if not (f.is_default or f.error)}

    def step(self) -> Step:
        """Returns the step to send; requires that there are no `errors`."""
        params = [self.fields[key].declared.wire(values) for key, values in self.given().items()]
        return Step(self.offer.type, self.offer.label, params)

    def reset(self) -> None:
        """Restores all defaults."""
        for field in self.fields.values():
            field.reset()

    def adopt(self, other: Form) -> None:
        """Copies the values of a form for an earlier version of the skill, where the declarations are equal."""
        for key, field in self.fields.items():
            old = other.fields.get(key)
            if old is not None and old.declared == field.declared and not old.is_default:
                field.text, field.value = old.text, old.value
                field.set_mode(old.mode)
