"""The action of a skill manager when a task is preempted while a skill runs, declared in the skill's description."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from skiros2_common.core.condition import ConditionBase
from skiros2_common.core.errors import WrongType, WrongValue
from skiros2_common.core.names import full_name
from skiros2_common.core.params import Param
from skiros2_common.core.source_location import SourceLocation, caller_location

#: The default of `PreemptHandler.seconds`.
HANDLER_SECONDS = 30.0


@dataclass(frozen=True)
class PreemptHandler:
    """The skill that handles the preemption of another one, such as a skill that puts down a held object.

    :param skill: its type: `PutDown`, `:PutDown` or `skiros:PutDown`.
    :param label: of the implementation; "" for any.
    :param bind: by key of the handler, the key of the preempted skill whose values it gets. Equal keys are bound
        without being listed, unless the parameter of the handler has a default.
    :param condition: the handler runs only if it holds after the preemption, for the parameters of the preempted skill;
        None: it always runs.
    :param seconds: that it may run.

    :raises WrongValue: `seconds` is not a finite positive number, or the type is empty.
    :raises WrongType: the condition is none.
    """

    skill: str
    label: str = ""
    bind: Mapping[str, str] = field(default_factory=dict)
    condition: ConditionBase | None = None
    seconds: float = HANDLER_SECONDS
    source_location: SourceLocation | None = field(default=None, compare=False)

    def __post_init__(self) -> None:
        seconds = self.seconds
        if isinstance(seconds, bool) or not isinstance(seconds, int | float) or not 0.0 < seconds < math.inf:
            raise WrongValue(f"on_preempt {self.skill}: its deadline is {seconds!r}, expected seconds above 0")
        if not isinstance(self.skill, str) or not self.skill:
            raise WrongValue(f"on_preempt: expected the type of a skill, got {self.skill!r}")
        if self.condition is not None and not isinstance(self.condition, ConditionBase):
            raise WrongType(f"on_preempt {self.skill}: expected a condition, got {self.condition!r}")
        object.__setattr__(self, "bind", dict(self.bind))

    def source_of(self, key: str, param: Param) -> str:
        """The key of the preempted skill whose values a parameter of the handler gets; "" for none."""
        return self.bind.get(key, "" if param.has_bound_default() else key)

    @property
    def type(self) -> str:
        """The handler's class in the ontology, such as `skiros:PutDown`."""
        return full_name(self.skill)

    def __str__(self) -> str:
        return f"{self.type}-{self.label}" if self.label else self.type


class Preemptible:
    """The part of a description that declares a handler of preemptions, and whether the skill is one of failures."""

    #: Whether the skill, and the children of a compound, may start in a task after a final failure (`FailureKind`): it
    #: brings the robot or a held object to a safe place, as a retreat does.
    is_reaction = False
    _on_preempt: PreemptHandler | None = None

    @property
    def on_preempt(self) -> PreemptHandler | None:
        """The skill that the manager runs when the task is preempted while this skill runs; None: none."""
        return self._on_preempt

    def set_on_preempt(
        self,
        skill: str,
        label: str = "",
        bind: Mapping[str, str] | None = None,
        condition: ConditionBase | None = None,
        seconds: float = HANDLER_SECONDS,
    ) -> None:
        """Declares what the manager does when a task is preempted while this skill runs; see `PreemptHandler`.

        :raises WrongValue, WrongType: see `PreemptHandler`.
        """
        self._on_preempt = PreemptHandler(skill, label, bind or {}, condition, seconds, caller_location())
