"""The commands `view`, `get` and `query`."""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from skiros2_common.command_line.command import CommandResult
from skiros2_common.command_line.layout import Branch, Screen, table, tree
from skiros2_common.core.names import full_name, local_name
from skiros2_common.core.world_element import Element
from skiros2_world_model.command_line.values import element_json
from skiros2_world_model.core.formatting import format_value, format_values, summary
from skiros2_world_model.core.query_table import query_table
from skiros2_world_model.core.scene import ROOT
from skiros2_world_model.core.world_model_abstract_interface import WmException, WorldModelPort

CONTAINS = "skiros:contain"


def view(wm: WorldModelPort, arguments: argparse.Namespace, screen: Screen) -> CommandResult:
    """Shows the scene as a tree of containment."""
    elements = wm.resolve_elements(Element(""), arguments.context)
    return scene_tree(elements, predicates_of(wm, arguments.all), screen, arguments.id, arguments.all)


def predicates_of(wm: WorldModelPort, whole: bool) -> set[str]:
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
            for r in self.elements[eid]._rels
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
        lines = [f"{key} = {format_values(p.values)}" for key, p in sorted(element._props.items())]
        below = set(self.children(element.id))
        relations = [(r["type"], r["dst"]) for r in element._rels if r["src"] == "-1"]
        return lines + [f"{kind} {dst}" for kind, dst in sorted(set(relations) - below)]


def _by_number(eid: str) -> tuple[str, int, str]:
    stem, _, number = eid.rpartition("-")
    return stem, int(number) if number.isdecimal() else -1, eid


def get(wm: WorldModelPort, arguments: argparse.Namespace, screen: Screen) -> CommandResult:
    """Shows an element, or one property or relation of it."""
    element = wm.get_element(arguments.id, arguments.context)
    if arguments.property:
        return _one_property(element, arguments.property)
    return element_answer(element, screen)


def element_answer(element: Element, screen: Screen) -> CommandResult:
    """Formats an element with its properties and relations."""
    lines = [screen.fitted(f"{element.id}  {element.type}  {element.label}".rstrip()), ""]
    properties = sorted(element._props.items())
    lines += table(screen, [(key, p.dataType().__name__, format_values(p.values)) for key, p in properties])
    relations = sorted((r["src"], r["type"], r["dst"]) for r in element._rels)
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


def query(wm: WorldModelPort, arguments: argparse.Namespace, screen: Screen) -> CommandResult:
    """Shows the rows of a SPARQL query."""
    if arguments.file:
        try:
            text = Path(arguments.file).read_text()
        except (OSError, ValueError) as error:
            raise WmException(f"{arguments.file}: cannot be read: {getattr(error, 'strerror', error)}") from None
    else:
        text = arguments.sparql
    names, rows = query_table(wm, text, arguments.context)
    lines = table(screen, [["" if v is None else format_value(v) for v in row] for row in rows], names)
    if names and not rows:
        lines = ["no rows"]
    return CommandResult(lines, [dict(zip(names, row, strict=True)) for row in rows] if names else rows)
