"""The commands that tell of the world model in a bag: world and changes."""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from typing import Any

from skiros2_bags.core.errors import BagError
from skiros2_bags.core.moments import moment, relative
from skiros2_bags.core.normal import summary
from skiros2_bags.core.run import Run
from skiros2_bags.core.world_changes import TimedChange
from skiros2_common.command_line.answer import Answer
from skiros2_common.command_line.layout import Screen
from skiros2_common.core.world_element import Element, RelationDict
from skiros2_world_model.command_line.reading import element_answer, scene_tree
from skiros2_world_model.command_line.values import element_json
from skiros2_world_model.core.apply_change import apply_change
from skiros2_world_model.core.changes import RESET, Change
from skiros2_world_model.core.history_entry import changed_lines, difference
from skiros2_world_model.core.scene import Scene

#: What leads down the tree of a scene; a bag has no ontologies that could tell.
_SPATIAL = ("skiros:contain", "skiros:hasA")

#: So many lines of one change are shown, unless all are wanted.
_SHOWN = 12


def world(run: Run, arguments: argparse.Namespace, screen: Screen) -> Answer:
    """The world model as it was at a time, or one element of it."""
    at = moment(arguments.at, run) if arguments.at else run.end
    scene = run.world(at, arguments.partial)
    elements = _elements(scene, [node.id for node in scene])
    if arguments.id:
        element = scene.element(arguments.id)
        if element is None:
            others = f"only {len(scene)} others"
            raise BagError(f"{run.path}: there was no element {arguments.id!r} at {relative(at, run)} s, {others}")
        answer = element_answer(element, screen)
    else:
        answer = scene_tree(elements, _SPATIAL, screen, "", arguments.all)
    return Answer([screen.fitted(f"at {relative(at, run)} s:"), "", *answer.lines], answer.data)


def changes(run: Run, arguments: argparse.Namespace, screen: Screen) -> Answer:
    """What was changed in the world model, when, and by whom."""
    since = moment(arguments.since, run) if arguments.since else float("-inf")
    until = moment(arguments.until, run) if arguments.until else float("inf")
    scene = Scene()
    lines: list[str] = []
    data: list[dict[str, Any]] = []
    for timed in run.changes():
        told = _told(scene, timed)
        change = timed.change
        is_meant = not arguments.id or any(arguments.id in line.split() for line in told)
        if since < timed.time <= until and arguments.author in ("", change.author) and is_meant:
            lines += [screen.fitted(f"MISSING: {timed.gap}")] if timed.gap else []
            lines += [screen.fitted(f"{relative(timed.time, run)} s  {change.author}  {change.action}")]
            shown = told if arguments.all else told[:_SHOWN]
            lines += [screen.fitted(f"    {line}") for line in shown]
            lines += [f"    {len(told) - len(shown)} more: --all"] if len(shown) < len(told) else []
            data.append(_change_json(timed))
    return Answer(lines or ["no changes"], data)


def _told(scene: Scene, timed: TimedChange) -> list[str]:
    """What a change made otherwise, a line each; the scene is that before it, and then that behind."""
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
