"""The command that runs skills."""

from __future__ import annotations

import argparse
import json
import logging
import sys
import threading
import time
from typing import Any, TextIO

from skiros2_common.command_line.command import INTERRUPTED, OK, REFUSED, CommandResult, Unavailable
from skiros2_common.command_line.layout import Screen
from skiros2_common.core.errors import Refused, SkirosError, TimedOut
from skiros2_common.core.explanation import PREEMPT, Explanation
from skiros2_skill.command_line.assignments import Step, read_steps
from skiros2_skill.command_line.connection import Manager
from skiros2_skill.command_line.description import Skill
from skiros2_skill.command_line.tree import SUCCESS, Changes, has_ended, word_of
from skiros2_skill.command_line.world import World

log = logging.getLogger(__name__)

#: Period of the display (s).
_PERIOD = 0.1

#: How long to wait for the last progress after the result (s); they arrive on different connections.
_PROGRESS_TIMEOUT = 3.0

#: The displayed fields of an element.
_ELEMENT = {"id", "label", "type"}


def run(manager: Manager, arguments: argparse.Namespace, screen: Screen) -> CommandResult:
    """Runs skills in sequence, as one task, until it has ended. Ctrl-C preempts it."""
    known = manager.skills()
    steps = read_steps(arguments.words, known, World(manager.name, manager.author).find_element)
    from skiros2_msgs import msg as msgs

    skills = [msgs.ResourceDescription(s.type, s.label, [msgs.Param(p) for p in s.params]) for s in steps]
    if arguments.detach:
        task_id = manager.command("start", -1, skills)
        return CommandResult([f"task {task_id} runs on {manager.name}"], {"robot": manager.name, "task": task_id})
    from skiros2_skill.command_line.monitor import become_node
    from skiros2_skill.ros.skill_run import SkillRunner

    become_node("skill_run")
    out = None if arguments.json else sys.stdout
    display = _ProgressDisplay(manager.name, screen, out)
    try:
        skill_run = SkillRunner(manager.name).run(manager.author, skills, display.on_feedback)
        interrupted = _wait(skill_run, display)
        result = skill_run.result()
    except TimedOut as error:
        raise Unavailable(str(error)) from None
    if result.task_id < 0:
        raise Refused(result.message or "cancelled before it was started")
    status = INTERRUPTED if interrupted else OK if result.state == SUCCESS else REFUSED
    explanations = _explanations(manager, result)
    lines, data = _summary(result, explanations, manager.name, display.seconds, _not_given(steps, known))
    return CommandResult([screen.fitted(line) if screen.width else line for line in lines], data, status)


def _wait(skill_run: Any, display: _ProgressDisplay) -> bool:
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
                self._out.write(line.shown(self._out.isatty()) + "\n")
        self._out.flush()

    def finish(self) -> None:
        """Displays the last progress, which may arrive after the result."""
        self._ended.wait(_PROGRESS_TIMEOUT)
        self.update()


def _explanations(manager: Manager, result: Any) -> list[dict[str, Any]]:
    """Why a task failed. The service `why` adds the authors of changes to the explanations of the result."""
    text = result.explanation
    if result.state != SUCCESS:
        try:
            text = manager.why(result.task_id).json
        except SkirosError as error:
            log.debug("%s", error)
    explanations: list[dict[str, Any]] = json.loads(text or "[]")
    return explanations


def _summary(
    result: Any, explanations: list[dict[str, Any]], robot: str, seconds: float, keys: set[str]
) -> tuple[list[str], dict[str, Any]]:
    """The summary of a result, for people and as JSON."""
    params = {p["key"]: [_brief(v) for v in p["values"]] for p in (json.loads(m.param) for m in result.params)}
    preempted = result.state != SUCCESS and bool(explanations) and explanations[-1]["stage"] == PREEMPT
    data = {
        "robot": robot,
        "task": result.task_id,
        "state": "preempted" if preempted else word_of(result.state),
        "code": result.code,
        "message": result.message,
        "params": params,
        "explanations": explanations,
    }
    if result.state == SUCCESS:
        return [f"task {result.task_id} has succeeded after {seconds:.1f} s", *_values(params, keys)], data
    failed = f"task {result.task_id} {'was preempted' if preempted else 'has failed'} after {seconds:.1f} s"
    if preempted:
        return [failed], data
    if not explanations:
        return [f"{failed}: {result.message}"], data
    lines = [f"  {line}" for line in Explanation.from_dict(explanations[-1]).lines()]
    more = [f"  {len(explanations) - 1} more failed before: why {result.task_id}"] if len(explanations) > 1 else []
    return [failed, *lines, *more], data


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
