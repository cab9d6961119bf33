"""Evidence of what the engine does with a task, which recordings keep and re-runs compare: the values with which skills
start, the conditions that are evaluated, with their results, the hooks that are called, the values that are pushed.

The sequence is the same in each run with the same inputs, however many ticks it has: of `execute` only the first call
of a run counts, of a hold-condition the first result and each other one, of pushes those at starts and ends.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable
from typing import Any

from skiros2_common.core.condition import ConditionBase
from skiros2_common.core.explanation import DEFAULT, HOLD, SPECIFIED, UNSET
from skiros2_common.core.json_codec import ParamsEncoder
from skiros2_common.core.world_element import Element
from skiros2_skill.core.engine.skill_run import Node, SkillRun

#: The path of the node (child indices from the root, such as "0.1"), the kind of entry, a name and a value as JSON
#: data. The kinds:
#: `given` and `pulled` (label of the skill; values by parameter), `pre`, `hold` and `post` (label of the condition;
#: whether it holds), `hook` (its name), `push` (key on the blackboard; values, None: the key was removed).
Entry = tuple[str, str, str, Any]

#: The origins of values that do not depend on other skills.
_OWN = frozenset({DEFAULT, SPECIFIED, UNSET})


class Evidence:
    """Collects entries while `is_on`. For the thread that ticks the task."""

    def __init__(self) -> None:
        #: Set it before the first tick.
        self.is_on = False
        self._entries: list[Entry] = []
        self._last: dict[SkillRun, dict[str, object]] = {}  # of the running skills
        self._pushed: dict[SkillRun, set[str]] = {}  # keys, by running skill

    @property
    def waiting(self) -> int:
        """The number of entries since the last `take`."""
        return len(self._entries)

    def take(self) -> list[Entry]:
        """Returns the entries since the last call."""
        entries, self._entries = self._entries, []
        return entries

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
        if name != "execute" or self._is_other(run, name, True):
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
        self._last.pop(run, None)
        self._pushed.pop(run, None)

    def _note(self, node: Node, kind: str, name: str, value: Any = None) -> None:
        self._entries.append((_path(node), kind, name, value))

    def _is_other(self, run: SkillRun, name: str, value: object) -> bool:
        last = self._last.setdefault(run, {})
        is_other = last.get(name) is not value
        last[name] = value
        return is_other


def evidence_json(task_id: int, entries: list[Entry]) -> str:
    """Returns entries as managers publish them."""
    return json.dumps({"task": task_id, "entries": entries})


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
