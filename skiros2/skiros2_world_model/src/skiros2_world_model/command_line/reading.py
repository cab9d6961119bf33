"""The commands that read: `view`, `get`, `query`, `history` and `diff`."""

from __future__ import annotations

import argparse
import re
import time
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from skiros2_common.command_line.command import REFUSED, CommandResult
from skiros2_common.command_line.layout import Branch, Screen, table, tree
from skiros2_common.core.errors import WrongValue
from skiros2_common.core.names import full_name, local_name
from skiros2_common.core.world_element import Element, RelationDict
from skiros2_world_model.core.formatting import format_time, format_value, format_values, summary
from skiros2_world_model.core.history import HistoryEntry, Point, changed_lines, difference
from skiros2_world_model.core.scene import ROOT
from skiros2_world_model.core.wm_errors import WmException
from skiros2_world_model.core.world_model_client import WorldModelClient

_UNITS = {"s": 1, "m": 60, "h": 3600, "d": 86400}
_TIME_FORMATS = ("%Y-%m-%d %H:%M:%S", "%Y-%m-%d %H:%M", "%Y-%m-%dT%H:%M:%S", "%Y-%m-%dT%H:%M", "%Y-%m-%d")


def element_json(element: Element) -> dict[str, Any]:
    """Converts an element to JSON; its relations have both ids."""
    return {
        "id": element.id,
        "type": element.type,
        "label": element.label,
        "properties": {key: p.values for key, p in sorted(element.property_view.items())},
        "relations": [relation_json(r, element.id) for r in element.relation_view],
    }


def relation_json(relation: RelationDict, eid: str = "-1") -> dict[str, str]:
    """Converts a relation to JSON with both ids.

    :param eid: replaces "-1".
    """
    return {part: eid if relation[part] == "-1" else relation[part] for part in ("src", "type", "dst")}


def entry_json(entry: HistoryEntry) -> dict[str, Any]:
    """Converts an entry of the history to JSON."""
    return {
        "number": entry.number,
        "stamp": entry.stamp,
        "author": entry.author,
        "action": entry.action,
        "before": [element_json(e) for e in entry.before],
        "after": [element_json(e) for e in entry.after],
        "related": [relation_json(r) for r in entry.related],
        "unrelated": [relation_json(r) for r in entry.unrelated],
        "stated": entry.stated,
        "unstated": entry.unstated,
    }


def point(text: str, now: float) -> Point:
    """Parses a point of the history.

    Formats: a time of today (`14:05`, `14:05:30`), a date and time (`2026-11-21 14:05`), a time ago (`90s`, `10m`,
    `2h`, `3d`), s since the epoch with a decimal point, or the number of a change (`#1795243845958443`).

    :param now: the current time (s since the epoch).
    :raises WrongValue: the text has another format.
    """
    text = text.strip()
    if match := re.fullmatch(r"#?(\d{1,18})", text):
        return int(match[1])
    if match := re.fullmatch(r"(\d+(?:\.\d+)?)([smhd])", text):
        return now - float(match[1]) * _UNITS[match[2]]
    if re.fullmatch(r"\d+\.\d*", text):
        return float(text)
    today = time.strftime("%Y-%m-%d ", time.localtime(now))
    for candidate in (text, today + text):
        for pattern in _TIME_FORMATS:
            try:
                return time.mktime(time.strptime(candidate, pattern))
            except (ValueError, OverflowError):
                continue
    raise WrongValue(f"{text!r} is not a time: expected 14:05, 2026-11-21 14:05, 10m (ago; s, m, h, d) or #NUMBER")


CONTAINS = "skiros:contain"


def view(wm: WorldModelClient, arguments: argparse.Namespace, screen: Screen) -> CommandResult:
    """Shows the scene as a tree of containment."""
    elements = wm.resolve_elements(Element(""), arguments.context)
    return scene_tree(elements, predicates_of(wm, arguments.all), screen, arguments.id, arguments.all)


def element_ids(wm: WorldModelClient, begun: str) -> list[str]:
    """The ids that may complete a word: those in the tree of the scene; if none begins so, all."""
    elements = wm.resolve_elements(Element(""))
    forest = _Forest(elements, frozenset(predicates_of(wm, False)), False)
    forest.branch(ROOT)
    return list(forest.shown if any(eid.startswith(begun) for eid in forest.shown) else forest.elements)


def names_of(wm: WorldModelClient, eid: str) -> list[str]:
    """The names of an element's properties and outgoing relations; [] if there is no such element."""
    element = wm.find_element(eid)
    if element is None:
        return []
    relations = [relation["type"] for relation in element.getRelations("-1")]
    return ["label", "type", *(prop.key for prop in element.properties), *dict.fromkeys(relations)]


def predicates_of(wm: WorldModelClient, whole: bool) -> set[str]:
    """The relations that form the tree of a scene: spatial ones, or all."""
    relation = "skiros:sceneProperty" if whole else "skiros:spatiallyRelated"
    return {relation, *wm.get_sub_properties(relation)}


def scene_tree(
    elements: Sequence[Element], predicates: Iterable[str], screen: Screen, root: str = "", whole: bool = False
) -> CommandResult:
    """Formats elements as a tree.

    :param predicates: the relations from parent to child.
    :param root: only this element and its descendants; "": all.
    :param whole: shows all properties and relations, and elements without parent and children.
    :raises WmException: the element `root` does not exist.
    """
    forest = _Forest(elements, frozenset(predicates), whole)
    if root and root not in forest.elements:
        raise WmException(f"there is no element {root!r}")
    roots = [root] if root else forest.roots()
    if not whole:
        roots = [eid for eid in roots if eid in (root, ROOT) or forest.children(eid)]
    lines = tree(screen, [forest.branch(eid) for eid in roots])
    left = len(forest.elements) - len(forest.shown)
    if left and not root:
        lines += ["", screen.fitted(f"{left} more that nothing holds (skills, parameters, ...): --all")]
    return CommandResult(lines, lambda: [element_json(forest.elements[eid]) for eid in forest.shown])


class _Forest:
    """Trees of elements. Each element is shown once, at its first position."""

    def __init__(self, elements: Iterable[Element], predicates: frozenset[str], whole: bool) -> None:
        self.elements = {element.id: element for element in elements}
        self.shown: dict[str, None] = {}
        self._predicates = predicates
        self._whole = whole
        self._children: dict[str, list[tuple[str, str]]] = {}

    def roots(self) -> list[str]:
        """The elements without a parent, and the first element of each cycle."""
        under = {child for eid in self.elements for _, child in self.children(eid)}
        roots = [eid for eid in self.elements if eid not in under]
        reached: set[str] = set()
        for eid in [*roots, *self.elements]:
            if eid not in reached:
                roots += [eid] if eid in under else []
                waiting = [eid]
                while waiting:
                    one = waiting.pop()
                    if one not in reached:
                        reached.add(one)
                        waiting += [child for _, child in self.children(one)]
        return roots

    def children(self, eid: str) -> list[tuple[str, str]]:
        """The children of an element: relations and ids."""
        known = self._children.get(eid)
        if known is not None:
            return known
        found = [
            (r["type"], r["dst"])
            for r in self.elements[eid].relation_view
            if r["src"] == "-1" and r["type"] in self._predicates and r["dst"] in self.elements
        ]
        found.sort(key=lambda pair: (pair[0] != CONTAINS, pair[0], _by_number(pair[1])))
        self._children[eid] = found
        return found

    def branch(self, root: str) -> Branch:
        """The tree of an element and its descendants."""
        top = Branch([root])
        waiting = [(root, "", top)]
        while waiting:
            eid, relation, branch = waiting.pop()
            name = eid if relation in ("", CONTAINS) else f"{local_name(relation)}: {eid}"
            if eid in self.shown:
                branch.cells = [f"{name} (see above)"]
                continue
            self.shown[eid] = None
            element = self.elements[eid]
            if self._whole:
                branch.cells = [f'{name} "{element.label}"' if element.label else name]
                branch.branches = [Branch([text]) for text in self._details(element)]
            else:
                branch.cells = [name, element.label, summary(element)]
            below = [(child, kind, Branch([child])) for kind, child in self.children(eid)]
            branch.branches += [child for _, _, child in below]
            waiting += below[::-1]
        return top

    def _details(self, element: Element) -> list[str]:
        """All properties, and the relations that are not part of the tree."""
        lines = [f"{key} = {format_values(p.values)}" for key, p in sorted(element.property_view.items())]
        below = set(self.children(element.id))
        relations = [(r["type"], r["dst"]) for r in element.relation_view if r["src"] == "-1"]
        return lines + [f"{kind} {dst}" for kind, dst in sorted(set(relations) - below)]


def _by_number(eid: str) -> tuple[str, int, str]:
    stem, _, number = eid.rpartition("-")
    return stem, int(number) if number.isdecimal() else -1, eid


def get(wm: WorldModelClient, arguments: argparse.Namespace, screen: Screen) -> CommandResult:
    """Shows an element, or one property or relation of it."""
    element = wm.get_element(arguments.id, arguments.context)
    if arguments.property:
        return _one_property(element, arguments.property)
    return element_answer(element, screen)


def element_answer(element: Element, screen: Screen) -> CommandResult:
    """Formats an element with its properties and relations."""
    lines = [screen.fitted(f"{element.id}  {element.type}  {element.label}".rstrip()), ""]
    properties = sorted(element.property_view.items())
    lines += table(screen, [(key, p.dataType().__name__, format_values(p.values)) for key, p in properties])
    relations = sorted((r["src"], r["type"], r["dst"]) for r in element.relation_view)
    if relations:
        lines += ["", *table(screen, [[element.id if e == "-1" else e for e in row] for row in relations])]
    return CommandResult(lines, element_json(element))


def _one_property(element: Element, name: str) -> CommandResult:
    """The values of a property, the objects of a relation, or the label or type: one per line."""
    values: list[Any]
    if name in ("label", "rdfs:label"):
        values = [element.label]
    elif name in ("type", "rdf:type"):
        values = [element.type]
    elif element.hasProperty(name):
        values = element.getProperty(name).values
    else:
        values = [r["dst"] for r in element.getRelations("-1", name)]
        if not values:
            known = sorted({*element.available_properties, *(r["type"] for r in element.getRelations("-1"))})
            raise WmException(f"{element.id} has no {full_name(name)}; it has: {', '.join(known) or 'none'}")
    return CommandResult([str(value) for value in values], values)


def query(wm: WorldModelClient, arguments: argparse.Namespace, screen: Screen) -> CommandResult:
    """Shows the rows of a SPARQL query."""
    if arguments.file:
        try:
            text = Path(arguments.file).read_text()
        except (OSError, ValueError) as error:
            raise WmException(f"{arguments.file}: cannot be read: {getattr(error, 'strerror', error)}") from None
    else:
        text = arguments.sparql
    names, rows = wm.query_table(text, arguments.context)
    lines = table(screen, [["" if v is None else format_value(v) for v in row] for row in rows], names)
    if names and not rows:
        lines = ["no rows"]
    return CommandResult(lines, [dict(zip(names, row, strict=True)) for row in rows] if names else rows)


#: The maximum number of changes shown for one request, without `--all`.
_SHOWN = 20


def history(wm: WorldModelClient, arguments: argparse.Namespace, screen: Screen) -> CommandResult:
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
        shown = changes if arguments.all else changes[:_SHOWN]
        lines += [screen.fitted(f"    {line}") for line in shown]
        lines += [f"    {len(changes) - len(shown)} more: --all"] if len(shown) < len(changes) else []
    if not entries:
        lines = ["no changes"]
    elif limit and len(entries) == limit:
        lines += ["", f"the last {limit}; --limit 0 shows all"]
    return CommandResult(lines, [entry_json(entry) for entry in entries])


def _at(wm: WorldModelClient, arguments: argparse.Namespace, at: Point, screen: Screen) -> CommandResult:
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


def diff(wm: WorldModelClient | None, arguments: argparse.Namespace, screen: Screen) -> CommandResult:
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
        sides = [_side(wm, side, now, context) for side in (old, new)]
        entry = difference(*sides)
    lines = [screen.fitted(line) for line in changed_lines(entry)]
    return CommandResult(lines, entry_json(entry), REFUSED if entry else 0)


def _side(wm: WorldModelClient | None, side: str, now: float, context: str) -> Sequence[Element]:
    if wm is not None and not side:
        return wm.resolve_elements(Element(""), context)
    if wm is not None and side.startswith("@"):
        return wm.scene_at(point(side[1:], now), context).after
    from skiros2_world_model.command_line.scene_file import read_scene_file  # takes time, and an RDF library

    return read_scene_file(Path(side))


def needs_world_model(arguments: argparse.Namespace) -> bool:
    """Whether a comparison needs a running world model."""
    return not arguments.new or arguments.old.startswith("@") or arguments.new.startswith("@")
