"""Tells on a terminal how a goal goes on: the plans, why they were made, and what the robot does."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Sequence
from typing import Any, TextIO

from skiros2_common.command_line.layout import Screen
from skiros2_demo.plan_text import Step, name_of, plan_lines, steps_of
from skiros2_skill.command_line.tree import has_ended
from skiros2_skill.command_line.watch import LineView, LiveView, View

_ID = re.compile(r"\b\w+:\w+-\d+\b")
_NODES = re.compile(r"^(\S+\(\w+\): )+")


class Story:
    """One goal.

    :param out: a terminal gets trees that are drawn in place, and what is said between them; anything else a line for
        each change.
    :param name: what a person calls the element with an id.
    """

    def __init__(self, out: TextIO, name: Callable[[str], str]) -> None:
        self.reasons: list[str] = []  #: why it was planned anew
        self._out = out
        self._name = name
        self._began_at = time.monotonic()
        live = out.isatty()
        self._view: View = LiveView(out, lambda skill_type, label: ()) if live else LineView(out, Screen())
        self._tasks: set[int] = set()  # that run
        self._waiting: list[str] = []
        self._known = 0  # the highest number of a step that was told of
        self._planning = ""  # why

    def tree(self, nodes: Sequence[Any]) -> None:
        """A task, a `SkillProgress` for each node, is so now."""
        (self._tasks.discard if has_ended(nodes) else self._tasks.add)(nodes[0].id)
        self._view.show(nodes)
        self._view.draw()
        self._say_waiting()

    def feedback(self, feedback: Any) -> list[Step]:
        """The goal stands so now. Returns the steps of its plan, with their states.

        :raises WrongValue: the plan cannot be read.
        """
        if feedback.phase == feedback.PLANNING and feedback.message:
            self._planning = feedback.message
        plan = steps_of(feedback.plan)
        states = {step["number"]: step for step in steps_of(feedback.steps)}
        for step in plan:
            told = states.get(step["number"], {})
            if told.get("state") == "failed":
                self._planning = f"{name_of(step)} has failed: {_plain(told.get('message', ''))}"
        new = [step for step in plan if step["number"] > self._known]
        if new:
            self._tell_plan(new)
        return [{**step, **states.get(step["number"], {"state": "waiting"})} for step in plan]

    def begin(self) -> None:
        """The goal is given now."""
        self._began_at = time.monotonic()

    @property
    def runs(self) -> bool:
        """Whether a task has not ended yet."""
        return bool(self._tasks)

    def title(self, text: str) -> None:
        """Says something in bold."""
        self.say(f"\n\033[1m{text}\033[0m" if self._out.isatty() else f"\n{text}")

    def say(self, text: str) -> None:
        """Says something, on a terminal as soon as no tree is being drawn."""
        self._waiting.append(text)
        self._say_waiting()

    def end(self) -> None:
        """Says what waits for a tree whose end was not heard of."""
        self._tasks.clear()
        self._say_waiting()

    def _say_waiting(self) -> None:
        if not (self._tasks and self._out.isatty()):
            for text in self._waiting:
                self._out.write(f"{text}\n")
            self._waiting.clear()
            self._out.flush()

    def _tell_plan(self, new: list[Step]) -> None:
        again = self._known > 0
        self._known = max(step["number"] for step in new)
        if again:
            reason = self._named(self._planning)
            self.reasons.append(reason)
            self.title(f"Planned anew, for {reason}")
        else:
            self.title(f"Plan ({time.monotonic() - self._began_at:.1f} s)")
        for line in plan_lines(new, self._name):
            self.say(f"  {line}")
        self.title("The tree as it runs" if not again else "It goes on")

    def _named(self, text: str) -> str:
        """A text with names where it has ids, alone or with the labels behind them."""
        for thing in set(_ID.findall(text)):
            name = self._name(thing)
            text = text.replace(f"{thing}-{name}", name).replace(thing, name)
        return text


def _plain(message: str) -> str:
    """A message without the names of the nodes that it came through."""
    return _NODES.sub("", message)
