"""A robot whose arm measures force and torque, and a skill that presses until a limit is exceeded."""

from __future__ import annotations

from types import SimpleNamespace as Message

from skiros2_common.core.params import ParamTypes
from skiros2_common.core.world_element import Element
from skiros2_gui.app.window import Window
from skiros2_skill.client.description import Step
from skiros2_skill.testing import describe, stand_in
from support.window.local_system import LocalManager

TOPIC = "/arm/wrench"

_ARM = ("Arm", Element("rparts:ArmDevice"), ParamTypes.Inferred)
_MAX_FORCE = ("MaxForce", 30.0, ParamTypes.Optional)


def _force_below_limit(skill):
    return skill.getSignalCond("ForceBelowLimit", "skiros:WristForce", "Arm", maximum="MaxForce", timeout=60.0)


Press = describe("Press", [_ARM, _MAX_FORCE], hold=[_force_below_limit])
press = stand_in(Press, label="press", execute=lambda s: s.step("pressing"))


class PressCell:
    """:param window: of a `LocalSystem`."""

    def __init__(self, window: Window) -> None:
        self.system = window.system
        self.wm = self.system.world
        self.manager: LocalManager = self.system.add_manager("/robot", [press], "skiros:robot")
        self.robot = self.wm.resolve_element(Element("cora:Robot", "skiros:robot"))
        self.arm = self.add(Element("rparts:ArmDevice", "arm"), self.robot)
        self.force = self.add_signal("skiros:WristForce", "wrist force", "wrench.force", "N")
        self.torque = self.add_signal("skiros:WristTorque", "wrist torque", "wrench.torque", "Nm")

    def add(self, element: Element, owner: Element) -> Element:
        element.addRelation(owner.id, "skiros:hasA", "-1")
        self.wm.add_element(element)
        return element

    def add_signal(self, kind: str, label: str, path: str, unit: str, topic: str = TOPIC) -> Element:
        signal = Element(kind, label)
        for key, value in (("SignalTopic", topic), ("MessageField", path), ("Unit", unit)):
            signal.setProperty(f"skiros:{key}", value)
        return self.add(signal, self.arm)

    def publish(self, force: float, torque: float = 0.0) -> None:
        """Publishes a force (N) and torque (Nm) along z."""
        wrench = Message(force=Message(x=0.0, y=0.0, z=force), torque=Message(x=0.0, y=0.0, z=torque))
        self.system.signals.publish(TOPIC, Message(wrench=wrench))

    def press(self) -> int:
        """Starts the skill. Returns the task id."""
        return self.manager.command("start", -1, [Step("skiros:Press", "press")])
