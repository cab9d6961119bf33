"""The world model as planning sees it: one look at the scene, and what the ontology says of it."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator
from functools import cached_property
from itertools import product

from skiros2_common.core.discrete_reasoner import reasoners, relations_of
from skiros2_common.core.errors import SkirosError
from skiros2_common.core.names import full_name
from skiros2_common.core.world_element import Element
from skiros2_task.core.skill_model import Robot, read_robots
from skiros2_world_model.core.world_model_abstract_interface import WorldModelPort

#: Where an element came from.
TEMPLATE = "skiros:Template"
TEMPLATE_RELATION = "skiros:hasTemplate"

#: The context that holds the ontologies alone.
_ONTOLOGY = "ontology"

#: What no goal and no parameter means, though it stands in the scene.
_NOT_OBJECTS = ("skiros:Skill", "skiros:Parameter", "skiros:Condition")


class WorldView:
    """The scene as it was when this was made. Later changes are not seen; templates are read when asked for."""

    def __init__(self, wm: WorldModelPort, managers: Collection[str] = ()) -> None:
        """Reads the whole scene.

        :param managers: the node names of the skill managers that run.
        :raises WmException: the world model does not answer.
        """
        self._wm = wm
        self._all: dict[str, Element] = {e.id: e for e in wm.resolve_elements(Element())}
        self.robots: tuple[Robot, ...] = read_robots(self._all, managers)
        skill_parts = self._skill_parts()
        #: The elements that goals and parameters may mean, by id; a template that stands for itself by its name.
        self.objects: dict[str, Element] = {
            eid: e
            for eid, e in self._all.items()
            if eid not in skill_parts and not any(self.is_subclass(e.type, cls) for cls in _NOT_OBJECTS)
        }
        #: The objects that are not in the scene: templates that stand for themselves, and what skills may make.
        self.stand_ins: set[str] = set()
        self.to_be_made: set[str] = set()
        self._relations: dict[str, list[tuple[str, str]]] | None = None
        self._members: dict[str, tuple[str, ...]] = {}

    def _skill_parts(self) -> set[str]:
        """The ids of skills, parameters and conditions, also where the ontology does not know their classes."""
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
        """Whether a class is another one or under it."""
        return child == parent or self._wm.is_subclass(child, parent)

    def is_subproperty(self, child: str, parent: str) -> bool:
        """Whether a relation or property is another one or under it."""
        return child == parent or self._wm.is_subproperty(child, parent)

    def classes(self) -> set[str]:
        """All classes that the ontology or the scene names."""
        return self._named("Class") | {e.type for e in self._all.values()}

    def relations(self) -> set[str]:
        """All relations that the ontology or the scene names, or that a reasoner computes."""
        return self._named("ObjectProperty") | set(self._relation_index()) | _computed_relations()

    def properties(self) -> set[str]:
        """All properties with values that the ontology or the scene names."""
        return self._named("DatatypeProperty") | {k for e in self.objects.values() for k in e.available_properties}

    def truth_properties(self) -> set[str]:
        """The properties whose values are true or false, as the ontology or the scene has them."""
        found = {
            key for e in self.objects.values() for key in e.available_properties if isinstance(e.value_of(key), bool)
        }
        rows = self._wm.query_ontology(
            "SELECT ?x WHERE { ?x <http://www.w3.org/2000/01/rdf-schema#range> "
            "<http://www.w3.org/2001/XMLSchema#boolean> }",
            context=_ONTOLOGY,
        )
        return found | set(rows)

    def texts(self) -> set[tuple[str, str]]:
        """The properties of objects that hold texts, each with such a text."""
        return {
            (prop.key, value)
            for e in self.objects.values()
            for prop in e.properties
            if prop.dataTypeIs(str)
            for value in prop.values
            if value
        }

    def _named(self, kind: str) -> set[str]:
        rows = self._wm.query_ontology(
            f"SELECT ?x WHERE {{ ?x <http://www.w3.org/1999/02/22-rdf-syntax-ns#type> "
            f"<http://www.w3.org/2002/07/owl#{kind}> }}",
            context=_ONTOLOGY,
        )
        return {name for name in rows if ":" in name and not name.startswith("_:")}

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
        """The names of all templates."""
        return self._template_names

    @cached_property
    def _template_names(self) -> set[str]:
        return self._named("NamedIndividual")

    def quantified(self, cls: str) -> tuple[str, ...]:
        """The objects that a goal's quantifier over a class means: those in the scene, or that may come there."""
        return tuple(name for name in self.members(cls) if name not in self.stand_ins)

    def add_template(self, name: str, template: Element) -> None:
        """Makes a template an object that stands for itself under its name."""
        element = Element(template.type, name)
        for prop in template.properties:
            element.setProperty(prop.key, list(prop.values) if prop.values else prop.dataType())
        for relation in template.getRelations("-1"):
            element.addRelation("-1", relation["type"], relation["dst"])
        self.stand_ins.add(name)
        self._add(name, element)

    def add_new(self, name: str, cls: str) -> None:
        """Makes something that a skill may make an object."""
        self.to_be_made.add(name)
        self._add(name, Element(cls))

    def _add(self, name: str, element: Element) -> None:
        self.objects[name] = element
        self._members.clear()
        self._relations = None

    # -- facts -------------------------------------------------------------------------------------------------

    def written_relations(self) -> list[str]:
        """The relations that are written between objects."""
        return list(self._relation_index())

    def pairs(self, relation: str) -> list[tuple[str, str]]:
        """The objects between which exactly that relation is written."""
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

    def computed(self, relation: str) -> bool:
        """Whether a reasoner of this process computes the relation."""
        return relation in _computed_relations()

    def computed_pairs(self, relation: str, subjects: Iterable[str], objects: Iterable[str]) -> list[tuple[str, str]]:
        """The pairs between which a reasoner finds the relation."""
        there = list(objects)
        return [(s, o) for s in subjects for o in there if s != o and self._check(s, relation, o, abstract=False)]

    def allowed_pairs(
        self, relation: str, subjects: Iterable[str], objects: Iterable[str]
    ) -> Iterator[tuple[str, str]]:
        """The pairs between which, or between whose templates, the relation is stated anywhere."""
        written = (other for other in self.written_relations() if self.is_subproperty(other, relation))
        named = {name for other in written for pair in self.pairs(other) for name in pair} | self._template_names
        others = self._sorts(objects, named)
        for ones in self._sorts(subjects, named):
            for others_alike in others:
                if self._check(ones[0], relation, others_alike[0], abstract=True):
                    yield from product(ones, others_alike)

    def _sorts(self, names: Iterable[str], apart: Collection[str]) -> list[list[str]]:
        """Some objects, together those of which the same is stated.

        :param apart: objects of which something is stated by their own name.
        """
        found: dict[tuple[object, ...], list[str]] = {}
        for name in sorted(names):
            found.setdefault((self._sort(name), name if name in apart else ""), []).append(name)
        return list(found.values())

    def _sort(self, name: str) -> tuple[object, ...]:
        """All that the answer of the world model depends on, where nothing in the scene names the object."""
        element = self.objects[name]
        outside = ((r["type"], r["dst"]) for r in element.getRelations("-1") if r["dst"] not in self._all)
        return (element.type, _template_of(element), *sorted(outside))

    def _check(self, subject: str, relation: str, obj: str, abstract: bool) -> bool:
        try:
            return bool(self._wm.check_relation(self.objects[subject], relation, self.objects[obj], True, abstract))
        except SkirosError:
            return False  # the world has changed since: the element is gone


def _template_of(element: Element) -> str:
    """The name of the template that an element came from; "" where it does not say."""
    return full_name(str(element.value_of(TEMPLATE) or ""))


def _computed_relations() -> set[str]:
    return {full_name(str(name)) for reasoner in reasoners.all() for name in relations_of(reasoner)}
