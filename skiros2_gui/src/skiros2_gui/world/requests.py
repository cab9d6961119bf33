"""Checks the user's changes and converts them to operations."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence

from skiros2_common.core.element_content import RelationDict, relation_dict
from skiros2_common.core.errors import UnknownName, WrongValue
from skiros2_common.core.names import full_name, local_name
from skiros2_common.core.operations import Add, Instantiate, Operation, Patch, Remove
from skiros2_common.core.property import Property
from skiros2_common.core.world_element import REASONER_PROPERTY, Element, ElementChanges
from skiros2_gui.world.scene import SceneHierarchy
from skiros2_motion.core.geometry import Pose, from_euler
from skiros2_std_reasoners.core.spatial_data import ORIENTATION, POSITION, set_pose
from skiros2_world_model.core.queries import cascade_ids
from skiros2_world_model.core.scene import ROOT, ElementRecord
from skiros2_world_model.core.vocabulary import Vocabulary

CONTAINS = "skiros:contain"
#: Maintains frame and pose.
_SPACE_REASONER = "AauSpatialReasoner"
_IN_SPACE = "sumo:Object"


class Requests:
    """Makes operations. Checks everything that can be checked without the world model.

    Methods raise `UnknownName` for unknown names, and `WrongValue` for invalid values.
    """

    def __init__(self, hierarchy: SceneHierarchy, vocabulary: Vocabulary) -> None:
        self._hierarchy = hierarchy
        self._vocabulary = vocabulary

    # -- properties --------------------------------------------------------------------------------------------

    def set_values(self, eid: str, key: str, texts: Sequence[str]) -> list[Operation]:
        """Sets the values of a property from texts, lists and dicts as JSON. No texts: no values."""
        record = self._record(eid)
        key = full_name(key.strip())
        if key in ("rdfs:label", "rdf:type") or not key.rpartition(":")[2]:
            raise WrongValue(f"{key!r} cannot be the name of a property")
        if self._vocabulary.ontology.has_relation(key) and not self._vocabulary.is_declared(key):
            raise WrongValue(f"{key} is a relation, not a property: add it as a relation")
        known = record.properties.get(key)
        current = known.dataType() if known is not None else None
        if current in (list, dict):
            prop = Property(key, current)
            prop.assign([_from_json(key, text, current) for text in texts])
        else:
            prop = Property(key, self._vocabulary.value_type(record.type, key, current))
            prop.assign([self._vocabulary.parsed(record.type, key, text, current) for text in texts])
        if known is not None and known.values == prop.values:
            return []
        return [Patch(eid, ElementChanges({key: prop}))]

    def remove_property(self, eid: str, key: str) -> list[Operation]:
        """Removes a property."""
        if key not in self._record(eid).properties:
            raise UnknownName(f"{eid} has no property {key}")
        return [Patch(eid, ElementChanges(removed_properties=[key]))]

    def set_label(self, eid: str, label: str) -> list[Operation]:
        """Sets the label."""
        if label == self._record(eid).label:
            return []
        return [Patch(eid, ElementChanges(label=label))]

    def set_type(self, eid: str, etype: str) -> list[Operation]:
        """Sets the class; the id does not change."""
        self._check_class(etype)
        if etype == self._record(eid).type:
            return []
        return [Patch(eid, ElementChanges(type=etype))]

    def set_pose(self, eid: str, position: Sequence[float], angles: Sequence[float]) -> list[Operation]:
        """Sets the pose in the element's base frame.

        :param position: x, y, z (m).
        :param angles: roll, pitch, yaw (degrees), about the fixed axes x, y, z in this order.
        """
        record = self._record(eid)
        if not all(math.isfinite(number) for number in (*position, *angles)):
            raise WrongValue(f"{eid}: a pose is six finite numbers")
        x, y, z = position
        pose = Pose((x, y, z), from_euler(*map(math.radians, angles)))
        moved = Element(record.type, record.label, eid)
        for key in pose_keys(record.properties):
            moved.put(key, record.properties[key].clone())
        set_pose(moved, pose)
        before = record.properties
        changed = {k: p for k, p in moved.property_view.items() if k not in before or p.values != before[k].values}
        return [Patch(eid, ElementChanges(changed))] if changed else []

    def remove_pose(self, eid: str) -> list[Operation]:
        """Removes the pose, and the reasoner that maintains it."""
        properties = self._record(eid).properties
        keys = pose_keys(properties)
        reasoners = properties.get(REASONER_PROPERTY)
        changes = ElementChanges(removed_properties=keys)
        if reasoners is not None and _SPACE_REASONER in reasoners.values:
            kept = [name for name in reasoners.values if name != _SPACE_REASONER]
            if kept:
                changes.properties[REASONER_PROPERTY] = Property(REASONER_PROPERTY, kept)
            else:
                keys.append(REASONER_PROPERTY)
        return [Patch(eid, changes)] if keys else []

    # -- elements ----------------------------------------------------------------------------------------------

    def add(
        self, etype: str, label: str = "", parent: str = ROOT, predicate: str = CONTAINS, in_space: bool = True
    ) -> list[Operation]:
        """Adds an element.

        :param parent: "" for none.
        :param in_space: gives it a frame and the identity pose in its parent, if its class can have one.
        """
        self._check_class(etype)
        element = Element(etype, label)
        if in_space and self._vocabulary.ontology.is_subclass(etype, _IN_SPACE):
            element.setProperty(REASONER_PROPERTY, _SPACE_REASONER)
            set_pose(element, Pose((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)))
        element._relations = self._placed(parent, predicate)
        return [Add(element)]

    def add_template(self, template: str, parent: str = ROOT, predicate: str = CONTAINS) -> list[Operation]:
        """Adds a copy of a template and of the templates it has or contains."""
        if self._vocabulary.ontology.individual(template) is None:
            raise UnknownName(f"the ontologies have no template {template!r}")
        return [Instantiate(template, True, self._placed(parent, predicate))]

    def removed_with(self, eid: str) -> list[str]:
        """Returns the elements that are removed with an element: itself, and descendants without other parents."""
        self._record(eid)
        return cascade_ids(self._hierarchy.scene, self._vocabulary.ontology, eid, "skiros:sceneProperty")

    def remove(self, ids: Sequence[str]) -> list[Operation]:
        """Removes elements with their descendants."""
        removed: set[str] = set()
        operations: list[Operation] = []
        for eid in ids:
            if eid == ROOT:
                raise WrongValue("the scene itself cannot be removed")
            if eid not in removed:
                under = self.removed_with(eid)
                operations = [o for o in operations if not (isinstance(o, Remove) and o.id in under)]
                removed.update(under)
                operations.append(Remove(eid))
        return operations

    def move(self, eid: str, parent: str, predicate: str = CONTAINS) -> list[Operation]:
        """Moves an element to a new parent."""
        self._record(eid)
        self._record(parent)
        if eid == parent or eid in self._hierarchy.path(parent):
            raise WrongValue(f"{eid} cannot be moved into {parent}, its descendant")
        if eid == ROOT:
            raise WrongValue("the scene itself cannot be moved")
        operations: list[Operation] = []
        for pred, holder in self._hierarchy.holders(eid):
            if (pred, holder) != (predicate, parent):
                operations.append(Patch(holder, ElementChanges(removed_relations=[relation_dict("-1", pred, eid)])))
        if not self._hierarchy.scene.related(parent, predicate, eid):
            added = ElementChanges(added_relations=[relation_dict("-1", predicate, eid)])
            operations.append(Patch(parent, added))
        return operations

    # -- relations ---------------------------------------------------------------------------------------------

    def relate(self, src: str, predicate: str, dst: str) -> list[Operation]:
        """Adds a relation to an element or template."""
        record = self._record(src)
        if not self._vocabulary.ontology.has_relation(predicate):
            raise UnknownName(f"the ontologies know no relation {predicate!r}")
        if dst not in self._hierarchy.scene and not self._vocabulary.ontology.knows(dst):
            raise UnknownName(f"there is no element or template {dst!r}")
        if self._hierarchy.scene.related(src, predicate, dst):
            return []
        added = ElementChanges(added_relations=[relation_dict("-1", predicate, dst)])
        return [Patch(record.id, added)]

    def unrelate(self, src: str, predicate: str, dst: str) -> list[Operation]:
        """Removes a relation."""
        if not self._hierarchy.scene.related(src, predicate, dst):
            raise UnknownName(f"there is no relation {src} {local_name(predicate)} {dst}")
        return [Patch(src, ElementChanges(removed_relations=[relation_dict("-1", predicate, dst)]))]

    def mismatch(self, src: str, predicate: str, dst: str) -> str:
        """Returns why a relation violates its domain or range; "" if it does not. The world model accepts it."""
        return self._vocabulary.mismatch(self._type_of(src), predicate, self._type_of(dst))

    # -- shared ------------------------------------------------------------------------------------------------

    def _placed(self, parent: str, predicate: str) -> list[RelationDict]:
        if not parent:
            return []
        self._record(parent)
        if predicate not in self._hierarchy.spatial:
            raise WrongValue(f"{predicate} does not place one element in another")
        return [relation_dict(parent, predicate, "-1")]

    def _type_of(self, eid: str) -> str:
        record = self._hierarchy.scene.record(eid)
        return record.type if record is not None else self._vocabulary.type_of(eid)

    def _check_class(self, etype: str) -> None:
        if not self._vocabulary.ontology.has_class(etype):
            raise UnknownName(f"the ontologies have no class {etype!r}")

    def _record(self, eid: str) -> ElementRecord:
        record = self._hierarchy.scene.record(eid)
        if record is None:
            raise UnknownName(f"there is no longer an element {eid!r}" if eid else "no element is chosen")
        return record


def _from_json(key: str, text: str, kind: type) -> object:
    """Parses a list or dict."""
    what = "a list, such as [1, 2]" if kind is list else 'a table, such as {"key": 1}'
    try:
        value = json.loads(text)
    except ValueError as error:
        raise WrongValue(f"{local_name(key)}: expected {what}; {error}") from None
    if not isinstance(value, kind):
        raise WrongValue(f"{local_name(key)}: expected {what}, got {text!r}")
    return value


def pose_keys(properties: Mapping[str, Property]) -> list[str]:
    """Returns the pose properties among some properties."""
    return [key for key in (*POSITION, *ORIENTATION) if key in properties]
