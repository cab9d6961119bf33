"""Stand-ins: skills that follow a script."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from typing import Any

from skiros2_common.core.abstract_skill import SkillDescription
from skiros2_common.core.errors import WrongValue
from skiros2_common.core.primitive import PrimitiveBase

_HOOKS = ("onStart", "onPreempt", "onEnd")

_LETTERS: dict[str, Callable[[Any], Any]] = {
    "R": lambda skill: skill.step("running"),
    "S": lambda skill: skill.success("done"),
    "F": lambda skill: skill.fail("failed", 1),
    "X": lambda skill: _raise(RuntimeError("scripted")),
}


def describe(
    name: str,
    params: Sequence[Sequence[Any]] = (),
    pre: Sequence[Callable[[Any], Any]] = (),
    hold: Sequence[Callable[[Any], Any]] = (),
    post: Sequence[Callable[[Any], Any]] = (),
) -> type[SkillDescription]:
    """Creates a description class.

    :param params: the arguments of `addParam` for each parameter.
    :param pre, hold, post: functions of the description that return a condition:
        `lambda d: d.getRelationCond("At", "skiros:at", "Robot", "Place", True)`.
    """

    def create(self: SkillDescription) -> None:
        for param in params:
            self.addParam(*param)
        for conditions, add in (
            (pre, self.addPreCondition),
            (hold, self.addHoldCondition),
            (post, self.addPostCondition),
        ):
            for condition in conditions:
                add(condition(self))

    return type(name, (SkillDescription,), {"createDescription": create})


class Script:
    """The outcomes of the ticks of a stand-in.

    :param starts: for each start, the outcomes of its ticks; the last start and the last outcome repeat. An outcome is
        `R` (running), `S` (success), `F` (failure, code -1), `X` (raises), an exception to raise, a function of the
        skill, or a return value of `execute`.
    :raises WrongValue: there are no outcomes, or a letter is unknown.
    """

    def __init__(self, *starts: Sequence[Any]) -> None:
        if not starts or not all(starts):
            raise WrongValue(f"a script has an outcome for each start at least, got {starts!r}")
        unknown = {o for outcomes in starts for o in outcomes if isinstance(o, str)} - _LETTERS.keys()
        if unknown:
            raise WrongValue(f"outcomes are {', '.join(_LETTERS)}, got {', '.join(sorted(unknown))}")
        self._starts = starts

    def play(self, skill: Any, start: int, tick: int) -> Any:
        """Produces an outcome. Returns the return value of `execute`.

        :param start, tick: counted from 0.
        """
        outcomes = self._starts[min(start, len(self._starts) - 1)]
        outcome = outcomes[min(tick, len(outcomes) - 1)]
        if isinstance(outcome, str):
            outcome = _LETTERS[outcome]
        if isinstance(outcome, Exception):
            raise outcome
        return outcome(skill) if callable(outcome) else outcome


def stand_in(
    description: type[SkillDescription] | str, outcomes: Script | Sequence[Any] = "S", label: str = "", **hooks: Any
) -> Any:
    """Creates a primitive class that follows a script.

    Its attribute `calls` lists the called hooks of all instances, in order.

    :param description: a class, or the name of a new description without parameters.
    :param outcomes: `"RRS"`: runs for two ticks, then succeeds; `Script("F", "S")`: fails at the first start only.
    :param label: of the implementation; "": the description's name in lower case.
    :param hooks: other hooks or methods, each a function of the skill or a return value. `execute` replaces the script.
    """
    described = describe(description) if isinstance(description, str) else description
    script = outcomes if isinstance(outcomes, Script) else Script(outcomes)
    name = label or described.__name__.lower()
    calls: list[str] = []
    starts = itertools.count()

    def recorded(hook: str, answer: Any) -> Callable[[Any], Any]:
        def call(self: Any) -> Any:
            if hook != "onInit":
                calls.append(hook)
            if hook == "onStart":
                self._script_position = (next(starts), itertools.count())
            return answer(self) if callable(answer) else answer

        return call

    def execute(self: Any) -> Any:
        start, ticks = self._script_position
        return script.play(self, start, next(ticks))

    def create(self: Any) -> None:
        self.setDescription(described(), name)

    body = {hook: getattr(PrimitiveBase, hook) for hook in _HOOKS}
    body.update({"execute": execute, **hooks})
    methods = {hook: recorded(hook, answer) for hook, answer in body.items()}
    return type(name, (PrimitiveBase,), {"createDescription": create, "calls": calls, **methods})


def _raise(error: Exception) -> None:
    raise error
