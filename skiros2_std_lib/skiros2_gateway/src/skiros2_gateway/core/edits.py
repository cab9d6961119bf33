"""Edits of the world model that a program proposes: checked and previewed on a copy of the scene."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import partial

from pydantic import BaseModel, ConfigDict, Field

from skiros2_common.core.errors import SkirosError
from skiros2_common.core.names import nearest
from skiros2_common.core.operations import Expect, Operation, Patch, Relate
from skiros2_common.core.property import Property
from skiros2_common.core.world_element import ElementChanges
from skiros2_gateway.core.change_words import entry_sentences
from skiros2_gateway.core.problems import Problem, Rejected
from skiros2_gateway.core.values import Value
from skiros2_world_model.core.history import difference
from skiros2_world_model.core.preview_copy import PreviewCopy
from skiros2_world_model.core.world_model_client import WorldModelClient


class PropertyEdit(BaseModel):
    """A property of an element with its new values."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    element: str = Field(description="id of an element")
    property: str = Field(description="name of the property, for example skiros:ContainerState")
    values: list[Value] = Field(max_length=1000, description="the new values; empty: the property is removed")


class RelationEdit(BaseModel):
    """A relation that is added or removed."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    subject: str = Field(description="id of an element")
    relation: str = Field(description="name of the relation, for example skiros:contain")
    object: str = Field(description="id of an element")
    holds: bool = Field(True, description="false: the relation is removed")


@dataclass(frozen=True)
class Edits:
    """Changes that are applied as a whole or not at all."""

    properties: tuple[PropertyEdit, ...] = ()
    relations: tuple[RelationEdit, ...] = ()

    def __bool__(self) -> bool:
        return bool(self.properties or self.relations)


@dataclass(frozen=True)
class EditPreview:
    """The changes that edits would make.

    :param lines: one change each, as of `entry_sentences`.
    :param versions: of the edited elements when the scene was read, by id.
    """

    lines: tuple[str, ...] = ()
    versions: Mapping[str, int] = field(default_factory=dict)


def preview_edits(wm: WorldModelClient, edits: Edits) -> EditPreview:
    """Checks edits as the world model does with `strict`, and returns what they would change. Blocks; changes nothing.

    :raises Rejected: with the problems of all edits.
    """
    ids = {eid for fields, _, _ in _operations(edits) for _, eid in fields}
    found = [wm.find_element(eid) for eid in sorted(ids)]  # before the copy, so that no change is missed
    copy = PreviewCopy(wm, strict=True)
    scene = {element.id: element for element in copy.get_scene_elements()}
    problems = []
    for fields, name, make in _operations(edits):
        unknown = [(where, eid) for where, eid in fields if eid not in scene]
        for where, eid in unknown:
            near = tuple(nearest(eid, scene) or list(scene)[:12])
            problems.append(Problem("unknown_name", where, f"there is no element {eid!r}", "the id of one", near))
        if unknown:
            continue
        try:
            copy.transact([make()])
        except SkirosError as error:
            where = fields[0][0].rpartition(".")[0]
            problems.append(Problem(error.code, where, str(error), nearest=_near(wm, name)))
    lines = entry_sentences(difference(scene.values(), copy.get_scene_elements()))
    if not problems and not lines:
        problems.append(Problem("wrong_value", "properties", "the world model has these values already", "a change"))
    if problems:
        raise Rejected(problems)
    versions = {element.id: element.version for element in found if element is not None}
    return EditPreview(tuple(lines), versions)


def apply_edits(wm: WorldModelClient, edits: Edits, preview: EditPreview) -> None:
    """Applies previewed edits in one transaction. Blocks.

    :raises SkirosError: the world model refuses them, for example because an edited element has changed since the
        preview. Nothing has changed then.
    """
    expected: list[Operation] = [Expect(eid, version) for eid, version in preview.versions.items()]
    wm.transact([*expected, *(make() for _, _, make in _operations(edits))])


def _operations(edits: Edits) -> Iterator[tuple[list[tuple[str, str]], str, Callable[[], Operation]]]:
    """Yields, of each edit, the fields with element ids, the property or relation, and a function for its operation."""
    for i, prop in enumerate(edits.properties):
        yield [(f"properties.{i}.element", prop.element)], prop.property, partial(_patch, prop)
    for i, edit in enumerate(edits.relations):
        fields = [(f"relations.{i}.subject", edit.subject), (f"relations.{i}.object", edit.object)]
        yield fields, edit.relation, partial(Relate, edit.subject, edit.relation, edit.object, edit.holds)


def _near(wm: WorldModelClient, name: str) -> tuple[str, ...]:
    """Returns the nearest names of properties and relations, if the ontologies lack a name."""
    full = wm.add_prefix(name)
    kinds = ("owl:DatatypeProperty", "owl:ObjectProperty")
    known = [declared for kind in kinds for declared in wm.declared_names(kind)]
    return () if full in known else tuple(nearest(full, known))


def _patch(edit: PropertyEdit) -> Patch:
    """
    :raises WrongValue: the values have several types.
    """
    if not edit.values:
        return Patch(edit.element, ElementChanges(removed_properties=[edit.property]))
    return Patch(edit.element, ElementChanges({edit.property: Property(edit.property, list(edit.values))}))
