"""Plain data about conditions: how they are read from the world model, and what their evaluation costs."""

from __future__ import annotations

from collections.abc import Sequence
from enum import IntEnum
from typing import Protocol


class Cost(IntEnum):
    """The cost of an evaluation: an indexed lookup, one element, a lookup that must find nothing, code of a skill, a
    relation computed by a reasoner."""

    LOOKUP, ELEMENT, ABSENCE, CODE, REASONER = range(5)


class ConditionRecord(Protocol):
    """A condition as read from the world model; see `ConditionBase.toElement`.

    :param kind: the name of its class.
    :param name: the relation, property or class that it tests.
    """

    @property
    def kind(self) -> str: ...
    @property
    def label(self) -> str: ...
    @property
    def subject(self) -> str: ...
    @property
    def object(self) -> str: ...
    @property
    def name(self) -> str: ...
    @property
    def operator(self) -> str: ...
    @property
    def value(self) -> str | bool | float | None: ...
    @property
    def state(self) -> bool: ...
    @property
    def parts(self) -> Sequence[ConditionRecord]: ...
