"""An element: an individual of the ontology, in the scene or to be added to it."""

from __future__ import annotations

import builtins
import logging
from collections.abc import Sequence
from datetime import datetime
from typing import Any, Protocol

from skiros2_common.core.element_content import (
    ElementChanges,
    ElementContent,
    RelationDict,
    relation_dict,
    relation_key,
    selected,
)
from skiros2_common.core.errors import UnknownName, WrongValue
from skiros2_common.core.names import ClassHierarchy, full_name, id_number, is_of_class, spellings
from skiros2_common.core.property import DATATYPES, Property, converted_property, same_value
from skiros2_common.core.reasoner_registry import Owner, ReasonerRegistry
from skiros2_common.core.revision import local_revision

log = logging.getLogger(__name__)

__all__ = ["REASONER_PROPERTY", "Element", "ElementChanges", "Reasoner", "RelationDict", "reasoners", "set_reasoners"]

#: The property of an element that names its reasoners.
REASONER_PROPERTY = "skiros:DiscreteReasoner"


class Element(ElementContent):
    """An individual: a class, a label, an id, typed properties and relations.

    An element without an id is abstract: in a parameter it stands for "some element of this type". An element read
    from a world model shares its content with the world model and copies it on write; `changes()` lists the changes.
    Not thread-safe.
    """

    # -- identity ----------------------------------------------------------------------------------------------

    @property
    def id(self) -> str:
        """`<type>-<number>`; "" for an abstract element."""
        return self._id

    @property
    def type(self) -> str:
        """The class, `prefix:Name`."""
        return self._type

    @type.setter
    def type(self, etype: str) -> None:
        self._type = etype
        local_revision.advance()

    @property
    def label(self) -> str:
        """The element's template, or a free name."""
        return self._label

    @label.setter
    def label(self, label: str) -> None:
        self._label = label
        local_revision.advance()

    def isAbstract(self) -> bool:
        """Whether the element has no id."""
        return not self._id

    def getIdNumber(self) -> int:
        """The number in the id; -1 without one."""
        return id_number(self._id)

    def setUri(self, eid: int) -> None:
        """Sets the id to `<type>-<eid>`."""
        self._id = f"{self._type}-{eid}"

    def getLastUpdate(self) -> datetime:
        """The time of the last change in the world model; 1970 if unknown."""
        return datetime.fromtimestamp(self.last_update)

    def __repr__(self) -> str:
        return f"{self._id or self._type}-{self._label}"

    def printState(self, verbose: bool = False, filter: str = "") -> str:
        """The element as text; with `verbose`, a line for each property (`filter`: only this key) and relation."""
        if not verbose:
            return repr(self)
        lines = [p.printState() for key, p in self._props.items() if filter in ("", key)]
        return "\n".join([repr(self), *lines, *map(str, self._rels)])

    # -- properties --------------------------------------------------------------------------------------------

    @property
    def available_properties(self) -> list[str]:
        """The keys of all properties, as written."""
        return list(self._props)

    @property
    def properties(self) -> list[Property]:
        """All properties."""
        return list(self._properties.values())

    def hasProperty(self, key: str, value: Any = None, not_none: bool = False) -> bool:
        """Whether the property exists; with `value`, whether it has this value; with `not_none`, whether it has any."""
        prop = self._find(key)
        if prop is None:
            return False
        if value is not None:
            return any(same_value(v, value) for v in prop.values)
        return not not_none or prop.value is not None

    def getProperty(self, key: str) -> Property:
        """The property.

        :raises UnknownName: the element has no such property.
        """
        known = self._key_of(key)
        if known is None:
            raise UnknownName(f"{self!r} has no property {key}; it has: {', '.join(sorted(self._props)) or 'none'}")
        return self._own(known)

    def value_of(self, key: str) -> Any:
        """The first value of a property; None if the property is missing or has no value."""
        prop = self._find(key)
        return prop.value if prop is not None else None

    def setProperty(self, key: str, value: Any, datatype: str | None = None, force_convertion: bool = False) -> None:
        """Sets a property to a value or a list of values. The key is stored as written.

        A value of another type than the property's is rejected with a logged error. When `skiros:DiscreteReasoner` is
        set, added reasoners add their properties and removed ones remove theirs.

        :param value: a Python type creates a property without a value; None unsets an existing one.
        :param datatype: an XSD datatype, such as `xsd:float`, of a new property, which replaces the old one.
        :param force_convertion: whether to convert each value to the property's type.
        :raises WrongValue: `force_convertion` is set and a value cannot be converted.
        """
        if full_name(key) == REASONER_PROPERTY and not isinstance(value, type):
            set_reasoners(self, [] if value is None else value if isinstance(value, list) else [value])
            return
        known = self._find(key)
        key = self._key_of(key) or key
        if datatype is not None and datatype not in DATATYPES:
            log.warning("%s: unknown datatype %s; known: %s", key, datatype, ", ".join(DATATYPES))
            known = datatype = None
        if datatype is not None:
            self._put_converted(key, value, DATATYPES[datatype], force_convertion)
        elif known is None:
            self.put(key, Property(key, value))
        elif isinstance(value, type):
            return
        elif force_convertion and value is not None:
            self._put_converted(key, value, known.dataType(), True)
        elif value is None:
            self.getProperty(key).unset()
        else:
            self.getProperty(key).setValues(value)

    def _put_converted(self, key: str, value: Any, datatype: builtins.type, strict: bool) -> None:
        try:
            prop = converted_property(key, value, datatype)
        except WrongValue as error:
            if strict:
                raise
            log.error("%s. The property has no value.", error)
            prop = Property(key, datatype)
        self.put(key, prop)

    def appendProperty(self, key: str, value: Any) -> None:
        """Appends a value to a property; creates the property if missing."""
        if self._find(key) is not None:
            self.getProperty(key).addValue(value)
        else:
            self.put(key, Property(key, value))

    def removeProperty(self, key: str) -> None:
        """Removes a property, if it exists; with `skiros:DiscreteReasoner`, also the properties of its reasoners."""
        if self._find(key) is None:
            return
        if full_name(key) == REASONER_PROPERTY:
            set_reasoners(self, [])
        self._own_dict()
        for name in spellings(key):
            self._props.pop(name, None)
        local_revision.advance()

    # -- relations ---------------------------------------------------------------------------------------------

    @property
    def local_relations(self) -> list[tuple[str, str, Element]]:
        """(subject, relation, object) with elements to be written together with this one; "-1" is this element."""
        return [(r["src"], r["type"], r["dst"]) for r in self._local_relations]

    def addRelation(self, subj: str, predicate: str, obj: Any, value: bool = True, abstract: bool = False) -> None:
        """Adds a relation between ids, unless it exists; "-1" is this element.

        :param obj: an id, or an `Element` to write later as a child of this one (`subj` is then ignored).
        :raises WrongValue: a subject or object is neither an id nor an element.
        """
        if isinstance(obj, Element):
            self._local_relations.append({"src": "-1", "type": predicate, "dst": obj})
            local_revision.advance()
            return
        if not isinstance(subj, str) or not isinstance(obj, str):
            raise WrongValue(f"{self!r}: {predicate} relates ids, got {subj!r} and {obj!r}")
        relation = relation_dict(subj, predicate, obj, value, abstract)
        key = relation_key(relation)
        if not any(r["dst"] == obj and relation_key(r) == key for r in self._rels):
            self._own_relations().append(relation)

    def setRelation(self, subj: str, predicate: str, obj: Any) -> None:
        """Adds a relation; it replaces those of the same predicate with the same side "-1" (all, without a "-1")."""
        source, target = ("-1" if side == "-1" else "" for side in (subj, obj))
        self.removeRelations(selected(self._rels, source, predicate, target))
        self.addRelation(subj, predicate, obj)

    def getRelations(self, subj: str = "", pred: str | Sequence[str] = [], obj: str = "") -> list[RelationDict]:
        """The relations with that subject, predicate (one or several) and object; an empty one matches any.

        The dicts belong to the element: changes in place change the element.
        """
        found = selected(self._rels, subj, pred, obj)
        if found and not self._owns_relations:
            found = selected(self._own_relations(), subj, pred, obj)
        elif found:
            local_revision.advance()
        return found

    def getRelation(self, subj: str = "", pred: str | Sequence[str] = [], obj: str = "") -> RelationDict | None:
        """The first relation of `getRelations`, or None."""
        found = self.getRelations(subj, pred, obj)
        return found[0] if found else None

    def hasRelation(self, subj: str, predicate: str, obj: str, value: bool = True, abstract: bool = False) -> bool:
        """Whether exactly this relation exists; "-1" or "" as subject, otherwise as object, is this element."""
        subjects, objects, own_ids = {subj}, {obj}, {"-1", self._id or "-1"}
        if subj in ("-1", ""):
            subjects |= own_ids
        elif obj in ("-1", ""):
            objects |= own_ids
        wanted = {(s, full_name(predicate), o, bool(value), bool(abstract)) for s in subjects for o in objects}
        return any(relation_key(r) in wanted for r in self._rels)

    def removeRelations(self, relations: Sequence[RelationDict]) -> None:
        """Removes those of the relations that exist."""
        removed = {relation_key(r) for r in relations}
        if any(relation_key(r) in removed for r in self._rels):
            own = self._own_relations()
            own[:] = [r for r in own if relation_key(r) not in removed]

    def removeRelation(self, relation: RelationDict) -> None:
        """Removes a relation, if it exists."""
        self.removeRelations([relation])

    def removeRelation2(self, subj: str, predicate: str, obj: str, value: bool = True, abstract: bool = False) -> None:
        """Removes exactly this relation; a missing one is logged."""
        wanted = relation_dict(subj, predicate, obj, value, abstract)
        if not any(relation_key(r) == relation_key(wanted) for r in self._rels):
            log.warning("%r has no relation %s %s %s to remove", self, subj, predicate, obj)
        self.removeRelations([wanted])

    # -- data of reasoners -------------------------------------------------------------------------------------

    def _getReasoner(self, get_code: str) -> Reasoner:
        return reasoners.get(get_code)

    def getAssociatedReasonerId(self, key: str) -> str:
        """The name of the reasoner that owns a property; "" if none does."""
        return reasoners.owner_of_data(key)

    def setReasoner(self, name: str) -> None:
        """Adds a reasoner and its properties to this element.

        :raises UnknownName: unknown reasoner.
        """
        reasoners.get(name).addProperties(self)

    def unsetReasoner(self, name: str) -> None:
        """Removes a reasoner and its properties from this element.

        :raises UnknownName: unknown reasoner.
        """
        reasoners.get(name).removeProperties(self)

    def hasData(self, get_code: str) -> bool:
        """Whether the element has all data of a reasoner's code.

        :raises UnknownName: no reasoner has the code.
        """
        return self._getReasoner(get_code).hasData(self, get_code)

    def getData(self, get_code: str) -> Any:
        """The data of a reasoner's code, such as `:Position`.

        :raises UnknownName: no reasoner has the code.
        """
        return self._getReasoner(get_code).getData(self, get_code)

    def setData(self, set_code: str, data: Any) -> Any:
        """Writes the data of a reasoner's code and adds the reasoner's properties.

        :returns: the result of the reasoner's `setData`.
        :raises UnknownName: no reasoner has the code.
        """
        reasoner = self._getReasoner(set_code)
        reasoner.addProperties(self)
        return reasoner.setData(self, data, set_code)

    # -- comparison --------------------------------------------------------------------------------------------

    def isInstance(self, abstract: Element, wmi: ClassHierarchy | None) -> bool:
        """Whether this element matches the description `abstract`.

        It matches if its class is the same or a subclass, its label is equal (unless `abstract` has none), and it has
        all property values and relations of `abstract`.

        :param wmi: the world model, queried for subclasses.
        """
        if not is_of_class(self._type, abstract.type, wmi):
            return False
        if abstract.label not in ("", "Unknown", self._label):
            return False
        for key, prop in abstract._props.items():
            if not all(self.hasProperty(key, v) for v in prop.values if v not in ("", None)):
                return False
        return all(self.hasRelation(*relation_key(r)) for r in abstract._rels)


class Reasoner(Owner, Protocol):
    """A reasoner as elements and clients of the world model see it; see `DiscreteReasoner`."""

    def addProperties(self, element: Element) -> None: ...
    def removeProperties(self, element: Element) -> None: ...
    def hasData(self, element: Element, get_code: str) -> bool: ...
    def getData(self, element: Element, get_code: str) -> Any: ...
    def setData(self, element: Element, data: Any, set_code: str) -> Any: ...
    def computeRelations(self, sub: Element, obj: Element, with_metrics: bool = False) -> list[Any]: ...


#: The reasoners of this process, filled by world-model interfaces and servers from their plugin packages.
reasoners: ReasonerRegistry[Reasoner] = ReasonerRegistry()


def set_reasoners(element: Element, names: Sequence[str]) -> None:
    """Sets the reasoners of an element: added ones add their properties, removed ones remove theirs."""
    before = list(element.getProperty(REASONER_PROPERTY).values) if element.hasProperty(REASONER_PROPERTY) else []
    for name in dict.fromkeys([*before, *names]):
        if (name in before) == (name in names):
            continue
        try:
            reasoner = reasoners.get(name)
        except UnknownName as error:
            log.error("%r: %s", element, error)
            continue
        if name in names:
            reasoner.addProperties(element)
        else:
            reasoner.removeProperties(element)
    if not element.hasProperty(REASONER_PROPERTY):
        element.appendProperty(REASONER_PROPERTY, str)  # without a name yet
    element.getProperty(REASONER_PROPERTY).setValues(list(names))
