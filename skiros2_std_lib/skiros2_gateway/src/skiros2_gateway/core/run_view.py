"""Runs of trees as JSON data for the live view."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import numpy.typing as npt

from skiros2_runs.core.frame import Frame, Shape
from skiros2_runs.core.message_log import LogLine
from skiros2_runs.core.task_run import TaskRun

#: The most lines of a message log in an answer.
_LINES = 500


def shape_data(shape: Shape) -> dict[str, Any]:
    """Returns the shape of a tree: for each node its id, parent (an index; -1: none), name, type and processor."""
    indices = range(len(shape))
    return {
        "ids": [shape.id(index) for index in indices],
        "parents": list(shape.parents),
        "names": [shape.name(index) for index in indices],
        "types": [shape.type(index) for index in indices],
        "processors": [shape.processor(index) for index in indices],
    }


def row_data(frame: Frame, indices: Iterable[int]) -> dict[str, list[Any]]:
    """Returns nodes by index: [state, progress code, start, end, message].

    Start and end are s after the start of the run; -1: not yet.
    """
    rows, messages = frame.rows, frame.messages
    chosen = list(indices)
    part = rows[chosen]
    began = np.round(np.nan_to_num(part["began"].astype("f8"), nan=-1.0), 3).tolist()
    ended = np.round(np.nan_to_num(part["ended"].astype("f8"), nan=-1.0), 3).tolist()
    values = zip(chosen, part["state"].tolist(), part["code"].tolist(), began, ended, strict=True)
    return {str(i): [state, code, b, e, messages.get(i, "")] for i, state, code, b, e in values}


def tree_data(frame: Frame) -> dict[str, Any]:
    """Returns a whole tree: `shape` as of `shape_data`, `rows` as of `row_data`."""
    return {"shape": shape_data(frame.shape), "rows": row_data(frame, range(len(frame.shape)))}


def tree_patch(before: Frame | None, after: Frame) -> dict[str, Any]:
    """Returns the merge patch of `tree_data` from one tick to a later one; empty if nothing is seen of the change."""
    if before is None:
        return tree_data(after)
    if before.shape is not after.shape:
        removed = {str(index): None for index in range(len(after.shape), len(before.shape))}
        data = tree_data(after)
        return {"shape": data["shape"], "rows": {**removed, **data["rows"]}}
    changed = set(np.flatnonzero(_differ(before.rows, after.rows)).tolist())
    if before.messages is not after.messages:
        ids = before.messages.keys() | after.messages.keys()
        changed |= {index for index in ids if before.message(index) != after.message(index)}
    return {"rows": row_data(after, sorted(changed))} if changed else {}


def _differ(a: npt.NDArray[np.void], b: npt.NDArray[np.void]) -> npt.NDArray[np.bool_]:
    """Returns which rows are shown differently. The run time is not: it changes with each tick."""
    differ = np.asarray((a["state"] != b["state"]) | (a["code"] != b["code"]))
    for name in ("began", "ended"):
        differ |= (a[name] != b[name]) & ~(np.isnan(a[name]) & np.isnan(b[name]))
    return differ


def summary_data(run: TaskRun) -> dict[str, Any]:
    """Returns what a list of runs shows: robot, task, name, state, start, nodes; `end` and `message` after the end."""
    frame = run.latest
    data = {
        "robot": run.robot,
        "task": run.task_id,
        "name": frame.shape.skills_text(3),
        "state": str(run.state),
        "start": round(run.start, 3),
        "nodes": len(frame.shape),
        "message": frame.message(0),
    }
    return {**data, "end": round(frame.time, 3)} if run.is_finished else data


def history_data(run: TaskRun, time: float | None) -> dict[str, Any]:
    """Returns a run at a time: `summary`, `tree`, the `time` of the shown tick, the times of the `first` and `last`
    tick, the count of `ticks`, `dropped`, and the `log` up to that time.

    :param time: s since the epoch; None: the end.
    """
    tick = len(run) - 1 if time is None else run.tick_at(time)
    frame = run.frame(tick)
    shown = frame.time if time is None else max(time, run.times[0])
    lines = [line for line in run.log.lines if line.time <= shown][-_LINES:]
    return {
        "summary": summary_data(run),
        "tree": tree_data(frame),
        "state": str(frame.task_state if time is not None else run.state),
        "time": shown,
        "first": run.times[0],
        "last": run.latest.time,
        "ticks": len(run),
        "dropped": run.dropped,
        "log": [_line_data(line) for line in lines],
    }


def _line_data(line: LogLine) -> dict[str, Any]:
    return {"time": line.time, "node": line.node, "name": line.name, "state": line.state, "message": line.message}
