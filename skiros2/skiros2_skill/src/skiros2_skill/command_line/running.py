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

#: How often what is new is shown (s).
_PERIOD = 0.1

#: How long the last progress may come after the result (s): they have connections of their own.
_OVERTAKEN = 3.0

#: What is shown of an element.
_ELEMENT = {"id", "label", "type"}


def run(manager: Manager, arguments: argparse.Namespace, screen: Screen) -> CommandResult:
    """Runs skills one after the other, as one task, until they have ended. Ctrl-C preempts them."""
    known = manager.skills()
    steps = read_steps(arguments.words, known, World(manager.name, manager.author).find_element)
    from skiros2_msgs import msg as msgs

    skills = [msgs.ResourceDescription(s.type, s.label, [msgs.Param(p) for p in s.params]) for s in steps]
    if arguments.detach:
        task_id = manager.command("start", -1, skills)
        return CommandResult([f"task {task_id} runs on {manager.name}"], {"robot": manager.name, "task": task_id})
    from skiros2_skill.command_line.following import become_node
    from skiros2_skill.ros.skill_run import SkillRunner

    become_node("skill_run")
    out = None if arguments.json else sys.stdout
    telling = _Telling(manager.name, screen, out)
    try:
        running = SkillRunner(manager.name).run(manager.author, skills, telling.take)
        interrupted = _follow(running, telling)
        result = running.result()
    except TimedOut as error:
        raise Unavailable(str(error)) from None
    if result.task_id < 0:
        raise Refused(result.message or "cancelled before it was started")
    status = INTERRUPTED if interrupted else OK if result.state == SUCCESS else REFUSED
    explanations = _explanations(manager, result)
    lines, data = _told(result, explanations, manager.name, telling.seconds, _not_given(steps, known))
    return CommandResult([screen.fitted(line) if screen.width else line for line in lines], data, status)


def _follow(running: Any, telling: _Telling) -> bool:
    """Tells how it goes on until it has ended. Returns whether it was interrupted, and so preempted."""
    interrupted = False
    while True:
        try:
            while not running.wait(_PERIOD):
                telling.tell()
            telling.tell_end()
            return interrupted
        except KeyboardInterrupt:
            name = f"task {running.task}" if running.task >= 0 else "what was not started yet"
            if interrupted:
                sys.stderr.write(f"{name} has not ended yet; leaving it\n")
                raise
            interrupted = True
            running.cancel()
            sys.stderr.write(f"preempting {name}; Ctrl-C again leaves it alone\n")


class _Telling:
    """Tells on a stream how a task goes on.

    :param out: None: nowhere.
    """

    def __init__(self, robot: str, screen: Screen, out: TextIO | None) -> None:
        self._out = out
        self._robot = robot
        self._changes = Changes(screen)
        self._lock = threading.Lock()
        self._news: list[Any] = []
        self._ended = threading.Event()
        self._task = -1
        self._began_at = time.monotonic()

    @property
    def seconds(self) -> float:
        """Since it began."""
        return time.monotonic() - self._began_at

    def take(self, feedback: Any) -> None:
        """Something is new; called by a thread of ROS."""
        with self._lock:
            self._news.append(feedback)
        if feedback.progress and has_ended(feedback.progress):
            self._ended.set()

    def tell(self) -> None:
        with self._lock:
            news, self._news = self._news, []
        if self._out is None:
            return
        for feedback in news:
            if self._task < 0:
                self._task = feedback.task_id
                self._out.write(f"task {self._task} on {self._robot}\n")
            for line in self._changes.lines(feedback.progress):
                self._out.write(line.shown(self._out.isatty()) + "\n")
        self._out.flush()

    def tell_end(self) -> None:
        """The last news, which the result may have overtaken."""
        self._ended.wait(_OVERTAKEN)
        self.tell()


def _explanations(manager: Manager, result: Any) -> list[dict[str, Any]]:
    """Why a task failed: what the manager tells when it is asked, where it also looks up who changed what."""
    told = result.explanation
    if result.state != SUCCESS:
        try:
            told = manager.why(result.task_id).json
        except SkirosError as error:
            log.debug("%s", error)
    explanations: list[dict[str, Any]] = json.loads(told or "[]")
    return explanations


def _told(
    result: Any, explanations: list[dict[str, Any]], robot: str, seconds: float, shown: set[str]
) -> tuple[list[str], dict[str, Any]]:
    """A result for people and for programs."""
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
        return [f"task {result.task_id} has succeeded after {seconds:.1f} s", *_found(params, shown)], data
    failed = f"task {result.task_id} {'was preempted' if preempted else 'has failed'} after {seconds:.1f} s"
    if preempted:
        return [failed], data
    if not explanations:
        return [f"{failed}: {result.message}"], data
    lines = [f"  {line}" for line in Explanation.from_dict(explanations[-1]).lines()]
    more = [f"  {len(explanations) - 1} more failed before: why {result.task_id}"] if len(explanations) > 1 else []
    return [failed, *lines, *more], data


def _not_given(steps: list[Step], known: list[Skill]) -> set[str]:
    """The parameters of the skills that were not given and have no default: what they are is of interest."""
    types = {step.type for step in steps}
    given = {key for step in steps for key in step.given}
    declared = [p for skill in known if skill.type in types for p in skill.parameters.values()]
    return {p.key for p in declared if not p.default} - {*given, "Robot"}


def _found(params: dict[str, list[Any]], keys: set[str]) -> list[str]:
    return [f"  {key} = {_shown(values)}" for key, values in sorted(params.items()) if key in keys]


def _brief(value: Any) -> Any:
    """A value; of an element only what it is known by."""
    if isinstance(value, dict) and value.keys() > _ELEMENT:
        return {part: value[part] for part in ("id", "label", "type")}
    return value


def _shown(values: list[Any]) -> str:
    return ", ".join(_reference(v) if isinstance(v, dict) and v.keys() == _ELEMENT else json.dumps(v) for v in values)


def _reference(element: dict[str, Any]) -> str:
    return f'{element["id"]} "{element["label"]}"' if element["label"] else str(element["id"])
