"""The content of an element, shared with a world model until something is changed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple, Self

from skiros2_common.core.element_relations import RelationDict, relation_key
from skiros2_common.core.names import spellings
from skiros2_common.core.property import Property
from skiros2_common.core.revision import local_revision


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
        return bool(
            self.properties
            or self.removed_properties
            or self.added_relations
            or self.removed_relations
            or self.label is not None
            or self.type is not None
        )


class _Original(NamedTuple):
    """The content as a world model returned it: shared with the world model, never changed here."""

    type: str
    label: str
    properties: dict[str, Property]
    relations: Sequence[RelationDict]


class ElementContent:
    """Class, label, id, properties and relations of an element, copied from the world model's when they are changed.

    `_type`, `_label`, `_id`, `_properties`, `_relations` and `_local_relations` are read, changed and assigned by
    libraries. `_props` and `_rels` are the same to be read only; reading them copies nothing.
    """

    def __init__(self, etype: str, elabel: str, eid: str) -> None:
        self._type = etype
        self._label = elabel
        self._id = eid
        self._props: dict[str, Property] = {}
        self._rels: Sequence[RelationDict] = []
        self._local_relations: list[RelationDict] = []
        self._original: _Original | None = None
        self._own_keys: set[str] | None = None  # None: all properties are our own
        self._owns_relations = True
        self._version = -1
        self._last_update = 0.0

    @classmethod
    def shared(
        cls,
        etype: str,
        label: str,
        eid: str,
        properties: dict[str, Property],
        relations: Sequence[RelationDict],
        version: int = 0,
    ) -> Self:
        """An element over content that belongs to the caller and is copied only when it is changed here.

        :param properties: by key; neither the dict nor its properties are ever changed through the element.
        :param relations: relation dicts, which are never changed through the element either.
        :param version: the world model's version of the element.
        """
        element = cls.__new__(cls)  # in the place of __init__, since each read makes one
        element._type = etype
        element._label = label
        element._id = eid
        element._props = properties
        element._rels = relations
        element._local_relations = []
        element._original = _Original(etype, label, properties, relations)
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
        """What was changed since a world model gave the element out; None when none did."""
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
        """Takes over id, content and version of `fresh`. World models call it when they have written the element.

        :param keep_children: the elements kept aside were not written and stay aside.
        """
        local = self._local_relations if keep_children else []
        self.__dict__.update(fresh.view().__dict__)
        self._last_update = fresh._last_update
        self._local_relations = local

    def view(self) -> Self:
        """An element over this one's content, copied only when it is changed there; `changes` counts from now."""
        return self.shared(self._type, self._label, self._id, self._props, self._rels, self._version)

    def copy(self) -> Self:
        """A copy that shares nothing that can be changed."""
        copy = self.__class__.__new__(self.__class__)
        ElementContent.__init__(copy, self._type, self._label, self._id)
        copy._props = {key: prop.clone() for key, prop in self._props.items()}
        copy._rels = [dict(r) for r in self._rels]
        copy._local_relations = list(self._local_relations)
        copy._original = self._original
        copy._version = self._version
        copy._last_update = self._last_update
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
            self._own_keys.add(key)
        return self._props[key]

    def _key_of(self, key: str) -> str | None:
        """The key under which a property is kept, however it is written; None when there is none."""
        if key in self._props:
            return key
        return next((name for name in spellings(key) if name in self._props), None)

    def _find(self, key: str) -> Property | None:
        """A property, to be read only; None when there is none."""
        prop = self._props.get(key)
        if prop is not None:
            return prop
        known = self._key_of(key)
        return None if known is None else self._props[known]

    def _put(self, key: str, prop: Property) -> None:
        self._own_dict()[key] = prop
        local_revision.advance()
        if self._own_keys is not None:
            self._own_keys.add(key)

    def _own_relations(self) -> list[RelationDict]:
        if not self._owns_relations:
            self._rels = [dict(r) for r in self._rels]
            self._owns_relations = True
        local_revision.advance()
        assert isinstance(self._rels, list)
        return self._rels

    @property
    def _properties(self) -> dict[str, Property]:
        # Libraries read, change and assign it, so all of it becomes the element's own.
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
        # Libraries read, change and assign it.
        return self._own_relations()

    @_relations.setter
    def _relations(self, relations: list[RelationDict]) -> None:
        self._rels = relations
        self._owns_relations = True
        local_revision.advance()
