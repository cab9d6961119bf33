"""Skills that stand in for others: each tick ends as a script says."""

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
    """A description class.

    :param params: the arguments of `addParam` for each.
    :param pre, hold, post: functions of the description, which give the conditions:
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
    """How the ticks of a stand-in end, from start to start.

    :param starts: for each start, how its ticks end; the last is for all further ones. Of each, the last outcome is
        for all further ticks. An outcome is `R` (running), `S` (success), `F` (failure, code -1), `X` (raises), an
        exception that is raised, a function of the skill, or what `execute` answers.
    :raises WrongValue: nothing is said, or a letter stands for nothing.
    """

    def __init__(self, *starts: Sequence[Any]) -> None:
        if not starts or not all(starts):
            raise WrongValue(f"a script has an outcome for each start at least, got {starts!r}")
        unknown = {o for outcomes in starts for o in outcomes if isinstance(o, str)} - _LETTERS.keys()
        if unknown:
            raise WrongValue(f"outcomes are {', '.join(_LETTERS)}, got {', '.join(sorted(unknown))}")
        self._starts = starts

    def play(self, skill: Any, start: int, tick: int) -> Any:
        """Does what is due, and returns what `execute` answers.

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
    """A primitive class whose ticks end as a script says.

    Its attribute `calls` names the hooks that were called since it was loaded, in order, over all its instances.

    :param description: what it implements; a text makes a description of that name, without parameters.
    :param outcomes: `"RRS"`: runs for two ticks, then succeeds; `Script("F", "S")`: fails at the first start only.
    :param label: the implementation's; "": the description's name in lower case.
    :param hooks: other hooks, or methods: a function of the skill, or an answer. `execute` takes the script's place.
    """
    described = describe(description) if isinstance(description, str) else description
    script = outcomes if isinstance(outcomes, Script) else Script(outcomes)
    name = label or described.__name__.lower()
    calls: list[str] = []
    starts = itertools.count()

    def noted(hook: str, answer: Any) -> Callable[[Any], Any]:
        def call(self: Any) -> Any:
            if hook != "onInit":
                calls.append(hook)
            if hook == "onStart":
                self._script_place = (next(starts), itertools.count())
            return answer(self) if callable(answer) else answer

        return call

    def execute(self: Any) -> Any:
        start, ticks = self._script_place
        return script.play(self, start, next(ticks))

    def create(self: Any) -> None:
        self.setDescription(described(), name)

    body = {hook: getattr(PrimitiveBase, hook) for hook in _HOOKS}
    body.update({"execute": execute, **hooks})
    methods = {hook: noted(hook, answer) for hook, answer in body.items()}
    return type(name, (PrimitiveBase,), {"createDescription": create, "calls": calls, **methods})


def _raise(error: Exception) -> None:
    raise error
