"""Feeds the live view from ROS: progress of tasks, goals, tf, robot descriptions, world model and signals."""

from __future__ import annotations

import asyncio
import logging
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import rospkg
import rospy
from tf2_msgs.msg import TFMessage

from skiros2_common.core.errors import Refused, SkirosError, UnknownName, WrongValue
from skiros2_common.core.forward_clock import now
from skiros2_common.core.manager_names import manager_of, matching_name
from skiros2_common.core.operations import SCENE, Change
from skiros2_common.core.signals import SIGNAL, TOPIC, Signal
from skiros2_common.core.world_element import Element
from skiros2_common.ros.signals import RosSignals
from skiros2_gateway.core.deadline import remaining
from skiros2_gateway.core.live import LiveView
from skiros2_gateway.core.scene_view import SceneView, frames_data
from skiros2_gateway.core.signal_view import full_topic
from skiros2_gateway.ros.goals import SILENCE
from skiros2_gateway.ros.ros_cell import RosCell
from skiros2_live.core.changed_elements import ChangedElements
from skiros2_msgs import msg as msgs
from skiros2_runs.core.goal_progress import goal_after, new_goal
from skiros2_runs.core.goal_runs import GOALS
from skiros2_runs.core.values import NodeStatus
from skiros2_skill.client.manager import ManagerClient
from skiros2_task.ros.task_manager_interface import ACHIEVE_ACTION
from skiros2_world_model.ros.world_model_interface import WorldModelInterface

log = logging.getLogger(__name__)

#: The period of checks for the world model, robot descriptions and lost robots (s).
_CHECK_PERIOD = 1.0
#: The highest rate at which changed elements are read, and at which frames and signals are taken over (Hz).
_RATE = 25.0
#: The pause after the world model has not answered (s).
_RETRY_DELAY = 1.0

#: Files in the folders with meshes that viewers may read: also materials and textures.
_MESH_FILES = (".stl", ".obj", ".dae", ".mtl", ".png", ".jpg", ".jpeg", ".bmp", ".tga")


class LiveRos:
    """Implements `LiveCell`. Made and used in the thread of the loop; call `close` at the end."""

    def __init__(self, cell: RosCell, view: LiveView) -> None:
        self._cell = cell
        self._view = view
        self._loop = asyncio.get_running_loop()
        self._scene: _SceneReader | None = None
        self._recorded: SceneView | None = None
        self._signals = _SignalReader(view, self._loop)
        self._frames = _Frames()
        self._descriptions: dict[str, tuple[str, str]] = {}
        cell.robots.on_tree = view.record
        cell.robots.on_connection = lambda name, is_connected: None if is_connected else view.mark_lost(name)
        name = ACHIEVE_ACTION
        self._subscribers = [
            rospy.Subscriber(f"{name}/goal", msgs.AchieveActionGoal, self._in_loop(self._on_goal)),
            rospy.Subscriber(f"{name}/feedback", msgs.AchieveActionFeedback, self._in_loop(self._on_progress)),
            rospy.Subscriber(f"{name}/result", msgs.AchieveActionResult, self._in_loop(self._on_progress)),
            rospy.Subscriber("/tf", TFMessage, self._frames.add, queue_size=100),
            rospy.Subscriber("/tf_static", TFMessage, self._frames.add, queue_size=100),
        ]
        self._tasks = [self._loop.create_task(self._check()), self._loop.create_task(self._take())]

    def close(self) -> None:
        """Ends all subscriptions."""
        for task in self._tasks:
            task.cancel()
        for subscriber in self._subscribers:
            subscriber.unregister()
        if self._scene is not None:
            self._scene.close()
        self._signals.close()

    # -- what viewers ask for ----------------------------------------------------------------------------------

    async def inspect(self, robot: str, task: int, node: int) -> NodeStatus:
        return await self._cell.in_thread(self._client(robot).inspect, task, node)

    async def why(self, robot: str, task: int) -> dict[str, Any]:
        why = await self._cell.in_thread(self._client(robot).why, task)
        return why.to_dict()

    async def command(self, action: str, robot: str, task: int) -> None:
        if action == "step":
            await self._cell.in_thread(self._client(robot).command, "tick_once", task)
        else:
            await self._cell.stops.command(action, [robot], rospy.get_name(), task, remaining())

    def stop_goal(self, goal_id: str) -> None:
        self._cell.stop(goal_id)

    def recorded_view(self) -> SceneView:
        if self._recorded is None:
            self._recorded = SceneView(self._is_subclass, _mesh_folders())
        return self._recorded

    def _is_subclass(self, child: str, parent: str) -> bool:
        """Whether one class is a subclass of another one, as far as the world model knows both."""
        wm = self._cell.world_model
        try:
            return wm is not None and wm.is_subclass(child, parent)
        except UnknownName:
            return False

    def mesh_file(self, url: str) -> Path:
        views = [self._scene.view if self._scene is not None else None, self._recorded]
        meshes = {mesh for view in views if view is not None for mesh in view.meshes}
        base, _, extra = url.rpartition("/")
        # A mesh file names textures and materials beside itself.
        if url not in meshes and not any(mesh.rpartition("/")[0] == base for mesh in meshes):
            raise UnknownName(f"no element or robot has the mesh {url}")
        if ".." in extra or Path(extra).suffix.lower() not in _MESH_FILES:
            raise UnknownName(f"{url} is not a mesh, and not a material or texture beside one")
        if url.startswith("package://"):
            package, _, rest = url.removeprefix("package://").partition("/")
            try:
                return Path(rospkg.RosPack().get_path(package)) / rest
            except rospkg.ResourceNotFound:
                raise UnknownName(f"{url}: there is no package {package}") from None
        return Path(url.removeprefix("file://"))

    def _client(self, robot: str) -> ManagerClient:
        agents = self._cell.robots.agents
        name = matching_name(robot, agents)
        if not name:
            raise Refused(f"the skill manager {robot} does not run; there are: {', '.join(agents) or 'none'}")
        return agents[name]

    # -- goals -------------------------------------------------------------------------------------------------

    def _on_goal(self, message: Any) -> None:
        goal_id = message.goal_id.id
        known = self._view.entry("goals", goal_id) or new_goal("", now())  # its feedback may come first
        self._view.put_goal(goal_id, {**known, "goal": message.goal.goals})

    def _on_progress(self, message: Any) -> None:
        goal_id = message.status.goal_id.id
        self._view.put_goal(goal_id, goal_after(self._view.entry("goals", goal_id), message, now()))

    # -- periodically ------------------------------------------------------------------------------------------

    async def _check(self) -> None:
        missing = 0
        while True:
            missing = 0 if self._cell.is_ready else missing + 1
            if missing == SILENCE // _CHECK_PERIOD:
                self._view.mark_lost(GOALS)
            wm = self._cell.world_model
            if self._scene is None and wm is not None:
                self._scene = _SceneReader(wm, SceneView(wm.is_subclass, _mesh_folders()), self._on_elements)
            if self._scene is not None:
                try:
                    texts = await self._cell.in_thread(_read_descriptions)
                    self._show_bodies(self._scene.view, texts)
                except (OSError, rospy.ROSException, SkirosError) as error:
                    log.debug("robot descriptions: %s", error)
            await asyncio.sleep(_CHECK_PERIOD)

    def _show_bodies(self, scene: SceneView, texts: dict[str, tuple[str, str]]) -> None:
        for name in {*self._descriptions, *texts}:
            if self._descriptions.get(name) == texts.get(name):
                continue
            try:
                self._view.put("bodies", name, scene.robot(*texts[name]) if name in texts else None)
            except WrongValue as error:
                log.warning("%s: %s", name, error)
        self._descriptions = texts

    async def _take(self) -> None:
        while True:
            for name, frame in self._frames.take().items():
                self._view.put("frames", name, frame)
            self._signals.take()
            await asyncio.sleep(1.0 / _RATE)

    def _on_elements(self, elements: dict[str, Any] | None, changed: dict[str, Any]) -> None:
        """In the thread of the scene's reader; see `_SceneReader`."""
        self._loop.call_soon_threadsafe(self._show_elements, elements, changed)

    def _show_elements(self, elements: dict[str, Any] | None, changed: dict[str, Any]) -> None:
        if elements is not None:
            self._view.replace("elements", elements)
        for eid, data in changed.items():
            self._view.put("elements", eid, data)
        wm = self._cell.world_model
        if wm is not None and (elements is not None or any(_may_be_signal(data) for data in changed.values())):
            self._loop.create_task(self._find_signals(wm))

    async def _find_signals(self, wm: WorldModelInterface) -> None:
        try:
            found = await self._cell.in_thread(_find_signals, wm)
        except SkirosError as error:
            log.warning("the signals of the scene are unknown: %s", error)
            return
        self._signals.follow(found)

    def _in_loop(self, handle: Callable[[Any], None]) -> Callable[[Any], None]:
        def callback(message: Any) -> None:
            if not self._loop.is_closed():
                self._loop.call_soon_threadsafe(handle, message)

        return callback


class _SceneReader:
    """Reads changed elements in a thread of its own.

    :param report: called in that thread with all elements by id, or None, and those that have changed; None: removed.
    """

    def __init__(
        self,
        world: WorldModelInterface,
        view: SceneView,
        report: Callable[[dict[str, Any] | None, dict[str, Any]], None],
    ) -> None:
        self.view = view
        self._world = world
        self._report = report
        self._changed = ChangedElements()
        self._is_ending = threading.Event()
        world.add_listener(self._on_change)
        self._thread = threading.Thread(target=self._run, name="live scene", daemon=True)
        self._thread.start()

    def close(self) -> None:
        self._world.remove_listener(self._on_change)
        self._is_ending.set()
        self._changed.waiting.set()
        self._thread.join(_RETRY_DELAY)  # a world model that is away may not answer for long

    def _on_change(self, change: Change) -> None:
        self._changed.add(change)
        self._changed.add_ids({str(end) for r in change.relations for end in (r["src"], r["dst"])})

    def _run(self) -> None:
        while not self._is_ending.is_set():
            self._changed.waiting.wait()
            if self._is_ending.is_set():
                return
            ids, begin = self._changed.take(), time.monotonic()
            try:
                if ids is None:
                    everything = self._world.resolve_elements(Element())
                    found = {element.id: self.view.element(element) for element in everything}
                    self._report(found, {})
                else:
                    elements = {eid: self._world.find_element(eid) for eid in ids}
                    self._report(None, {eid: self.view.element(e) if e else None for eid, e in elements.items()})
            except (SkirosError, rospy.ROSException) as error:
                log.warning("the live view cannot read the scene: %s", error)
                self._changed.restore(ids)
                self._is_ending.wait(_RETRY_DELAY)
            self._is_ending.wait(max(0.0, begin + 1.0 / _RATE - time.monotonic()))


class _Frames:
    """The last transform of each frame of tf."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._changed: dict[str, list[Any]] = {}

    def add(self, message: Any) -> None:
        """In threads of ROS."""
        frames = frames_data(message)
        with self._lock:
            self._changed.update(frames)

    def take(self) -> dict[str, list[Any]]:
        """Returns and clears those that were received since."""
        with self._lock:
            changed, self._changed = self._changed, {}
            return changed


class _SignalReader:
    """Reads the signals of the scene. Used in the thread of the loop."""

    def __init__(self, view: LiveView, loop: asyncio.AbstractEventLoop) -> None:
        self._view = view
        self._loop = loop
        self._source = RosSignals()
        self._followed: dict[str, tuple[Signal, Callable[[], None]]] = {}
        self._lock = threading.Lock()
        self._values: dict[str, dict[str, Any]] = {}

    def close(self) -> None:
        self._source.close()

    def follow(self, signals: dict[str, tuple[Signal, str]]) -> None:
        """Follows these signals only: (signal, robot) by the id of the element."""
        known = {eid: signal for eid, (signal, _) in self._followed.items()}
        for eid in [eid for eid in known if eid not in signals or signals[eid][0] != known[eid]]:
            self._followed.pop(eid)[1]()
            self._view.put("signals", eid, None)
        for eid, (signal, robot) in signals.items():
            if eid not in self._followed:
                self._view.put("signals", eid, {"name": signal.name, "unit": signal.unit, "robot": robot})
                self._followed[eid] = (signal, self._source.subscribe(signal, partial(self._receive, eid)))

    def take(self) -> None:
        """Takes over the values since the last call."""
        with self._lock:
            values, self._values = self._values, {}
        for eid, value in values.items():
            if eid in self._followed:
                signal, known = self._followed[eid][0], self._view.entry("signals", eid)
                base = {"name": signal.name, "unit": signal.unit, "robot": known.get("robot", "")}
                self._view.put("signals", eid, {**base, **value})

    def _receive(self, eid: str, value: float, _: float, problem: str) -> None:
        """In threads of ROS."""
        at = round(now(), 3)
        with self._lock:
            if problem:
                self._values[eid] = {"problem": problem, "time": at}
                return
            known = self._values.get(eid, {})
            low, high = min(value, known.get("low", value)), max(value, known.get("high", value))
            number = float(f"{value:.5g}")
            self._values[eid] = {"value": number, "low": float(f"{low:.5g}"), "high": float(f"{high:.5g}"), "time": at}


def _mesh_folders() -> list[str]:
    return [str(folder) for folder in [rospy.get_param("wm/workspace_dir", "")] if folder]


def _may_be_signal(data: dict[str, Any] | None) -> bool:
    """Whether a changed element is a signal; a removed one (None) may have been one."""
    return data is None or TOPIC in data["properties"]


def _find_signals(wm: WorldModelInterface) -> dict[str, tuple[Signal, str]]:
    """Returns the usable signals of the scene with the managers of their robots ("": none), by id."""
    found = {}
    for element in wm.resolve_elements(Element(SIGNAL)):
        robot = _manager_above(wm, element)
        try:
            signal = Signal.of(element)
        except WrongValue as error:
            log.warning("%s", error)
            continue
        found[element.id] = (replace(signal, topic=full_topic(signal.topic, robot)), robot)
    return found


def _manager_above(wm: WorldModelInterface, element: Element) -> str:
    """Returns the manager of the robot that an element is a part of; "" for none."""
    scene, seen = wm.known_scene, set()
    above: Element | None = element
    while above is not None and above.id not in seen:
        if manager := manager_of(above):
            return manager
        seen.add(above.id)
        owners = scene.related("", "skiros:hasA", above.id, SCENE) if scene is not None else []
        above = scene.find(owners[0]["src"], SCENE) if scene is not None and owners else None
    return ""


def _read_descriptions() -> dict[str, tuple[str, str]]:
    """Returns each parameter `robot_description` with the `tf_prefix` beside it. Calls the master."""
    names = [name for name in rospy.get_param_names() if name.rpartition("/")[2] == "robot_description"]
    return {
        name: (str(rospy.get_param(name, "")), str(rospy.get_param(f"{name.rpartition('/')[0]}/tf_prefix", "")))
        for name in names
    }
