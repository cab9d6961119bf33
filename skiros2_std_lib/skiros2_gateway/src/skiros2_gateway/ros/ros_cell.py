"""The adapter of the port `Cell` over ROS: task manager, skill managers and world model."""

from __future__ import annotations

import asyncio
import json
import logging
import threading
from collections.abc import Callable, Collection, Mapping, Sequence
from functools import partial
from typing import Any, TypeVar

import rospy

from skiros2_common.core.errors import Refused, SkirosError, UnknownName, WrongValue
from skiros2_common.core.manager_names import matching_name
from skiros2_common.core.names import nearest
from skiros2_gateway.core.cell import Collected, Ending, Goal, GoalListener, Progress
from skiros2_gateway.core.change_words import entry_sentences
from skiros2_gateway.core.connection import connect
from skiros2_gateway.core.deadline import remaining
from skiros2_gateway.core.edits import EditPreview, Edits, apply_edits, preview_edits
from skiros2_gateway.core.events import EventStream
from skiros2_gateway.core.goal_check import goal_problems
from skiros2_gateway.core.goal_form import GoalEdit, GoalForms
from skiros2_gateway.core.problems import Problem
from skiros2_gateway.core.work_masters import WorkMasters
from skiros2_gateway.ros.blocking_calls import BlockingCalls
from skiros2_gateway.ros.goal_starts import GoalStarts
from skiros2_gateway.ros.goals import AchieveGoals, set_on_restart
from skiros2_gateway.ros.queries import UserQueries
from skiros2_gateway.ros.robot_stops import RobotStops
from skiros2_gateway.ros.scene_work_masters import SceneWorkMasters
from skiros2_gateway.ros.skill_runs import SkillRuns, check_start
from skiros2_live.core.cell import CellDocument, RobotChanged
from skiros2_live.core.element_data import change_data, element_data
from skiros2_live.core.patch import Patch
from skiros2_live.core.robots import DISCONNECTED, Robot, first_stop
from skiros2_live.ros.managers import ManagerConnections
from skiros2_live.ros.scene_feed import SceneFeed
from skiros2_msgs import srv as srvs
from skiros2_msgs.msg import MakePlanResult
from skiros2_skill.client.manager import ManagerClient
from skiros2_task.core.goal_report import ASKING
from skiros2_task.ros.achieve_action import INTERRUPT_PRIORITY
from skiros2_task.ros.task_manager_interface import TaskManagerInterface
from skiros2_world_model.ros.world_model_interface import WorldModelInterface

log = logging.getLogger(__name__)

T = TypeVar("T")

#: The most goals in the document.
_MAX_GOALS = 20
#: How long an order waits for the first answer of the world model (s): it may come right after the gateway's start.
_FIRST_ANSWER = 10.0


class RosCell:
    """Implements `Cell`. Call `close` at the end.

    :param masters: gets those that the scene defines.
    :param capacity: how many goals run at once; 0: as many as there are robots.
    """

    def __init__(self, listener: GoalListener, events: EventStream, masters: WorkMasters, capacity: int = 0) -> None:
        self._loop = asyncio.get_running_loop()
        self._listener = listener
        self._events = events
        self._masters = masters
        self._capacity = capacity
        self._calls = BlockingCalls()
        #: Runs a blocking call; see `BlockingCalls`.
        self.in_thread = self._calls.run
        #: Stops, pauses and resumes tasks; shares no thread and no connection.
        self.stops = RobotStops()
        self._queries = UserQueries()
        self._wm: WorldModelInterface | None = None
        self._has_answered = threading.Event()
        self.document = CellDocument(max_goals=_MAX_GOALS)
        self.scene = SceneFeed(self.report)
        self.document.subscribe(RobotChanged, lambda change: self._on_robot(change.robot))
        self._goals = AchieveGoals(self._loop, _PausingListener(self, listener), self._apply, listener.cell_changed)
        self._starts = GoalStarts(self._goals.send, listener, self.in_thread, self.plan)
        self._managers = ManagerConnections(rospy.get_name(), self.report)
        self._robots_of: dict[str, list[tuple[str, str]]] = {}  # (robot, skill) of each goal's running steps
        self._questions: dict[str, str] = {}  # of goals that ask how to continue after a restart; "": they do not
        self._paused: set[str] = set()
        self._tasks: set[asyncio.Task[None]] = set()
        self._skill_runs = SkillRuns()
        self._goal_forms = GoalForms(lambda: self._world_model)
        self._planners: list[TaskManagerInterface] = []  # those without a request: each has subscriptions
        self._closed = threading.Event()
        threading.Thread(target=self._connect, name="world model", daemon=True).start()

    def _connect(self) -> None:
        """Connects to the world model. In a thread of its own: no job starts before."""
        wm = connect(partial(_world_model, self._masters, self._loop), self._closed)
        if wm is not None:
            wm.add_listener(lambda change: self._in_loop(self._events.publish, "world", change_data(change)))
            self._wm = wm
            self.scene.follow(wm)
            self._has_answered.set()
            self._in_loop(self._listener.cell_changed)

    def close(self) -> None:
        """Closes all connections. Goals continue."""
        self._closed.set()
        self._starts.close()
        self.scene.close()
        for task in self._tasks:
            task.cancel()
        self._goals.close()
        self._managers.close()
        self.stops.close()
        self._calls.close()
        self._queries.close()

    # -- goals -------------------------------------------------------------------------------------------------

    @property
    def is_ready(self) -> bool:
        return self._wm is not None and self._goals.is_ready

    @property
    def revision(self) -> int:
        return self._wm.last_change_number if self._wm is not None else 0

    @property
    def capacity(self) -> int:
        connected = sum(robot.is_connected for robot in self.document.robots.values())
        return self._capacity or max(1, connected)

    @property
    def interrupt_priority(self) -> int:
        return INTERRUPT_PRIORITY

    async def problems(
        self, goal: str, elements: Mapping[str, tuple[str, str]], robots: Sequence[str]
    ) -> list[Problem]:
        await self.in_thread(self._has_answered.wait, _FIRST_ANSWER)
        problems = _robot_problems(robots, self.document.robots)
        return problems + await self.in_thread(goal_problems, self._world_model, list(self.managers), goal, elements)

    def start(self, goal: Goal) -> None:
        self._starts.start(goal)

    def follow(self, goal: Goal) -> None:
        self._goals.follow(goal.id)

    def stop(self, goal_id: str) -> None:
        if not self._starts.stop(goal_id):
            self._goals.cancel(goal_id)

    def pause(self, goal_id: str) -> None:
        self._paused.add(goal_id)
        self._command_tasks(goal_id, "pause")

    def resume(self, goal_id: str) -> None:
        self._paused.discard(goal_id)
        if self._questions.get(goal_id):
            self._spawn(self._continue(goal_id))
        self._command_tasks(goal_id, "resume")

    async def _continue(self, goal_id: str) -> None:
        """Has a goal continue that asks how; reports it as suspended if it still does."""
        try:
            await self.in_thread(set_on_restart, goal_id, srvs.GoalOnRestartRequest.CONTINUE)
        except SkirosError as error:
            log.error("resume job %s: %s", goal_id, error)
            self._report_stop(goal_id)

    def note_progress(self, goal_id: str, progress: Progress) -> None:
        """Notes which robots run steps of a goal; pauses new steps of a paused goal, and reports stops."""
        names = {step["number"]: step["label"] for step in progress.plan}
        running = [(s["robot"], names.get(s["number"], "")) for s in progress.steps if s["state"] == "running"]
        has_new = set(running) - set(self._robots_of.get(goal_id, []))
        self._robots_of[goal_id] = running
        self._questions[goal_id] = progress.message if progress.phase == ASKING else ""
        if goal_id in self._paused and has_new:
            self._command_tasks(goal_id, "pause")
        self._report_stop(goal_id)

    def note_end(self, goal_id: str) -> None:
        """Forgets a goal that has ended."""
        self._robots_of.pop(goal_id, None)
        self._questions.pop(goal_id, None)
        self._paused.discard(goal_id)

    def _report_stop(self, goal_id: str) -> None:
        robots = [robot for robot, _ in self._robots_of.get(goal_id, [])]
        reason = self._questions.get(goal_id, "") or first_stop(self.document.robots, robots)
        self._listener.goal_suspended(goal_id, reason)

    def _command_tasks(self, goal_id: str, action: str) -> None:
        """Pauses or resumes the tasks of a goal's running steps."""
        for name, label in self._robots_of.get(goal_id, []):
            for run in self.document.running(name):
                if any(node.label == label for node in run.nodes):
                    self._spawn(self._command_task(action, name, run.task_id, goal_id))

    async def _command_task(self, action: str, robot: str, task: int, goal_id: str) -> None:
        try:
            await self.stops.command(action, [robot], f"job {goal_id}", task)
        except SkirosError as error:  # it has ended meanwhile, or its robot does not answer
            log.error("%s job %s: task %d of %s: %s", action, goal_id, task, robot, error)

    # -- reading -----------------------------------------------------------------------------------------------

    @property
    def managers(self) -> dict[str, ManagerClient]:
        """The clients of the robots' managers that run, by their node names."""
        return self._managers.managers

    @property
    def connected(self) -> list[str]:
        """The node names of the robots' managers that run."""
        return sorted(robot.name for robot in self.document.robots.values() if robot.is_connected)

    @property
    def world_model(self) -> WorldModelInterface | None:
        """The client with a replica of the scene; None before the world model has answered."""
        return self._wm

    def state(self) -> dict[str, Any]:
        return {"robots": self.document.robots_data(), "ready": self.is_ready, "capacity": self.capacity}

    async def world(self) -> dict[str, Any]:
        def read() -> dict[str, Any]:
            wm = self._world_model
            elements, snapshot = wm.get_scene()
            return {"revision": wm.version, "snapshot": snapshot, "elements": [element_data(e) for e in elements]}

        return await self.in_thread(read)

    async def query(self, text: str, user: str) -> dict[str, Any]:
        return await self._queries.ask(user, text)

    async def skills(self) -> dict[str, list[dict[str, Any]]]:
        def read() -> dict[str, list[dict[str, Any]]]:
            return {
                name: [
                    {"type": s.type, "label": s.label, "parameters": [p.as_json() for p in s.parameters.values()]}
                    for s in client.read_skills()
                ]
                for name, client in self.managers.items()
            }

        return await self.in_thread(read)

    async def check_start(self, robot: str, skill: str, parameters: Mapping[str, Any]) -> dict[str, Any]:
        return await self.in_thread(check_start, self._client(robot), self._world_model, skill, parameters)

    async def run_skill(self, robot: str, skill: str, parameters: Mapping[str, Any], values: Mapping[str, Any]) -> int:
        client = self._client(robot)
        return await self.in_thread(self._skill_runs.start, client, self._world_model, skill, parameters, values)

    async def skill_run(self, robot: str, task: int) -> dict[str, Any]:
        return await self.in_thread(self._skill_runs.describe, robot, task)

    async def stop_task(self, robot: str, task: int) -> None:
        await self.stops.command("stop", [robot], rospy.get_name(), task, remaining())

    async def preview_edits(self, edits: Edits) -> EditPreview:
        return await self.in_thread(preview_edits, self._world_model, edits)

    async def apply_edits(self, edits: Edits, preview: EditPreview) -> None:
        await self.in_thread(apply_edits, self._world_model, edits, preview)

    async def goal_form(self, edit: GoalEdit) -> dict[str, Any]:
        return await self.in_thread(self._goal_forms.form, edit)

    async def plan(self, goal: str, quality: str = "") -> dict[str, Any]:
        def make() -> Any:
            try:
                client = self._planners.pop()
            except IndexError:
                client = TaskManagerInterface()
            try:
                client.make_plan(goal, quality=quality)
                return client.wait_for_result()
            finally:
                self._planners.append(client)

        return _plan_data(await self._calls.plan(make))

    async def command_robots(self, action: str, robots: Sequence[str], user: str = "") -> dict[str, Any]:
        return await self.stops.command(action, robots, user or rospy.get_name(), limit=remaining())

    async def collect(
        self, robots: Sequence[str], start: float, end: float, quality: Mapping[str, tuple[str, str]]
    ) -> Collected:
        return await self.in_thread(lambda: _collect(self._world_model, robots, start, end, dict(quality)))

    # -- in threads of the pool --------------------------------------------------------------------------------

    @property
    def _world_model(self) -> WorldModelInterface:
        if self._wm is None:
            raise Refused("the world model has not answered yet")
        return self._wm

    def _client(self, robot: str) -> ManagerClient:
        """:raises UnknownName: no such robot is connected."""
        clients = self.managers
        name = matching_name(robot, clients)
        if not name:
            near = ", ".join(nearest(robot, clients) or clients) or "none"
            raise UnknownName(f"no robot {robot!r} is connected; near: {near}")
        return clients[name]

    # -- internals ---------------------------------------------------------------------------------------------

    def report(self, patch: Patch) -> None:
        """Has a patch applied to the document. Any thread."""
        self._in_loop(self._apply, patch)

    def _apply(self, patch: Patch) -> None:
        try:
            self.document.apply(patch)
        except WrongValue as error:
            log.warning("%s", error)

    def _on_robot(self, robot: Robot) -> None:
        self.stops.set_robots(self.connected)
        for goal_id, running in list(self._robots_of.items()):
            if any(name == robot.name for name, _ in running) and robot.state != DISCONNECTED:
                self._report_stop(goal_id)
        self._listener.cell_changed()

    def _spawn(self, coroutine: Any) -> None:
        task = self._loop.create_task(coroutine)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    def _in_loop(self, call: Callable[..., Any], *arguments: Any) -> None:
        if not self._loop.is_closed():
            self._loop.call_soon_threadsafe(partial(call, *arguments))


def _world_model(masters: WorkMasters, loop: asyncio.AbstractEventLoop) -> WorldModelInterface:
    wm = WorldModelInterface(rospy.get_name(), make_cache=True)
    SceneWorkMasters(wm, masters, loop)
    return wm


def _robot_problems(names: Sequence[str], robots: Collection[str]) -> list[Problem]:
    problems = []
    for i, name in enumerate(names):
        if name not in robots:
            near = tuple(nearest(name, robots) or robots)
            problems.append(Problem("unknown_name", f"robots.{i}", f"there is no robot {name}", nearest=near))
    return problems


def _collect(
    wm: WorldModelInterface, robots: Sequence[str], start: float, end: float, quality: dict[str, tuple[str, str]]
) -> Collected:
    notes = []
    values: dict[str, Any] = {}
    changes: list[dict[str, Any]] = []
    for key, (eid, prop) in quality.items():
        element = wm.find_element(eid)
        if element is None or not element.hasProperty(prop, not_none=True):
            reason = "does not exist" if element is None else f"has no {prop}"
            notes.append(f"quality data {key}: {eid} {reason}")
        else:
            values[key] = element.value_of(prop)
    try:
        for robot in robots:
            for entry in wm.history("", start, end, robot):
                lines = entry_sentences(entry)
                related = {eid for s, _, o in entry.changes.relations for eid in (s, o)}
                ids = sorted(related | set(entry.changes.records))
                changes.append({"author": entry.author, "time": entry.stamp, "elements": ids, "lines": lines})
    except SkirosError as error:
        notes.append(f"the changes of the world model are unknown: {error}")
    return Collected(sorted(changes, key=lambda change: change["time"]), values, notes)


def _plan_data(result: MakePlanResult) -> dict[str, Any]:
    return {
        "state": result.state,
        "message": result.message,
        "plan": json.loads(result.plan or "[]"),
        "makespan": result.makespan,
        "why": json.loads(result.why) if result.why else None,
        "preview": json.loads(result.preview) if result.preview else None,
        "notes": list(result.notes),
    }


class _PausingListener:
    """Passes events of goals on, and keeps the cell's notes of their running steps."""

    def __init__(self, cell: RosCell, listener: GoalListener) -> None:
        self._cell = cell
        self._listener = listener
        self.cell_changed = listener.cell_changed
        self.goal_accepted = listener.goal_accepted
        self.goal_suspended = listener.goal_suspended

    def goal_progress(self, goal_id: str, progress: Progress) -> None:
        self._listener.goal_progress(goal_id, progress)
        self._cell.note_progress(goal_id, progress)

    def goal_ended(self, goal_id: str, ending: Ending) -> None:
        self._cell.note_end(goal_id)
        self._listener.goal_ended(goal_id, ending)
