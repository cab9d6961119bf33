"""A robot with an arm and a gripper, an object, and stand-ins of the skills that teach."""

from __future__ import annotations

from skiros2_common.core.params import ParamTypes
from skiros2_common.core.world_element import Element
from skiros2_gui.app.window import Window
from skiros2_skill.testing import describe, stand_in

REQUIRED, OPTIONAL = ParamTypes.Required, ParamTypes.Optional
_ARM = ("Arm", Element("rparts:ArmDevice"), REQUIRED)
_OBJECT = ("Object", Element("sumo:Object"), REQUIRED)
_NAME, _REPLACE = ("Name", str, REQUIRED), ("Replace", False, OPTIONAL)
_POSE, _PATH = ("Pose", Element("skiros:TaughtPose"), REQUIRED), ("Path", Element("skiros:TaughtPath"), REQUIRED)
_SAMPLES = "[[0.0, 0, 0, 0, 0, 0, 0, 1], [5.2, 0.1, 0, 0, 0, 0, 0, 1]]"


def taught(kind: str, name: str, owner: str, **properties: object) -> Element:
    """A taught element that is a part of another one."""
    element = Element(kind, name)
    pose = {"PositionX": 0.1, "PositionY": 0.0, "PositionZ": 0.25, **properties}
    for key, value in pose.items():
        element.setProperty(f"skiros:{key}", value)
    element.addRelation(owner, "skiros:hasA", "-1")
    return element


class Arm:
    """What the stand-ins do with the arm."""

    def __init__(self) -> None:
        self.is_released = self.is_recorded = self.is_teleoperated = False

    def release(self, skill):
        return skill.step("arm is guided by hand") if self.is_released else skill.success("arm holds its pose")

    def teleoperate(self, skill):
        return skill.step("arm is moved by twists") if self.is_teleoperated else skill.success("arm holds its pose")

    def end(self, skill):
        self.is_recorded = False
        keeps = bool(skill.params["KeepReleased"].value)
        self.is_released, self.is_teleoperated = self.is_released and keeps, self.is_teleoperated and keeps
        return skill.success("arm holds its pose")

    def record_path(self, skill):
        if self.is_recorded:
            return skill.step("Recording: 3.2 s, 90 samples, 1 gripper commands")
        path = taught("skiros:TaughtPath", skill.params["Name"].value, skill.params["Object"].value.id)
        path.setProperty("skiros:PathSamples", _SAMPLES)
        path.setProperty("skiros:GripperEvents", "[[1.0, 0.02, 10.0]]")
        skill.wmi.add_element(path)
        return skill.success("Taught path")

    @staticmethod
    def record_pose(skill):
        skill.wmi.add_element(taught("skiros:TaughtPose", skill.params["Name"].value, skill.params["Object"].value.id))
        return skill.success("Taught pose")

    @staticmethod
    def record_lifting(skill):
        pose = skill.params["Pose"].value
        skill.wmi.add_element(taught("skiros:LiftingPose", f"{pose.label} lifting", pose.id))
        return skill.success("Taught lifting pose")

    def begin(self, what):
        """Returns an `onStart`."""
        return lambda skill: setattr(self, what, True) or True

    @staticmethod
    def move(skill):
        return skill.step("Moving")

    def skills(self) -> list[type]:
        keep = ("KeepReleased", False, OPTIONAL)
        width = ("Width", float, REQUIRED)
        return [
            stand_in(describe(name, params), label=label, execute=execute, **dict(hooks))
            for name, params, label, execute, *hooks in (
                ("TeachRelease", [_ARM], "teach_release", self.release, ("onStart", self.begin("is_released"))),
                ("TeleoperateArm", [_ARM, ("WaitTime", 10.0, OPTIONAL)], "teleoperate_arm", self.teleoperate,
                 ("onStart", self.begin("is_teleoperated"))),
                ("TeachEnd", [_ARM, keep], "teach_end", self.end),
                ("TeachPose", [_ARM, _OBJECT, _NAME, _REPLACE], "teach_pose", self.record_pose),
                ("TeachLiftingPose", [_ARM, _POSE], "teach_lifting_pose", self.record_lifting),
                ("TeachPath", [_ARM, _OBJECT, _NAME, _REPLACE], "teach_path", self.record_path,
                 ("onStart", self.begin("is_recorded"))),
                ("MoveToTaughtPose", [_ARM, _POSE], "move_to_taught_pose", self.move),
                ("ReplayTaughtPath", [_ARM, _PATH], "replay_taught_path", self.move),
                ("MoveGripper", [_ARM, width], "move_gripper", lambda skill: skill.success("Moved")),
            )
        ]  # fmt: skip


class Pushes:
    """A `Simulator` that records the forces."""

    def __init__(self, is_running: bool = True) -> None:
        self.is_running = is_running
        self.pushes: list[tuple[str, tuple[float, float, float], float]] = []

    def is_up(self) -> bool:
        return self.is_running

    def push(self, eid: str, force: tuple[float, float, float], duration: float) -> None:
        self.pushes.append((eid, force, duration))


class TeachCell:
    """:param window: of a `LocalSystem`."""

    def __init__(self, window: Window) -> None:
        self.system = window.system
        self.wm = self.system.world
        self.simulator = self.system.simulator = Pushes()
        self.manager = self.system.add_manager("/robot", Arm().skills(), "skiros:robot")
        robot = self.wm.resolve_element(Element("cora:Robot", "skiros:robot"))
        self.arm = self._add("rparts:ArmDevice", "arm", robot.id)
        self.gripper = self._add("rparts:GripperEffector", "gripper", self.arm.id)
        self.block = self._add("skiros:Product", "block", "skiros:Scene-0", "skiros:contain")

    def _add(self, kind: str, label: str, owner: str, relation: str = "skiros:hasA") -> Element:
        element = Element(kind, label)
        element.addRelation(owner, relation, "-1")
        self.wm.add_element(element)
        return element

    def teach(self, name: str, kind: str = "skiros:TaughtPose", owner: str = "", **properties: object) -> Element:
        """Adds a taught element to the block, or to another element."""
        element = taught(kind, name, owner or self.block.id, **properties)
        self.wm.add_element(element)
        return element
