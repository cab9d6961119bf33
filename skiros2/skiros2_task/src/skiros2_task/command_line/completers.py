"""Completes goals on a command line."""

from __future__ import annotations

import re
from collections.abc import Iterator

from skiros2_common.core.world_element import Element
from skiros2_task.core.goal_text import keywords
from skiros2_world_model.command_line.reading import element_ids
from skiros2_world_model.core.world_model_client import WorldModelClient

_POST, _TERM = "skiros:hasPostCondition", "skiros:appliedOnType"


def goals(wm: WorldModelClient, begun: str) -> Iterator[str]:
    """Completes the last name of a goal: behind `(` what skills bring about, elsewhere an element."""
    before, name = re.fullmatch(r"((?:.*[\s(])?)([^\s()]*)", begun, re.S).groups()  # type: ignore[union-attr]
    if before.rstrip().endswith("(") or not before:
        before = before or "("
        yield from (f"{before}{term}" for term in [*_effects(wm), *keywords()])
    else:
        yield from (f"{before}{eid}" for eid in element_ids(wm, name))


def _effects(wm: WorldModelClient) -> list[str]:
    """The relations and properties in the post-conditions of the robots' skills."""
    elements = {element.id: element for element in wm.resolve_elements(Element(""))}
    ids = {relation["dst"] for each in elements.values() for relation in each.getRelations("-1", _POST)}
    terms = (elements[eid].value_of(_TERM) for eid in ids if eid in elements)
    return sorted({str(term) for term in terms if term})
