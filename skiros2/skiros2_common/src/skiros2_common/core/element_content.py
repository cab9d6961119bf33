"""The content of an element: shared with the world model, copied on write.

Names of relations are kept as written and compared by their full form.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple, NotRequired, Self, TypedDict

from skiros2_common.core.names import full_name, spellings
from skiros2_common.core.property import Property
from skiros2_common.core.revision import local_revision


class RelationDict(TypedDict):
    """A relation in the contract's form. The side "-1" is the element that has it.

    :ivar state: False: the relation does not hold; missing: True.
    :ivar abstract: between the templates of elements; missing: False.
    """

    src: str
    type: str
    dst: str
    state: NotRequired[bool]
    abstract: NotRequired[bool]


class LocalRelation(TypedDict):
    """A relation to an element that is written together with the one that has it."""

    src: str
    type: str
    dst: Any  # an `Element`


def relation_dict(src: str, pred: str, dst: str, state: bool = True, abstract: bool = False) -> RelationDict:
    """A relation as a dict, in the format of SkiROS2."""
    return {"src": src, "type": pred, "dst": dst, "state": state, "abstract": abstract}


def relation_key(relation: RelationDict) -> tuple[Any, ...]:
    """A key that is equal for equal relations, in any spelling and with or without the optional parts."""
    return (
        relation["src"],
        full_name(relation["type"]),
        relation["dst"],
        bool(relation.get("state", True)),
        bool(relation.get("abstract", False)),
    )


def is_fact(relation: RelationDict) -> bool:
    """Whether the relation holds in a scene: its state is True and it is not abstract."""
    return bool(relation.get("state", True)) and not relation.get("abstract", False)


def selected(relations: Iterable[RelationDict], subj: str, pred: str | Sequence[str], obj: str) -> list[RelationDict]:
    """The relations with that subject, predicate (one or several) and object; an empty one matches any."""
    names = {full_name(p) for p in ([pred] if isinstance(pred, str) else pred) if p}
    return [
        r
        for r in relations
        if (not subj or r["src"] == subj)
        and (not obj or r["dst"] == obj)
        and (not names or full_name(r["type"]) in names)
    ]


@dataclass
class ElementChanges:
    """The changes of an element since it was read from a world model. False when there are none."""

    properties: dict[str, Property] = field(default_factory=dict)
    removed_properties: list[str] = field(default_factory=list)
    added_relations: list[RelationDict] = field(default_factory=list)
    removed_relations: list[RelationDict] = field(default_factory=list)
    label: str | None = None
    type: str | None = None

    def __bool__(self) -> bool:
        return self != ElementChanges()


class _Original(NamedTuple):
    """The content as a world model returned it: shared with the world model, never changed here."""

    type: str
    label: str
    properties: dict[str, Property]
    relations: Sequence[RelationDict]


# Each read makes an element: without a Python function for its original, and a set that hardly any element fills.
_new = tuple.__new__
_NO_KEYS: frozenset[str] = frozenset()


class ElementContent:
    """Class, label, id, properties and relations of an element, copied from the world model's on write.

    Libraries read, change and assign `_type`, `_label`, `_id`, `_properties`, `_relations` and `_local_relations`.
    `property_view` and `relation_view` are the read-only forms, which copy nothing.
    """

    def __init__(self, etype: str = "Unknown", elabel: str = "", eid: str = "") -> None:
        self._type = etype
        self._label = elabel
        self._id = eid
        self._props: dict[str, Property] = {}
        self._rels: Sequence[RelationDict] = []
        self._local_relations: list[LocalRelation] = []
        self._original: _Original | None = None
        self._own_keys: frozenset[str] | None = None  # None: the element owns all properties
        self._owns_relations = True
        #: The revision of the element in the world model when it was read; -1 if it was not read from one.
        self.version = -1
        #: The time of the last change in the world model (s since the epoch); 0.0: unknown.
        self.last_update = 0.0

    @classmethod
    def with_content(
        cls, etype: str, label: str, eid: str, properties: dict[str, Property], relations: Sequence[RelationDict]
    ) -> Self:
        """A hand-made element with this content, which is not copied."""
        element = cls(etype, label, eid)
        element._props = properties
        element._rels = relations
        return element

    @classmethod
    def shared(
        cls,
        etype: str,
        label: str,
        eid: str,
        properties: dict[str, Property],
        relations: Sequence[RelationDict],
        version: int = 0,
        original: _Original | None = None,
    ) -> Self:
        """An element over content that belongs to the caller and is copied on write.

        :param properties: by key; the element never changes the dict or its properties.
        :param relations: relation dicts, which the element never changes either.
        :param version: the revision of the element in the world model.
        :param original: all that as the original of another element, if there is one.
        """
        element = cls.__new__(cls)  # faster than __init__: each read creates one
        element._type = etype
        element._label = label
        element._id = eid
        element._props = properties
        element._rels = relations
        element._local_relations = []
        element._original = original or _new(_Original, (etype, label, properties, relations))
        element._own_keys = _NO_KEYS
        element._owns_relations = False
        element.version = version
        element.last_update = 0.0
        return element

    @property
    def property_view(self) -> dict[str, Property]:
        """The properties by key as written. Not copied: to be read only."""
        return self._props

    @property
    def relation_view(self) -> Sequence[RelationDict]:
        """The relations. Not copied: to be read only."""
        return self._rels

    @property
    def may_be_changed(self) -> bool:
        """Whether it may have changed since it was read from a world model. Fast; `changes` is exact."""
        original = self._original
        return (
            self._own_keys is None
            or bool(self._own_keys)
            or self._owns_relations
            or bool(self._local_relations)
            or (original is not None and self._props is not original.properties)
            or (original is not None and (self._label != original.label or self._type != original.type))
        )

    def changes(self) -> ElementChanges | None:
        """The changes since the element was read from a world model; None if it was not read from one."""
        original = self._original
        if original is None:
            return None
        changes = ElementChanges(
            label=self._label if self._label != original.label else None,
            type=self._type if self._type != original.type else None,
        )
        if self._props is not original.properties:
            for key, prop in self._props.items():
                before = original.properties.get(key)
                if before is prop:
                    continue
                if before is None or before.values != prop.values or before.dataType() is not prop.dataType():
                    changes.properties[key] = prop
            changes.removed_properties = [key for key in original.properties if key not in self._props]
        if self._owns_relations:
            before_keys = {relation_key(r) for r in original.relations}
            keys = {relation_key(r) for r in self._rels}
            changes.added_relations = [r for r in self._rels if relation_key(r) not in before_keys]
            changes.removed_relations = [r for r in original.relations if relation_key(r) not in keys]
        return changes

    def adopt(self, fresh: Self, keep_children: bool = False) -> None:
        """Replaces id, content and revision with those of `fresh`. World models call it after writing the element.

        :param keep_children: keep the local relations, which were not written.
        """
        local = self._local_relations if keep_children else []
        self.__dict__.update(fresh.view().__dict__)
        self.last_update = fresh.last_update
        self._local_relations = local

    def complete(self, present: Self) -> None:
        """Makes an element that was not read from a world model one that was: its own content becomes its `changes`.

        :param present: the element as it is in the world model.
        """
        base = present.view()
        for key, prop in self._props.items():
            base.put(base._key_of(key) or key, prop)
        known = {relation_key(r) for r in base._rels}
        added = [r for r in self._rels if relation_key(r) not in known]
        if added:
            base._own_relations().extend(added)
        base._label = self._label or base._label
        base._local_relations = self._local_relations
        self.__dict__.update(base.__dict__)

    def view(self) -> Self:
        """A new element that shares this one's content, copied on write; its `changes` start from here."""
        return self.shared(self._type, self._label, self._id, self._props, self._rels, self.version)

    def as_read(self) -> Self:
        """A view of the content that a world model has returned, without the changes since; of its own, if none has."""
        original = self._original
        if original is None:
            return self.view()
        etype, label, properties, relations = original
        return self.shared(etype, label, self._id, properties, relations, self.version, original)

    def copy(self) -> Self:
        """A copy that shares no mutable data."""
        copy = self.__class__.__new__(self.__class__)
        ElementContent.__init__(copy, self._type, self._label, self._id)
        copy._props = {key: prop.clone() for key, prop in self._props.items()}
        copy._rels = [r.copy() for r in self._rels]
        copy._local_relations = list(self._local_relations)
        copy._original = self._original
        copy.version = self.version
        copy.last_update = self.last_update
        return copy

    def __copy__(self) -> Self:
        return self.copy()

    # -- copy on write -----------------------------------------------------------------------------------------

    def _own_dict(self) -> dict[str, Property]:
        if self._original is not None and self._props is self._original.properties:
            self._props = dict(self._props)
        return self._props

    def _own(self, key: str) -> Property:
        if self._own_keys is not None and key not in self._own_keys:
            self._own_dict()[key] = self._props[key].clone()
            self._own_keys |= {key}
        return self._props[key]

    def _key_of(self, key: str) -> str | None:
        """The stored spelling of a property's key; None if the property is missing."""
        if key in self._props:
            return key
        return next((name for name in spellings(key) if name in self._props), None)

    def _find(self, key: str) -> Property | None:
        """A property, read-only; None if it is missing."""
        prop = self._props.get(key)
        if prop is not None:
            return prop
        known = self._key_of(key)
        return None if known is None else self._props[known]

    def put(self, key: str, prop: Property) -> None:
        """Stores a property, which belongs to the element then. It replaces one of the same key, as written."""
        self._own_dict()[key] = prop
        local_revision.advance()
        if self._own_keys is not None:
            self._own_keys |= {key}

    def _own_relations(self) -> list[RelationDict]:
        if not self._owns_relations:
            self._rels = [r.copy() for r in self._rels]
            self._owns_relations = True
        local_revision.advance()
        assert isinstance(self._rels, list)
        return self._rels

    @property
    def _properties(self) -> dict[str, Property]:
        # Libraries change it in place, so the element copies all of it.
        if self._own_keys is not None:
            for key in list(self._props):
                self._own(key)
            self._own_keys = None
            self._own_dict()
        local_revision.advance()
        return self._props

    @_properties.setter
    def _properties(self, properties: dict[str, Property]) -> None:
        self._props = properties
        self._own_keys = None
        local_revision.advance()

    @property
    def _relations(self) -> list[RelationDict]:
        return self._own_relations()

    @_relations.setter
    def _relations(self, relations: list[RelationDict]) -> None:
        self._rels = relations
        self._owns_relations = True
        local_revision.advance()
