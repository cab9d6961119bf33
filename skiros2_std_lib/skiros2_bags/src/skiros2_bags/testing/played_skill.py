"""Primitives that do in a re-run what was told of them: a bag does not have what they went by."""

from __future__ import annotations

import sys
from typing import Any

from skiros2_bags.testing.past_world import operations_of
from skiros2_bags.testing.recording import Seen
from skiros2_common.core.abstract_skill import State
from skiros2_common.core.primitive import PrimitiveBase

_STATES = {"R": State.Running, "S": State.Success, "F": State.Failure}


def is_played(cls: type, label: str, labels: frozenset[str]) -> bool:
    """Whether a skill is played: one of those labels, and those that call services."""
    return issubclass(cls, PrimitiveBase) and (label in labels or _calls_a_service(cls))


def played(cls: type, manager: Any) -> type:
    """A class in the place of a primitive, with its description, whose hooks do as was told.

    :param manager: the `RerunManager`, which knows the task that is being ticked.
    """

    def told_of(skill: Any) -> Seen | None:
        seen: Seen | None = manager.ticked.told_of(skill) if manager.ticked is not None else None
        return seen

    def on_start(self: Any) -> bool:
        return True

    def execute(self: Any) -> State:
        seen = told_of(self)
        if seen is None or seen.state not in _STATES:
            return self.step()  # type: ignore[no-any-return]
        if seen.state != "R":
            for change in manager.ticked.take_due():
                manager.wmi._transact(operations_of(change, manager.wmi.model.scene()), "scene")
        self._setProgress(seen.message, seen.code)
        return _STATES[seen.state]

    def on_preempt(self: Any) -> State:
        seen = told_of(self)
        if seen is not None:
            self._setProgress(seen.message, seen.code)
        return State.Failure

    def on_end(self: Any) -> bool:
        return True

    hooks = {"onInit": on_start, "onStart": on_start, "execute": execute, "onPreempt": on_preempt, "onEnd": on_end}
    return type(cls.__name__, (cls,), {**hooks, "__module__": cls.__module__, "__abstractmethods__": frozenset()})


def _calls_a_service(cls: type) -> bool:
    module = sys.modules.get("skiros2_std_skills.service_client_primitive")
    return module is not None and issubclass(cls, module.PrimitiveServiceClient)
