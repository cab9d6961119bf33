"""A named context: a scene, what its file says beside elements, and its mirror in the store."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from itertools import chain

import pyoxigraph as ox

from skiros2_common.core.errors import SkirosError, UnknownName, WrongType, WrongValue
from skiros2_common.core.world_element import Element
from skiros2_world_model.core.changes import SPATIAL
from skiros2_world_model.core.checks import Checks
from skiros2_world_model.core.context_names import ONTOLOGY, SCENE
from skiros2_world_model.core.file_checks import LEFT_OUT
from skiros2_world_model.core.journal_state import ContextState
from skiros2_world_model.core.ontology_base import OntologyBase
from skiros2_world_model.core.queries import containment_cycle, told
from skiros2_world_model.core.rdf_files import parse_n_triples
from skiros2_world_model.core.scene import ROOT, Node, Provenance, Scene
from skiros2_world_model.core.scene_rdf import Mirror, element_triples, read_scene, relation_triple, scene_turtle
from skiros2_world_model.core.templates import template_element

_BLANK_SCENE = "skiros:blank_scene"


class Context:
    """One context of a world model. Used under the world model's lock.

    :param file: the file it was last loaded from or saved to, "" when with none.
    :raises WrongValue: it cannot have that name.
    """

    def __init__(self, name: str, base: OntologyBase) -> None:
        if not re.fullmatch(r"[\w.~-]+", name) or name == ONTOLOGY:
            raise WrongValue(f"{name!r} cannot be the name of a context with elements")
        self.name = name
        self.file = ""
        self.scene = Scene()
        self.extras: list[ox.Triple] = []
        self._base = base
        self._mirror = Mirror(base.store, name)
        if name == SCENE:
            self._add_root(self.scene)

    def flush(self) -> None:
        """Brings the store up to date with the scene."""
        self._mirror.flush(self.scene, self.extras, self._base.index, self._base.prefixes)

    def triples(self) -> Iterator[ox.Triple]:
        """All of it as it is now. The triples are made while they are read, which needs no lock."""
        ontology, prefixes = self._base.index, self._base.prefixes
        nodes, relations, extras = list(self.scene), list(self.scene.relations()), list(self.extras)
        elements = (triple for node in nodes for triple in element_triples(node, ontology, prefixes))
        return chain(elements, (relation_triple(relation, prefixes) for relation in relations), extras)

    def turtle(self) -> bytes:
        """All of it as sorted Turtle."""
        return scene_turtle(self.scene, self.extras, self._base.index, self._base.prefixes)

    def read(
        self, triples: Iterable[ox.Triple], checks: Checks, origin: str, made: Provenance, adds_root: bool = True
    ) -> tuple[Scene, list[ox.Triple]]:
        """A scene, and what is beside it, from triples; nothing of this context changes.

        :param made: what its elements are to know of their last change.
        :param adds_root: whether a scene without a root gets one; else it is refused.
        :raises SkirosError: something in it is refused.
        """
        base = self._base
        content = read_scene(triples, base.index, base.prefixes, checks, origin, made)
        scene = Scene()
        for node in content.nodes:
            scene.put(node)
        if self.name == SCENE and ROOT not in scene:
            if not adds_root:
                raise WrongValue(f"{origin}: there is no {ROOT}, the root of a scene")
            self._add_root(scene)
        for src, pred, dst in content.relations:
            try:
                if dst not in scene:
                    checks.individual(dst, f"{src} {pred} {dst}")
            except SkirosError as error:
                checks.refuse(src, pred, error, LEFT_OUT)
            else:
                scene.relate(src, pred, dst)
        spatial = base.index.subproperties(SPATIAL)
        while cycle := containment_cycle(scene, spatial, (node.id for node in scene)):
            holder, held = cycle[1], cycle[0]
            loop = WrongValue(f"{origin}: elements that contain themselves: {told(cycle)}")
            checks.refuse(held, "", loop, f"left out that {holder} holds {held}")
            for relation in list(scene.relations(holder, spatial, held)):
                scene.unrelate(*relation)
        checks.finish()
        return scene, content.extras

    def replace(self, scene: Scene, extras: list[ox.Triple]) -> None:
        """Puts another scene in the place of the present one."""
        self.scene = scene
        self.scene.dirty = None  # the store has another one
        self.extras = extras

    def restore(self, state: ContextState) -> None:
        """Makes it what the journal has."""
        scene = Scene()
        for node in state.nodes:
            scene.put(node)
        for relation in state.relations:
            scene.relate(*relation)
        scene.reserve(state.next_number)
        self.replace(scene, parse_n_triples(state.extras))
        self.file = state.file

    def _add_root(self, scene: Scene) -> None:
        try:
            root = template_element(self._base.index, _BLANK_SCENE)
        except (UnknownName, WrongType, WrongValue):
            root = Element("skiros:Scene", _BLANK_SCENE)
        scene.put(Node(ROOT, root.type, root.label, dict(root._props)))
