"""A stand-in for a compliant arm above a surface, without physics."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from skiros2_common.core.failure_kind import FailureKind
from skiros2_motion.core.compliant_arm import ArmState, Wrench
from skiros2_motion.core.geometry import Pose, Vector

DOWN = (1.0, 0.0, 0.0, 0.0)
SURFACE, OPENING = 0.30, 0.25  # m, heights of the surface and of the floor of the opening


class SurfaceArm:
    """A tool that follows its reference at once, above a surface that pushes back with the commanded stiffness.

    :ivar opens: the tool falls into an opening in the surface.
    """

    def __init__(self) -> None:
        self.calls: list[str] = []
        self.time = 0.0
        self.pose = Pose((0.5, 0.0, 0.32), DOWN)
        self.reference = self.pose
        self.stiffness = 0.0
        self.exerted = 0.0
        self.stopped, self.silent, self.opens = "", False, False
        self.kind = FailureKind.RETRYABLE

    def step(self) -> None:
        """A period of the ticks passes."""
        self.time += 0.04
        x, y, z = self.reference.position
        floor = OPENING if self.opens else SURFACE
        z -= self.exerted / self.stiffness if self.stiffness else 0.0
        self._pressed = self.stiffness * max(0.0, floor - z)
        self.pose = Pose((x, y, max(z, floor)), self.reference.orientation)

    _pressed = 0.0

    def now(self) -> float:
        return self.time

    def state(self) -> ArmState | None:
        wrench: Wrench = (0.0, 0.0, self._pressed, 0.0, 0.0, 0.0)
        return None if self.silent else ArmState(self.pose, wrench, self.time, self.stopped, self.kind)

    def begin(self) -> None:
        self.calls.append("begin")

    def end(self) -> None:
        self.calls.append("end")
        self.reference, self.exerted = self.pose, 0.0

    def set_reference(self, pose: Pose) -> None:
        self.reference = pose

    def set_stiffness(self, translational: Vector, rotational: Vector) -> None:
        self.stiffness = translational[2]

    def set_damping(self, factors: Sequence[float]) -> None:
        pass

    def set_wrench(self, force: Vector, torque: Vector = (0.0, 0.0, 0.0)) -> None:
        self.exerted = force[2]

    def start_spiral(self, spiral: Any) -> None:
        self.calls.append("start_spiral")
        self.spiral = spiral

    def stop_overlay(self) -> None:
        self.calls.append("stop_overlay")

    def set_wrench_limits(self, force: float, torque: float, axes: Sequence[float] = ()) -> None:
        self.calls.append(" ".join(f"{limit:g}" for limit in (force, torque, *axes)))

    def zero_sensor(self) -> None:
        self.calls.append("zero_sensor")
