"""The values of signals in a bag."""

from __future__ import annotations

import logging
import math
from collections import defaultdict
from functools import partial
from typing import Any

from skiros2_bags.core.bag_file import MONITOR
from skiros2_bags.core.run import Run
from skiros2_common.core.errors import WrongValue
from skiros2_common.core.signals import TOPIC, FieldPath
from skiros2_live.core.signals import manager_above, owner, read_signal

log = logging.getLogger(__name__)

#: The time of a sample, which has the lowest and highest value in it (s).
_PERIOD = 0.1


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
        read, samples = read_signal(element, manager_above(element, partial(owner, scene))), list[list[float]]()
        if read.signal is None:
            log.warning("%s: %s", run.path, read.problem)
            continue
        signal = read.signal
        found[element.id] = {"name": signal.name, "unit": signal.unit, "robot": read.robot, "samples": samples}
        readers[signal.topic].append((samples, FieldPath(signal.path)))
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
