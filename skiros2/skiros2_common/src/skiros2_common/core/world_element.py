"""An element: an individual of the ontology, in the scene or about to be."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from typing import Any, NamedTuple

from skiros2_common.core.datatypes import DATATYPES, converted
from skiros2_common.core.discrete_reasoner import DiscreteReasoner, reasoners
from skiros2_common.core.element_changes import ElementChanges, RelationDict
from skiros2_common.core.errors import UnknownName
from skiros2_common.core.mutations import mutations
from skiros2_common.core.names import full_name, id_number
from skiros2_common.core.property import Property, same_value

log = logging.getLogger(__name__)

__all__ = ["REASONER_PROPERTY", "Element", "ElementChanges", "RelationDict"]

REASONER_PROPERTY = "skiros:DiscreteReasoner"


class _Origin(NamedTuple):
    """What a world model gave out: shared with it, never changed here."""

    type: str
    label: str
    properties: dict[str, Property]
    relations: Sequence[RelationDict]


class Element:
    """An individual: a class, a label, an id, typed properties and relations.

    Without an id the element is abstract: in a parameter it stands for "some element of this type". An element
    that a world model gave out shares its content with the world model until something is changed; `changes()`
    tells what was. Elements are not locked: one thread at a time.
    """

    def __init__(self, etype: str = "Unknown", elabel: str = "", eid: str = "") -> None:
        self._type = etype
        self._label = elabel
        self._id = eid
        self._props: dict[str, Property] = {}
        self._rels: Sequence[RelationDict] = []
        self._local: list[tuple[Any, str, Any]] = []
        self._origin: _Origin | None = None
        self._own_keys: set[str] | None = None  # None: all properties are our own
        self._owns_relations = True
        self._version = -1
        self._last_update = 0.0

    # -- how world models give elements out and see what was changed ------------------------------------------

    @classmethod
    def shared(
        cls,
        etype: str,
        label: str,
        eid: str,
        properties: dict[str, Property],
        relations: Sequence[RelationDict],
        version: int = 0,
    ) -> Element:
        """An element over content that belongs to the caller and is copied only when it is changed here.

        :param properties: by key; neither the dict nor its properties are ever changed through the element.
        :param relations: relation dicts, likewise.
        :param version: the world model's version of the element.
        """
        element = cls.__new__(cls)  # in the place of __init__, since each read makes one
        element._type = etype
        element._label = label
        element._id = eid
        element._props = properties
        element._rels = relations
        element._local = []
        element._origin = _Origin(etype, label, properties, relations)
        element._own_keys = set()
        element._owns_relations = False
        element._version = version
        element._last_update = 0.0
        return element

    @property
    def version(self) -> int:
        """The world model's version of the element when it was read; -1 when it was not read from one."""
        return self._version

    @property
    def touched(self) -> bool:
        """Whether something may have been changed since a world model gave it out. Fast; `changes` is exact."""
        return (
            self._own_keys is None
            or bool(self._own_keys)
            or self._owns_relations
            or bool(self._local)
            or (self._origin is not None and self._props is not self._origin.properties)
            or (self._origin is not None and (self._label != self._origin.label or self._type != self._origin.type))
        )

    def changes(self) -> ElementChanges | None:
        """What was changed since a world model gave the element out; None when none did."""
        origin = self._origin
        if origin is None:
            return None
        changes = ElementChanges(
            label=self._label if self._label != origin.label else None,
            type=self._type if self._type != origin.type else None,
        )
        if self._props is not origin.properties:
            for key, prop in self._props.items():
                before = origin.properties.get(key)
                if before is prop:
                    continue
                if before is None or before.values != prop.values or before.dataType() is not prop.dataType():
                    changes.properties[key] = prop
            changes.removed_properties = [key for key in origin.properties if key not in self._props]
        if self._owns_relations:
            changes.added_relations = [r for r in self._rels if r not in origin.relations]
            changes.removed_relations = [r for r in origin.relations if r not in self._rels]
        return changes

    def adopt(self, fresh: Element, keep_children: bool = False) -> None:
        """Takes over id, content and version of `fresh`. World models call it when they have written the element.

        :param keep_children: the elements kept aside were not written and stay aside.
        """
        local = self._local if keep_children else []
        self.__dict__.update(fresh.view().__dict__)
        self._last_update = fresh._last_update
        self._local = local

    def view(self) -> Element:
        """An element over this one's content, copied only when it is changed there; `changes` counts from now."""
        return Element.shared(self._type, self._label, self._id, self._props, self._rels, self._version)

    def copy(self) -> Element:
        """A copy that shares nothing that can be changed."""
        copy = Element(self._type, self._label, self._id)
        copy._props = {key: prop.clone() for key, prop in self._props.items()}
        copy._rels = [dict(r) for r in self._rels]
        copy._local = list(self._local)
        copy._origin = self._origin
        copy._version = self._version
        copy._last_update = self._last_update
        return copy

    # -- identity ----------------------------------------------------------------------------------------------

    @property
    def id(self) -> str:
        """`<type>-<number>`, or "" for an abstract element."""
        return self._id

    @property
    def type(self) -> str:
        """The class, `prefix:Name`."""
        return self._type

    @type.setter
    def type(self, etype: str) -> None:
        self._type = etype
        mutations.note()

    @property
    def label(self) -> str:
        """The template that the element came from, or a free name."""
        return self._label

    @label.setter
    def label(self, label: str) -> None:
        self._label = label
        mutations.note()

    def isAbstract(self) -> bool:
        """Whether the element has no id."""
        return not self._id

    def getIdNumber(self) -> int:
        """The number in the id, or -1."""
        return id_number(self._id)

    def setUri(self, eid: int) -> None:
        """Gives the element the id `<type>-<eid>`."""
        self._id = f"{self._type}-{eid}"

    def getLastUpdate(self) -> float:
        """When the content was last changed in the world model (s since the epoch; 0.0: not known)."""
        return self._last_update

    def __repr__(self) -> str:
        return f"{self._id or self._type}-{self._label}"

    def printState(self, verbose: bool = False, filter: str = "") -> str:
        """The element as text; with `verbose` its properties and relations, those whose name contains `filter`."""
        if not verbose:
            return repr(self)
        lines = [repr(self), "Properties:"]
        lines += [f"  {p.printState()}" for p in self._props.values() if filter in p.key]
        lines.append("Relations:")
        lines += [f"  {r['src']} {r['type']} {r['dst']}" for r in self._rels if filter in r["type"]]
        return "\n".join(lines)

    # -- properties --------------------------------------------------------------------------------------------

    @property
    def available_properties(self) -> list[str]:
        """The keys of all properties."""
        return list(self._props)

    @property
    def properties(self) -> list[Property]:
        """All properties."""
        return list(self._properties.values())

    @property
    def _properties(self) -> dict[str, Property]:
        # Read by libraries in the field; they may change what they get, so all of it becomes our own.
        for key in list(self._props):
            self._own(key)
        self._own_keys = None
        return self._props

    def hasProperty(self, key: str, value: Any = None, not_none: bool = False) -> bool:
        """Whether the property is there; with `value`, whether it has that one; with `not_none`, whether it has one."""
        prop = self._props.get(full_name(key))
        if prop is None:
            return False
        if value is not None:
            return any(same_value(v, value) for v in prop.values)
        return not not_none or prop.isSpecified()

    def getProperty(self, key: str) -> Property:
        """The property.

        :raises UnknownName: the element has none of that key.
        """
        key = full_name(key)
        if key not in self._props:
            known = ", ".join(sorted(self._props)) or "none"
            raise UnknownName(f"{self!r} has no property {key}; it has: {known}")
        return self._own(key)

    def value_of(self, key: str) -> Any:
        """The first value of a property, or None when it, or a value, is missing."""
        prop = self._props.get(full_name(key))
        return prop.value if prop is not None else None

    def setProperty(self, key: str, value: Any, datatype: str | None = None, force_convertion: bool = False) -> None:
        """Sets a property to a value or a list of values, or, given a Python type, to none of that type.

        :param datatype: an XSD datatype, such as `xsd:float`: the property gets that type, the value is converted.
        :param force_convertion: the value is converted to the type that the property has.
        :raises UnknownName: the datatype is not known.
        :raises WrongValue: the value cannot be converted.

        A value of another type than the property's is refused with a logged error.
        """
        key = full_name(key)
        if datatype is not None:
            if datatype not in DATATYPES:
                raise UnknownName(f"{key}: unknown datatype {datatype!r}; known: {', '.join(DATATYPES)}")
            self._put(key, converted(key, value, DATATYPES[datatype]))
        elif key not in self._props or isinstance(value, type):
            self._put(key, Property(key, value))
        elif force_convertion:
            self._put(key, converted(key, value, self._props[key].dataType()))
        else:
            self._own(key).setValues(value)

    def appendProperty(self, key: str, value: Any) -> None:
        """Adds a value to a property, which is made when missing."""
        key = full_name(key)
        if key in self._props:
            self._own(key).addValue(value)
        else:
            self._put(key, Property(key, value))

    def removeProperty(self, key: str) -> None:
        """Removes a property, if it is there."""
        key = full_name(key)
        if key in self._props:
            self._own_dict()
            del self._props[key]
            mutations.note()

    # -- relations ---------------------------------------------------------------------------------------------

    @property
    def _relations(self) -> list[RelationDict]:
        # Read, and in the field changed, by libraries.
        return self._own_relations()

    @property
    def local_relations(self) -> list[tuple[Any, str, Any]]:
        """(subject, relation, object) with elements kept aside, to be written when this one is; "-1" is this one."""
        return list(self._local)

    def clear_local_relations(self) -> None:
        """Forgets the elements kept aside; called when they have been written."""
        self._local = []

    def addRelation(self, subj: Any, predicate: str, obj: Any, value: bool = True, abstract: bool = False) -> None:
        """Adds a relation between ids ("-1" is this element); an `Element` is kept aside and written as a child."""
        predicate = full_name(predicate)
        if isinstance(obj, Element) or isinstance(subj, Element):
            self._local.append((subj, predicate, obj))
            mutations.note()
        elif not self.hasRelation(subj, predicate, obj, value, abstract):
            self._own_relations().append(
                {"src": subj, "type": predicate, "dst": obj, "state": value, "abstract": abstract}
            )

    def setRelation(self, subj: Any, predicate: str, obj: Any) -> None:
        """Adds a relation in the place of those that this element has along the predicate, in that direction."""
        if subj == "-1":
            self.removeRelations(self.getRelations("-1", predicate, ""))
        else:
            self.removeRelations(self.getRelations("", predicate, "-1"))
        self.addRelation(subj, predicate, obj)

    def getRelations(self, subj: str = "", pred: str | Sequence[str] = [], obj: str = "") -> list[RelationDict]:
        """The relations with that subject, predicate (one or several) and object; an empty one matches any."""
        names = {full_name(p) for p in ([pred] if isinstance(pred, str) else pred) if p}
        return [
            dict(r)
            for r in self._rels
            if (not subj or r["src"] == subj) and (not names or r["type"] in names) and (not obj or r["dst"] == obj)
        ]

    def getRelation(self, subj: str = "", pred: str | Sequence[str] = [], obj: str = "") -> RelationDict | None:
        """The first of `getRelations`, or None."""
        found = self.getRelations(subj, pred, obj)
        return found[0] if found else None

    def hasRelation(self, subj: str, predicate: str, obj: str, value: bool = True, abstract: bool = False) -> bool:
        """Whether there is such a relation; an empty side or predicate matches any."""
        return any(r["state"] == value and r["abstract"] == abstract for r in self.getRelations(subj, predicate, obj))

    def removeRelations(self, relations: Sequence[RelationDict]) -> None:
        """Removes those relations that are there."""
        if any(r in self._rels for r in relations):
            self._rels = [r for r in self._own_relations() if r not in relations]

    def removeRelation(self, relation: RelationDict) -> None:
        """Removes a relation, if it is there."""
        self.removeRelations([relation])

    def removeRelation2(self, subj: str, predicate: str, obj: str, value: bool = True, abstract: bool = False) -> None:
        """Removes the relations with these parts; an empty side or predicate matches any."""
        self.removeRelations(
            [r for r in self.getRelations(subj, predicate, obj) if r["state"] == value and r["abstract"] == abstract]
        )

    # -- data of reasoners -------------------------------------------------------------------------------------

    def _getReasoner(self, get_code: str) -> DiscreteReasoner:
        return reasoners.get(get_code)

    def getAssociatedReasonerId(self, key: str) -> str:
        """The name of the reasoner that owns a property or code, "" when none does."""
        found = reasoners.find(key)
        return found.__class__.__name__ if found is not None else ""

    def setReasoner(self, name: str) -> None:
        """Makes a reasoner one of this element's."""
        if not self.hasProperty(REASONER_PROPERTY, name):
            self.appendProperty(REASONER_PROPERTY, name)

    def unsetReasoner(self, name: str) -> None:
        """Takes a reasoner away from this element's."""
        if self.hasProperty(REASONER_PROPERTY, name):
            prop = self.getProperty(REASONER_PROPERTY)
            prop.removeValue(name)
            if not prop.isSpecified():
                self.removeProperty(REASONER_PROPERTY)

    def hasData(self, get_code: str) -> bool:
        """Whether all data behind a reasoner's code are there.

        :raises UnknownName: no reasoner has the code.
        """
        return self._getReasoner(get_code).hasData(self, get_code)

    def getData(self, get_code: str) -> Any:
        """The data behind a reasoner's code, such as `:Position`.

        :raises UnknownName: no reasoner has the code.
        """
        return self._getReasoner(get_code).getData(self, get_code)

    def setData(self, set_code: str, data: Any) -> None:
        """Writes the data behind a reasoner's code; the element gains that reasoner's properties.

        :raises UnknownName: no reasoner has the code.
        """
        reasoner = self._getReasoner(set_code)
        if not self.hasProperty(REASONER_PROPERTY, reasoner.__class__.__name__):
            reasoner.addProperties(self)
        reasoner.setData(self, data, set_code)

    # -- comparison --------------------------------------------------------------------------------------------

    def isInstance(self, abstract: Element, wmi: Any) -> bool:
        """Whether this element is one that `abstract` describes.

        Its class is the same or under it, its label is equal where the abstract one has one, and it has all its
        property values and all its relations.
        """
        if self._type != abstract.type and not wmi.is_subclass(self._type, abstract.type):
            return False
        if abstract.label and abstract.label != self._label:
            return False
        for key, prop in abstract._props.items():
            if not all(self.hasProperty(key, v) for v in prop.values if v not in ("", None)):
                return False
        return all(self.hasRelation(r["src"], r["type"], r["dst"], r["state"], r["abstract"]) for r in abstract._rels)

    # -- copy on write -----------------------------------------------------------------------------------------

    def _own_dict(self) -> dict[str, Property]:
        if self._origin is not None and self._props is self._origin.properties:
            self._props = dict(self._props)
        return self._props

    def _own(self, key: str) -> Property:
        if self._own_keys is not None and key not in self._own_keys:
            self._own_dict()[key] = self._props[key].clone()
            self._own_keys.add(key)
        return self._props[key]

    def _put(self, key: str, prop: Property) -> None:
        self._own_dict()[key] = prop
        mutations.note()
        if self._own_keys is not None:
            self._own_keys.add(key)

    def _own_relations(self) -> list[RelationDict]:
        if not self._owns_relations:
            self._rels = [dict(r) for r in self._rels]
            self._owns_relations = True
        mutations.note()
        assert isinstance(self._rels, list)
        return self._rels
