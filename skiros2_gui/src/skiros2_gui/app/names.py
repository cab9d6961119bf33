"""The names of the elements of the running system for people."""

from __future__ import annotations

from skiros2_common.core.names import local_name
from skiros2_common.core.operations import SCENE
from skiros2_common.core.wording import in_words, label_text, short_name, visible, with_names
from skiros2_common.core.world_element import Element
from skiros2_gui.app.system import System


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
            return short_name(local_name(eid))
        name = label_text(label)
        return name if self.is_unique(label) else f"{name} ({short_name(local_name(eid))})"

    def is_unique(self, label: str) -> bool:
        """Returns whether at most one element has a label. Parameters of skills, such as `Arm`, do not count."""
        scene = self._system.scene
        if scene is None:
            return True
        return sum(e.type != "skiros:Parameter" for e in scene.matching(Element("", label), SCENE)) < 2

    def in_text(self, text: str) -> str:
        """Returns a text with the names of the elements whose ids are in it as `id`, `id-label` or `id "label"`."""
        return visible(with_names(text, self._label, self.of), keep="\n")

    def readable(self, text: str) -> str:
        """Returns a text with names instead of ids, and words instead of the names of ontologies."""
        return in_words(self.in_text(text))

    def _label(self, eid: str) -> str:
        scene = self._system.scene
        element = scene.find(eid, SCENE) if scene is not None else None
        return element.label if element is not None else ""
