"""Primitives: the leaves of a skill tree."""

from __future__ import annotations

from skiros2_common.core.abstract_skill import ParamOptions, SkillCore, SkillDescription, State
from skiros2_common.core.params import ParamTypes
from skiros2_common.core.world_element import Element
from skiros2_common.core.world_model_port import WorldModelPort

__all__ = ["Element", "ParamOptions", "ParamTypes", "PrimitiveBase", "SkillCore", "SkillDescription", "State"]


class PrimitiveBase(SkillCore):
    """Base of all primitives.

    Override `createDescription` (with `self.setDescription(Description(), "label")`), `execute`, and where needed
    `onInit`, `onStart`, `onPreempt` and `onEnd`.
    """

    #: Whether a re-run of a bag replaces the skill by its recorded progress: its driver's answers are in no bag.
    replays_progress = False

    def init(self, wmi: WorldModelPort, _: object = None) -> bool:
        """Loads the primitive: declares its description and calls `onInit`. Returns False if it cannot be used."""
        self._wmi = wmi
        self.declare()
        if self.onInit() is False:
            return False
        self._setState(State.Idle)
        return True

    def tick(self) -> State:
        """Calls `execute` once if the skill runs. Returns the state."""
        if self._state is State.Running:
            result = self.execute()
            if not isinstance(result, State):
                raise TypeError(f"{self._label}.execute returned {result!r}, expected a State")
            self._setState(result)
        return self._state

    def onInit(self) -> bool | None:
        """To override: called once when the primitive is loaded. Return False if it cannot be used."""
        return True
