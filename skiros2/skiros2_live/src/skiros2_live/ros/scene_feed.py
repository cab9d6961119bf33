"""Reports the scene of a running cell: elements, robots' bodies, frames of tf, and the values of signals."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from functools import partial
from typing import Any

import rospy
from tf2_msgs.msg import TFMessage

from skiros2_common.core.errors import SkirosError, WrongValue
from skiros2_common.core.forward_clock import now
from skiros2_common.core.operations import Change
from skiros2_common.core.signals import SIGNAL, TOPIC, Signal
from skiros2_common.core.world_element import Element
from skiros2_common.ros.signals import RosSignals
from skiros2_live.core.changed_elements import ChangedElements
from skiros2_live.core.patch import EntriesChanged
from skiros2_live.core.scene_view import SceneView, frames_data
from skiros2_live.core.signals import SceneSignal, manager_above, read_signal
from skiros2_live.ros.parameters import mesh_folders, robot_descriptions
from skiros2_world_model.ros.world_model_interface import WorldModelInterface

log = logging.getLogger(__name__)

#: The highest rate of patches (Hz).
_RATE = 25.0
#: The period of checks for robot descriptions, and the pause after the world model has not answered (s).
_CHECK_PERIOD = _RETRY_DELAY = 1.0

Report = Callable[[EntriesChanged], None]


class SceneFeed:
    """Works in threads of its own. Call `close` at the end.

    :param report: called with each patch, in any thread; must not block.
    :ivar view: how elements and robots look; None before `follow`.
    """

    def __init__(self, report: Report) -> None:
        self._report = report
        self._frames: dict[str, list[Any]] = {}
        self._lock = threading.Lock()
        self._has_values = threading.Event()
        self._is_ending = threading.Event()
        self._signals = _Signals(report, self._has_values)
        self._changed = ChangedElements()
        self._world: WorldModelInterface | None = None
        self.view: SceneView | None = None
        self._threads = [threading.Thread(target=self._take_values, name="live values", daemon=True)]
        self._threads[0].start()
        self._subscribers = [
            rospy.Subscriber(topic, TFMessage, self._on_frames, queue_size=100) for topic in ("/tf", "/tf_static")
        ]

    def follow(self, world: WorldModelInterface) -> None:
        """Reports the elements of a world model with a replica of the scene. To be called once."""
        self._world = world
        self.view = SceneView(world.is_subclass, mesh_folders())
        world.add_listener(self._on_change)
        for name, run in (("live scene", self._read_elements), ("live bodies", self._read_bodies)):
            self._threads.append(threading.Thread(target=run, args=(world, self.view), name=name, daemon=True))
            self._threads[-1].start()

    def close(self) -> None:
        """Ends all subscriptions."""
        self._is_ending.set()
        for waiting in (self._changed.waiting, self._has_values):
            waiting.set()
        for subscriber in self._subscribers:
            subscriber.unregister()
        if self._world is not None:
            self._world.remove_listener(self._on_change)
        for thread in self._threads:
            thread.join(_RETRY_DELAY)  # a world model that is away may not answer for long
        self._signals.close()

    # -- frames and signals --------------------------------------------------------------------------------------

    def _on_frames(self, message: Any) -> None:
        frames = frames_data(message)
        with self._lock:
            self._frames.update(frames)
        self._has_values.set()

    def _take_values(self) -> None:
        while True:
            self._has_values.wait()
            self._has_values.clear()
            if self._is_ending.is_set():
                return
            with self._lock:
                frames, self._frames = self._frames, {}
            if frames:
                self._report(EntriesChanged("frames", frames))
            self._signals.take()
            self._is_ending.wait(1.0 / _RATE)

    # -- elements ------------------------------------------------------------------------------------------------

    def _on_change(self, change: Change) -> None:
        self._changed.add(change)
        self._changed.add_ids({str(end) for r in change.relations for end in (r["src"], r["dst"])})

    def _read_elements(self, world: WorldModelInterface, view: SceneView) -> None:
        while not self._is_ending.is_set():
            self._changed.waiting.wait()
            if self._is_ending.is_set():
                return
            begin = time.monotonic()
            try:
                with self._changed.read(world) as (elements, is_whole):
                    found = {eid: view.element(element) if element else None for eid, element in elements.items()}
                    self._report(EntriesChanged("elements", found, is_whole))
                    if is_whole or any(element is None or element.hasProperty(TOPIC) for element in elements.values()):
                        self._signals.follow(_find_signals(world))
            except (SkirosError, rospy.ROSException) as error:
                log.warning("the live view cannot read the scene: %s", error)
                self._is_ending.wait(_RETRY_DELAY)
            self._is_ending.wait(max(0.0, begin + 1.0 / _RATE - time.monotonic()))

    # -- bodies --------------------------------------------------------------------------------------------------

    def _read_bodies(self, _: WorldModelInterface, view: SceneView) -> None:
        known: dict[str, tuple[str, str]] = {}
        while not self._is_ending.is_set():
            try:
                texts = robot_descriptions()
            except (OSError, rospy.ROSException) as error:
                log.debug("robot descriptions: %s", error)
            else:
                changed = {name for name in {*known, *texts} if known.get(name) != texts.get(name)}
                if bodies := {name: _body(view, name, texts.get(name)) for name in changed}:
                    self._report(EntriesChanged("bodies", bodies))
                known = texts
            self._is_ending.wait(_CHECK_PERIOD)


class _Signals:
    """Follows the signals of the scene. Any thread.

    :param has_values: is set when `take` has something to report.
    """

    def __init__(self, report: Report, has_values: threading.Event) -> None:
        self._report = report
        self._has_values = has_values
        self._source = RosSignals()
        self._followed: dict[str, tuple[SceneSignal, Callable[[], None]]] = {}
        self._lock = threading.Lock()  # guards what was received
        self._values: dict[str, dict[str, Any]] = {}
        self._known: dict[str, dict[str, Any]] = {}

    def close(self) -> None:
        self._source.close()

    def follow(self, signals: dict[str, SceneSignal]) -> None:
        """Follows these signals only. Called by one thread."""
        gone = [eid for eid, (signal, _) in self._followed.items() if signals.get(eid) != signal]
        for eid in gone:
            self._followed.pop(eid)[1]()
        new = {eid: signal for eid, signal in signals.items() if eid not in self._followed}
        data = {eid: _signal_data(found.signal, found.robot) for eid, found in new.items() if found.signal is not None}
        with self._lock:
            for eid in gone:
                self._known.pop(eid, None)
            self._known.update(data)
            if gone or data:
                self._report(EntriesChanged("signals", {**dict.fromkeys(gone), **data}))
        for eid, found in new.items():
            if found.signal is not None:
                self._followed[eid] = (found, self._source.subscribe(found.signal, partial(self._receive, eid)))

    def take(self) -> None:
        """Reports the values since the last call."""
        with self._lock:
            values, self._values = self._values, {}
            data = {eid: {**self._known[eid], **value} for eid, value in values.items() if eid in self._known}
            if data:
                self._report(EntriesChanged("signals", data))

    def _receive(self, eid: str, value: float, _: float, problem: str) -> None:
        """In threads of ROS."""
        at = round(now(), 3)
        with self._lock:
            if problem:
                self._values[eid] = {"problem": problem, "time": at}
            else:
                known = self._values.get(eid, {})
                low, high = min(value, known.get("low", value)), max(value, known.get("high", value))
                parts = {"value": value, "low": low, "high": high}
                self._values[eid] = {key: float(f"{part:.5g}") for key, part in parts.items()} | {"time": at}
        self._has_values.set()


def _signal_data(signal: Signal, robot: str) -> dict[str, Any]:
    return {"name": signal.name, "unit": signal.unit, "robot": robot}


def _find_signals(world: WorldModelInterface) -> dict[str, SceneSignal]:
    """Returns the signals of the scene by id."""
    found = {}
    for element in world.resolve_elements(Element(SIGNAL)):
        found[element.id] = read = read_signal(element, manager_above(element, partial(_owner, world)))
        if read.problem:
            log.warning("%s", read.problem)
    return found


def _owner(world: WorldModelInterface, eid: str) -> Element | None:
    """Returns the element that has an element as a part; None if there is none."""
    relations = world.get_relations("", "skiros:hasA", eid)
    return world.find_element(relations[0]["src"]) if relations else None


def _body(view: SceneView, name: str, description: tuple[str, str] | None) -> list[dict[str, Any]] | None:
    """Returns the visuals of a robot; None if it has no description any more, or one that is not a URDF."""
    if description is None:
        return None
    try:
        return view.robot(*description)
    except WrongValue as error:
        log.warning("%s: %s", name, error)
        return None
