"""Signals for the live view: where the signals of a scene are published, and their values in a bag."""

from __future__ import annotations

import logging
import math
from collections import defaultdict
from typing import Any

from skiros2_bags.core.bag_file import MONITOR
from skiros2_bags.core.run import Run
from skiros2_common.core.errors import WrongValue
from skiros2_common.core.manager_names import manager_of
from skiros2_common.core.signals import TOPIC, FieldPath, Signal
from skiros2_common.core.world_element import Element
from skiros2_world_model.core.scene import Scene

log = logging.getLogger(__name__)

#: The time of a sample, which has the lowest and highest value in it (s).
_PERIOD = 0.1


def full_topic(topic: str, manager: str) -> str:
    """Returns the full name of a signal's topic, as the manager's conditions read it.

    :param topic: full, relative to the namespace of the manager, or private (`~topic`).
    :param manager: the node name of the robot's skill manager; "": none.
    """
    if topic.startswith("/"):
        return topic
    return f"{manager}/{topic[1:]}" if topic.startswith("~") else f"{manager.rpartition('/')[0]}/{topic}"


def recorded_signals(run: Run) -> dict[str, dict[str, Any]]:
    """Returns the signals of the scene in a bag by their ids: {name, unit, robot, samples}.

    `samples` are [time (s since the epoch), lowest, highest value], ten a second at most.

    :raises BagError: the bag cannot be read.
    """
    if MONITOR not in run.topics.values():
        return {}
    scene = run.world(partial=True)
    found: dict[str, dict[str, Any]] = {}
    readers: defaultdict[str, list[tuple[list[list[float]], FieldPath]]] = defaultdict(list)
    for element in filter(None, [scene.element(record.id) for record in scene if TOPIC in record.properties]):
        try:
            signal = Signal.of(element)
        except WrongValue as error:
            log.warning("%s: %s", run.path, error)
            continue
        manager, samples = _manager_above(scene, element), list[list[float]]()
        found[element.id] = {"name": signal.name, "unit": signal.unit, "robot": manager, "samples": samples}
        readers[full_topic(signal.topic, manager)].append((samples, FieldPath(signal.path)))
    for message in run.messages(*readers) if readers else ():
        for samples, path in readers[message.topic]:
            try:
                value = path.read(message.content)
            except WrongValue as error:
                log.warning("%s: %s", message.location, error)
                continue
            if math.isfinite(value):
                _add(samples, message.time, float(f"{value:.5g}"))
    return found


def _add(samples: list[list[float]], time: float, value: float) -> None:
    if samples and time - samples[-1][0] < _PERIOD:
        samples[-1][1:] = [min(samples[-1][1], value), max(samples[-1][2], value)]
    else:
        samples.append([round(time, 3), value, value])


def _manager_above(scene: Scene, element: Element) -> str:
    """Returns the manager of the robot that an element is a part of; "" for none."""
    seen: set[str] = set()
    above: Element | None = element
    while above is not None and above.id not in seen:
        if manager := manager_of(above):
            return manager
        seen.add(above.id)
        owners = list(scene.sources("skiros:hasA", above.id))
        above = scene.element(owners[0]) if owners else None
    return ""
