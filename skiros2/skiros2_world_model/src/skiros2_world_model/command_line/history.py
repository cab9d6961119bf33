"""The commands `history` and `diff`."""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Protocol

from skiros2_common.command_line.command import REFUSED, CommandResult
from skiros2_common.command_line.layout import Screen
from skiros2_common.core.world_element import Element
from skiros2_world_model.command_line.reading import element_answer, predicates_of, scene_tree
from skiros2_world_model.command_line.values import entry_json, point
from skiros2_world_model.core.formatting import format_time
from skiros2_world_model.core.history_entry import HistoryEntry, Point, changed_lines, difference
from skiros2_world_model.core.world_model_abstract_interface import WmException, WorldModelPort

#: The maximum number of changes shown for one request, without `--all`.
_SHOWN = 20


class WithHistory(WorldModelPort, Protocol):
    """A world model with a journal."""

    def history(
        self,
        eid: str = "",
        since: Point | None = None,
        until: Point | None = None,
        author: str = "",
        limit: int = 0,
        context_id: str = "scene",
    ) -> list[HistoryEntry]: ...
    def scene_at(self, at: Point, context_id: str = "scene") -> HistoryEntry: ...
    def difference(self, since: Point, until: Point | None = None, context_id: str = "scene") -> HistoryEntry: ...


def history(wm: WithHistory, arguments: argparse.Namespace, screen: Screen) -> CommandResult:
    """The changes of the scene or of one element; with `--at`, the scene or element as it was."""
    now = time.time()
    if arguments.at:
        return _at(wm, arguments, point(arguments.at, now), screen)
    since, until = (point(text, now) if text else None for text in (arguments.since, arguments.until))
    limit, context = arguments.limit, arguments.context
    asked = (until, arguments.author, limit, context)
    try:
        entries = wm.history(arguments.id, since, *asked)
    except WmException:
        if not isinstance(since, float):
            raise
        # the journal may begin later than that time
        entries = [entry for entry in wm.history(arguments.id, None, *asked) if entry.stamp > since]
    lines: list[str] = []
    for entry in entries:
        what = "" if entry.action == "change" else f"  {entry.action}"
        lines += [screen.fitted(f"{format_time(entry.stamp)}  {entry.author}{what}  #{entry.number}")]
        changes = changed_lines(entry)
        format_value = changes if arguments.all else changes[:_SHOWN]
        lines += [screen.fitted(f"    {line}") for line in format_value]
        lines += [f"    {len(changes) - len(format_value)} more: --all"] if len(format_value) < len(changes) else []
    if not entries:
        lines = ["no changes"]
    elif limit and len(entries) == limit:
        lines += ["", f"the last {limit}; --limit 0 shows all"]
    return CommandResult(lines, [entry_json(entry) for entry in entries])


def _at(wm: WithHistory, arguments: argparse.Namespace, at: Point, screen: Screen) -> CommandResult:
    entry = wm.scene_at(at, arguments.context)
    since = f"as it was since {format_time(entry.stamp)}, {entry.author}, #{entry.number}"
    if arguments.id:
        element = next((e for e in entry.after if e.id == arguments.id), None)
        if element is None:
            raise WmException(f"there was no element {arguments.id!r} then, only {len(entry.after)} others")
        answer = element_answer(element, screen)
    else:
        answer = scene_tree(entry.after, predicates_of(wm, arguments.all), screen, "", arguments.all)
    return CommandResult([screen.fitted(since), "", *answer.lines], answer.data)


def diff(wm: WithHistory | None, arguments: argparse.Namespace, screen: Screen) -> CommandResult:
    """Compares two scenes; each is a file, a time in the history (`@10m`), or the current scene.

    :param wm: None when both are files.
    """
    now = time.time()
    context = arguments.context
    old, new = arguments.old, arguments.new
    if wm is not None and old.startswith("@") and (not new or new.startswith("@")):
        until = point(new[1:], now) if new else None
        entry = wm.difference(point(old[1:], now), until, context)
    else:
        sides = [_elements(wm, side, now, context) for side in (old, new)]
        entry = difference(*sides)
    lines = [screen.fitted(line) for line in changed_lines(entry)]
    return CommandResult(lines, entry_json(entry), REFUSED if entry else 0)


def _elements(wm: WithHistory | None, side: str, now: float, context: str) -> Sequence[Element]:
    if wm is not None and not side:
        return wm.resolve_elements(Element(""), context)
    if wm is not None and side.startswith("@"):
        return wm.scene_at(point(side[1:], now), context).after
    from skiros2_world_model.command_line.scene_file import read_scene_file  # takes time, and an RDF library

    return read_scene_file(Path(side))


def needs_world_model(arguments: argparse.Namespace) -> bool:
    """Whether a comparison needs a running world model."""
    return not arguments.new or arguments.old.startswith("@") or arguments.new.startswith("@")
