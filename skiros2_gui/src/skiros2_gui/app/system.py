"""The port to the running system, and the status of its parts as text. `app.ros.system` is its adapter."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from skiros2_common.core.signals import SignalSource
from skiros2_live.core.cell import CellDocument
from skiros2_live.core.patch import MASTER, TASK_MANAGER, WORLD_MODEL, SafetyChanged
from skiros2_runs.core.values import NodeStatus, TaskBounds
from skiros2_skill.client.description import Skill, Step, Why
from skiros2_skill.core.breakpoint import Breakpoint
from skiros2_skill.core.start_preview import StartPreview
from skiros2_world_model.core.queries import SceneReader
from skiros2_world_model.core.world_model_client import WorldModelClient

#: The kind of parts that are robots; others have the kinds of `skiros2_live.core.patch`.
MANAGER = "robot"


@dataclass(frozen=True)
class Part:
    """A part of the system and its status.

    :param kind: `MANAGER`, `MASTER`, `WORLD_MODEL` or `TASK_MANAGER`.
    :param name: the node name, or the master's URI.
    :param since: when the status changed last (s since the epoch); 0.0 if the part has never been up.
    :param text: details for users.
    :param stop: the stop of a robot, such as "emergency stop"; "" while it is not stopped.
    """

    kind: str
    name: str
    is_up: bool
    since: float
    text: str = ""
    stop: str = ""


class Manager(Protocol):
    """A skill manager. Methods block and are called by jobs only. They raise `SkirosError` if the manager refuses or
    does not answer.
    """

    @property
    def name(self) -> str:
        """The node name. Does not block."""

    def read_skills(self) -> list[Skill]:
        """Returns the skills offered."""

    def command(self, action: str, task_id: int, skills: Sequence[Step] = ()) -> int:
        """Sends a command and returns the task id.

        :param action: `start` (resumes a paused task; with id -1 starts a new one), `preempt`, `pause` or `tick_once`
            (with id -1 starts a new task, ticks it once and pauses it).
        :param skills: the skills of a new task, in sequence.
        """

    def read_tasks(self, task_id: int = -1) -> list[Sequence[Any]]:
        """Returns the `SkillProgress` of all nodes of each unfinished task, ordered by task id."""

    def preview(self, skills: Sequence[Step], partial: bool = False) -> StartPreview:
        """Returns what a start of skills would do now; changes nothing.

        :param partial: whether required parameters may have no value yet.
        """

    def why(self, task_id: int = -1) -> Why:
        """Explains a failed task; -1: the last one that failed or was refused."""

    def inspect(self, task_id: int, node_id: int) -> NodeStatus:
        """Returns the current parameters and conditions of a node of an unfinished task."""

    def signal_bounds(self, task_id: int) -> TaskBounds:
        """Returns the limits that the nodes of a task have set for signals in their last runs."""

    def set_breakpoint(self, kind: str, pattern: str, when: str = "") -> int:
        """Adds a breakpoint. Returns its number."""

    def remove_breakpoint(self, number: int = -1) -> None:
        """Removes a breakpoint; -1: all."""

    def breakpoints(self) -> dict[int, Breakpoint]:
        """Returns the breakpoints by number."""


class Planner(Protocol):
    """The task manager. Methods are called by jobs only; they raise `SkirosError` if it refuses or does not answer."""

    @property
    def active_goals(self) -> frozenset[str]:
        """The ids of the goals of all clients that have not ended. Does not block."""

    def plan(self, goals: str) -> Any:
        """Makes a plan without executing it; blocks until the end and returns a `MakePlanResult`."""

    def achieve(self, goals: str, on_feedback: Callable[[Any], None], quality: str = "", seconds: float = 0.0) -> Any:
        """Plans and executes goals; blocks until the end and returns an `AchieveResult`.

        :param on_feedback: called, in any thread, with each `AchieveFeedback`.
        """

    def cancel(self) -> None:
        """Cancels a running `plan` or `achieve`, from another thread."""

    def cancel_goal(self, goal_id: str) -> None:
        """Cancels a goal of any client."""


class Simulator(Protocol):
    """The simulated world. Called by jobs only."""

    def is_up(self) -> bool:
        """Returns whether a simulator runs."""

    def push(self, eid: str, force: tuple[float, float, float], duration: float) -> None:
        """Applies a force at the centre of an element.

        :param force: N, in the map.
        :param duration: s.
        :raises SkirosError: the simulator refuses, or does not answer.
        """


class System(Protocol):
    """The running system. Members do not block. Parts that are not up are None or missing.

    It puts patches of a `CellDocument` into the window's queue of events; see also `parts_of`.
    """

    @property
    def world(self) -> WorldModelClient | None:
        """The world model for blocking calls: changes, queries, files, history. For jobs only. None before it was
        found; raises `WmException` when it is down.
        """

    @property
    def scene(self) -> SceneReader | None:
        """The replica of the scene (context "scene"), read in the window's thread without blocking. It may be newer
        than the last `WorldChanged`, and keeps its last state while the world model is down.
        """

    @property
    def managers(self) -> dict[str, Manager]:
        """The managers that are up, by node name."""

    @property
    def planner(self) -> Planner | None:
        """The task manager; None if it is not up."""

    @property
    def signals(self) -> SignalSource | None:
        """Delivers the values of signals; None before the window is connected."""

    @property
    def simulator(self) -> Simulator | None:
        """The simulator, which may not run; None before the window is connected."""

    def set_movable(self, eid: str) -> None:
        """Lets views outside the window (rviz) move this element; "" for none."""

    def gateway_address(self) -> str:
        """Returns the address of the cell's gateway (REST); "" if none has run. Blocks: for jobs only."""

    def close(self) -> None:
        """Disconnects. Does not block."""


def stop_of(safety: SafetyChanged | None) -> tuple[str, str]:
    """Returns the stops of a robot as a sentence, and the kind of the worst; ("", "") for none."""
    if safety is None or not safety.stops:
        return "", ""
    return f"Stopped since {clock(safety.since)}: {'; '.join(safety.stops)}.", safety.state.replace("_", " ")


def parts_of(cell: CellDocument) -> list[Part]:
    """Returns the status of the master, the world model, all robots seen so far and the task manager."""
    robots = [
        Part(MANAGER, robot.name, robot.is_connected, robot.connection_since, *stop_of(robot.safety))
        for _, robot in sorted(cell.robots.items())
    ]
    others = {c.name: Part(c.name, c.address, c.is_up, c.since, c.text) for c in cell.connections.values()}
    first = [others[kind] for kind in (MASTER, WORLD_MODEL) if kind in others]
    return [*first, *robots, *(part for kind, part in others.items() if kind == TASK_MANAGER)]


def part_of(cell: CellDocument, kind: str, name: str = "") -> Part | None:
    """Returns the part of a kind (and name, if given); None if it has never been up."""
    return next((p for p in parts_of(cell) if p.kind == kind and name in ("", p.name)), None)


def short(part: Part) -> str:
    """Returns the name of a part for the status line."""
    name = f"{part.kind} {part.name.lstrip('/')}" if part.kind == MANAGER else part.kind
    return f"{name}: {part.stop}" if part.is_up and part.stop else name


def sign(part: Part) -> tuple[str, str]:
    """Returns the status symbol of a part and its colour role."""
    if part.is_up:
        return ("■", "failure") if part.stop else ("●", "success")
    return ("✕", "failure") if part.since else ("○", "idle")


def sentence(part: Part) -> str:
    """Describes the status of a part in one sentence."""
    if not part.is_up and not part.since:
        return f"{_never(part.kind)} {part.text}".rstrip()
    name = f"The {part.kind} {part.name}" if part.kind in (MASTER, MANAGER) else f"The {part.kind}"
    since = clock(part.since)
    more = f" {part.text}" if part.text else ""
    if part.is_up:
        return f"{name} has been running since {since}.{more if part.stop else ''}"
    return f"{name} has been missing since {since}.{more}"


def clock(stamp: float) -> str:
    """Formats a time (s since the epoch); with the date unless it is today."""
    then = time.localtime(stamp)
    is_today = then[:3] == time.localtime()[:3]
    return time.strftime("%H:%M:%S" if is_today else "%Y-%m-%d %H:%M:%S", then)


def missing(parts: Sequence[Part], needs: Sequence[str]) -> str:
    """Describes the required parts that are missing; "" if none is.

    :param needs: the kinds of parts required. One part of each kind is enough.
    """
    kinds = {p.kind: p for p in parts}
    if MASTER in kinds and not kinds[MASTER].is_up:
        return sentence(kinds[MASTER]) + " The window reconnects when it is back."
    sentences = []
    for kind in needs:
        of_kind = [p for p in parts if p.kind == kind]
        if any(p.is_up for p in of_kind):
            continue
        sentences += [sentence(p) for p in of_kind] or [_never(kind)]
    return " ".join(sentences)


def _never(kind: str) -> str:
    return {
        WORLD_MODEL: "The world model is not running yet.",
        MANAGER: "No robot is running yet: there is no skill manager.",
        TASK_MANAGER: "The task manager is not running yet.",
    }.get(kind, f"There is no {kind} yet.")
