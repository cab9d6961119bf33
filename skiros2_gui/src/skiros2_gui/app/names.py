"""How elements, relations and facts are named for people: labels instead of ids, verbs instead of relations."""

from __future__ import annotations

import re

from skiros2_common.core.names import local_name
from skiros2_common.core.world_element import Element
from skiros2_gui.app.system import System

#: An id in a text, and the label that may follow it.
_ID = re.compile(r"""\b([A-Za-z_]\w*:\w+-\d+)\b(?: ?["'][^"'\n]*["'])?""")
_PREFIX = re.compile(r"^[A-Za-z_]\w*:(?=\S)")
_HUMP = re.compile(r"(?<=[a-z0-9])(?=[A-Z])")

#: Relations in a sentence: while it holds, does not hold, and has ended.
_VERBS = {
    "contain": ("contains", "does not contain", "no longer contains"),
    "hasA": ("has", "does not have", "no longer has"),
    "at": ("is at", "is not at", "is no longer at"),
}


class Names:
    """The names of the elements of a scene. Used in the window's thread.

    :param system: the running system, with its replica of the scene.
    """

    def __init__(self, system: System) -> None:
        self._system = system

    def of(self, eid: str) -> str:
        """Returns the label of an element; with the id if other elements have the same label. Without a label, and for
        an unknown element, the id without prefix.
        """
        scene = self._system.scene
        element = scene.find(eid, "scene") if scene is not None else None
        if scene is None or element is None or not element.label:
            return local_name(eid)
        name = label_text(element.label)
        return name if self.is_unique(element.label) else f"{name} ({local_name(eid)})"

    def is_unique(self, label: str) -> bool:
        """Returns whether at most one element has a label."""
        scene = self._system.scene
        return scene is None or len(scene.matching(Element("", label), "scene")) < 2

    def in_text(self, text: str) -> str:
        """Returns a text for people with the names of the elements whose ids are in it."""
        return _ID.sub(lambda found: self.of(found[1]), text)


def label_text(label: str) -> str:
    """Returns a label for people: without the prefix of a template."""
    return _PREFIX.sub("", label)


def verb(relation: str, state: bool = True, has_ended: bool = False) -> str:
    """Returns a relation as the verb of a sentence.

    :param state: whether the relation holds.
    :param has_ended: it held before.
    """
    name = local_name(relation)
    shown = words(name)
    return _VERBS.get(name, (shown, f"not {shown}", f"no longer {shown}"))[0 if state else 2 if has_ended else 1]


def words(name: str) -> str:
    """Returns an ontology name in words: `skiros:ContainerState` gives `container state`."""
    return _HUMP.sub(" ", local_name(name)).replace("_", " ").lower()
