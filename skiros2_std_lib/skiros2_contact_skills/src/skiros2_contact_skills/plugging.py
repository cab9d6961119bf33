"""Skills of connectors with a latch: plug in, and connect with two arms."""

from __future__ import annotations

import logging
from typing import Any

from skiros2_common.core.abstract_skill import SkillDescription, State
from skiros2_common.core.params import ParamTypes
from skiros2_common.core.world_element import Element
from skiros2_contact_skills.assembly import RETREAT, SWING, Handling
from skiros2_contact_skills.contact_primitive import (
    NO_CLICK,
    WRONG_CLICK,
    WRONG_SOCKET,
    ContactPrimitive,
    axis_of,
    forces,
    moved,
    pressed,
)
from skiros2_contact_skills.core.latch_signature import Expected, LatchSignature, Verdict
from skiros2_contact_skills.descriptions import ContactMotion, add_axis_limits
from skiros2_motion.core.compliant_arm import ArmState, KeepsStates
from skiros2_motion.core.geometry import Pose
from skiros2_skill.core.processors import NoFail, ParallelFs, RetryOnFail, SelectorStar, SerialStar
from skiros2_skill.core.skill import SkillBase
from skiros2_std_reasoners.core.places import CONTAINER_STATE

log = logging.getLogger(__name__)

Inferred, Optional, Required = ParamTypes.Inferred, ParamTypes.Optional, ParamTypes.Required

#: Stiffness along the tool axis (N/m).
_STIFFNESS = 2000.0
#: Distance before the latch at which a peak of the force may be its click: the depth of the tool is not exact (m).
_EARLY = 0.004
#: Depth that counts as progress (m).
_PROGRESS = 0.0005
#: Height above the socket at which the search starts (m), and the motion from there on; see `insertion`.
_ABOVE = 0.004
_CONTACT = {"Speed": 0.008, "MaxDistance": 0.010, "NeedsContact": False}
#: Attempts to find the socket.
_ATTEMPTS = 3
#: Height of a retreat above the socket (m).
_TRANSFER = 0.12
#: The arm with the housing presses it on its place against a pull at its end. How far the housing yields is judged by
#: the pull test.
HOLD = {"Force": 20.0, "Stiffness": 2000.0, "RotationalStiffness": 300.0, "MaxDistance": 0.05}
#: Less than what pulls a latched plug out. It travels back from the floor to the latch (3 mm), and the hands yield by
#: another 8 mm.
_PULL = {"Force": 10.0, "Duration": 0.5, "MaxDistance": 0.0115}
_CODES = {Verdict.NO_CLICK: NO_CLICK, Verdict.WRONG_FORCE: WRONG_CLICK, Verdict.WRONG_DEPTH: WRONG_CLICK}


class PlugIn(ContactMotion):
    """Pushes a plug that is in the entry of a socket to its floor; succeeds if the force shows that it has latched."""

    def createDescription(self) -> None:
        # softer than force by length of the plug (270 N/m), hand and plug buckle like a strut under the force
        self.add_arm(1000.0, 60.0)
        self.add_surface("Position of the tool with the plug at the rim, in the arm's base frame (m)")
        self.addParam("Socket", Element("skiros:Bore"), Required, description="With depth, latch depth and latch force")
        self.add_number("Speed", 0.01, "m/s", 0.001, 0.1, "Of the reference")
        self.add_number("Force", 20.0, "N", 1.0, 40.0, "Pushed with at most")
        self.add_number("SeatForce", 6.0, "N", 0.5, 30.0, "Of the floor, above the friction: the plug is seated")
        self.add_number("ForceTolerance", 0.25, "", 0.01, 1.0, "Of the force of the click, as a part of the latch's")
        self.add_number("TravelTolerance", 0.0015, "m", 0.0001, 0.01, "Of the way from the click to the floor")
        self.add_number("Patience", 1.0, "s", 0.2, 30.0, "Without progress, after which the motion ends")
        self.addParam(
            "Signature",
            [float],
            Optional,
            description="Result: peak of the force (N), its depth (m), smallest force after it (N), last depth (m)",
        )


class PlugIntoSocket(SkillDescription):
    """Plugs a held plug into a socket, and proves that its latch holds it."""

    def createDescription(self) -> None:
        self.setAvailableForPlanning(False)
        self.addParam("Arm", Element("rparts:ArmDevice"), Required, description="The arm with the plug")
        self.addParam("Part", Element("skiros:Product"), Required, description="The held plug")
        self.addParam("Socket", Element("skiros:Bore"), Required, description="Where it goes")
        add_axis_limits(self)


class ConnectPlug(Handling):
    """Plugs a held plug into the socket of a housing, which the other arm puts on a work place and holds there."""

    def createDescription(self) -> None:
        self.set_duration(30.0)
        self.addParam("Part", Element("connector:Plug"), Required, description="The held plug")
        self.addParam("Socket", Element("skiros:Bore"), Required, description="Where it goes")
        self.addParam("Housing", Element("connector:Housing"), Inferred, description="The held housing of the socket")
        self.add_arm()
        self.add_arm("HousingArm", "HousingGripper")
        self.add_stand("WorkPlace", "Place", "HousingArm", "connector:WorkPlace")
        self.add_stand("PlugHolder", "PlugPlace")  # where the plug is put down if it must be gripped again
        self.addPreCondition(self.getRelationCond("HousingHasSocket", "skiros:hasA", "Housing", "Socket", True))
        self.addPreCondition(self.getPropCond("SocketIsEmpty", CONTAINER_STATE, "Socket", "=", "Empty", True))
        self.add_move("Part", "Gripper", "Socket")
        self.add_move("Housing", "HousingGripper", "WorkPlace")


class plug_in(ContactPrimitive):
    """Pushes with a limited force until the click and the floor, or until nothing moves any more; then judges."""

    #: Three times more along the axis: the spring that has pushed the catch aside hits the floor behind it, if the tick
    #: that lets go of it is late.
    damping = (2.0, 2.0, 6.0, 2.0, 2.0, 2.0)

    def createDescription(self) -> None:
        self.setDescription(PlugIn(), self.__class__.__name__)

    def begin(self, state: ArmState) -> None:
        socket = self.element("Socket")
        deepest, latch, force = (
            float(socket.value_of(key) or 0.0) for key in ("skiros:Depth", "skiros:LatchDepth", "skiros:LatchForce")
        )
        self._has_latch = 0.0 < latch < deepest and force > 0.0
        tolerances = self.value("ForceTolerance"), self.value("TravelTolerance")
        self._signature = LatchSignature(Expected(latch - _EARLY, force, deepest - latch, *tolerances))
        self.set_stiffness(_STIFFNESS)
        self._best = self._target = self.depth(state)
        self._best_at = state.stamp
        self._states(state)  # those before are not of this motion
        if not isinstance(self.arm, KeepsStates):
            log.warning("%s keeps no states between ticks: ticks of more than 0.1 s may miss the click", self.label)

    def move(self, state: ArmState, dt: float) -> State:
        if not self._has_latch:
            wants = "expected skiros:LatchForce, and skiros:LatchDepth below skiros:Depth"
            return self.fail(f"{self.label_of('Socket')} has no latch: {wants}", WRONG_SOCKET)
        had_clicked = self._signature.has_clicked
        for each in self._states(state):
            self._signature.add(self.depth(each), pressed(each))
        depth, force = self.depth(state), pressed(state)
        clicked, seat = self._signature.has_clicked, self.value("SeatForce")
        if depth > self._best + _PROGRESS:
            self._best, self._best_at = depth, state.stamp
        is_seated = clicked and force >= self._signature.low + seat
        if is_seated or state.stamp - self._best_at > self.value("Patience"):
            return self._result(state)
        if clicked and not had_clicked:  # the stretched spring would hit the floor behind the click
            self._target = depth
        limit = self._signature.low + 1.5 * seat if clicked else self.value("Force")
        self._target = min(self._target + self.value("Speed") * dt, depth + limit / _STIFFNESS)
        ahead = self._target - self.depth(self.start)
        position = moved(self.start.pose.position, axis_of(self.start), ahead)
        self.arm.set_reference(Pose(position, self.start.pose.orientation))
        return self.step(f"Plugging in: {1000 * depth:.1f} mm, {forces(state)}")

    def _states(self, state: ArmState) -> list[ArmState]:
        """Returns the states since the last tick: a late tick must not miss the peak of the click."""
        return (self.arm.take_states() if isinstance(self.arm, KeepsStates) else []) or [state]

    def _result(self, state: ArmState) -> State:
        self.params["Signature"].values = self._signature.values()
        verdict = self._signature.verdict
        text = f"{verdict.value}: {self._signature} ({forces(state)})"
        if verdict is Verdict.LATCHED:
            return self.success(f"{self.label_of('Socket')}: {text}")
        return self.fail(f"{self.label_of('Socket')}: {text}; expected {self._signature.expected}", _CODES[verdict])


class plug_into_socket(SkillBase):
    """Searches the socket with its estimated pose, plugs in, and pulls less than what unlatches the plug."""

    def createDescription(self) -> None:
        self.setDescription(PlugIntoSocket(), self.__class__.__name__)

    def expand(self, skill: Any) -> None:
        skill.setProcessor(SerialStar())
        skill(
            self.skill(RetryOnFail(_ATTEMPTS, SerialStar()))(
                self.skill("ApproachTarget", "", remap={"Target": "Socket"}, specify={"Height": _ABOVE}),
                # without contact the plug is in the entry already
                self.skill("MoveUntilContact", "", specify=_CONTACT),
                self.skill("SpiralSearch", "", remap={"Bore": "Socket"}),
            ),
            self.skill("PlugIn", ""),
            self.skill("PullTest", "", specify=_PULL),
        )


class connect_plug(SkillBase):
    """One arm puts the housing down and holds it, the other one plugs in, pulls to prove that the latch holds, and
    releases the plug. When it does not latch or hold, the plug is retracted and put back into its holder, from where
    the next plan takes it again."""

    def createDescription(self) -> None:
        self.setDescription(ConnectPlug(), self.__class__.__name__)

    def expand(self, skill: Any) -> None:
        housing = {"Arm": "HousingArm", "Part": "Housing", "Gripper": "HousingGripper"}
        there = housing | {"Target": "Place"}
        skill.setProcessor(SerialStar())
        skill(
            self.skill("ApproachTarget", "", remap=there, specify=SWING | {"ZeroSensor": True}),
            self.skill("ApproachTarget", "", remap=there, specify={"Height": 0.02, "Tolerance": 0.01}),
            self.skill("MoveUntilContact", "", remap=housing, specify={"Speed": 0.01, "MaxDistance": 0.04}),
            self.skill(ParallelFs())(
                # also during a retreat: the plug may be latched
                self.skill("HoldPose", "", remap={"Arm": "HousingArm"}, specify=HOLD),
                self.skill(SelectorStar())(
                    self.skill(SerialStar())(
                        self.skill(
                            "ApproachTarget", "", remap={"Target": "Socket"}, specify=SWING | {"ZeroSensor": True}
                        ),
                        self.skill("PlugIntoSocket", ""),
                        self.skill("CheckGrip", ""),
                        self.skill("ReleasePart", "", remap={"Container": "Socket"}),
                        self.skill("RetractTool", "", specify=SWING),
                    ),
                    self.skill(SerialStar())(
                        # a plug that has slipped in the fingers fails each time: the next plan takes it again
                        self.skill(NoFail(SerialStar()))(
                            self.skill("RetractTool", "", specify=RETREAT | {"Height": _TRANSFER}),
                            self.skill("CheckGrip", ""),
                            self.skill("PutDownPart", "", remap={"Container": "PlugHolder", "Place": "PlugPlace"}),
                        ),
                        self.skill("RetractAfterFailure", "", specify=RETREAT | {"Height": _TRANSFER}),
                    ),
                ),
            ),
            self.skill("ReleasePart", "", remap=housing | {"Container": "WorkPlace"}),
            self.skill("RetractTool", "", remap=housing, specify=SWING),
        )
