"""The exception that a skill's code may raise to end itself as preempted."""

from __future__ import annotations

from skiros2_common.core.errors import SkirosError


class SkillPreempted(SkirosError):
    """A skill was preempted. Raised in a hook, it ends the skill as a preemption does, without a traceback."""

    def __init__(self, value: object) -> None:
        super().__init__(str(value))
        self.value = value
