"""The commands `world`, `changes` and `restore`."""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from dataclasses import asdict
from typing import Any

from skiros2_bags.core.errors import BagError
from skiros2_bags.core.restore import restore as restore_scene
from skiros2_bags.core.run import Run
from skiros2_bags.core.times import parse_time, relative_time
from skiros2_bags.core.world_diff import summary
from skiros2_bags.core.world_history import TimedChange
from skiros2_common.command_line.command import CommandResult, user
from skiros2_common.command_line.layout import Screen
from skiros2_common.core.world_element import Element, RelationDict
from skiros2_world_model.command_line.reading import element_answer, element_json, scene_tree
from skiros2_world_model.core.changes import RESET, Change
from skiros2_world_model.core.history import changed_lines, difference
from skiros2_world_model.core.replica import apply_change
from skiros2_world_model.core.scene import Scene

#: Relations along which the tree of a scene is printed; a bag contains no ontologies to derive them from.
_SPATIAL = ("skiros:contain", "skiros:hasA")

#: Maximum number of lines per change without `--all`.
_MAX_LINES = 12


def world(run: Run, arguments: argparse.Namespace, screen: Screen) -> CommandResult:
    """Prints the scene at a time, or one element of it."""
    at = parse_time(arguments.at, run) if arguments.at else run.end
    scene = run.world(at, arguments.partial)
    elements = _elements(scene, [node.id for node in scene])
    if arguments.id:
        element = scene.element(arguments.id)
        if element is None:
            others = f"only {len(scene)} others"
            raise BagError(f"{run.path}: there was no element {arguments.id!r} at {relative_time(at, run)} s, {others}")
        answer = element_answer(element, screen)
    else:
        answer = scene_tree(elements, _SPATIAL, screen, "", arguments.all)
    return CommandResult([screen.fitted(f"at {relative_time(at, run)} s:"), "", *answer.lines], answer.data)


def changes(run: Run, arguments: argparse.Namespace, screen: Screen) -> CommandResult:
    """Prints the changes of the world model with time and author."""
    since = parse_time(arguments.since, run) if arguments.since else float("-inf")
    until = parse_time(arguments.until, run) if arguments.until else float("inf")
    scene = Scene()
    lines: list[str] = []
    data: list[dict[str, Any]] = []
    for timed in run.changes():
        details = _change_lines(scene, timed)
        change = timed.change
        matches = not arguments.id or any(arguments.id in line.split() for line in details)
        if since < timed.time <= until and arguments.author in ("", change.author) and matches:
            lines += [screen.fitted(f"MISSING: {timed.gap}")] if timed.gap else []
            lines += [screen.fitted(f"{relative_time(timed.time, run)} s  {change.author}  {change.action}")]
            shown = details if arguments.all else details[:_MAX_LINES]
            lines += [screen.fitted(f"    {line}") for line in shown]
            lines += [f"    {len(details) - len(shown)} more: --all"] if len(shown) < len(details) else []
            data.append(_change_json(timed))
    return CommandResult(lines or ["no changes"], data)


def _change_lines(scene: Scene, timed: TimedChange) -> list[str]:
    """Returns the lines of a change, and applies it to the scene."""
    change = timed.change
    ids = [e.id for e in change.elements]
    if change.action == RESET:
        apply_change(scene, change)
        return [f"the whole scene, {len(ids)} elements"]
    facts = [(r["src"], r["dst"]) for part in (change, *change.elements) for r in _relations(part)]
    facts += [(src, dst) for eid in ids for src, _, dst in scene.relations(dst=eid)]
    touched = dict.fromkeys([*ids, *(end for fact in facts for end in fact if end != "-1")])
    before = _elements(scene, touched)
    apply_change(scene, change)
    after = _elements(scene, touched)
    return changed_lines(difference(before, after)) or [summary(change)]


def _relations(part: Change | Element) -> Iterable[RelationDict]:
    return part.relations if isinstance(part, Change) else part._rels


def _elements(scene: Scene, ids: Iterable[str]) -> list[Element]:
    return [element for eid in ids if (element := scene.element(eid)) is not None]


def _change_json(timed: TimedChange) -> dict[str, Any]:
    change = timed.change
    return {
        "time": timed.time,
        "gap": timed.gap,
        "author": change.author,
        "action": change.action,
        "snapshot_id": change.snapshot_id,
        "elements": [element_json(e) for e in change.elements],
        "relations": [{"src": r["src"], "type": r["type"], "dst": r["dst"]} for r in change.relations],
    }


def restore(run: Run, arguments: argparse.Namespace, screen: Screen) -> CommandResult:
    """Replaces the scene of a running world model by the scene of the bag at a time, in one transaction."""
    from skiros2_world_model.command_line.program import connect  # takes a second to import, and needs ROS

    at = parse_time(arguments.at, run) if arguments.at else run.end
    scene = run.world(at, arguments.partial)
    done = restore_scene(connect(arguments.wm, user()), scene)
    counts = f"{done.added} added, {done.changed} changed, {done.removed} removed"
    text = f"the scene is as at {relative_time(at, run)} s: {counts}"
    return CommandResult([screen.fitted(text)], asdict(done))
