"""Prints the execution of a goal on a terminal: plans, reasons for new plans, and the trees of the robot."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Sequence
from typing import Any, TextIO

from skiros2_common.command_line.layout import Screen, can_redraw, styled
from skiros2_demo.run_check import Step, name_of, plan_lines, steps_of
from skiros2_runs.core.progress import NodeMessage, has_ended
from skiros2_skill.command_line.views import view_of

_ID = re.compile(r"\b\w+:\w+-\d+\b")
_NODES = re.compile(r"^(\S+\(\w+\): )+")


class ProgressReport:
    """The report of one goal, or of several, one after the other.

    :param out: a terminal gets trees that are updated in place, with texts between them; other files one line per
        change.
    :param name: returns the name of an element.
    """

    def __init__(self, out: TextIO, name: Callable[[str], str]) -> None:
        self.reasons: list[str] = []  #: why new plans were made
        self._out = out
        self._name = name
        self._started = time.monotonic()
        self._view = view_of(out, Screen())
        self._tasks: set[int] = set()  # running
        self._waiting: list[str] = []
        self._known = 0  # highest reported step number
        self._planning = ""  # reason of the next plan

    def tree(self, nodes: Sequence[NodeMessage]) -> None:
        """Updates the tree of a task, with a `SkillProgress` per node."""
        (self._tasks.discard if has_ended(nodes) else self._tasks.add)(nodes[0].id)
        self._view.show(nodes)
        self._view.draw()
        self._flush()

    def feedback(self, feedback: Any) -> list[Step]:
        """Processes feedback of the goal. Returns the steps of its plan with their states.

        :raises WrongValue: the plan cannot be read.
        """
        if feedback.phase == feedback.PLANNING and feedback.message:
            self._planning = feedback.message
        plan = steps_of(feedback.plan)
        states = {step["number"]: step for step in steps_of(feedback.steps)}
        for step in plan:
            state = states.get(step["number"], {})
            if state.get("state") == "failed":
                self._planning = _plain(state.get("message", "")) or f"{name_of(step)} has failed"
        new = [step for step in plan if step["number"] > self._known]
        if new:
            self._print_plan(new)
        return [{**step, **states.get(step["number"], {"state": "waiting"})} for step in plan]

    def begin(self) -> None:
        """Starts with a goal, and with the time measurement."""
        self._started, self._known, self._planning = time.monotonic(), 0, ""

    @property
    def runs(self) -> bool:
        """Whether a task is running."""
        return bool(self._tasks)

    def title(self, text: str) -> None:
        """Prints a title."""
        self.say(f"\n{styled(text, '1', self._out)}")

    def say(self, text: str) -> None:
        """Prints a text; on a terminal, once no tree is being drawn."""
        self._waiting.append(text)
        self._flush()

    def end(self) -> None:
        """Prints texts that wait for a tree without a known end."""
        self._tasks.clear()
        self._flush()

    def _flush(self) -> None:
        if not (self._tasks and can_redraw(self._out)):
            for text in self._waiting:
                self._out.write(f"{text}\n")
            self._waiting.clear()
            self._out.flush()

    def _print_plan(self, new: list[Step]) -> None:
        again = self._known > 0
        self._known = max(step["number"] for step in new)
        if again:
            reason = self._with_names(self._planning)
            self.reasons.append(reason)
            self.title(f"New plan: {reason}")
        else:
            self.title(f"Plan ({time.monotonic() - self._started:.1f} s)")
        for line in plan_lines(new, self._name):
            self.say(f"  {line}")
        self.title("The tree as it runs" if not again else "Continued")

    def _with_names(self, text: str) -> str:
        """Replaces ids in a text by names."""
        for thing in set(_ID.findall(text)):
            name = self._name(thing)
            text = text.replace(f"{thing}-{name}", name).replace(thing, name)
        return text


def _plain(message: str) -> str:
    """Removes the names of the nodes that passed a message on."""
    return _NODES.sub("", message)
