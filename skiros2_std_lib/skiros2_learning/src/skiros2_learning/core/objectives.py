"""The parts of a scenario that judge executions: objectives, constraints and the definition of success."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Literal

from pydantic import PlainValidator

from skiros2_learning.core.rewards import Reward, RewardSection, read_reward
from skiros2_learning.core.sections import Mistake, Name, Number, Section, Some, numbers

Sense = Literal["maximise", "minimise"]


@dataclass(frozen=True)
class WeightedReward:
    """A reward as a part of an objective.

    :param name: as in the scenario, for reports.
    """

    name: str
    weight: float
    reward: Reward


@dataclass(frozen=True, kw_only=True)
class _Weighted(RewardSection):
    weight: Number = 1.0


def _read_weighted(data: Any) -> WeightedReward:
    name, reward, section = read_reward(_Weighted, data)
    return WeightedReward(name, section.weight, reward)


@dataclass(frozen=True)
class Objective(Section):
    """A weighted sum of rewards, kept apart from other objectives."""

    name: Name
    rewards: Annotated[tuple[Annotated[WeightedReward, PlainValidator(_read_weighted)], ...], Some]
    sense: Sense = "maximise"


@dataclass(frozen=True)
class Criterion:
    """A reward with limits: a constraint, or a part of the definition of success.

    :param name: as in the scenario, for reports.
    """

    name: str
    reward: Reward
    at_least: float = -math.inf
    at_most: float = math.inf

    def violation(self, value: float) -> float:
        """How far a value is outside the limits; 0 or less inside."""
        return max(self.at_least - value, value - self.at_most)


@dataclass(frozen=True, kw_only=True)
class _Limited(RewardSection):
    at_least: Number = -math.inf
    at_most: Number = math.inf

    @classmethod
    def mistakes(cls, data: Mapping[str, Any]) -> Iterator[Mistake]:
        if not data.keys() & {"at_least", "at_most"}:
            yield (), "expected at_least or at_most"
        low, high = numbers(data.get("at_least")), numbers(data.get("at_most"))
        if low and high and low > high:
            yield ("at_least",), f"expected at most {high[0]:g}, as at_most, got {low[0]:g}"


def _read_criterion(data: Any) -> Criterion:
    name, reward, section = read_reward(_Limited, data)
    return Criterion(name, reward, section.at_least, section.at_most)


Criteria = tuple[Annotated[Criterion, PlainValidator(_read_criterion)], ...]
