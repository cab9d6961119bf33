"""Fleets of 1, 5 and 20 robots with 20 tasks each on one world model of 10 000 elements.

All in one process: 20 managers as nodes do not fit on two cores (`fleet_nodes` has five). Each robot has a client and a
scheduler of its own, as its node has. What a robot costs must not depend on the number of the others; that is CPU time,
without the thread that makes the changes. The delay is from before the call that changes an element to the `execute`
that sees it. All robots share one interpreter lock here, as nodes do not: a thread that holds it while another process
has its core keeps all of them waiting, ten times as long as they wait for each other. So this process has the highest
priority of ordinary processes, if it may; if not (it needs root), compare the delay on a quiet machine only.
"""

from __future__ import annotations

import itertools
import logging
import os
import statistics
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

from benchmarks.measurement import Measurement
from skiros2_common.core.abstract_skill import SkillDescription, State
from skiros2_common.core.operations import Add
from skiros2_common.core.params import ParamTypes
from skiros2_common.core.primitive import PrimitiveBase
from skiros2_common.core.world_element import Element
from skiros2_skill.core.library.library import SkillLibrary
from skiros2_skill.core.runtime.scheduler import Scheduler
from skiros2_skill.core.skill import SkillWrapper
from skiros2_world_model.core.local_world_model import LocalWorldModel, source_ontologies
from skiros2_world_model.core.world_model import WorldModel

FLEETS = (1, 5, 20)
TASKS = 20
ELEMENTS = 10_000
SECONDS = 4.0
UPDATES = 200
#: For the last change to be seen (s).
TIMEOUT = 30.0
#: The changes that each robot sees (1/s), of the objects of its tasks in turn.
RATE = 5.0
#: What a robot may cost among 20, beside a robot alone.
FLAT = 1.2
#: As for `nice`: other processes still get a share, even if this one should use all cores.
HIGHEST_PRIORITY = -20

#: When each weight was about to be written (s, monotonic), and the delays until a skill saw it.
_written: dict[float, float] = {}
_delays: list[float] = []


class Watch(SkillDescription):
    def createDescription(self) -> None:
        self.addParam("Object", Element("skiros:Product"), ParamTypes.Required)
        self.addHoldCondition(self.getPropCond("Light", "skiros:Weight", "Object", "<", 1.0, True))


class watch(PrimitiveBase):
    """Notes when it sees another weight."""

    def createDescription(self) -> None:
        self.setDescription(Watch(), "watch")

    def execute(self) -> State:
        written = _written.pop(self.params["Object"].value.value_of("skiros:Weight"), None)
        if written is not None:
            _delays.append(time.monotonic() - written)
        return State.Running


class Robot:
    """A manager's scheduler with its tasks."""

    def __init__(self, model: WorldModel, name: str) -> None:
        self.wmi = LocalWorldModel(name, model)
        library = SkillLibrary(self.wmi)
        library.add(watch)
        self.objects = [product(f"{name} {number}") for number in range(TASKS)]
        self.wmi.add_elements(self.objects)
        self.scheduler = Scheduler()
        self.wmi.add_listener(self.scheduler.on_change)
        for thing in self.objects:
            task = self.scheduler.new_task(self.wmi, "bench")
            node = SkillWrapper("Watch", "", library)
            node.specifyParamDefault("Object", thing)
            task.root(node)
            self.scheduler.start(task.id)

    def stop(self) -> None:
        self.wmi.remove_listener(self.scheduler.on_change)
        self.scheduler.stop()


def measure() -> Iterator[Measurement]:
    logging.disable(logging.WARNING)
    try:
        with _priority():
            found = {robots: _fleet(robots) for robots in FLEETS}
    finally:
        logging.disable(logging.NOTSET)
    alone = found[FLEETS[0]]
    units = (
        ("CPU of each robot", "% of a core"),
        ("delay from a change to its tick, p99", "ms"),
        ("an update, for each robot that is notified", "µs"),
    )
    for robots in FLEETS[1:]:
        for (what, unit), one, other in zip(units, found[robots], alone, strict=True):
            name = f"fleet of {robots} robots, {TASKS} tasks each: {what}"
            yield Measurement(name, one, unit, 1, "one robot alone", other, one / other, FLAT)


@contextmanager
def _priority() -> Iterator[None]:
    """Gives this thread, and the threads that it starts, priority over other processes, if that is allowed."""
    before = os.getpriority(os.PRIO_PROCESS, 0)
    try:
        os.setpriority(os.PRIO_PROCESS, 0, HIGHEST_PRIORITY)
    except PermissionError:
        print("    fleet: no higher priority, the delays depend on other processes", file=sys.stderr)
    try:
        yield
    finally:
        os.setpriority(os.PRIO_PROCESS, 0, before)


def _fleet(number: int) -> tuple[float, float, float]:
    """Returns the CPU of each robot (% of a core), the delay (ms, p99), and CPU of an update for each robot (µs)."""
    model = WorldModel(source_ontologies())
    for start in range(0, ELEMENTS, 1000):
        model.transact([Add(product(str(n)), str(n)) for n in range(start, start + 1000)], "bench")
    robots = [Robot(model, f"robot_{n}") for n in range(number)]
    writer = LocalWorldModel("writer", model)
    weights = itertools.count(1)
    try:
        time.sleep(1.0)
        _written.clear()
        _delays.clear()
        changes = int(SECONDS * RATE * number)
        cpu, own = time.process_time(), time.thread_time()
        begin = time.monotonic()
        for count in range(changes):
            time.sleep(max(0.0, begin + count / (RATE * number) - time.monotonic()))
            things = robots[count % number].objects
            _change(writer, things[count // number % TASKS], next(weights))
        elapsed = time.monotonic() - begin
        cpu, own = time.process_time() - cpu, time.thread_time() - own
        share = 100.0 * (cpu - own) / elapsed / number
        limit = time.monotonic() + TIMEOUT
        while len(_delays) < changes:  # the latest to be seen have the longest delays
            if time.monotonic() > limit:
                raise RuntimeError(f"{changes - len(_delays)} of {changes} changes were not seen in {TIMEOUT} s")
            time.sleep(0.01)
        delay = 1e3 * statistics.quantiles(_delays, n=100, method="inclusive")[-1]
        other = writer.get_element("skiros:Product-5000")
        start_time = time.thread_time()
        for _ in range(UPDATES):
            _change(writer, other, next(weights))
        return share, delay, 1e6 * (time.thread_time() - start_time) / UPDATES / number
    finally:
        stopping = [threading.Thread(target=robot.stop) for robot in robots]
        for stopping_robot in stopping:
            stopping_robot.start()
        for stopping_robot in stopping:
            stopping_robot.join()


def _change(writer: LocalWorldModel, thing: Element, number: int) -> None:
    weight = number * 1e-6
    thing.setProperty("skiros:Weight", weight)
    _written[weight] = time.monotonic()
    writer.update_element(thing)


def product(label: str) -> Element:
    element = Element("skiros:Product", label)
    element.setProperty("skiros:Weight", 0.0)
    element.addRelation("skiros:Scene-0", "skiros:contain", "-1")
    return element
