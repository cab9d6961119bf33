"""The commands run and preview."""

from __future__ import annotations

import argparse
import json
import sys
import threading
import time
from typing import Any, TextIO

from skiros2_common.command_line.command import INTERRUPTED, OK, REFUSED, CommandResult, Unavailable
from skiros2_common.command_line.layout import Screen
from skiros2_common.core.errors import Refused, TimedOut
from skiros2_common.core.explanation import PREEMPT, Explanation
from skiros2_runs.core.progress import has_ended
from skiros2_runs.core.states import SUCCESS, state_name
from skiros2_skill.client.description import Skill, Step
from skiros2_skill.client.port import NEW, ManagerPort, RunPort, explain
from skiros2_skill.command_line.assignments import read_steps
from skiros2_skill.command_line.queries import World
from skiros2_skill.command_line.tree import Changes

#: Period of the display (s).
_PERIOD = 0.1

#: How long to wait for the last progress after the result (s); they arrive on different connections.
_PROGRESS_TIMEOUT = 3.0

#: The displayed fields of an element.
_ELEMENT = {"id", "label", "type"}


def run(manager: ManagerPort, arguments: argparse.Namespace, screen: Screen) -> CommandResult:
    """Runs skills in sequence, as one task, until it has ended. Ctrl-C preempts it."""
    known = manager.read_skills()
    world = World.of(manager)
    steps = read_steps(arguments.words, known, world.find_element, world.has_learned_values)
    if arguments.detach:
        task_id = manager.command("start", NEW, steps)
        return CommandResult([f"task {task_id} runs on {manager.name}"], {"robot": manager.name, "task": task_id})
    if manager.world_model is None:
        from skiros2_skill.command_line.connection import become_node  # not there without ROS

        become_node("skill_run")
    out = None if arguments.json else sys.stdout
    display = _ProgressDisplay(manager.name, screen, out)
    try:
        skill_run = manager.run(steps, display.on_feedback)
        interrupted = _wait(skill_run, display)
        result = skill_run.result()
    except TimedOut as error:
        raise Unavailable(str(error)) from None
    if result.task_id < 0:
        raise Refused(result.message or "cancelled before it was started")
    status = INTERRUPTED if interrupted else OK if result.state == SUCCESS else REFUSED
    explanations = explain(manager, skill_run)
    lines, data = _summary(result, explanations, manager.name, display.seconds, _not_given(steps, known))
    return CommandResult([part for line in lines for part in screen.wrapped(line, "    ")], data, status)


def preview(manager: ManagerPort, arguments: argparse.Namespace, screen: Screen) -> CommandResult:
    """Shows whether skills would start now, and with which elements; nothing is started."""
    world = World.of(manager)
    steps = read_steps(arguments.words, manager.read_skills(), world.find_element, world.has_learned_values)
    found = manager.preview(steps)
    data = {
        "label": found.label,
        "elements": {key: {"id": e.id, "label": e.label, "type": e.type} for key, e in found.elements.items()},
        "refusal": found.refusal.to_dict() if found.refusal is not None else None,
    }
    if found.refusal is not None:
        return CommandResult(["it would be refused", *(f"  {line}" for line in found.refusal.lines())], data, REFUSED)
    elements = {key: [element] for key, element in data["elements"].items()}
    return CommandResult([f"{found.label} would start", *_values(elements, set(elements) - {"Robot"})], data)


def _wait(skill_run: RunPort, display: _ProgressDisplay) -> bool:
    """Displays the progress until the task has ended. Returns whether Ctrl-C has preempted it."""
    interrupted = False
    while True:
        try:
            while not skill_run.wait(_PERIOD):
                display.update()
            display.finish()
            return interrupted
        except KeyboardInterrupt:
            name = f"task {skill_run.task}" if skill_run.task >= 0 else "the skills before their start"
            if interrupted:
                sys.stderr.write(f"{name} has not ended yet; it keeps running\n")
                raise
            interrupted = True
            skill_run.cancel()
            sys.stderr.write(f"preempting {name}; Ctrl-C again ends this command at once\n")


class _ProgressDisplay:
    """Displays the progress of a task.

    :param out: a stream; None: no display.
    """

    def __init__(self, robot: str, screen: Screen, out: TextIO | None) -> None:
        self._out = out
        self._robot = robot
        self._changes = Changes(screen)
        self._lock = threading.Lock()
        self._received: list[Any] = []
        self._ended = threading.Event()
        self._task = -1
        self._began_at = time.monotonic()

    @property
    def seconds(self) -> float:
        """The time since the start (s)."""
        return time.monotonic() - self._began_at

    def on_feedback(self, feedback: Any) -> None:
        """Handles feedback; called in a thread of ROS."""
        with self._lock:
            self._received.append(feedback)
        if feedback.progress and has_ended(feedback.progress):
            self._ended.set()

    def update(self) -> None:
        with self._lock:
            received, self._received = self._received, []
        if self._out is None:
            return
        for feedback in received:
            if self._task < 0:
                self._task = feedback.task_id
                self._out.write(f"task {self._task} on {self._robot}\n")
            for line in self._changes.lines(feedback.progress):
                self._out.write(line.shown(self._out) + "\n")
        self._out.flush()

    def finish(self) -> None:
        """Displays the last progress, which may arrive after the result."""
        self._ended.wait(_PROGRESS_TIMEOUT)
        self.update()


def _summary(
    result: Any, explanations: list[Explanation], robot: str, seconds: float, keys: set[str]
) -> tuple[list[str], dict[str, Any]]:
    """The summary of a result, for people and as JSON."""
    params = {p["key"]: [_brief(v) for v in p["values"]] for p in (json.loads(m.param) for m in result.params)}
    preempted = result.state != SUCCESS and bool(explanations) and explanations[-1].stage == PREEMPT
    data = {
        "robot": robot,
        "task": result.task_id,
        "state": "preempted" if preempted else state_name(result.state),
        "code": result.code,
        "message": result.message,
        "params": params,
        "explanations": [explanation.to_dict() for explanation in explanations],
    }
    if result.state == SUCCESS:
        return [f"task {result.task_id} has succeeded after {seconds:.1f} s", *_values(params, keys)], data
    failed = f"task {result.task_id} {'was preempted' if preempted else 'has failed'} after {seconds:.1f} s"
    if not explanations:
        return [f"{failed}: {result.message}"], data
    if preempted:
        return [explanations[-1].sentence, failed], data
    lines = [f"  {line}" for line in explanations[-1].details()]
    more = [f"  {len(explanations) - 1} more failed before: why {result.task_id}"] if len(explanations) > 1 else []
    return [explanations[-1].sentence, failed, *lines, *more], data


def _not_given(steps: list[Step], known: list[Skill]) -> set[str]:
    """The parameters that were not given and have no default; their final values are displayed."""
    types = {step.type for step in steps}
    given = {key for step in steps for key in step.given}
    declared = [p for skill in known if skill.type in types for p in skill.parameters.values()]
    return {p.key for p in declared if not p.default} - {*given, "Robot"}


def _values(params: dict[str, list[Any]], keys: set[str]) -> list[str]:
    return [f"  {key} = {_format(values)}" for key, values in sorted(params.items()) if key in keys]


def _brief(value: Any) -> Any:
    """A value; of an element only id, label and type."""
    if isinstance(value, dict) and value.keys() > _ELEMENT:
        return {part: value[part] for part in ("id", "label", "type")}
    return value


def _format(values: list[Any]) -> str:
    return ", ".join(_reference(v) if isinstance(v, dict) and v.keys() == _ELEMENT else json.dumps(v) for v in values)


def _reference(element: dict[str, Any]) -> str:
    return f'{element["id"]} "{element["label"]}"' if element["label"] else str(element["id"])
