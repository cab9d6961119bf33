"""The named contexts of a world model."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator

import pyoxigraph as ox

from skiros2_common.core.changeset import ChangeSet
from skiros2_common.core.element_content import relation_dict
from skiros2_common.core.errors import SkirosError, UnknownName, WrongType, WrongValue
from skiros2_common.core.operations import ONTOLOGY, SCENE, SPATIAL, Add, Operation, Patch, Relate
from skiros2_common.core.property import Property, same_value
from skiros2_common.core.world_element import Element, ElementChanges
from skiros2_world_model.core.checks import LEFT_OUT, Checks
from skiros2_world_model.core.journal import ContextState
from skiros2_world_model.core.knowledge_base import KnowledgeBase
from skiros2_world_model.core.queries import containment_cycle, format_cycle
from skiros2_world_model.core.rdf import parse_n_triples, python_value
from skiros2_world_model.core.scene import ROOT, ChangeInfo, ElementRecord, Scene
from skiros2_world_model.core.scene_rdf import GraphSync, SceneContent, scene_triples
from skiros2_world_model.core.scene_turtle import scene_turtle
from skiros2_world_model.core.transaction import template_element

_BLANK_SCENE = "skiros:blank_scene"


class Context:
    """A scene, the other triples of its file (`extras`), and its graph in the triple store. Used under the lock.

    :ivar file: the file it was last loaded from or saved to; "": none.
    :raises WrongValue: the name is invalid.
    """

    def __init__(self, name: str, knowledge_base: KnowledgeBase) -> None:
        if not re.fullmatch(r"[\w.~-]+", name) or name == ONTOLOGY:
            raise WrongValue(f"{name!r} cannot be the name of a context with elements")
        self.name = name
        self.file = ""
        self.scene = Scene()
        self.extras: list[ox.Triple] = []
        self._knowledge_base = knowledge_base
        self._graph_sync = GraphSync(knowledge_base.store, name)
        if name == SCENE:
            self._add_root(self.scene)

    def flush(self) -> None:
        """Brings the store up to date with the scene."""
        self._graph_sync.flush(self.scene, self.extras, self._knowledge_base.index, self._knowledge_base.prefixes)

    def triples(self) -> Iterator[ox.Triple]:
        """The triples of the current state, generated lazily. Iterating needs no lock."""
        return scene_triples(self.scene, self._knowledge_base.index, self._knowledge_base.prefixes, list(self.extras))

    def snapshot(self) -> Callable[[], bytes]:
        """Returns a function that formats the current state as sorted Turtle. It needs no lock."""
        ontology, prefixes = self._knowledge_base.index, self._knowledge_base.prefixes
        records, relations, extras = list(self.scene), list(self.scene.relations()), list(self.extras)
        return lambda: scene_turtle(records, relations, extras, ontology, prefixes)

    def read(
        self, triples: Iterable[ox.Triple], checks: Checks, change_info: ChangeInfo, adds_root: bool = True
    ) -> tuple[Scene, list[ox.Triple]]:
        """Builds a scene and its extra triples from triples. Does not change this context.

        :param change_info: the last change of the elements.
        :param adds_root: adds the root to a scene without one, instead of refusing it.
        :raises SkirosError: a check refuses the content.
        """
        knowledge_base = self._knowledge_base
        content = SceneContent(triples, checks, change_info)
        scene = Scene()
        for record in content.records.values():
            scene.put(record)
        if self.name == SCENE and ROOT not in scene:
            if not adds_root:
                raise WrongValue(f"{checks.origin}: there is no {ROOT}, the root of a scene")
            self._add_root(scene)
        for src, pred, dst in content.relations:
            try:
                if dst not in scene:
                    checks.individual(dst, f"{src} {pred} {dst}")
            except SkirosError as error:
                checks.report(src, pred, error, LEFT_OUT)
            else:
                scene.relate(src, pred, dst)
        spatial = knowledge_base.index.subproperties(SPATIAL)
        while cycle := containment_cycle(scene, spatial, (record.id for record in scene)):
            holder, held = cycle[1], cycle[0]
            loop = WrongValue(f"{checks.origin}: elements that contain themselves: {format_cycle(cycle)}")
            checks.report(held, "", loop, f"left out that {holder} holds {held}")
            for relation in list(scene.relations(holder, spatial, held)):
                scene.unrelate(*relation)
        checks.finish()
        return scene, content.extras

    def replace(self, scene: Scene, extras: list[ox.Triple]) -> None:
        """Replaces the scene and the extra triples."""
        self.scene = scene
        self.scene.unsynced = None  # the store has the previous scene
        self.extras = extras

    def restore(self, state: ContextState) -> None:
        """Restores the state that the journal recorded."""
        scene = Scene()
        for record in state.records:
            scene.put(record)
        for relation in state.relations:
            scene.relate(*relation)
        scene.reserve(state.next_number)
        self.replace(scene, parse_n_triples(state.extras))
        self.file = state.file

    def _add_root(self, scene: Scene) -> None:
        try:
            root = template_element(self._knowledge_base.index, _BLANK_SCENE)
        except (UnknownName, WrongType, WrongValue):
            root = Element("skiros:Scene", _BLANK_SCENE)
        scene.put(ElementRecord(ROOT, root.type, root.label, dict(root.property_view)))


class Contexts(dict[str, Context]):
    """The existing contexts, by name. Used under the world model's lock."""

    def __init__(self, knowledge_base: KnowledgeBase) -> None:
        super().__init__()
        self._knowledge_base = knowledge_base
        self.named(SCENE)

    def named(self, name: str) -> Context:
        """Returns a context, creating it when it does not exist.

        :raises WrongValue: the name is invalid.
        """
        found = self.get(name)
        if found is None:
            found = self[name] = Context(name, self._knowledge_base)
        return found

    def scenes(self) -> list[Scene]:
        """The scenes of all contexts."""
        return [context.scene for context in self.values()]

    def others(self, name: str) -> dict[str, Scene]:
        """The scenes of the other contexts."""
        return {context.name: context.scene for context in self.values() if context.name != name}

    def home(self, eid: str, first: str = SCENE) -> str:
        """The name of the context that has an element; "" when none has it.

        :param first: the context to search first.
        """
        order = sorted(self, key=lambda name: name != first)
        return next((name for name in order if eid in self[name].scene), "")

    def dangling(self, changes: ChangeSet) -> Iterator[tuple[str, list[Patch]]]:
        """Patches, by context, that remove the relations to removed elements, unless another context has them."""
        gone = [eid for eid, (_, after) in changes.records.items() if after is None and not self.home(eid)]
        for name, context in list(self.items()) if gone else ():
            patches = [
                Patch(src, ElementChanges(removed_relations=[relation_dict("-1", pred, dst)]))
                for eid in gone
                for src, pred, dst in context.scene.relations(dst=eid)
            ]
            if patches:
                yield name, patches


#: Instances of classes of these vocabularies belong to an ontology, not to a scene.
_META = ("owl:", "rdfs:", "rdf:")


def element_operations(
    knowledge_base: KnowledgeBase, scene: Scene, removed: Iterable[ox.Triple], added: Iterable[ox.Triple]
) -> list[Operation]:
    """The operations that have the effect of removing and adding triples.

    :raises UnknownName: a triple describes an element that does not exist, and no triple gives it a class.
    :raises WrongValue: a triple removes the class of an element.
    """
    prefixes = knowledge_base.prefixes
    new: dict[str, Element] = {}
    known: dict[str, Element] = {}
    operations: list[Operation] = []
    statements = [(t, False) for t in removed] + [(t, True) for t in added]
    for triple, value in sorted(statements, key=lambda s: prefixes.name(s[0].predicate.value) != "rdf:type"):
        item = triple.object
        if not isinstance(triple.subject, ox.NamedNode) or not isinstance(item, (ox.NamedNode, ox.Literal)):
            raise WrongValue(f"{triple}: elements are described without blank nodes")
        eid, key = prefixes.name(triple.subject.value), prefixes.name(triple.predicate.value)
        element = new.get(eid) or known.get(eid) or scene.element(eid)
        if key == "rdf:type":
            etype = prefixes.name(item.value)
            if not value:
                raise WrongValue(f"{eid}: an element has a class; remove the element instead")
            if etype == "owl:NamedIndividual":
                continue
            if etype.startswith(_META):
                raise WrongValue(f"{eid} is declared a {etype}, which belongs in the ontologies (context '')")
            if element is None:
                new[eid] = Element(etype, "", eid)
                continue
            element.type = etype
        elif element is None:
            raise UnknownName(f"there is no element {eid!r}, and nothing gives it a class")
        elif isinstance(item, ox.NamedNode):
            operations.append(Relate(eid, key, prefixes.name(item.value), value))
        elif key == "rdfs:label":
            element.label = item.value if value else ""
        else:
            _write_value(element, key, python_value(item), value)
        if eid not in new:
            known[eid] = element
    adds: list[Operation] = [Add(element) for element in new.values()]
    patches: list[Operation] = [Patch(eid, e.changes() or ElementChanges()) for eid, e in known.items() if e.changes()]
    return [*adds, *patches, *operations]


def _write_value(element: Element, key: str, item: object, present: bool) -> None:
    prop = element.property_view.get(key)
    values = [v for v in (prop.values if prop is not None else []) if not same_value(v, item)]
    if present:
        values.append(item)
    element.removeProperty(key)
    if values:
        element.put(key, Property(key, values if len({type(v) for v in values}) == 1 else [str(v) for v in values]))
