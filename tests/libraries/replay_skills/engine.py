"""Skills with which each rule of the engine makes a difference: conditions that do not hold, hooks that write, values
that are taken off the blackboard, processors, preemption. Their run is recorded in `engine.bag`.
"""

from __future__ import annotations

from typing import Any

from skiros2_common.core.abstract_skill import SkillDescription, State
from skiros2_common.core.params import ParamTypes
from skiros2_common.core.primitive import PrimitiveBase
from skiros2_common.core.world_element import Element
from skiros2_motion.core.geometry import Pose, composed
from skiros2_skill.core.processors import Loop, ParallelFf, ParallelFs, RetryOnFail, Selector, SerialStar
from skiros2_skill.core.skill import SkillBase
from skiros2_std_reasoners.core.spatial_data import pose_of, set_pose

#: A property of the robot.
WEIGHT = "skiros:Weight"


class SetWeight(SkillDescription):
    """Writes the robot's weight, which must then be more than 10."""

    def createDescription(self) -> None:
        self.addParam("Weight", 20.0, ParamTypes.Optional)
        self.addPostCondition(self.getPropCond("Heavy", WEIGHT, "Robot", ">", 10.0, True))


class set_weight(PrimitiveBase):
    def createDescription(self) -> None:
        self.setDescription(SetWeight(), "set_weight")

    def execute(self) -> State:
        robot = self.params["Robot"].value
        robot.setProperty(WEIGHT, self.params["Weight"].value, "xsd:float")
        self.wmi.update_element_properties(robot)
        return self.success("written")


class NoteEnd(SkillDescription):
    """Writes the weight at its end."""

    def createDescription(self) -> None:
        self.addParam("Weight", 30.12345, ParamTypes.Optional)


class note_end(PrimitiveBase):
    def createDescription(self) -> None:
        self.setDescription(NoteEnd(), "note_end")

    def execute(self) -> State:
        return self.success("")

    def onEnd(self) -> bool:
        robot = self.params["Robot"].value
        robot.setProperty(WEIGHT, self.params["Weight"].value, "xsd:float")
        robot.setProperty("rdfs:comment", "weighs 0.08 t")
        self.wmi.update_element_properties(robot)
        return True


class Stock(SkillDescription):
    """Uses a list of values on the blackboard."""

    def createDescription(self) -> None:
        self.addParam("Stock", str, ParamTypes.Optional)


class produce(PrimitiveBase):
    """Provides two values."""

    def createDescription(self) -> None:
        self.setDescription(Stock(), "produce")

    def execute(self) -> State:
        self.params["Stock"].setValues(["first", "second"])
        return self.success("")


class consume(PrimitiveBase):
    """Takes one value; none is left after the second."""

    def createDescription(self) -> None:
        self.setDescription(Stock(), "consume")

    def execute(self) -> State:
        self.params["Stock"].values.pop(0)
        return self.success("")


class report(PrimitiveBase):
    """Reports how many values there are."""

    def createDescription(self) -> None:
        self.setDescription(Stock(), "report")

    def execute(self) -> State:
        return self.success(f"{len(self.params['Stock'].values)} left")


class fail_twice(PrimitiveBase):
    """Fails at its first two starts."""

    def createDescription(self) -> None:
        self.setDescription(Stock(), "fail_twice")

    def onInit(self) -> bool:
        self._starts = 0
        return True

    def execute(self) -> State:
        self._starts += 1
        return self.fail(f"attempt {self._starts}", -7) if self._starts % 3 else self.success("third attempt")


class StepAside(SkillDescription):
    """Turns the robot and moves it in its own frame."""


class step_aside(PrimitiveBase):
    """The parameter is assigned: the engine writes the robot."""

    def createDescription(self) -> None:
        self.setDescription(StepAside(), "step_aside")

    def execute(self) -> State:
        robot = self.params["Robot"].value
        robot.setData(":OrientationEuler", [0.1, 0.2, 0.7])
        pose = pose_of(robot)
        assert pose is not None
        set_pose(robot, composed(pose, Pose((0.2, 0.1, 0.0), pose.orientation)))
        self.params["Robot"].value = robot
        return self.success("")


class EngineRun(SkillDescription):
    """Uses each processor, and the blackboard."""


class engine_run(SkillBase):
    def createDescription(self) -> None:
        self.setDescription(EngineRun(), "engine_run")

    def expand(self, skill: Any) -> None:
        skill.setProcessor(SerialStar())
        skill(
            self.skill("Stock", "produce"),
            self.skill("Stock", "consume"),
            self.skill("Stock", "report"),
            self.skill("Stock", "consume"),
            self.skill("Stock", "report"),
            self.skill(RetryOnFail(2))(self.skill("Stock", "fail_twice")),
            self.skill(Selector())(
                self.skill("SetWeight", "set_weight", specify={"Weight": 5.0}),
                self.skill("SetWeight", "set_weight", specify={"Weight": 15.5}),
            ),
            self.skill("SetWeight", "set_weight", specify={"Weight": 15.5}),  # writes what is there
            self.skill(ParallelFf())(
                self.skill("Wait", "wait", specify={"Duration": 0.2}),
                self.skill("Wait", "wait", specify={"Duration": 0.5}),
            ),
            self.skill(ParallelFs())(
                self.skill("Wait", "wait", specify={"Duration": 0.2}),
                self.skill("Wait", "wait", specify={"Duration": 5.0}),
            ),
            self.skill(Loop(2))(self.skill("Wait", "wait", specify={"Duration": 0.1})),
            self.skill("StepAside", "step_aside"),
            self.skill("NoteEnd", "note_end"),
        )


class WatchedRun(SkillDescription):
    """The robot must be light; one of its own skills makes it heavy."""

    def createDescription(self) -> None:
        self.addHoldCondition(self.getPropCond("Light", WEIGHT, "Robot", "<", 50.0, True))


class watched_run(SkillBase):
    def createDescription(self) -> None:
        self.setDescription(WatchedRun(), "watched_run")

    def expand(self, skill: Any) -> None:
        skill.setProcessor(ParallelFf())
        skill(
            self.skill("Wait", "wait", specify={"Duration": 2.0}),
            self.skill(SerialStar())(
                self.skill("Wait", "wait", specify={"Duration": 0.3}),
                self.skill("SetWeight", "set_weight", specify={"Weight": 60.0}),
            ),
        )


class WeighedWait(SkillDescription):
    """Waits while the robot is light."""

    def createDescription(self) -> None:
        self.addParam("Place", Element("sumo:Object"), ParamTypes.Optional)
        self.addHoldCondition(self.getPropCond("Light", WEIGHT, "Robot", "<", 50.0, True))


class weighed_wait(PrimitiveBase):
    """Three ticks long."""

    def createDescription(self) -> None:
        self.setDescription(WeighedWait(), "weighed_wait")

    def onStart(self) -> bool:
        self._ticks = 0
        return True

    def execute(self) -> State:
        self._ticks += 1
        return self.step(f"tick {self._ticks}") if self._ticks < 3 else self.success("")
