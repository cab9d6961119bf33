"""The command achieve."""

from __future__ import annotations

import argparse
import json
import sys
import threading
import time
from collections.abc import Callable
from typing import Any, Protocol, TextIO

from skiros2_common.command_line.command import INTERRUPTED, OK, REFUSED, CommandResult, Unavailable
from skiros2_common.command_line.layout import Screen, styled
from skiros2_common.command_line.master import check_node
from skiros2_common.core.errors import TimedOut
from skiros2_common.core.explanation import Explanation
from skiros2_task.command_line.planning import goal_text
from skiros2_task.core.goal_report import RUNNING

#: The task manager's node, and a service that each node has.
_NODE, _SERVICE = "tm", "get_loggers"

#: The style of each step state: symbol, ASCII symbol, ANSI colour.
_STATE_STYLES = {
    "running": ("▶", ">", "36"),
    "succeeded": ("✓", "+", "32"),
    "failed": ("✗", "x", "31"),
    "stopped": ("■", "#", "33"),
    "dropped": ("·", ".", "90"),
}

#: States of a result that are not failures.
_REACHED = ("succeeded", "nothing_to_do")


class GoalClient(Protocol):
    """Achieves one goal."""

    def achieve(
        self,
        goals: str,
        *,
        feedback_cb: Callable[[Any], None],
        quality: str,
        seconds: float,
        priority: int,
        max_replans: int,
    ) -> None:
        """Starts; see `TaskManagerInterface.achieve`. Feedback has the fields of `GoalProgress`."""

    def wait_for_result(self) -> Any:
        """Waits for the end. Returns an object with the fields of `GoalResult`."""

    def preempt(self) -> None:
        """Cancels the goal."""


def achieve(arguments: argparse.Namespace, screen: Screen, client: GoalClient | None = None) -> CommandResult:
    """Achieve a goal: plan, and run the steps on the robots until the goal holds. Ctrl-C cancels it."""
    goal = goal_text(arguments.goal)
    client = client or _connect()
    printer = ProgressPrinter(screen, None if arguments.json else sys.stdout)
    try:
        client.achieve(
            goal,
            feedback_cb=printer.on_feedback,
            quality=arguments.quality,
            seconds=arguments.seconds or 0.0,
            priority=arguments.priority,
            max_replans=arguments.max_replans,
        )
        result, interrupted = _result(client)
    except TimedOut as error:
        raise Unavailable(str(error)) from None
    printer.end(result)
    status = INTERRUPTED if interrupted else OK if result.state in _REACHED else REFUSED
    lines, data = format_result(result, printer.seconds)
    return CommandResult(lines, data, status)


def _connect() -> GoalClient:
    """Connects to the task manager.

    :raises Unavailable: it does not answer.
    """
    import rosgraph  # not there without ROS

    check_node(rosgraph.names.ns_join(rosgraph.names.get_ros_namespace(), _NODE), _SERVICE, "task manager")
    from skiros2_skill.command_line.connection import become_node
    from skiros2_task.ros.task_manager_interface import TaskManagerInterface

    become_node("achieve")
    return TaskManagerInterface()


def _result(client: GoalClient) -> tuple[Any, bool]:
    """Returns the result, and whether Ctrl-C cancelled the goal."""
    interrupted = False
    while True:
        try:
            return client.wait_for_result(), interrupted
        except KeyboardInterrupt:
            if interrupted:
                sys.stderr.write("the goal has not ended yet; not waiting for it\n")
                raise
            interrupted = True
            client.preempt()
            sys.stderr.write("cancelling the goal; press Ctrl-C again to quit without waiting\n")


class ProgressPrinter:
    """Prints the progress of a goal: a line for each plan, and for each state of a step.

    :param out: None: prints nothing.
    """

    def __init__(self, screen: Screen, out: TextIO | None) -> None:
        self._screen = screen
        self._out = out
        self._lock = threading.Lock()
        self._started_at = time.monotonic()
        self._phase = ""
        self._known: set[int] = set()  # the steps of printed plans
        self._states: dict[int, str] = {}

    @property
    def seconds(self) -> float:
        """The time since the start (s)."""
        return time.monotonic() - self._started_at

    def on_feedback(self, feedback: Any) -> None:
        """Prints what is new in a feedback message. Called by a ROS thread."""
        with self._lock:
            if self._out is None:
                return
            plan = {step["number"]: step for step in json.loads(feedback.plan or "[]")}
            if feedback.phase != self._phase:
                self._phase = feedback.phase
                if feedback.phase != RUNNING:  # the steps show this phase
                    self._print(f"{feedback.phase}: {feedback.message}" if feedback.message else feedback.phase)
            self._print_plan(plan)
            for step in json.loads(feedback.steps or "[]"):
                self._print_step(plan.get(step["number"], {}), step)
            self._out.flush()

    def end(self, result: Any) -> None:
        """Prints the final states of the steps. Later feedback is ignored."""
        with self._lock:
            if self._out is None:
                return
            for step in json.loads(result.done or "[]"):
                self._print_step(step, step)
            self._out.flush()
            self._out = None

    def _print_plan(self, plan: dict[int, dict[str, Any]]) -> None:
        new = [step for number, step in plan.items() if number not in self._known]
        if not new:
            return
        name = "another plan" if self._known else "a plan"
        self._known.update(plan)
        robots = len({step["robot"] for step in new})
        seconds = max(step["end"] for step in new)
        self._print(f"{name} of {_count(len(new), 'step')} of {_count(robots, 'robot')}, {seconds:.1f} s")

    def _print_step(self, planned: dict[str, Any], step: dict[str, Any]) -> None:
        number, state = step["number"], step["state"]
        if state == self._states.get(number) or state not in _STATE_STYLES:
            return
        self._states[number] = state
        symbol, ascii_symbol, colour = _STATE_STYLES[state]
        name = planned.get("label") or planned.get("skill", "")
        line = f"  {symbol if self._screen.fancy else ascii_symbol} {number} {name} by {step['robot']}"
        if state == "running":
            line += f" {format_arguments(planned)}"
        elif step["message"]:
            line += f": {step['message']}"
        self._print(line.rstrip(), colour)

    def _print(self, text: str, colour: str = "") -> None:
        assert self._out is not None
        for line in self._screen.wrapped(f"{self.seconds:6.1f} s  {text}", " " * 14):
            self._out.write(f"{styled(line, colour, self._out)}\n")


def format_result(result: Any, seconds: float) -> tuple[list[str], dict[str, Any]]:
    """Returns a result as text and as JSON data.

    :param seconds: the duration of the goal.
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
    outcome = "was cancelled" if result.state == "cancelled" else "is not reached"
    first = f"the goal {outcome} after {seconds:.1f} s, {_count(succeeded, 'step')} done"
    cause, *details = result.message.splitlines() or [""]
    lines = [*([cause] if cause else []), first, *details]
    if explanations:
        lines += [f"  {line}" for line in Explanation.from_dict(explanations[-1]).details()]
    return lines, data


def format_arguments(planned: dict[str, Any]) -> str:
    """Formats the arguments of a step: labels in quotes as in a plan, else ids."""
    labels = planned.get("labels", {})
    given = ((key, value) for key, value in planned.get("arguments", {}).items() if key != "Robot")
    return ", ".join(f'{key}="{labels[key]}"' if key in labels else f"{key}={value}" for key, value in given)


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}{'' if number == 1 else 's'}"
