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

#: A name of an ontology in a text. Ids end with a number.
_NAME = re.compile(r"\b[A-Za-z_]\w*:([A-Za-z_]\w*)\b(?!-\d)")

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
        label = self._label(eid)
        if not label:
            return local_name(eid)
        name = label_text(label)
        return name if self.is_unique(label) else f"{name} ({local_name(eid)})"

    def is_unique(self, label: str) -> bool:
        """Returns whether at most one element has a label. Parameters of skills, such as `Arm`, do not count."""
        scene = self._system.scene
        if scene is None:
            return True
        return sum(e.type != "skiros:Parameter" for e in scene.matching(Element("", label), "scene")) < 2

    def in_text(self, text: str) -> str:
        """Returns a text with the names of the elements whose ids are in it as `id`, `id-label` or `id "label"`."""
        parts, end = [], 0
        for found in _ID.finditer(text):
            if found.start() < end:
                continue  # in a label
            parts += [text[end : found.start()], self.of(found[1])]
            after = f"-{self._label(found[1])}"
            end = found.end(1) + len(after) if len(after) > 1 and text.startswith(after, found.end(1)) else found.end()
        return "".join((*parts, text[end:]))

    def readable(self, text: str) -> str:
        """Returns a text with names instead of ids, and words instead of the names of ontologies."""
        return in_words(self.in_text(text))

    def _label(self, eid: str) -> str:
        scene = self._system.scene
        element = scene.find(eid, "scene") if scene is not None else None
        return element.label if element is not None else ""


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


def in_words(text: str) -> str:
    """Returns a text with words instead of the names of ontologies: "Arm skiros:hasA Gripper" gives "Arm has Gripper".
    A name with underscores is a label and only loses its prefix.
    """
    return _NAME.sub(lambda found: found[1] if "_" in found[1] else verb(found[1]), text)


def words(name: str) -> str:
    """Returns an ontology name in words: `skiros:ContainerState` gives `container state`."""
    return _HUMP.sub(" ", local_name(name)).replace("_", " ").lower()
