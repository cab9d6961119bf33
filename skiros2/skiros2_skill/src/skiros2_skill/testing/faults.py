"""Injects failures into hooks of skills and into the world model."""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from typing import Any

from skiros2_common.core.errors import WrongType
from skiros2_common.core.world_model_port import WorldModelPort
from skiros2_world_model.core.wm_errors import refusal
from skiros2_world_model.core.world_model_client import WorldModelClient


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


#: The calls of a transport (`skiros2_world_model.core.transport`) that change something, and the reads of its server.
_CHANGES = ("transact", "modify", "load")
_SERVER_READS = ("query", "query_json", "template")

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
    :raises WrongType: the world model is a stand-in without a transport.
    """

    def refuse(*args: Any, **kwargs: Any) -> Any:
        raise refusal(reason)

    if not isinstance(wmi, WorldModelClient):
        raise WrongType(f"a {type(wmi).__name__} cannot be made to refuse, only a WorldModelClient")
    transport = wmi.transport
    with ExitStack() as stack:
        for name in _CHANGES if changes else ():
            stack.enter_context(replaced(transport, name, refuse))
        if reads:
            stack.enter_context(replaced(transport, "scene", _Refusing(refuse)))
            for name in _SERVER_READS:
                stack.enter_context(replaced(transport.server, name, refuse))
        yield


class _Refusing:
    """An object of which every method is `refuse`."""

    def __init__(self, refuse: Callable[..., Any]) -> None:
        self._refuse = refuse

    def __getattr__(self, name: str) -> Callable[..., Any]:
        return self._refuse
