"""The signals of a scene: of which robot they are, and where they are published."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from skiros2_common.core.errors import WrongValue
from skiros2_common.core.manager_names import manager_of
from skiros2_common.core.operations import SCENE
from skiros2_common.core.signals import Signal
from skiros2_common.core.world_element import Element
from skiros2_world_model.core.queries import SceneReader
from skiros2_world_model.core.scene import Scene


@dataclass(frozen=True)
class SceneSignal:
    """A signal's element.

    :param signal: with the full name of its topic; None if the element cannot be used.
    :param problem: why it cannot; "" if it can.
    :param robot: the manager of the robot that has it; "" for none.
    """

    signal: Signal | None
    problem: str
    robot: str


def read_signal(element: Element, robot: str, reader: str = "") -> SceneSignal:
    """Returns a signal as its element describes it.

    :param robot: the manager of the robot that has it; "" for none.
    :param reader: the node in whose namespace a relative topic of no robot is; "": the root namespace.
    """
    try:
        signal = Signal.of(element)
    except WrongValue as error:
        return SceneSignal(None, str(error), robot)
    return SceneSignal(replace(signal, topic=_full_topic(signal.topic, robot or reader)), "", robot)


def manager_above(element: Element, owner_of: Callable[[str], Element | None]) -> str:
    """Returns the manager of the robot that an element is a part of; "" for none.

    :param owner_of: returns the element that has an element as a part.
    """
    seen: set[str] = set()
    above: Element | None = element
    while above is not None and above.id not in seen:
        if manager := manager_of(above):
            return manager
        seen.add(above.id)
        above = owner_of(above.id)
    return ""


def owner(scene: Scene | SceneReader, eid: str) -> Element | None:
    """Returns the element that has an element as a part; None if there is none."""
    if isinstance(scene, Scene):
        return next((scene.element(source) for source in scene.sources("skiros:hasA", eid)), None)
    return next((scene.find(each["src"], SCENE) for each in scene.related("", "skiros:hasA", eid, SCENE)), None)


def _full_topic(topic: str, node: str) -> str:
    """Returns the full name of a topic that a node reads: full, relative to its namespace, or private (`~topic`)."""
    if topic.startswith("/"):
        return topic
    return f"{node}/{topic[1:]}" if topic.startswith("~") else f"{node.rpartition('/')[0]}/{topic}"
