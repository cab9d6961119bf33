"""Evidence of what the engine does with a task, which recordings keep and re-runs compare: the values with which skills
start, the conditions that are evaluated, with their results, the hooks that are called, what these write to the world
model, the values that are pushed.

The sequence is the same in each run with the same inputs, however many ticks it has: of `execute` only the first call
of a run counts, of a hold-condition the first result and each other one, of pushes those at starts and ends, of what
`execute` writes the first tick and each that writes something else.
"""

from __future__ import annotations

import itertools
import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

from skiros2_common.core.abstract_skill import State
from skiros2_common.core.clock_notes import reading_clock
from skiros2_common.core.condition import ConditionBase
from skiros2_common.core.explanation import DEFAULT, HOLD, SPECIFIED, UNSET
from skiros2_common.core.json_codec import ParamsEncoder
from skiros2_common.core.world_element import Element
from skiros2_common.core.write_notes import noting_writes
from skiros2_skill.core.engine.hook_guard import EXECUTE_HOOK, HookGuard
from skiros2_skill.core.engine.skill_run import Node, SkillRun

#: The path of the node (child indices from the root, such as "0.1"), the kind of entry, a name and a value as JSON
#: data. The kinds:
#: `given` and `pulled` (label of the skill; values by parameter), `pre`, `hold` and `post` (label of the condition;
#: whether it holds), `hook` (its name), `write` (what a hook requests of the world model), `push` (key on the
#: blackboard; values, None: the key was removed).
Entry = tuple[str, str, str, Any]

#: The origins of values that do not depend on other skills.
_OWN = frozenset({DEFAULT, SPECIFIED, UNSET})

#: The hooks whose writes count. What the engine writes itself follows from its entries.
_WRITING = frozenset({"onStart", EXECUTE_HOOK, "onPreempt", "onEnd"})

#: A time that a skill has read while it was ticked: the path of its node, and s of its clock.
Reading = tuple[str, float]

#: Of the format of published entries: 2 has writes, 3 the times that skills have read.
VERSION = 3


class Evidence:
    """Collects entries while `is_on`. For the thread that ticks the task."""

    def __init__(self) -> None:
        #: Set it before the first tick.
        self.is_on = False
        #: Whether writes are noted too.
        self.has_writes = True
        #: The times that skills have read in the last tick: what they decide by them no message states exactly.
        self.readings: list[Reading] = []
        #: How many progress messages of the task were published.
        self.messages = 0
        #: In a re-run: the times that the skills of a tick get instead, by path, oldest first.
        self.recorded_readings: Mapping[str, Sequence[float]] = {}
        self._entries: list[Entry] = []
        self._last: dict[SkillRun, dict[str, object]] = {}  # of the running skills
        self._pushed: dict[SkillRun, set[str]] = {}  # keys, by running skill
        self._written: list[tuple[SkillRun, str, str]] = []  # run, hook and write, not noted yet

    @property
    def waiting(self) -> int:
        """The number of entries since the last `take`."""
        return len(self._entries)

    def take(self) -> list[Entry]:
        """Returns the entries since the last call."""
        entries, self._entries = self._entries, []
        return entries

    def tick(self, guard: HookGuard[SkillRun], tick: Callable[[], State]) -> State:
        """Calls a function that ticks the task, and notes what hooks write meanwhile.

        :param guard: knows the hook that is called.
        """
        if not self.is_on:
            return tick()

        def note(write: str) -> None:
            for call in guard.calls[-1:]:
                run, hook = call if isinstance(call, tuple) else (call, EXECUTE_HOOK)
                if hook in _WRITING:
                    self._written.append((run, hook, write))

        recorded = {path: list(times) for path, times in self.recorded_readings.items()}

        def read(now: float) -> float:
            runs = [call[0] if isinstance(call, tuple) else call for call in guard.calls[-1:]]
            path = _path(runs[0].node) if runs else ""
            time = recorded[path].pop(0) if recorded.get(path) else now
            self.readings.append((path, time))
            return time

        self.readings = []
        with noting_writes(note if self.has_writes else None), reading_clock(read):
            state = tick()
        self._note_writes()
        return state

    def start(self, run: SkillRun) -> None:
        """Notes the values with which a skill starts."""
        if not self.is_on:
            return
        given: dict[str, Any] = {}
        pulled: dict[str, Any] = {}
        for slot in run.slots:
            values = given if slot.provenance in _OWN else pulled
            values[slot.param.key] = _data(slot.param.current)
        for kind, values in (("given", given), ("pulled", pulled)):
            if values:
                self._note(run.node, kind, run.label, values)

    def conditions(self, run: SkillRun, stage: str) -> Callable[[ConditionBase, bool], None] | None:
        """Returns what notes the result of a condition of a stage; None while nothing is collected."""
        if not self.is_on:
            return None

        def note(condition: ConditionBase, holds: bool) -> None:
            if stage != HOLD or self._is_other(run, condition.label, holds):
                self._note(run.node, stage, condition.label, holds)

        return note

    def hook(self, run: SkillRun, name: str) -> None:
        """Notes a call of a hook."""
        if name != EXECUTE_HOOK or self._is_other(run, name, True):
            self._note(run.node, "hook", name)

    def push(
        self, run: SkillRun, keys: Iterable[str], values_of: Callable[[str], list[Any]], is_boundary: bool
    ) -> None:
        """Notes what a skill has pushed, at its end also what it has pushed meanwhile.

        :param values_of: returns the present values of a key on the blackboard; [] without it.
        :param is_boundary: whether the skill starts or ends.
        """
        pushed = self._pushed.setdefault(run, set())
        pushed.update(keys)
        if is_boundary:
            for key in sorted(self._pushed.pop(run)):
                self._note(run.node, "push", key, _data(values_of(key)) or None)

    def end(self, run: SkillRun) -> None:
        """A skill has ended."""
        self._note_writes()
        self._last.pop(run, None)
        self._pushed.pop(run, None)

    def _note_writes(self) -> None:
        written, self._written = self._written, []
        for (run, hook), group in itertools.groupby(written, lambda each: each[:2]):
            writes = sorted(write for _, _, write in group)  # code may take them from a set
            if hook != EXECUTE_HOOK or self._is_other(run, "what execute writes", writes):
                for write in writes:
                    self._note(run.node, "write", write)

    def _note(self, node: Node, kind: str, name: str, value: Any = None) -> None:
        if self._written:
            self._note_writes()
        self._entries.append((_path(node), kind, name, value))

    def _is_other(self, run: SkillRun, name: str, value: object) -> bool:
        last = self._last.setdefault(run, {})
        is_other = last.get(name) != value
        last[name] = value
        return is_other


def evidence_json(task_id: int, entries: list[Entry], number: int, readings: Sequence[Reading]) -> str:
    """Returns evidence as managers publish it.

    :param number: of the progress message of the same tick, from 1.
    :param readings: in the tick of that message.
    """
    found = {"version": VERSION, "task": task_id, "entries": entries, "number": number, "readings": readings}
    return json.dumps(found)


def _path(node: Node) -> str:
    indices: list[str] = []
    while node.parent is not None:
        indices.append(str(node.child_index))
        node = node.parent
    return ".".join(reversed(indices))


def _data(values: list[Any]) -> list[Any]:
    return [_value(value) for value in values]


def _value(value: Any) -> Any:
    if isinstance(value, Element):
        return value.id or f"{value.type} {value.label}".strip()
    return value if isinstance(value, str | int | float) else json.loads(json.dumps(value, cls=ParamsEncoder))
