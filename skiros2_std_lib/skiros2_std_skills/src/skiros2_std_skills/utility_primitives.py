"""Waiting, counting, and edits of the world model."""

from __future__ import annotations

from typing import Any

from skiros2_common.core.abstract_skill import SkillDescription, State
from skiros2_common.core.errors import SkirosError
from skiros2_common.core.params import ParamTypes
from skiros2_common.core.primitive import PrimitiveBase
from skiros2_common.core.world_element import Element
from skiros2_common.core.world_model_port import WorldModelPort
from skiros2_std_skills.clock import Stopwatch

SPATIAL_RELATION = "skiros:spatiallyRelated"
CONTAINER_STATE = "skiros:ContainerState"
FRAME_ID = "skiros:FrameId"
SPATIAL_REASONER = "AauSpatialReasoner"


class Wait(SkillDescription):
    """Waits for a time."""

    def createDescription(self) -> None:
        self.addParam("Duration", 0.0, ParamTypes.Required, description="Time to wait", unit="s", minimum=0)


class wait(PrimitiveBase):
    """Runs for `Duration` seconds of ROS time."""

    def createDescription(self) -> None:
        self.setDescription(Wait(), self.__class__.__name__)

    def onPreempt(self) -> State:
        return self.fail("Stopped while waiting", -1)

    def onStart(self) -> bool:
        self._stopwatch = Stopwatch()
        return True

    def execute(self) -> State:
        passed, duration = self._stopwatch.passed(), self.params["Duration"].value
        if passed >= duration:
            return self.success(f"Waited {duration:.1f} s")
        return self.step(f"Waiting: {passed:.1f} of {duration:.1f} s")


class WmSetRelation(SkillDescription):
    """Adds or removes a relation between two elements."""

    def createDescription(self) -> None:
        self.addParam("Src", Element("sumo:Object"), ParamTypes.Required, description="The subject")
        self.addParam("Dst", Element("sumo:Object"), ParamTypes.Required, description="The object")
        self.addParam("Relation", str, ParamTypes.Required, description="The relation, such as skiros:contain")
        self.addParam("RelationState", True, ParamTypes.Required, description="True adds it, False removes it")
        self.addParam(
            "OldDstToRemove",
            Element("sumo:Object"),
            ParamTypes.Optional,
            description="Also removes the relation from Src to this element",
        )
        self.addParam(
            "OldSrcToRemove",
            Element("sumo:Object"),
            ParamTypes.Optional,
            description="Also removes the relation from this element to Dst",
        )


class wm_set_relation(PrimitiveBase):
    """Sets the relation in one step; removes old relations in the same change."""

    def createDescription(self) -> None:
        self.setDescription(WmSetRelation(), self.__class__.__name__)

    def execute(self) -> State:
        source, target = self.params["Src"].value, self.params["Dst"].value
        relation, state = self.params["Relation"].value, self.params["RelationState"].value
        old_target, old_source = self.params["OldDstToRemove"].value, self.params["OldSrcToRemove"].value
        try:
            if _in_scene(old_target):
                source.removeRelation2("-1", relation, old_target.id)
                _put_relation(source, "-1", relation, target.id, state)
                self.wmi.update_element(source)
            if _in_scene(old_source):
                target.removeRelation2(old_source.id, relation, "-1")
                _put_relation(target, source.id, relation, "-1", state)
                self.wmi.update_element(target)
            if not (_in_scene(old_target) or _in_scene(old_source)):
                self.wmi.set_relation(source.id, relation, target.id, state)
        except SkirosError as error:
            return self.fail(str(error), -1)
        return self.success(f"{_name(source)} {'' if state else 'no longer '}{relation} {_name(target)}")


class WmSetProperties(SkillDescription):
    """Sets properties of an element."""

    def createDescription(self) -> None:
        self.addParam("Src", Element("sumo:Object"), ParamTypes.Required, description="The element")
        self.addParam("Properties", dict, ParamTypes.Required, description="Property to value, or list of values")


class wm_set_properties(PrimitiveBase):
    """Sets all properties in one change, or none."""

    def createDescription(self) -> None:
        self.setDescription(WmSetProperties(), self.__class__.__name__)

    def execute(self) -> State:
        element, wanted = self.params["Src"].value.copy(), self.params["Properties"].value
        try:
            for key, value in wanted.items():
                element.setProperty(key, value)
                now_there = element.getProperty(key)
                if now_there.values != (value if isinstance(value, list) else [value]):
                    return self.fail(
                        f"{element!r}: {key} takes values of type {now_there.dataType().__name__}, got {value!r}", -1
                    )
            self.wmi.update_element_properties(element)
        except SkirosError as error:
            return self.fail(str(error), -2)
        self.params.specify("Src", element)
        return self.success(f"{_name(element)}: set {', '.join(wanted) or 'nothing'}")


class WmMoveObject(SkillDescription):
    """Moves an object in the world model from one place to another."""

    def createDescription(self) -> None:
        self.addParam("StartLocation", Element("sumo:Object"), ParamTypes.Inferred, description="The present place")
        self.addParam(
            "TargetLocation",
            Element("sumo:Object"),
            ParamTypes.Optional,
            description="The new place; unset: the start location",
        )
        self.addParam("Object", Element("sumo:Object"), ParamTypes.Required, description="The moved object")
        self.addParam("Relation", "skiros:contain", ParamTypes.Required, description="From the new place to the object")
        self.addPreCondition(self.getRelationCond("ObjectAtStart", SPATIAL_RELATION, "StartLocation", "Object", True))


class wm_move_object(PrimitiveBase):
    """Moves the object; the spatial reasoner, if the object has it, converts the pose."""

    def createDescription(self) -> None:
        self.setDescription(WmMoveObject(), self.__class__.__name__)

    def onEnd(self) -> bool:
        # the object is no longer there: the next run must infer it again
        self.params["StartLocation"].unset()
        return True

    def execute(self) -> State:
        try:
            return self.success(_move(self.wmi, self.params))
        except SkirosError as error:
            return self.fail(str(error), -1)


class wm_move_and_transform_object(PrimitiveBase):
    """Moves the object and writes its pose in the frame of the target."""

    def createDescription(self) -> None:
        self.setDescription(WmMoveObject(), self.__class__.__name__)

    def onEnd(self) -> bool:
        self.params["StartLocation"].unset()
        return True

    def transform_to_frame(self, element: Element, target_frame: str) -> bool:
        """Expresses the pose of `element` in another tf frame, without writing it to the world model.

        :returns: False when the transform between the frames is not known.
        """
        return bool(element._getReasoner(SPATIAL_REASONER).transform(element, target_frame))  # type: ignore[attr-defined]

    def execute(self) -> State:
        moved, target = self.params["Object"].value, _target(self.params)
        frame = target.value_of(FRAME_ID) or target.id
        try:
            if not self.transform_to_frame(moved, frame):
                return self.fail(f"{moved!r}: no transform to frame {frame!r} is known", -2)
            return self.success(_move(self.wmi, self.params))
        except SkirosError as error:
            return self.fail(str(error), -1)


class Forget(SkillDescription):
    """Clears a value on the blackboard: the next skill with that key infers it again."""

    def createDescription(self) -> None:
        self.addParam(
            "Value", Element("sumo:Object"), ParamTypes.Optional, description="To be remapped to the key to clear"
        )
        self.setAvailableForPlanning(False)


class forget(PrimitiveBase):
    """Unsets its parameter."""

    def createDescription(self) -> None:
        self.setDescription(Forget(), self.__class__.__name__)

    def execute(self) -> State:
        self.params["Value"].unset()
        return self.success()


class Counter(SkillDescription):
    """Counts ticks."""

    def createDescription(self) -> None:
        self.addParam("CountTarget", int, ParamTypes.Required, description="Number of ticks", minimum=0)


class counter(PrimitiveBase):
    """Succeeds at its `CountTarget`-th tick."""

    def createDescription(self) -> None:
        self.setDescription(Counter(), self.__class__.__name__)

    def onPreempt(self) -> State:
        return self.fail(f"Stopped at {self._count}", -1)

    def onStart(self) -> bool:
        self._count = 0
        return True

    def execute(self) -> State:
        self._count += 1
        target = self.params["CountTarget"].value
        if self._count >= target:
            return self.success(f"Counted to {target}")
        return self.step(f"{self._count} of {target}")


def _name(element: Element) -> str:
    """Returns the name of an element."""
    return element.label or element.id


def _in_scene(element: Element | None) -> bool:
    return element is not None and not element.isAbstract()


def _put_relation(element: Element, source: str, relation: str, target: str, state: bool) -> None:
    if state:
        element.addRelation(source, relation, target)
    else:
        element.removeRelation2(source, relation, target)


def _target(params: Any) -> Element:
    """Returns the target of the object: `TargetLocation`; without one, the start."""
    target: Element = params["TargetLocation"].value
    start: Element = params["StartLocation"].value
    return target if _in_scene(target) else start


def _move(wmi: WorldModelPort, params: Any) -> str:
    """Moves `Object` from `StartLocation` to `TargetLocation` in the world model and says so.

    :raises SkirosError: the world model refuses.
    """
    moved, start, target = params["Object"].value, params["StartLocation"].value, _target(params)
    spatial = [SPATIAL_RELATION, *wmi.get_sub_properties(SPATIAL_RELATION)]
    moved.removeRelations(moved.getRelations(start.id, spatial, "-1"))
    moved.addRelation(target.id, params["Relation"].value, "-1")
    wmi.update_element(moved)
    for place, content in ((start, "Empty"), (target, "Full")):
        place.setProperty(CONTAINER_STATE, content)
        wmi.update_element_properties(place)
    return f"{_name(moved)} moved from {_name(start)} to {_name(target)}"
