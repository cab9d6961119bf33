"""Compares what the engine has done with a task with the recording: `~evidence` of its manager."""

from __future__ import annotations

import itertools
import json
from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Any

from skiros2_bags.testing.field_tolerances import FieldTolerances
from skiros2_runs.core.compare import path_text
from skiros2_runs.core.frame import NodeProgress
from skiros2_runs.core.tolerance import COMMANDED, same_data
from skiros2_skill.core.engine.evidence import Entry

_NAMES = {"pre": "pre-condition", "hold": "hold-condition", "post": "post-condition"}
#: The kinds with the values of a start.
_STARTS = ("given", "pulled")


class RecordedEvidence:
    """The recorded entries of a task, and how far a re-run has made the same.

    :param entries: the recorded ones, oldest first.
    :param tolerances: of values that a skill has pulled or pushed; given ones are compared exactly.
    :param played: keys that played skills have pushed: what others pull of them while these run was not recorded.
    """

    def __init__(self, entries: Sequence[Entry], tolerances: FieldTolerances, played: Collection[str] = ()) -> None:
        self._entries = sorted_groups(entries, "push")
        self._tolerances = tolerances
        self._played = played
        self._number = 0

    def pushes(self, waiting: int, path: tuple[int, ...]) -> list[tuple[str, Any]]:
        """Returns what the recorded node has pushed next: keys and values, None for a key that was removed.

        :param waiting: the number of entries that the re-run has made since the last comparison.
        """
        node = ".".join(map(str, path))
        following = itertools.islice(self._entries, self._number + waiting, None)
        return [
            (name, value) for _, _, name, value in itertools.takewhile(lambda e: e[:2] == (node, "push"), following)
        ]

    def difference(
        self, made: list[Entry], nodes: Mapping[tuple[int, ...], NodeProgress], is_end: bool
    ) -> tuple[str, str, str] | None:
        """Compares entries that a tick has made with the next recorded ones.

        :param nodes: of the tree, by their child indices from the root.
        :param is_end: whether all recorded entries must have been made.
        :returns: the first difference (node, recorded, now); None without one.
        """
        for entry in sorted_groups(map(tuple, json.loads(json.dumps(made))), "push"):  # type: ignore[arg-type]
            if self._number == len(self._entries):
                return _node_text(entry, nodes), "nothing more", _text(entry)
            wanted = self._entries[self._number]
            self._number += 1
            if not self._is_same(wanted, entry):
                return self._difference(wanted, entry, nodes)
        if is_end and self._number < len(self._entries):
            wanted = self._entries[self._number]
            return _node_text(wanted, nodes), _text(wanted), "nothing more"
        return None

    def _is_same(self, wanted: Entry, entry: Entry) -> bool:
        if wanted[:3] != entry[:3]:
            return False
        if wanted[1] in _STARTS:
            return not self._other_parameters(wanted, entry)
        tolerance = self._tolerances.of_value(wanted[2]) if wanted[1] == "push" else COMMANDED
        return same_data(wanted[3], entry[3], tolerance)

    def _other_parameters(self, wanted: Entry, entry: Entry) -> list[str]:
        """Returns the parameters with different values at a start."""
        (_, kind, _, one), two = wanted, entry[3]
        keys = [k for k in dict.fromkeys([*one, *two]) if kind != "pulled" or k not in self._played]
        of_value = self._tolerances.of_value if kind == "pulled" else lambda _: COMMANDED
        return [key for key in keys if not same_data(one.get(key), two.get(key), of_value(key))]

    def _difference(
        self, wanted: Entry, entry: Entry, nodes: Mapping[tuple[int, ...], NodeProgress]
    ) -> tuple[str, str, str]:
        where = _node_text(wanted, nodes)
        if wanted[:3] == entry[:3] and wanted[1] in _STARTS:
            key = self._other_parameters(wanted, entry)[0]
            texts = [json.dumps(values.get(key)) for values in (wanted[3], entry[3])]
            return f"{where}, parameter {key} at its start", texts[0], texts[1]
        texts = [_text(each) for each in (wanted, entry)]
        if wanted[0] != entry[0]:
            texts[1] = f"{_node_text(entry, nodes)}: {texts[1]}"
        return where, texts[0], texts[1]


def sorted_groups(entries: Iterable[Entry], kind: str) -> list[Entry]:
    """Sorts consecutive entries of one node and this kind by name: code may take them from a set."""
    groups = itertools.groupby(entries, lambda entry: entry[:2])
    return [
        entry
        for (_, each), group in groups
        for entry in (sorted(group, key=lambda entry: entry[2]) if each == kind else group)
    ]


def _node_text(entry: Entry, nodes: Mapping[tuple[int, ...], NodeProgress]) -> str:
    node = nodes.get(tuple(map(int, filter(None, entry[0].split(".")))))
    return path_text(node.path) if node is not None else f"node {entry[0]}"


def _text(entry: Entry) -> str:
    _, kind, name, value = entry
    if kind in _NAMES:
        return f"{_NAMES[kind]} {name} {'holds' if value else 'does not hold'}"
    if kind == "hook":
        return f"{name} is called"
    if kind == "write":
        return f"writes: {name}"
    if kind == "push":
        return f"{name} is taken off the blackboard" if value is None else f"pushes {name} = {_values(value)}"
    return f"{name} starts with {_values(value)}"


def _values(value: Any) -> str:
    return json.dumps(value)[:200]
