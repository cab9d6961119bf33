"""The tolerance of each field that a re-run compares: exact for what is commanded, wide for what is measured.

| field | what it is | default |
|---|---|---|
| `message`, `message:SKILL` | measured numbers in the messages of nodes | narrow |
| `value`, `value:PARAMETER` | values that skills have from other skills | narrow |
| `pose` | written poses | exact; wide where others have moved elements |
| `skiros:Weight` | a written property | exact, for poses as `pose` |
| `/gripper:command.position` | a field of goals for an action | exact |
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field

from skiros2_bags.core.diff import POSE
from skiros2_common.core.errors import WrongValue
from skiros2_runs.core.tolerance import COMMANDED, MEASURED, NARROW, Tolerance

MESSAGE, VALUE, POSES = "message", "value", "pose"

_INDEX = re.compile(r"\[\d+\]")


@dataclass(frozen=True)
class FieldTolerances:
    """Tolerances by field.

    :param measured: of measured numbers without a tolerance of their own; unless it is given, that of poses is
        `MEASURED` where others move elements.
    :param fields: of single fields, by name.
    """

    measured: Tolerance = NARROW
    fields: Mapping[str, Tolerance] = field(default_factory=dict)

    def of_message(self, skill: str) -> Tolerance:
        """Returns that of numbers in messages of a skill, by its label."""
        return self._first((f"{MESSAGE}:{skill}", MESSAGE), self.measured)

    def of_value(self, parameter: str) -> Tolerance:
        """Returns that of a value that a skill has from another one."""
        return self._first((f"{VALUE}:{parameter}", VALUE), self.measured)

    def of_property(self, are_measured: bool) -> Callable[[str], Tolerance]:
        """Returns a function that returns that of a written property.

        :param are_measured: whether others have moved elements.
        """
        poses = self.of_poses(are_measured)
        return lambda key: self.fields.get(key, poses if POSE.fullmatch(key) else COMMANDED)

    def of_poses(self, are_measured: bool) -> Tolerance:
        """Returns that of written poses."""
        wide = MEASURED if self.measured == NARROW else self.measured
        return self.fields.get(POSES, wide if are_measured else COMMANDED)

    def of_goal(self, action: str) -> Callable[[str], Tolerance]:
        """Returns a function that returns that of a field of goals for an action, such as `points[0].x`."""
        return lambda name: self.fields.get(f"{action}:{_INDEX.sub('', name)}", COMMANDED)

    def text(self, are_measured: bool) -> str:
        """Names the fields with a tolerance."""
        named = {MESSAGE: self.of_message(""), VALUE: self.of_value(""), POSES: self.of_poses(are_measured)}
        texts = (f"{name} {_text(each)}" for name, each in {**named, **self.fields}.items())
        return f"{', '.join(texts)}; all else exact"

    def _first(self, names: Iterable[str], default: Tolerance) -> Tolerance:
        return next((self.fields[name] for name in names if name in self.fields), default)


def _text(tolerance: Tolerance) -> str:
    return "exact" if tolerance.is_exact else f"{tolerance.absolute:g} (relative {tolerance.relative:g})"


def field_tolerances(texts: Iterable[str]) -> dict[str, Tolerance]:
    """Reads tolerances such as `pose=0.01` or `value:Force=0.5,0.02`: field, absolute, relative (default 0).

    :raises WrongValue: a text is not of this form.
    """
    found = {}
    for text in texts:
        name, _, numbers = text.partition("=")
        try:
            absolute, *relative = map(float, numbers.split(","))
            found[name.strip()] = Tolerance(*relative or (0.0,), absolute=absolute)
        except (ValueError, TypeError):
            raise WrongValue(f"{text!r}: expected a tolerance such as pose=0.01 or value:Force=0.5,0.02") from None
    return found
