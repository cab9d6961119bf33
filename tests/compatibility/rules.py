"""Marks a compatibility test with the rule that it checks; `table.py` makes docs/compatibility.md from the marks."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

_Test = TypeVar("_Test", bound=Callable[..., Any])

#: The topics of docs/compatibility.md, in its order.
TOPICS = {
    "wire": "Plans and parameters on the wire",
    "blackboard": "Parameters of a running tree",
    "loading": "Choosing and loading implementations",
    "params": "`Param` and `ParamHandler`",
    "property": "`Property`",
    "element": "`Element`",
    "conditions": "Conditions",
    "client": "World model client",
    "reasoners": "Reasoners",
    "spatial": "Spatial relations",
    "tools": "Logger and tools",
    "robots": "Robots and action clients",
    "robustness": "What does not stop a system",
    "description": "Descriptions and `SkillCore`",
    "nodes": "Nodes inside `expand`",
    "more": "Beyond SkiROS2",
}


def rule(topic: str, text: str, *, better: str = "", differs: str = "") -> Callable[[_Test], _Test]:
    """The rule that a test checks.

    The arguments are literals: `table.py` reads them from the source.

    :param topic: a key of `TOPICS`.
    :param text: the behaviour in one line of Markdown, as a user of SkiROS2 knows it.
    :param better: what this platform adds to it, without a change for existing callers.
    :param differs: what this platform does differently on purpose, and how a caller moves to it.
    """
    assert topic in TOPICS, topic
    assert not (better and differs)

    def mark(test: _Test) -> _Test:
        test.rule = (topic, text, better, differs)  # type: ignore[attr-defined]
        return test

    return mark
