"""Failures that a test wants: in the hooks of skills, and of the world model."""

from __future__ import annotations

import itertools
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import Any

from skiros2_skill.testing.replace import replaced
from skiros2_world_model.core.world_model_abstract_interface import refusal

#: The methods through which all adapters of the world model change it, and read it.
_CHANGES = ("_transact", "_modify", "load")
_READS = ("find_element", "_matching", "_branch", "_related", "_holds", "_query", "_template")

_AS_EVER = object()


@contextmanager
def inject(
    skill: type,
    hook: str,
    *,
    raises: Exception | None = None,
    returns: Any = _AS_EVER,
    late: float = 0.0,
    at: int = 0,
) -> Iterator[None]:
    """A hook of a skill fails while this is entered.

    :param skill: the class of the implementation.
    :param hook: `onInit`, `onStart`, `execute`, `onPreempt`, `onEnd`, or any other method, such as `run` or `onDone`.
    :param raises: what it raises.
    :param returns: what it answers, instead of what the skill's own code does; that does not run.
    :param late: how long it takes more (s); by the fake clock where there is one.
    :param at: only at that call, counted from 1; 0: at each.
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
        return genuine(self, *args, **kwargs) if returns is _AS_EVER else returns

    with replaced(skill, hook, faulty):
        yield


@contextmanager
def refusing(wmi: Any, reason: str, *, changes: bool = True, reads: bool = False) -> Iterator[None]:
    """A world model refuses all that it is asked for while this is entered, with a `WmException`.

    :param wmi: of a task, or of a bench.
    :param changes, reads: what it refuses.
    """

    def refuse(*args: Any, **kwargs: Any) -> Any:
        raise refusal(reason)

    with ExitStack() as stack:
        for name in (*(_CHANGES if changes else ()), *(_READS if reads else ())):
            stack.enter_context(replaced(wmi, name, refuse))
        yield
