"""Injects failures into hooks of skills and into the world model."""

from __future__ import annotations

import itertools
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import Any

from skiros2_common.core.world_model_port import WorldModelPort
from skiros2_world_model.core.world_model_abstract_interface import refusal


@contextmanager
def replaced(owner: Any, name: str, value: Any) -> Iterator[None]:
    """Replaces an attribute of a module, class or object inside the `with` block. Inherited attributes are restored."""
    own = vars(owner)
    had, before = name in own, own.get(name)
    setattr(owner, name, value)
    try:
        yield
    finally:
        if had:
            setattr(owner, name, before)
        else:
            delattr(owner, name)


#: The methods that all adapters of the world model use for changes and for reading.
_CHANGES = ("transact", "_modify", "load")
_READS = ("find_element", "_matching", "_branch", "_related", "_holds", "_query", "_template")

_GENUINE = object()


@contextmanager
def inject(
    skill: type,
    hook: str,
    *,
    raises: Exception | None = None,
    returns: Any = _GENUINE,
    late: float = 0.0,
    at: int = 0,
) -> Iterator[None]:
    """Makes a hook of a skill fail inside the `with` block.

    :param skill: the class of the implementation.
    :param hook: `onInit`, `onStart`, `execute`, `onPreempt`, `onEnd`, or any other method, such as `run` or `onDone`.
    :param raises: the exception to raise.
    :param returns: the value to return instead of calling the skill's code.
    :param late: additional duration (s); of the fake clock, if there is one.
    :param at: the call that fails, counted from 1; 0: every call.
    :raises AttributeError: the skill has no such hook.
    """
    genuine = getattr(skill, hook)
    calls = itertools.count(1)

    def faulty(self: Any, *args: Any, **kwargs: Any) -> Any:
        if next(calls) != at and at:
            return genuine(self, *args, **kwargs)
        if late:
            time.sleep(late)
        if raises is not None:
            raise raises
        return genuine(self, *args, **kwargs) if returns is _GENUINE else returns

    with replaced(skill, hook, faulty):
        yield


@contextmanager
def refusing(wmi: WorldModelPort, reason: str, *, changes: bool = True, reads: bool = False) -> Iterator[None]:
    """Makes a world model refuse requests with a `WmException` inside the `with` block.

    :param wmi: of a task or a bench.
    :param changes, reads: the refused requests.
    """

    def refuse(*args: Any, **kwargs: Any) -> Any:
        raise refusal(reason)

    with ExitStack() as stack:
        for name in (*(_CHANGES if changes else ()), *(_READS if reads else ())):
            stack.enter_context(replaced(wmi, name, refuse))
        yield
