"""The values that the user has started skills with."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from skiros2_gui.skills.form import Editor, Form

#: The most values kept of a parameter.
_MAX_VALUES = 5

#: Editors of values that are entered; those of other values list them all.
_ENTERED = (Editor.ELEMENT, Editor.TEXT, Editor.NUMBER, Editor.JSON)

#: The values of a form: the text, or the id of the element, by key.
Values = Mapping[str, str]


def entered(form: Form) -> Values:
    """Returns the valid values that are not defaults."""
    fields = (form.fields[key] for key in form.given())
    return {f.key: str(f.value if f.editor is Editor.ELEMENT else f.text) for f in fields if f.editor in _ENTERED}


class RecentValues:
    """The last values of each parameter, the newest first, by the skill's class."""

    def __init__(self) -> None:
        self._values: dict[str, dict[str, list[str]]] = {}

    def of(self, skill_type: str, key: str) -> list[str]:
        """Returns the values of a parameter: texts, or ids of elements."""
        return list(self._values.get(skill_type, {}).get(key, ()))

    def note(self, skill_type: str, values: Values) -> None:
        """Adds the values of a started skill."""
        kept = self._values.setdefault(skill_type, {})
        for key, value in values.items():
            kept[key] = [value, *(old for old in kept.get(key, ()) if old != value)][:_MAX_VALUES]

    def settings(self) -> dict[str, Any]:
        """Returns the values as JSON values."""
        return {stype: {key: list(values) for key, values in kept.items()} for stype, kept in self._values.items()}

    def restore(self, settings: Any) -> None:
        """Restores the result of `settings`; anything else is skipped."""
        for stype, kept in settings.items() if isinstance(settings, Mapping) else ():
            for key, values in kept.items() if isinstance(kept, Mapping) else ():
                texts = [value for value in values if isinstance(value, str)] if isinstance(values, list) else []
                for text in reversed(texts):
                    self.note(stype, {key: text})
