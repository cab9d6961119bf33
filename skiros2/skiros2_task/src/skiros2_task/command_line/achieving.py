"""The command that has a goal reached by the robots."""

from __future__ import annotations

import argparse
import json
import sys
import threading
import time
from typing import Any, TextIO

import rosgraph

from skiros2_common.command_line.command import INTERRUPTED, OK, REFUSED, CommandResult, Unavailable
from skiros2_common.command_line.layout import Screen
from skiros2_common.command_line.master import check_node
from skiros2_common.core.errors import TimedOut
from skiros2_common.core.explanation import Explanation
from skiros2_task.command_line.planning import goal_text

#: The task manager's node, and a service that each node has.
_NODE, _SERVICE = "tm", "get_loggers"

#: State of a step -> symbol, the same in ASCII, ANSI colour.
_LOOKS = {
    "running": ("▶", ">", "36"),
    "succeeded": ("✓", "+", "32"),
    "failed": ("✗", "x", "31"),
    "stopped": ("■", "#", "33"),
    "dropped": ("·", ".", "90"),
}

#: States of a result that are no failure.
_REACHED = ("succeeded", "nothing_to_do")


def achieve(arguments: argparse.Namespace, screen: Screen) -> CommandResult:
    """Has a goal reached: plans, and has the robots carry the plan out, until it holds. Ctrl-C cancels it."""
    goal = goal_text(arguments.goal)
    check_node(rosgraph.names.ns_join(rosgraph.names.get_ros_namespace(), _NODE), _SERVICE, "task manager")
    from skiros2_skill.command_line.monitor import become_node
    from skiros2_task.ros.task_manager_interface import TaskManagerInterface

    become_node("achieve")
    telling = Telling(screen, None if arguments.json else sys.stdout)
    client = TaskManagerInterface()
    try:
        client.achieve(
            goal,
            feedback_cb=telling.take,
            wish=arguments.wish,
            seconds=arguments.seconds or 0.0,
            priority=arguments.priority,
            max_replans=arguments.max_replans,
        )
        result, interrupted = _result(client)
    except TimedOut as error:
        raise Unavailable(str(error)) from None
    telling.end(result)
    status = INTERRUPTED if interrupted else OK if result.state in _REACHED else REFUSED
    lines, data = told(result, telling.seconds)
    return CommandResult(lines, data, status)


def _result(client: Any) -> tuple[Any, bool]:
    """The result, and whether the goal was cancelled by Ctrl-C."""
    interrupted = False
    while True:
        try:
            return client.wait_for_result(), interrupted
        except KeyboardInterrupt:
            if interrupted:
                sys.stderr.write("the goal has not ended yet; leaving it\n")
                raise
            interrupted = True
            client.preempt()
            sys.stderr.write("cancelling the goal; Ctrl-C again leaves it alone\n")


class Telling:
    """Tells how a goal goes on: a line for each plan, and for each change of a step.

    :param out: None: it is told nowhere.
    """

    def __init__(self, screen: Screen, out: TextIO | None) -> None:
        self._screen = screen
        self._out = out
        self._lock = threading.Lock()
        self._began_at = time.monotonic()
        self._phase = ""
        self._known: set[int] = set()  # the steps of plans that were told of
        self._states: dict[int, str] = {}

    @property
    def seconds(self) -> float:
        """Since it began."""
        return time.monotonic() - self._began_at

    def take(self, feedback: Any) -> None:
        """Something is new; called by a thread of ROS."""
        with self._lock:
            if self._out is None:
                return
            plan = {step["number"]: step for step in json.loads(feedback.plan or "[]")}
            if feedback.phase != self._phase:
                self._phase = feedback.phase
                if feedback.phase != feedback.RUNNING:  # of that the steps tell
                    self._tell(f"{feedback.phase}: {feedback.message}" if feedback.message else feedback.phase)
            self._tell_plan(plan)
            for step in json.loads(feedback.steps or "[]"):
                self._tell_step(plan.get(step["number"], {}), step)
            self._out.flush()

    def end(self, result: Any) -> None:
        """Tells what the result has overtaken. What is new later is not told."""
        with self._lock:
            if self._out is None:
                return
            for step in json.loads(result.done or "[]"):
                self._tell_step(step, step)
            self._out.flush()
            self._out = None

    def _tell_plan(self, plan: dict[int, dict[str, Any]]) -> None:
        new = [step for number, step in plan.items() if number not in self._known]
        if not new:
            return
        again = "another plan" if self._known else "a plan"
        self._known.update(plan)
        robots = len({step["robot"] for step in new})
        seconds = max(step["end"] for step in new)
        self._tell(f"{again} of {_count(len(new), 'step')} of {_count(robots, 'robot')}, {seconds:.1f} s")

    def _tell_step(self, planned: dict[str, Any], step: dict[str, Any]) -> None:
        number, state = step["number"], step["state"]
        if state == self._states.get(number) or state not in _LOOKS:
            return
        self._states[number] = state
        symbol, ascii_symbol, colour = _LOOKS[state]
        name = planned.get("label") or planned.get("skill", "")
        line = f"  {symbol if self._screen.fancy else ascii_symbol} {number} {name} by {step['robot']}"
        if state == "running":
            line += f" {shown_arguments(planned)}"
        elif step["message"] and state != "succeeded":
            line += f": {step['message']}"
        self._tell(line.rstrip(), colour)

    def _tell(self, text: str, colour: str = "") -> None:
        assert self._out is not None
        line = self._screen.fitted(f"{self.seconds:6.1f} s  {text}")
        self._out.write(f"\033[{colour}m{line}\033[0m\n" if colour and self._out.isatty() else f"{line}\n")


def told(result: Any, seconds: float) -> tuple[list[str], dict[str, Any]]:
    """A result for people and for programs.

    :param seconds: how long it took.
    """
    done = json.loads(result.done or "[]")
    explanations = json.loads(result.explanations or "[]")
    data = {"state": result.state, "message": result.message, "done": done, "explanations": explanations}
    succeeded = sum(step["state"] == "succeeded" for step in done)
    if result.state in _REACHED:
        if not done:
            return [result.message or "the goal holds already"], data
        unsuccessful = len(done) - succeeded
        more = f", {unsuccessful} more did not succeed" if unsuccessful else ""
        return [f"the goal is reached after {seconds:.1f} s: {_count(succeeded, 'step')} done{more}"], data
    word = "was cancelled" if result.state == "cancelled" else "is not reached"
    lines = [f"the goal {word} after {seconds:.1f} s, {_count(succeeded, 'step')} done", *result.message.splitlines()]
    if explanations:
        lines += [f"  {line}" for line in Explanation.from_dict(explanations[-1]).lines()]
    return lines, data


def shown_arguments(planned: dict[str, Any]) -> str:
    return ", ".join(f"{key}={value}" for key, value in planned.get("arguments", {}).items() if key != "Robot")


def _count(number: int, what: str) -> str:
    return f"{number} {what}{'' if number == 1 else 's'}"
