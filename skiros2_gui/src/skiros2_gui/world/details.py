"""The details of an element: properties with types and units, relations in both directions, pose."""

from __future__ import annotations

import json
import math
import re
from dataclasses import dataclass
from typing import Any

from skiros2_common.core.names import id_order, local_name
from skiros2_common.core.property import Property
from skiros2_common.core.wording import short_name
from skiros2_gui.world.scene import UNPLACED, SceneHierarchy
from skiros2_motion.core.geometry import to_euler
from skiros2_std_reasoners.core.spatial_data import BASE_FRAME, ORIENTATION, POSITION, pose_of, text
from skiros2_world_model.core.formatting import format_values
from skiros2_world_model.core.scene import ROOT
from skiros2_world_model.core.vocabulary import Vocabulary

_TYPE_NAMES = {float: "number", int: "whole number", bool: "yes or no", str: "text", list: "list", dict: "table"}
#: The display order of properties: the index of the first pattern that matches.
_ORDER = tuple(
    re.compile(pattern)
    for pattern in (
        r"skiros:(Position[XYZ]|Orientation[XYZW])",
        r"skiros:Size[XYZ]",
        r"(?!skiros:((Base|LinkedTo|PushTo)?FrameId|PublishTf|TfTimeStamp|DiscreteReasoner|Template)$).*",
        r".*",
    )
)


@dataclass(frozen=True)
class PropertyRow:
    """A property of an element.

    :param values: strings, numbers, booleans, lists or dicts.
    :param kind: the Python type of the values.
    :param unit: of numbers; "" for none.
    :param description: from the ontologies; "" for none.
    """

    key: str
    values: tuple[Any, ...]
    kind: type
    unit: str = ""
    description: str = ""

    @property
    def name(self) -> str:
        """The displayed name."""
        return local_name(self.key)

    @property
    def text(self) -> str:
        """The displayed values, without the unit."""
        return format_values(self.values)

    @property
    def kind_text(self) -> str:
        """The displayed type."""
        return _TYPE_NAMES.get(self.kind, self.kind.__name__)

    @property
    def is_plain(self) -> bool:
        """Whether the values are not lists or dicts, which are edited as JSON."""
        return self.kind in (float, int, bool, str)

    @property
    def texts(self) -> tuple[str, ...]:
        """The values as edited, not shortened."""
        if not self.is_plain:
            return tuple(json.dumps(value, default=str) for value in self.values)
        return tuple(repr(value) if isinstance(value, float) else str(value) for value in self.values)


@dataclass(frozen=True)
class RelationRow:
    """A relation of an element.

    :param other: the other element, or a template.
    :param is_element: whether `other` is an element of the scene.
    :param outgoing: whether the element is the subject.
    """

    predicate: str
    other: str
    other_text: str
    is_element: bool
    outgoing: bool
    description: str = ""

    @property
    def name(self) -> str:
        """The displayed name."""
        return local_name(self.predicate)


@dataclass(frozen=True)
class PoseDetails:
    """The pose of an element.

    :param position: x, y, z (m).
    :param angles: roll, pitch, yaw (degrees), about the fixed axes x, y, z in this order.
    :param frame: the name of the base frame; "" if unknown.
    """

    position: tuple[float, float, float]
    angles: tuple[float, float, float]
    frame: str


@dataclass(frozen=True)
class Details:
    """The details of an element.

    :param properties: all but those of the pose, if it has one.
    :param pose: None if it has no pose.
    :param author, stamp: of the last change (s since the epoch; 0.0 if unknown).
    """

    id: str
    type: str
    label: str
    type_description: str
    author: str
    stamp: float
    properties: tuple[PropertyRow, ...]
    relations: tuple[RelationRow, ...]
    pose: PoseDetails | None = None


def details_of(hierarchy: SceneHierarchy, vocabulary: Vocabulary, eid: str) -> Details | None:
    """Returns the details of an element; None if it does not exist."""
    record = hierarchy.scene.record(eid)
    if record is None:
        return None
    pose = _pose(hierarchy, eid)
    of_pose = (*POSITION, *ORIENTATION) if pose is not None else ()
    rows = [
        property_row(vocabulary, record.type, key, prop)
        for key, prop in record.properties.items()
        if key not in of_pose
    ]
    outgoing = [(pred, dst, True) for _, pred, dst in hierarchy.scene.relations(eid)]
    incoming = [(pred, src, False) for src, pred, _ in hierarchy.scene.relations(dst=eid)]
    relations = [
        RelationRow(
            pred, other, display_name(hierarchy, other), other in hierarchy.scene, is_out, vocabulary.description(pred)
        )
        for pred, other, is_out in sorted(
            [*outgoing, *incoming], key=lambda r: (r[2], r[0] not in hierarchy.spatial, r[0], id_order(r[1]))
        )
    ]
    return Details(
        eid,
        record.type,
        record.label,
        vocabulary.description(record.type),
        record.change_info.author,
        record.change_info.stamp,
        tuple(sorted(rows, key=_property_order)),
        tuple(relations),
        pose,
    )


def property_row(vocabulary: Vocabulary, etype: str, key: str, prop: Property) -> PropertyRow:
    """Returns the row of a property."""
    kind = vocabulary.value_type(etype, key, prop.dataType())
    return PropertyRow(key, tuple(prop.values), kind, vocabulary.unit(key), vocabulary.description(key))


def display_name(hierarchy: SceneHierarchy, eid: str) -> str:
    """Returns the displayed name of an element: its label; without one, its id without prefix. If several elements have
    the label, both; parameters of skills do not count.
    """
    if eid == UNPLACED:
        return "Not placed"
    record = hierarchy.scene.record(eid)
    short = short_name(local_name(eid))
    if record is None:
        return short
    if eid == ROOT:
        return "Scene"
    label = short_name(local_name(record.label))
    if not label:
        return short
    same = map(hierarchy.scene.record, hierarchy.scene.of_label(record.label))
    count = sum(other is not None and other.type != "skiros:Parameter" for other in same)
    return f"{label}  ({short})" if count > 1 else label


def _pose(hierarchy: SceneHierarchy, eid: str) -> PoseDetails | None:
    element = hierarchy.scene.element(eid)
    pose = pose_of(element) if element is not None else None
    if element is None or pose is None:
        return None
    roll, pitch, yaw = map(math.degrees, to_euler(pose.orientation))
    frame = text(element, BASE_FRAME)
    frame_name = display_name(hierarchy, frame) if frame in hierarchy.scene else frame
    return PoseDetails(pose.position, (_plain(roll), _plain(pitch), _plain(yaw)), frame_name)


def _plain(number: float) -> float:
    """Rounds away numerical noise."""
    return round(number, 6) + 0.0


def _property_order(row: PropertyRow) -> tuple[int, str]:
    rank = next(i for i, pattern in enumerate(_ORDER) if pattern.fullmatch(row.key))
    return rank, "~W" if row.name == "OrientationW" else row.name
