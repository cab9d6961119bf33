"""Conditions of every kind, as pre-, hold- and post-condition."""

from __future__ import annotations

from abc import ABC, ABCMeta, abstractmethod
from collections.abc import Callable
from typing import Any

from catalogue.case import Event, Tree, case
from catalogue.parts import OPTIONAL, Scripted
from skiros2_common.core.abstract_skill import SkillDescription
from skiros2_common.core.conditions import ConditionFunction
from skiros2_common.core.world_element import Element
from skiros2_skill.core.skill import ParallelFf, Serial, SerialStar
from skiros2_skill.testing import SkillBench

_Condition = Callable[[SkillDescription], Any]

#: Of the trees and of their leaves. Optional: a required thing that is removed would be found anew.
_PARAMS = (
    ("Thing", Element("sumo:Object"), OPTIONAL),
    ("Tray", Element("sumo:Object"), OPTIONAL),
    ("Other", Element("sumo:Object"), OPTIONAL),
)


def _scene(world: SkillBench) -> None:
    tray = world.add("skiros:LargeBox", "tray")
    world.add("skiros:LargeBox", "other tray")
    world.add("skiros:Product", "thing", tray, Weight=1.0)


# -- what breaks them --------------------------------------------------------------------------------------------------


def _weight(value: float | None) -> Event:
    def change(world: SkillBench) -> None:
        thing = world.element("thing")
        if value is None:
            thing.removeProperty("skiros:Weight")
        else:
            thing.setProperty("skiros:Weight", value)
        world.wmi.update_element(thing)

    return change


def _state(world: SkillBench) -> None:
    thing = world.element("thing")
    thing.setProperty("skiros:StateProperty", "Busy")
    world.wmi.update_element(thing)


def _move(world: SkillBench) -> None:
    thing = world.element("thing")
    thing.removeRelations(thing.getRelations("", ["skiros:contain"], "-1"))
    thing.addRelation(world.element("other tray").id, "skiros:contain", "-1")
    world.wmi.update_element(thing)


def _remove(world: SkillBench) -> None:
    world.wmi.remove_element(world.element("thing"))


def _either(description: SkillDescription) -> Any:
    either = description.getOrCond(True)
    for value in (1.0, 2.0):
        either.addCondition(description.getPropCond(f"Weighs{value:.0f}", "skiros:Weight", "Thing", "=", value, True))
    return either


def _neither(description: SkillDescription) -> Any:
    neither = description.getOrCond(False)
    for value in (2.0, 3.0):
        neither.addCondition(description.getPropCond(f"Weighs{value:.0f}", "skiros:Weight", "Thing", "=", value, True))
    return neither


def _is_light(thing: Element) -> bool:
    return bool(thing.value_of("skiros:Weight") < 1.5)


def _is_heavy(thing: Element) -> bool:
    return bool(thing.value_of("skiros:Weight") > 1.5)


#: By kind: a condition that holds of the scene, and what breaks it.
KINDS: dict[str, tuple[_Condition, Event]] = {
    "equal": (lambda d: d.getPropCond("C", "skiros:Weight", "Thing", "=", 1.0, True), _weight(2.0)),
    "not_equal": (lambda d: d.getPropCond("C", "skiros:Weight", "Thing", "=", 2.0, False), _weight(2.0)),
    "greater": (lambda d: d.getPropCond("C", "skiros:Weight", "Thing", ">", 0.9, True), _weight(0.9)),
    "at_least": (lambda d: d.getPropCond("C", "skiros:Weight", "Thing", ">=", 1.0, True), _weight(0.9)),
    "less": (lambda d: d.getPropCond("C", "skiros:Weight", "Thing", "<", 1.1, True), _weight(1.1)),
    "at_most": (lambda d: d.getPropCond("C", "skiros:Weight", "Thing", "<=", 1.0, True), _weight(1.1)),
    "compared_with_nothing": (lambda d: d.getPropCond("C", "skiros:Weight", "Thing", ">", 0.9, True), _weight(None)),
    "has_property": (lambda d: d.getHasPropCond("C", "skiros:Weight", "Thing", True), _weight(None)),
    "has_no_property": (lambda d: d.getHasPropCond("C", "skiros:StateProperty", "Thing", False), _state),
    "related": (lambda d: d.getRelationCond("C", "skiros:contain", "Tray", "Thing", True), _move),
    "related_by_one_below": (lambda d: d.getRelationCond("C", "skiros:spatiallyRelated", "Tray", "Thing", True), _move),
    "not_related": (lambda d: d.getRelationCond("C", "skiros:contain", "Other", "Thing", False), _move),
    "specified": (lambda d: d.getIsSpecifiedCond("C", "Thing", True), _remove),
    "generated": (lambda d: d.getGenerateCond("C", "Thing", True), _remove),
    "either": (_either, _weight(3.0)),
    "neither": (_neither, _weight(3.0)),
    "function": (lambda d: ConditionFunction("C", ["Thing"], _is_light), _weight(1.5)),
    "function_false": (lambda d: ConditionFunction("C", ["Thing"], _is_heavy, False), _weight(2.0)),
}

#: Likewise those that speak of classes, with parameters of which they do not hold: nothing in the scene changes that.
KINDS_OF_CLASSES: dict[str, tuple[_Condition, dict[str, str]]] = {
    "of_a_type": (lambda d: d.getOnTypeCond("C", "Thing", "skiros:Product"), {"Thing": "@tray"}),
    "abstractly_related": (
        lambda d: d.getAbstractRelationCond("C", "sumo:isLocationOf", "Tray", "Thing", True),
        {"Tray": "@thing", "Thing": "@tray"},
    ),
}

_GIVEN = {"Thing": "@thing", "Tray": "@tray", "Other": "@other tray"}

# -- the trees: the condition of the leaf holds for two ticks, and is broken before the third --------------------------

_BREAKS_AT = 3


def _leaf(name: str, condition: _Condition, when: str, script: str) -> type:
    """A primitive with the condition."""

    def declare(self: SkillDescription) -> None:
        for arguments in _PARAMS:
            self.addParam(*arguments)
        add = {"pre": self.addPreCondition, "hold": self.addHoldCondition, "post": self.addPostCondition}[when]
        add(condition(self))

    description = type(name.title().replace("_", ""), (SkillDescription,), {"createDescription": declare})
    body = {"script": script, "createDescription": lambda self: self.setDescription(description(), name)}
    return type(name, (Scripted,), body)


class _GuardedTree(Tree, ABC):
    """The leaf comes first; what comes beside it is a script, where there is something."""

    declares = _PARAMS
    beside = "RRRS"
    processor: Any = SerialStar()

    @property
    @abstractmethod
    def leaf(self) -> str:
        """The label of the leaf."""

    def expand(self, skill: Any) -> None:
        skill.setProcessor(self.processor)
        skill(self.skill(self.leaf.title().replace("_", ""), self.leaf))
        if self.beside:
            skill(self.act(self.beside))


class _Started(_GuardedTree, ABC):
    """Started anew at each tick, while another one runs."""

    processor = Serial()


class _Held(_GuardedTree, ABC):
    """Runs, and so does another one."""

    processor = ParallelFf()


class _Ended(_GuardedTree, ABC):
    """Succeeds at the third tick."""

    beside = ""


#: By when the condition is checked: the tree, the script of its leaf, the trace when it is broken before the third
#: tick, and the trace when it never holds.
_WHEN = {
    "pre": (
        _Started,
        "S",
        """
        root      R   R   F-1
          TREE    R   R   F-1
            LEAF  S1  S1  F-1
            act   R1  R2  F-9
        """,
        """
        root      F-1
          TREE    F-1
            LEAF  F-1
            act   .
        """,
    ),
    "hold": (
        _Held,
        "RRRS",
        """
        root      R   R   F-1
          TREE    R   R   F-2
            LEAF  R1  R2  F-2
            act   R1  R2  F-9
        """,
        """
        root      F-1
          TREE    F-2
            LEAF  F-2
            act   .
        """,
    ),
    "post": (
        _Ended,
        "RRS",
        """
        root      R   R   F-1
          TREE    R   R   F-3
            LEAF  R1  R2  F-3
        """,
        """
        root      R   R   F-1
          TREE    R   R   F-3
            LEAF  R1  R2  F-3
        """,
    ),
}

#: The trace of the first of them, for conditions that nothing breaks.
_HOLDS = """
    root      R   R   R   S1
      TREE    R   R   R   S1
        LEAF  S1  S1  S1  S1
        act   R1  R2  R3  S4
"""


def _add(name: str, condition: _Condition, when: str, trace: str, **more: Any) -> None:
    """Adds a leaf with the condition, and a tree with the leaf, to this module and to the catalogue."""
    base, script, *_ = _WHEN[when]
    leaf = _leaf(f"{name}_leaf", condition, when, script)
    tree = ABCMeta(name, (base,), {"leaf": leaf.__name__})
    for cls in (leaf, tree):
        cls.__module__ = __name__
        globals()[cls.__name__] = cls
    case(trace.replace("TREE", name).replace("LEAF", leaf.__name__), scene=_scene, **{"given": _GIVEN, **more})(tree)


for _when, (_, _, _broken, _never) in _WHEN.items():
    for _kind, (_condition, _breaks) in KINDS.items():
        # A skill whose element is gone fails before it is asked for its post-conditions.
        _trace = _broken.replace("F-3", "F-2") if _breaks is _remove else _broken
        _add(f"{_when}_{_kind}", _condition, _when, _trace, events={_BREAKS_AT: _breaks})
    for _kind, (_condition, _wrong) in KINDS_OF_CLASSES.items():
        _add(f"{_when}_not_{_kind}", _condition, _when, _never, given={**_GIVEN, **_wrong})
for _kind, (_condition, _) in KINDS_OF_CLASSES.items():
    _add(f"pre_{_kind}", _condition, "pre", _HOLDS)
