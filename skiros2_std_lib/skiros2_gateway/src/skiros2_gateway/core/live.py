"""The live view: the cell's document as JSON data, the same for all viewers, which follow it by patches.

Its members are tables, objects by key; see also `skiros2_live.core.cell.CellDocument`:

- `runs`: the runs of trees, see `run_view.summary_data`; `trees`: the newest runs as of `run_view.tree_data`.
- `goals`: {goal, title, phase, message, start, plan, steps}; see `skiros2_runs.core.goal_progress`. A goal is a run
  too, of the robot `goals`; `goal` of a step's run is its key, and `trees` has the goal's.
- `jobs` as in the event `job`, without plan, steps and changes; `title` is the goal as a sentence.
- `approvals`: what agents ask for, as in `GET /api/approvals`, without previews and failures; `title` as of jobs.
- `connections`: {name, address, is_up, since, text} of the parts beside the robots, as far as they are known.
- `alarms`: what needs a person, see `skiros2_gateway.core.alarms`.
- `queue`: `hidden` is {count}, how many jobs wait beside those in `jobs`.
- `cell`: robots, ready and capacity, as in `GET /api/state`.
- `elements`: {type, label, properties, relations, marker}; see `skiros2_live.core.scene_view`.
- `frames`: of tf: [parent, x, y, z, qx, qy, qz, qw] (m) by child; `bodies`: the visuals of each robot.
- `signals`: {name, unit, robot, value, low, high, time, problem}; `low` and `high` since the previous patch.

A patch is a JSON Merge Patch (RFC 7396), encoded once, and sent at most 25 times a second.
"""

from __future__ import annotations

import asyncio
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from itertools import islice
from pathlib import Path
from typing import Any, Protocol

from skiros2_common.core.errors import UnknownName
from skiros2_common.core.names import nearest
from skiros2_gateway.core.alarms import TABLES as ALARM_TABLES
from skiros2_gateway.core.alarms import Alarms, alarms_of
from skiros2_gateway.core.events import EventStream
from skiros2_gateway.core.job import BEFORE, FINAL
from skiros2_gateway.core.json_text import json_text
from skiros2_gateway.core.patch import apply_patch, merge_patch, without_none
from skiros2_gateway.core.run_view import summary_data, tree_patch
from skiros2_gateway.core.scene_history import TABLES, SceneHistory
from skiros2_gateway.core.service import Service
from skiros2_live.core.cell import CellDocument, GoalChanged, RunsLost
from skiros2_live.core.patch import Connection, EntriesChanged
from skiros2_live.core.scene_view import SceneView
from skiros2_runs.core.frame import Frame
from skiros2_runs.core.task_run import Recorded, TaskRun
from skiros2_runs.core.values import NodeStatus

#: Actions on a task.
TASK_ACTIONS = ("stop", "pause", "resume", "step")

#: The shortest time between patches (s).
PERIOD = 0.04

#: Patches kept for viewers that resume: 10 s of changes at each patch.
_KEPT = 250
#: The trees and ended jobs in the document.
_MAX_TREES, _MAX_JOBS = 6, 50
#: The jobs in the document that have not started.
_MAX_WAITING = 100

#: The parts of a job's response in the document; `goals` has its plan and steps.
_RESPONSE = ("started", "ended", "outcome", "message", "robots", "quality")

_TABLES = (
    *("runs", "trees", "goals", "jobs", "approvals", "connections", "cell", "alarms", "queue"),
    *("elements", "frames", "bodies", "signals"),
)


class LiveCell(Protocol):
    """The cell as viewers use it. Methods raise `SkirosError` if the cell refuses or does not answer."""

    async def inspect(self, robot: str, task: int, node: int) -> NodeStatus:
        """Returns the parameters and conditions of a node."""

    async def why(self, robot: str, task: int) -> dict[str, Any]:
        """Returns why a task failed: `text`, and `explanations` as of `Explanation.to_dict`."""

    async def command(self, action: str, robot: str, task: int) -> None:
        """Applies one of `TASK_ACTIONS` to a task."""

    def stop_goal(self, goal_id: str) -> None:
        """Cancels a goal of any client."""

    def recorded_view(self) -> SceneView:
        """Returns the view for scenes of bags. Its methods block."""

    def mesh_file(self, url: str) -> Path:
        """Returns the file of a mesh in the document, or of a file beside one.

        :raises UnknownName: it is no such file.
        """


class LiveView:
    """The document and its patches. To be used in the thread of the gateway's loop.

    :param cell: the cell's document, of which this is a view.
    """

    def __init__(self, cell: CellDocument) -> None:
        self.cell = cell
        self._loop = asyncio.get_running_loop()
        self.stream = EventStream(kept=_KEPT, behind=_KEPT)
        self.scenes = SceneHistory()
        self._keys: dict[str, TaskRun] = {}
        self._count = 0
        self._document: dict[str, Any] = {table: {} for table in _TABLES}
        self._texts: dict[str, str] = {}  # of tables that have not changed since
        self._patch: dict[str, Any] = {}
        self._changed_runs: dict[str, TaskRun] = {}
        self._sent: dict[str, Frame] = {}
        self._timer: asyncio.TimerHandle | None = None
        self._last_flush = 0.0
        self._waiting: set[str] = set()  # the jobs in the document that have not started
        self._hidden: set[str] = set()  # others
        self._ended: dict[str, None] = {}  # the ended jobs in the document, the oldest first
        self._alarms: Alarms | None = None  # before it follows
        self._has_alarm_change = False
        cell.subscribe(Recorded, self._on_progress)
        cell.subscribe(RunsLost, lambda lost: self._show_runs(lost.runs))
        cell.subscribe(GoalChanged, lambda goal: self._show_goal(goal.goal_id, goal.data, goal.new_steps))
        cell.subscribe(EntriesChanged, lambda patch: self._show_entries(patch.table, patch.entries, patch.is_whole))
        cell.subscribe(Connection, lambda patch: self.put("connections", patch.name, asdict(patch)))
        self._show_runs(cell.runs)
        for connection in cell.connections.values():
            self.put("connections", connection.name, asdict(connection))
        for goal_id, data in cell.goals.items():
            self._show_goal(goal_id, data)
        for table, entries in cell.tables.items():
            self._show_entries(table, entries, is_whole=True)

    def snapshot(self) -> dict[str, Any]:
        """Returns `document`, and the id of the last patch in it as `event`."""
        self.flush()
        return {"event": self.stream.last_id, "time": self.cell.clock(), "document": self._document}

    def snapshot_text(self, more: Mapping[str, Any]) -> str:
        """Returns the snapshot as JSON, with further members. The texts of tables are kept until they change."""
        found = {**self.snapshot(), **more}
        for table, entries in found.pop("document").items():
            if table not in self._texts:
                self._texts[table] = f'"{table}":{json_text(entries)}'
        return f'{{"document":{{{",".join(self._texts.values())}}},{json_text(found)[1:]}'

    async def follow(self, service: Service) -> None:
        """Follows the jobs, and the state of the cell, until it is cancelled."""
        self._alarms = service.alarms
        while True:
            after = service.events.last_id
            for job in [*reversed(list(service.store.jobs(limit=_MAX_JOBS))), *service.control.open_jobs]:
                self.put_job(job.to_dict())
            self.replace("approvals", {each.id: self._approval(each.to_dict()) for each in service.approvals.open})
            self.replace("cell", service.control.cell.state())
            async for event in service.events.follow(after, ("job", "approval", "cell", "alarm")):
                if event.kind == "reset":
                    break
                if event.kind == "job":
                    self.put_job(event.data)
                    self._fill_up(service)
                elif event.kind == "approval":
                    if "ended" in event.data:
                        self._show_alarms()  # also of a request that was made just now
                        service.alarms.approval_has_ended(*(event.data[each] for each in ("id", "ended", "text")))
                    self.put("approvals", event.data["id"], self._approval(event.data))
                elif event.kind == "cell":
                    self.replace("cell", event.data)
                else:
                    self._show_alarms()

    # -- runs --------------------------------------------------------------------------------------------------

    def _on_progress(self, recorded: Recorded) -> None:
        if recorded.is_new_tick or self._key(recorded.run) in self._changed_runs:
            self._show_runs([recorded.run])

    def _show_runs(self, runs: Iterable[TaskRun]) -> None:
        """Has runs sent with the next patch."""
        self._changed_runs.update((self._key(run), run) for run in runs)
        if self._changed_runs:
            self._schedule()

    def _show_goal(self, goal_id: str, data: Mapping[str, Any] | None, new_steps: Sequence[TaskRun] = ()) -> None:
        self.put("goals", goal_id, data)
        self._show_runs(new_steps)

    def _show_entries(self, table: str, entries: Mapping[str, Any], is_whole: bool) -> None:
        if is_whole:
            self.replace(table, entries)
            if table == "elements":
                self._name_goals()
            return
        for key, value in entries.items():
            self.put(table, key, value)

    def find_run(self, key: str) -> TaskRun:
        """Returns a run by its key in the document.

        :raises UnknownName: there is none.
        """
        if key not in self._keys:
            near = ", ".join(nearest(key, self._keys)) or "see `runs` of the live view"
            raise UnknownName(f"there is no run {key!r}; near: {near}")
        return self._keys[key]

    def _key(self, run: TaskRun) -> str:
        for key in reversed(self._keys):
            if self._keys[key] is run:
                return key
        self._count += 1
        self._keys[f"run-{self._count}"] = run
        return f"run-{self._count}"

    # -- other tables ------------------------------------------------------------------------------------------

    def put(self, table: str, key: str, value: Mapping[str, Any] | Sequence[Any] | None) -> None:
        """Replaces an entry of a table.

        :param value: JSON data; None removes the entry.
        """
        entries = self._document[table]
        new = {} if value is None else {key: without_none(value)}
        self._change(table, {key: entries[key]} if key in entries else {}, new)

    def entry(self, table: str, key: str) -> Mapping[str, Any]:
        """Returns an entry of a table; empty if there is none."""
        found: Mapping[str, Any] = self._document[table].get(key, {})
        return found

    def replace(self, table: str, entries: Mapping[str, Any]) -> None:
        """Replaces a table."""
        self._change(table, self._document[table], without_none(entries))

    def _change(self, table: str, before: Mapping[str, Any], after: Mapping[str, Any]) -> None:
        """Replaces entries of a table by others."""
        patch = merge_patch(before, after)
        for key in patch if table in TABLES else ():
            self.scenes.add(table, key, self.cell.clock(), after.get(key))
        self._apply({table: patch} if patch else {})

    def put_job(self, job: Mapping[str, Any]) -> None:
        """Updates a job. The document has a limited number of waiting jobs: its cost does not grow with the queue."""
        job_id, is_cleared = str(job["id"]), bool(job["cleared"])
        if is_cleared and self._alarms is not None:
            self._alarms.job_was_cleared(job_id)
            self._has_alarm_change = True
            self._schedule()
        is_waiting = not is_cleared and job["state"] in BEFORE
        if is_waiting and job_id not in self._waiting and len(self._waiting) >= _MAX_WAITING:
            self._hidden.add(job_id)
            return self._show_hidden()
        self._hidden.discard(job_id)
        self._waiting.discard(job_id)
        self._ended.pop(job_id, None)
        if is_waiting:
            self._waiting.add(job_id)
        elif job["state"] in FINAL and not is_cleared:
            self._ended[job_id] = None
        response = {key: value for key, value in job["response"].items() if key in _RESPONSE}
        title = self.cell.sentence(job["goal"])
        self.put("jobs", job_id, None if is_cleared else {**job, "response": response, "title": title})
        while len(self._ended) > _MAX_JOBS:
            oldest = next(iter(self._ended))
            del self._ended[oldest]
            self.put("jobs", oldest, None)
        return self._show_hidden()

    def _approval(self, data: Mapping[str, Any]) -> dict[str, Any] | None:
        """Returns what a person needs to answer a request; None once it has ended."""
        if "ended" in data:
            return None
        what = {key: value for key, value in data["what"].items() if key not in ("preview", "failure")}
        return {**data, "what": what, "title": self.cell.sentence(what["goal"]) if "goal" in what else ""}

    def _name_goals(self) -> None:
        """Makes the titles of jobs and approvals again: elements that they name may have come after them."""
        for job_id, job in list(self._document["jobs"].items()):
            self.put("jobs", job_id, {**job, "title": self.cell.sentence(job["goal"])})
        for approval_id, approval in list(self._document["approvals"].items()):
            self.put("approvals", approval_id, self._approval(approval))

    def _fill_up(self, service: Service) -> None:
        """Shows jobs that have waited out of sight, when there is room for half of them."""
        if self._hidden and len(self._waiting) <= _MAX_WAITING // 2:
            hidden = (job for job in service.control.open_jobs if job.id in self._hidden)
            for job in islice(hidden, _MAX_WAITING - len(self._waiting)):
                self.put_job(job.to_dict())

    def _show_hidden(self) -> None:
        self.put("queue", "hidden", {"count": len(self._hidden)} if self._hidden else None)

    # -- patches -----------------------------------------------------------------------------------------------

    def flush(self) -> None:
        """Publishes what has changed since the last patch."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        self._last_flush = self._loop.time()
        changed, self._changed_runs = self._changed_runs, {}
        for key, run in changed.items():
            goal = self.cell.goal_runs.goal_of(run)
            self.put("runs", key, summary_data(run) | ({"goal": self._key(goal)} if goal is not None else {}))
            if goal is not None:
                if self._sent.pop(key, None) is not None:
                    self.put("trees", key, None)
                continue
            if patch := tree_patch(self._sent.get(key), run.latest):
                self._apply({"trees": {key: patch}})
            self._sent[key] = run.latest
        if changed:
            self._forget()
        if self._has_alarm_change:
            self._show_alarms()
        self._publish()

    @property
    def alarms(self) -> dict[str, dict[str, Any]]:
        """The alarms by id."""
        self.flush()
        found: dict[str, dict[str, Any]] = self._document["alarms"]
        return found

    def _show_alarms(self) -> None:
        self._has_alarm_change = False
        found = alarms_of(self._document)
        self.replace("alarms", found if self._alarms is None else self._alarms.listed(found))

    def _forget(self) -> None:
        """Removes runs that are no longer kept, and the trees of older ones."""
        kept = {id(run) for run in self.cell.runs}
        for key in [key for key, run in self._keys.items() if id(run) not in kept]:
            del self._keys[key]
            self.put("runs", key, None)
        ended = [key for key in self._sent if key not in self._keys or self._keys[key].is_finished]
        for key in ended[: max(0, len(self._sent) - _MAX_TREES)]:
            del self._sent[key]
            self.put("trees", key, None)

    def _publish(self) -> None:
        patch, self._patch = self._patch, {}
        if patch:
            self.stream.publish("patch", patch)

    def _apply(self, patch: dict[str, Any]) -> None:
        if not patch:
            return
        if _conflicts(self._patch, patch):
            self._publish()
        apply_patch(self._document, patch)
        for table in patch:
            self._texts.pop(table, None)
        self._has_alarm_change |= not ALARM_TABLES.isdisjoint(patch)
        _merge(self._patch, patch)
        self._schedule()

    def _schedule(self) -> None:
        if self._timer is None:
            self._timer = self._loop.call_at(max(self._loop.time(), self._last_flush + PERIOD), self.flush)


def _conflicts(patch: Mapping[str, Any], later: Mapping[str, Any]) -> bool:
    """Returns whether a later patch makes an object of what a patch removes or makes a plain value.

    Merged into one patch, the object would keep the members that it had before both.
    """
    return any(
        not isinstance(patch[key], dict) or _conflicts(patch[key], new)
        for key, new in later.items()
        if isinstance(new, dict) and key in patch
    )


def _merge(patch: dict[str, Any], later: Mapping[str, Any]) -> None:
    """Adds a later patch to a patch."""
    for key, new in later.items():
        old = patch.get(key)
        if isinstance(new, dict) and isinstance(old, dict):
            _merge(old, new)
        else:
            # An own copy: the parts of the document and of published patches must not change with it.
            patch[key] = _copy(new)


def _copy(data: Any) -> Any:
    return {key: _copy(value) for key, value in data.items()} if isinstance(data, dict) else data
