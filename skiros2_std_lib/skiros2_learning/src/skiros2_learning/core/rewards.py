"""The catalogue of rewards: functions of an execution.

A reward is a frozen dataclass with the method `__call__(record) -> float`; its fields are its parameters in the
scenario. Decorate a class of your own with `@reward("name")`, in a module that the scenario names in `plugins`. A
reward may state `things` (labels), `pairs` (labels whose clearance it reads) and `series` that must be recorded for it.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol, TypeVar

import numpy as np

from skiros2_common.core.errors import WrongValue
from skiros2_common.core.world_element import Element
from skiros2_learning.core.elements import find_element
from skiros2_learning.core.episode_record import Array, EpisodeRecord
from skiros2_learning.core.sections import Section, near


class Reward(Protocol):
    """Computes a number from an execution."""

    def __call__(self, record: EpisodeRecord) -> float: ...


R = TypeVar("R", bound=type)

#: The classes of the catalogue, by name.
REWARDS: dict[str, Callable[..., Reward]] = {}


def reward(name: str) -> Callable[[R], R]:
    """Adds a class to the catalogue.

    :raises WrongValue: another class has the name.
    """

    def add(cls: R) -> R:
        known = REWARDS.get(name)
        if known is not None and (known.__module__, getattr(known, "__qualname__", "")) != (
            cls.__module__,
            cls.__qualname__,
        ):
            raise WrongValue(f"reward {name!r} is {known.__module__}.{getattr(known, '__qualname__', '')} already")
        REWARDS[name] = cls
        return cls

    return add


def read_reward(section: Section) -> Reward | None:
    """Reads a reward and its parameters. Returns None after a mistake, which the section has reported."""
    name = section.text("reward")
    cls: Any = REWARDS.get(name)
    if cls is None:
        if name:
            section.problem("reward", f"unknown: {name!r}; {near(name, REWARDS)}")
        return None
    values: dict[str, Any] = {}
    before = len(section.problems)
    for field in dataclasses.fields(cls):
        default = {} if field.default is dataclasses.MISSING else {"default": field.default}
        limits = {key: value for key, value in field.metadata.items() if key in ("low", "high", "above")}
        if field.type == "float":
            values[field.name] = section.number(field.name, **default, **limits)
        elif field.type == "tuple[str, ...]":
            values[field.name] = tuple(section.texts(field.name, **default))
        elif "known" in field.metadata:
            values[field.name] = section.choice(field.name, field.metadata["known"], **default)
        elif field.type == "str":
            values[field.name] = section.text(field.name, **default)
        else:
            values[field.name] = section.take(field.name, **default)
    if len(section.problems) > before:
        return None
    made: Reward = cls(**values)
    return made


def names_used(rewards: Iterable[Reward]) -> tuple[set[str], set[tuple[str, str]], set[str]]:
    """Returns the labels, the pairs of labels and the series that rewards read."""
    things: set[str] = set()
    pairs: set[tuple[str, str]] = set()
    series: set[str] = set()
    for each in rewards:
        things |= {thing for thing in getattr(each, "things", ()) if thing}
        pairs |= set(getattr(each, "pairs", ()))
        series |= set(getattr(each, "series_names", ()))
    return things | {label for pair in pairs for label in pair}, pairs, series


#: Ways to make one number of a series.
STATISTICS: dict[str, Callable[[Array, Array], float]] = {
    "final": lambda values, times: float(values[-1]),
    "maximum": lambda values, times: float(values.max()),
    "minimum": lambda values, times: float(values.min()),
    "mean": lambda values, times: _mean(values, times),
    "integral": lambda values, times: _integral(values, times),
}


def _integral(values: Array, times: Array) -> float:
    return float(np.sum((values[1:] + values[:-1]) / 2.0 * np.diff(times)))


def _mean(values: Array, times: Array) -> float:
    spent = float(times[-1] - times[0])
    return _integral(values, times) / spent if spent > 0.0 else float(values[0])


_POSITIVE = {"above": 0.0}


@reward("success")
@dataclass(frozen=True)
class Success:
    """1 if the task ended with success, else 0."""

    def __call__(self, record: EpisodeRecord) -> float:
        return 1.0 if record.succeeded else 0.0


@reward("goal_distance")
@dataclass(frozen=True)
class GoalDistance:
    """exp(-d²/2w²) of the final distance d between a thing and its goal: 1 at the goal, 0.61 at the distance w.

    :param width: w (m).
    """

    object: str
    goal: str
    width: float = dataclasses.field(default=0.05, metadata=_POSITIVE)

    @property
    def things(self) -> tuple[str, str]:
        return self.object, self.goal

    def __call__(self, record: EpisodeRecord) -> float:
        return math.exp(-(record.distance(self.object, self.goal) ** 2) / (2.0 * self.width**2))


@reward("distance")
@dataclass(frozen=True)
class Distance:
    """The final distance between two things (m)."""

    object: str
    goal: str

    @property
    def things(self) -> tuple[str, str]:
        return self.object, self.goal

    def __call__(self, record: EpisodeRecord) -> float:
        return record.distance(self.object, self.goal)


@reward("time")
@dataclass(frozen=True)
class Time:
    """The duration of the execution (s of simulated time)."""

    def __call__(self, record: EpisodeRecord) -> float:
        return record.duration


@dataclass(frozen=True)
class _Wrench:
    arm: str
    quantity: str = dataclasses.field(default="force", metadata={"known": ("force", "torque")})
    statistic: str = dataclasses.field(default="maximum", metadata={"known": tuple(STATISTICS)})
    prefix: ClassVar[str] = ""

    @property
    def series_names(self) -> tuple[str, ...]:
        return (f"{self.arm}.{self.prefix}{self.quantity}",)

    def __call__(self, record: EpisodeRecord) -> float:
        return STATISTICS[self.statistic](record.values_of(self.series_names[0]), record.times)


@reward("applied_force")
@dataclass(frozen=True)
class AppliedForce(_Wrench):
    """The force (N) or torque (Nm) that an arm's hand and the things it touches exert on each other."""


@reward("measured_force")
@dataclass(frozen=True)
class MeasuredForce(_Wrench):
    """The force (N) or torque (Nm) that the sensor at an arm's wrist measures, with its noise."""

    prefix: ClassVar[str] = "measured_"


@reward("obstacle_distance")
@dataclass(frozen=True)
class ObstacleDistance:
    """The smallest distance (m) between a thing and obstacles during the execution, at most `limit`; 0 on contact."""

    object: str
    obstacles: tuple[str, ...]
    limit: float = dataclasses.field(default=0.1, metadata=_POSITIVE)

    @property
    def pairs(self) -> tuple[tuple[str, str], ...]:
        return tuple((self.object, obstacle) for obstacle in self.obstacles)

    def __call__(self, record: EpisodeRecord) -> float:
        return max(0.0, min([self.limit, *(float(record.clearances[pair].min()) for pair in self.pairs)]))


@reward("path_length")
@dataclass(frozen=True)
class PathLength:
    """The length of the path of a thing or a gripper (m)."""

    object: str

    @property
    def things(self) -> tuple[str]:
        return (self.object,)

    def __call__(self, record: EpisodeRecord) -> float:
        return float(np.linalg.norm(np.diff(record.path(self.object), axis=0), axis=1).sum())


@reward("energy")
@dataclass(frozen=True)
class Energy:
    """The mechanical work of an arm's motors, braking included (J): the integral of |torque · velocity|."""

    arm: str

    @property
    def series_names(self) -> tuple[str, ...]:
        return (f"{self.arm}.power",)

    def __call__(self, record: EpisodeRecord) -> float:
        # a sample is the mean since the one before
        return float(np.sum(record.values_of(self.series_names[0])[1:] * np.diff(record.times)))


@reward("signal")
@dataclass(frozen=True)
class Signal:
    """A statistic of any recorded series, such as `Arm.power`."""

    series: str
    statistic: str = dataclasses.field(default="final", metadata={"known": tuple(STATISTICS)})

    @property
    def series_names(self) -> tuple[str, ...]:
        return (self.series,)

    def __call__(self, record: EpisodeRecord) -> float:
        return STATISTICS[self.statistic](record.values_of(self.series), record.times)


@reward("relation")
@dataclass(frozen=True)
class Relation:
    """1 if a relation of two elements, given by label, holds in the world model at the end, else 0."""

    subject: str
    relation: str
    object: str

    def __call__(self, record: EpisodeRecord) -> float:
        subject, other = _element(record, self.subject), _element(record, self.object)
        assert record.wmi is not None
        names = [self.relation, *record.wmi.get_sub_properties(self.relation)]
        return 1.0 if subject.getRelations("-1", names, other.id) else 0.0


@reward("property")
@dataclass(frozen=True)
class PropertyValue:
    """1 if a property of an element, given by label, has a value in the world model at the end, else 0."""

    element: str
    property: str
    value: Any

    def __call__(self, record: EpisodeRecord) -> float:
        return 1.0 if _element(record, self.element).hasProperty(self.property, self.value) else 0.0


@reward("sparql")
@dataclass(frozen=True)
class Sparql:
    """1 if a SPARQL query of the world model has a solution at the end, else 0."""

    query: str

    def __call__(self, record: EpisodeRecord) -> float:
        if record.wmi is None:
            raise WrongValue("the execution has no world model")
        return 1.0 if record.wmi.query_ontology(self.query) else 0.0


def _element(record: EpisodeRecord, label: str) -> Element:
    if record.wmi is None:
        raise WrongValue("the execution has no world model")
    return find_element(record.wmi, label)
