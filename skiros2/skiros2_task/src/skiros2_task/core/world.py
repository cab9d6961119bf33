"""A snapshot of the scene for planning, with the index of the ontologies: no query leaves this process."""

from __future__ import annotations

import copy
import threading
from collections.abc import Collection, Iterable, Iterator, Mapping
from functools import cached_property
from itertools import product

from skiros2_common.core.discrete_reasoner import reasoners
from skiros2_common.core.errors import SkirosError
from skiros2_common.core.names import full_name
from skiros2_common.core.reasoner_registry import relations_of
from skiros2_common.core.world_element import Element
from skiros2_common.core.world_model_port import WorldModelPort
from skiros2_task.core.skills import Robot, RunningManagers, no_managers, read_robots
from skiros2_world_model.core.datatypes import PYTHON_TYPES

#: The template of an instance.
TEMPLATE = "skiros:Template"
TEMPLATE_RELATION = "skiros:hasTemplate"

#: Classes of the scene whose elements are not objects of planning.
_NOT_OBJECTS = ("skiros:Skill", "skiros:Parameter", "skiros:Condition", "skiros:ParameterSet")


#: The number of changes of an object that are searched.
_MAX_ENTRIES = 100


class WorldView:
    """A snapshot of the scene. Templates are read on demand."""

    def __init__(self, wm: WorldModelPort, running: RunningManagers = no_managers) -> None:
        """Reads the whole scene.

        :raises WmException: the world model does not answer.
        """
        self._wm = wm
        self._all: dict[str, Element] = {e.id: e for e in wm.resolve_elements(Element())}
        self.robots: tuple[Robot, ...] = read_robots(self._all, running)
        skill_parts = self._skill_parts()
        types = {e.type for e in self._all.values()}
        others = {cls for cls in types if any(self.is_subclass(cls, parent) for parent in _NOT_OBJECTS)}
        #: The elements that goals and parameters may refer to, by id; a template that stands for itself, by name.
        self.objects: dict[str, Element] = {
            eid: e for eid, e in self._all.items() if eid not in skill_parts and e.type not in others
        }
        #: The objects that are not in the scene: templates that stand for themselves, and objects to create.
        self.stand_ins: set[str] = set()
        self.to_create: set[str] = set()
        self._relations: dict[str, list[tuple[str, str]]] | None = None
        self._members: dict[str, tuple[str, ...]] = {}

    def fork(self) -> WorldView:
        """Returns a view of the same snapshot, with objects of its own."""
        self._relation_index()
        view = copy.copy(self)
        view.objects, view._members = dict(self.objects), dict(self._members)
        view.stand_ins, view.to_create = set(self.stand_ins), set(self.to_create)
        return view

    def _skill_parts(self) -> set[str]:
        """Returns the ids of skills, parameters and conditions, also of classes that the ontology lacks."""
        found: set[str] = set()
        waiting = [r["dst"] for e in self._all.values() for r in e.getRelations("-1", "skiros:hasSkill", "")]
        relations = ["skiros:hasParam", "skiros:hasPreCondition", "skiros:hasHoldCondition"]
        relations += ["skiros:hasPostCondition", "skiros:hasCondition"]
        while waiting:
            eid = waiting.pop()
            if eid in self._all and eid not in found:
                found.add(eid)
                waiting += [r["dst"] for r in self._all[eid].getRelations("-1", relations, "")]
        return found

    # -- classes and properties --------------------------------------------------------------------------------

    def is_subclass(self, child: str, parent: str) -> bool:
        """Whether a class equals another one or is a subclass of it."""
        return child == parent or self._wm.is_subclass(child, parent)

    def is_subproperty(self, child: str, parent: str) -> bool:
        """Whether a relation or property equals another one or is a subproperty of it."""
        return child == parent or self._wm.is_subproperty(child, parent)

    def classes(self) -> set[str]:
        """Returns the classes of the ontology and the scene."""
        return self._named("Class") | {e.type for e in self._all.values()}

    def relations(self) -> set[str]:
        """Returns the relations of the ontology, the scene and the reasoners."""
        return self._named("ObjectProperty") | set(self._relation_index()) | _computed_relations()

    def properties(self) -> set[str]:
        """Returns the datatype properties of the ontology and the scene."""
        return self._named("DatatypeProperty") | {k for e in self.objects.values() for k in e.available_properties}

    def boolean_properties(self) -> set[str]:
        """Returns the boolean properties of the ontology and the scene."""
        found = {
            key for e in self.objects.values() for key in e.available_properties if isinstance(e.value_of(key), bool)
        }
        return found | set(self._wm.properties_of_range("xsd:boolean"))

    def value_type(self, prop: str) -> type | None:
        """Returns the Python type of a property's values; None if the ontologies declare none."""
        return PYTHON_TYPES.get(self._wm.get_datatype(prop) or "")

    def texts(self) -> set[tuple[str, str]]:
        """Returns the (property, value) pairs of objects with text values."""
        return {
            (prop.key, value)
            for e in self.objects.values()
            for prop in e.properties
            if prop.dataTypeIs(str)
            for value in prop.values
            if value
        }

    def _named(self, kind: str) -> set[str]:
        return {name for name in self._wm.declared_names(f"owl:{kind}") if ":" in name}

    # -- objects -----------------------------------------------------------------------------------------------

    def is_a(self, name: str, cls: str) -> bool:
        """Whether an object is of a class."""
        return self.is_subclass(self.objects[name].type, cls)

    def members(self, cls: str) -> tuple[str, ...]:
        """The objects of a class, in the order of the scene."""
        if cls not in self._members:
            fitting = {t for t in {e.type for e in self.objects.values()} if self.is_subclass(t, cls)}
            self._members[cls] = tuple(name for name, e in self.objects.items() if e.type in fitting)
        return self._members[cls]

    def members_of_all(self, classes: Iterable[str]) -> set[str]:
        """The objects that belong to each of some classes."""
        return set.intersection(*(set(self.members(cls)) for cls in classes))

    def instances(self, label: str) -> list[str]:
        """The objects that bear a label or came from the template of that name."""
        return [
            eid
            for eid, e in self.objects.items()
            if eid == e.id
            and (e.label == label or _template_of(e) == label or e.hasRelation("-1", TEMPLATE_RELATION, label))
        ]

    def template(self, name: str) -> Element | None:
        """The template of that name, or None where the ontology has none."""
        try:
            return self._wm.get_template_element(name)
        except SkirosError:
            return None

    def templates(self) -> set[str]:
        """Returns the names of all templates."""
        return self._template_names

    @cached_property
    def _template_names(self) -> set[str]:
        return self._named("NamedIndividual")

    def quantified(self, cls: str) -> tuple[str, ...]:
        """Returns the objects that a quantifier over a class ranges over: those in the scene or to be created."""
        return tuple(name for name in self.members(cls) if name not in self.stand_ins)

    def add_template(self, name: str, template: Element) -> None:
        """Adds a template as an object that stands for itself."""
        element = Element(template.type, name)
        for prop in template.properties:
            element.setProperty(prop.key, list(prop.values) if prop.values else prop.dataType())
        for relation in template.getRelations("-1"):
            element.addRelation("-1", relation["type"], relation["dst"])
        self.stand_ins.add(name)
        self._add(name, element)

    def add_new(self, name: str, cls: str) -> None:
        """Adds an object that a skill may create."""
        self.to_create.add(name)
        self._add(name, Element(cls))

    def _add(self, name: str, element: Element) -> None:
        self.objects[name] = element
        self._members.clear()
        self._relations = None

    # -- facts -------------------------------------------------------------------------------------------------

    def stated_relations(self) -> list[str]:
        """Returns the relations that the scene states between objects."""
        return list(self._relation_index())

    def pairs(self, relation: str) -> list[tuple[str, str]]:
        """Returns the pairs of objects for which the scene states exactly this relation."""
        return self._relation_index().get(relation, [])

    def _relation_index(self) -> dict[str, list[tuple[str, str]]]:
        if self._relations is None:
            index: dict[str, dict[tuple[str, str], None]] = {}
            for name, element in self.objects.items():
                for r in element.getRelations("-1"):
                    if r["dst"] in self.objects and r["state"] and not r["abstract"]:
                        index.setdefault(r["type"], {})[(name, r["dst"])] = None
            self._relations = {relation: list(pairs) for relation, pairs in index.items()}
        return self._relations

    def removal(self, eid: str, relation: str) -> tuple[str, str, float] | None:
        """Returns what held an object last by a relation or a subproperty, with the author and the time of the removal.

        None if the world model's journal does not have it.
        """
        try:
            entries = self._wm.history(eid, limit=_MAX_ENTRIES)
        except SkirosError:
            return None
        for entry in reversed(entries):
            for found in entry.unrelated:
                if found["dst"] == eid and self.is_subproperty(str(found["type"]), relation):
                    return str(found["src"]), entry.author, entry.stamp
        return None

    def computed(self, relation: str) -> bool:
        """Whether a reasoner of this process computes the relation."""
        return relation in _computed_relations()

    def computed_pairs(self, relation: str, subjects: Iterable[str], objects: Iterable[str]) -> list[tuple[str, str]]:
        """Returns the pairs for which a reasoner computes the relation."""
        others = list(objects)
        return [(s, o) for s in subjects for o in others if s != o and self._check(s, relation, o, abstract=False)]

    def allowed_pairs(
        self, relation: str, subjects: Iterable[str], objects: Iterable[str]
    ) -> Iterator[tuple[str, str]]:
        """Yields the pairs for which the scene or the ontology states the relation, also between their templates."""
        stated = (other for other in self.stated_relations() if self.is_subproperty(other, relation))
        named = {name for other in stated for pair in self.pairs(other) for name in pair} | self._template_names
        groups = self._equivalent(objects, named)
        for ones in self._equivalent(subjects, named):
            for others in groups:
                if self._check(ones[0], relation, others[0], abstract=True):
                    yield from product(ones, others)

    def _equivalent(self, names: Iterable[str], distinct: Collection[str]) -> list[list[str]]:
        """Groups objects for which the world model gives the same answer.

        :param distinct: objects with statements of their own.
        """
        found: dict[tuple[object, ...], list[str]] = {}
        for name in sorted(names):
            found.setdefault((self._signature(name), name if name in distinct else ""), []).append(name)
        return list(found.values())

    def _signature(self, name: str) -> tuple[object, ...]:
        """Returns everything that the world model's answer depends on for an object without own statements."""
        element = self.objects[name]
        outside = ((r["type"], r["dst"]) for r in element.getRelations("-1") if r["dst"] not in self._all)
        return (element.type, _template_of(element), *sorted(outside))

    def _check(self, subject: str, relation: str, obj: str, abstract: bool) -> bool:
        try:
            return bool(self._wm.check_relation(self.objects[subject], relation, self.objects[obj], True, abstract))
        except SkirosError:
            return False  # the element was removed since the snapshot


class WorldViews:
    """Views of the current scene. All that ask before it changes share one reading of it. Thread-safe."""

    def __init__(self, wm: WorldModelPort, running: RunningManagers = no_managers) -> None:
        self._wm = wm
        self._running = running
        self._mutex = threading.Lock()
        self._view: WorldView | None = None
        self._version = -1
        self._named: Collection[str] = ()
        self._managers: Mapping[str, str] = {}

    def current(self) -> WorldView:
        """Returns a view of the current scene, with objects of its own.

        :raises WmException: the world model does not answer.
        """
        with self._mutex:
            version = self._wm.version  # before the scene: a change meanwhile is read again
            known = version == self._version != -1 and self._running(self._named) == self._managers
            if self._view is None or not known:
                self._view, self._version = WorldView(self._wm, self._find), version
            return self._view.fork()

    def _find(self, named: Collection[str]) -> Mapping[str, str]:
        self._named, self._managers = named, self._running(named)
        return self._managers


def _template_of(element: Element) -> str:
    """Returns the name of an element's template; "" if it has none."""
    return full_name(str(element.value_of(TEMPLATE) or ""))


def _computed_relations() -> set[str]:
    return {full_name(str(name)) for reasoner in reasoners.all() for name in relations_of(reasoner)}
