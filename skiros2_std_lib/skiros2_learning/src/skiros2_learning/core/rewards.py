"""The catalogue of rewards: functions of an execution.

A reward is a frozen dataclass with the method `__call__(record) -> float`; its fields are its parameters in the
scenario. Decorate a class of your own with `@reward("name")`, in a module that the scenario names in `plugins`. A
reward may state `things` (labels), `pairs` (labels whose clearance it reads) and `series_names` that must be recorded
for it, and `names` in the world model: kind (see `_KINDS`; "" for an element) and name by parameter.
"""

from __future__ import annotations

import builtins
import dataclasses
import functools
import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Literal, Protocol, TypeVar, cast, get_type_hints, runtime_checkable

import numpy as np

from skiros2_common.core.errors import SkirosError, WrongValue
from skiros2_common.core.world_element import Element
from skiros2_common.core.world_model_port import WorldModelPort
from skiros2_learning.core.elements import find_element
from skiros2_learning.core.episode_record import Array, EpisodeRecord
from skiros2_learning.core.sections import Flag, Number, Positive, Section, Text, Whole, mistaken, near, read


@runtime_checkable
class Reward(Protocol):
    """Computes a number from an execution."""

    def __call__(self, record: EpisodeRecord) -> float: ...


R = TypeVar("R", bound=type)
S = TypeVar("S", bound="RewardSection")

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


@functools.cache
def _with_parameters(base: Any, cls: Any) -> type[Any]:
    """Returns a section with the keys of another and the parameters of a reward."""
    try:
        hints = get_type_hints(cls, include_extras=True)
    except NameError:  # a name that is imported for type checkers only
        hints = {}
    strict: dict[Any, Any] = {float: Number, int: Whole, str: Text, bool: Flag}
    parameters = []
    for each in dataclasses.fields(cls):
        hint = hints.get(each.name, Any)
        default = {} if each.default is dataclasses.MISSING else {"default": each.default}
        parameters.append((each.name, strict.get(hint, hint), dataclasses.field(**default)))
    return dataclasses.make_dataclass(cls.__name__, parameters, bases=(base,), frozen=True, kw_only=True)


@dataclass(frozen=True, kw_only=True)
class RewardSection(Section):
    """The keys of a section with a reward, besides the parameters of that."""

    reward: Text
    name: Text = ""


def read_reward(base: type[S], data: Any) -> tuple[str, Reward, S]:
    """Reads a section with a reward.

    :returns: the name for reports, the reward, and the section.
    :raises ValidationError: with all mistakes.
    """
    name = data.get("reward", "") if isinstance(data, Mapping) else ""
    cls, keys = cast(tuple[Any, Any], (REWARDS.get(str(name)), base))
    if not name:
        raise mistaken([(("reward",), "missing")])
    if cls is None:
        raise mistaken([(("reward",), f"unknown: {name!r}; {near(str(name), REWARDS)}")])
    section = read(_with_parameters(keys, cls), data)
    made: Reward = cls(**{each.name: getattr(section, each.name) for each in dataclasses.fields(cls)})
    return section.name or section.reward, made, section


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


#: Names in the ontologies: the kinds by which a reward may state them.
_KINDS = {"relation": "owl:ObjectProperty", "property": "owl:DatatypeProperty"}


def unknown_names(one: Reward, wmi: WorldModelPort) -> Iterator[tuple[str, str]]:
    """Yields each parameter of a reward that names something the world model does not have, and the text."""
    for key, (kind, name) in getattr(one, "names", {}).items():
        try:
            if not kind:
                find_element(wmi, name)
            elif wmi.add_prefix(name) not in (known := wmi.declared_names(_KINDS[kind])):
                yield key, f"no ontology declares the {kind} {name!r}; {near(name, known)}"
        except SkirosError as error:
            yield key, str(error)


Statistic = Literal["final", "maximum", "minimum", "mean", "integral"]
#: Ways to make one number of a series.
STATISTICS: dict[Statistic, Callable[[Array, Array], float]] = {
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
    width: Positive = 0.05

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
    quantity: Literal["force", "torque"] = "force"
    statistic: Statistic = "maximum"
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
    limit: Positive = 0.1

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
    statistic: Statistic = "final"

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

    @property
    def names(self) -> dict[str, tuple[str, str]]:
        return {
            "subject": ("", self.subject), "relation": ("relation", self.relation), "object": ("", self.object)
        }  # fmt: skip

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

    @builtins.property
    def names(self) -> dict[str, tuple[str, str]]:
        return {"element": ("", self.element), "property": ("property", self.property)}

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
