"""The port of the simulated world to a physics engine; `Bullet` adapts it to PyBullet.

A body is a number of the engine, and so is a link: joint `i` moves link `i`, and -1 is the first link of a body.
Units are SI; poses and vectors are in the map. Call in the thread that steps.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

from skiros2_motion.core.geometry import Pose, Vector
from skiros2_sim.core.scene_spec import Colour


class Part(NamedTuple):
    """A link of a body."""

    body: int
    link: int = -1


@dataclass(frozen=True)
class Joint:
    """A joint. Positions in rad or m, velocities per second, effort in Nm or N.

    :param index: of the joint and of its child link.
    :param child: name of the child link.
    :param lower: -inf (and `upper` inf) for a joint without limits.
    :param parent: index of the parent link, which is smaller than that of the child.
    :param axis: in the frame of the child link.
    """

    name: str
    index: int
    kind: str
    child: str
    lower: float
    upper: float
    velocity: float
    effort: float
    parent: int = -1
    axis: Vector = (0.0, 0.0, 1.0)

    @property
    def moves(self) -> bool:
        return self.kind != "fixed"


class JointState(NamedTuple):
    """The state of a joint after the last step.

    :param reaction: force and torque on the child link, in the frame of its centre of mass; zero without a sensor.
    :param effort: of the motor.
    """

    position: float
    velocity: float
    reaction: tuple[float, ...]
    effort: float


class ContactPoint(NamedTuple):
    """A point where two bodies touch, or nearly do.

    :param kind: of the engine.
    :param normal: from the other body to the first.
    :param distance: negative is the depth.
    :param force: along the normal.
    :param friction_1, friction_2: forces along `direction_1`, `direction_2`.
    """

    kind: int
    body: int
    other_body: int
    link: int
    other_link: int
    position: Vector
    other_position: Vector
    normal: Vector
    distance: float
    force: float
    friction_1: float
    direction_1: Vector
    friction_2: float
    direction_2: Vector

    def exerted(self, on_first: bool) -> tuple[Vector, Vector]:
        """Return the position of the contact and its whole force, on the first or the other body."""
        n, one, two = self.normal, self.direction_1, self.direction_2
        x, y, z = (self.force * n[i] + self.friction_1 * one[i] + self.friction_2 * two[i] for i in range(3))
        return (self.position, (x, y, z)) if on_first else (self.other_position, (-x, -y, -z))

    def swapped(self) -> ContactPoint:
        """Return the same contact with the other body first."""
        normal, one, two = ((-x, -y, -z) for x, y, z in (self.normal, self.direction_1, self.direction_2))
        return self._replace(
            body=self.other_body,
            other_body=self.body,
            link=self.other_link,
            other_link=self.link,
            position=self.other_position,
            other_position=self.position,
            normal=normal,
            direction_1=one,
            direction_2=two,
        )


class Image(NamedTuple):
    """A rendered image.

    :param rgb: height x width x 3.
    :param depth: height x width: distance along the optical axis.
    :param bodies: height x width: the body of each pixel, or -1.
    """

    rgb: npt.NDArray[np.uint8]
    depth: npt.NDArray[np.float32]
    bodies: npt.NDArray[np.int32]


class Physics(Protocol):
    """One world of an engine."""

    # -- time ------------------------------------------------------------------------------------------------------

    def reset(self, dt: float) -> None:
        """Remove all bodies.

        :param dt: duration of a step.
        """

    def step(self) -> None:
        """Make one step."""

    def show(self, shown: bool) -> None:
        """Enable or disable rendering in the window, if there is one; disabled while many bodies are created."""

    def close(self) -> None:
        """Disconnect. Further calls of `close` do nothing."""

    # -- bodies ----------------------------------------------------------------------------------------------------

    def add_ground(self, friction: float) -> int:
        """Add a plane at z = 0."""

    def add_box(self, size: Vector, mass: float, pose: Pose, colour: Colour) -> int:
        """Add a box; with mass 0 it is fixed."""

    def add_mesh(self, file: Path, mass: float, pose: Pose, colour: Colour) -> int:
        """Add a mesh. With mass 0 it is fixed and has its exact shape; otherwise it collides as its convex hull.

        :raises ConfigurationError: the engine does not load it.
        """

    def load_urdf(
        self,
        text: str,
        pose: Pose,
        fixed: bool,
        exact_cylinders: bool = False,
        visuals: bool = True,
        margin: float | None = None,
    ) -> int:
        """Load a URDF.

        :param exact_cylinders: whether cylinders collide as such, and not as a mesh with a margin of 1 mm.
        :param visuals: whether it can be seen; its meshes are not read otherwise, which takes most of the time.
        :param margin: radius of the edges of the first link's shapes; None for the engine's default.
        :raises ConfigurationError: the engine does not load it.
        """

    def remove(self, body: int) -> None:
        """Remove a body."""

    def set_surface(
        self,
        body: int,
        link: int,
        friction: float,
        spinning: float | None = None,
        rolling: float | None = None,
        bounce: float | None = None,
        anchored: bool | None = None,
    ) -> None:
        """Set coefficients of friction and restitution; the engine multiplies those of both contact partners.

        :param anchored: whether contacts keep their place under a load. The others stay as they are if None.
        """

    def remove_damping(self, body: int) -> None:
        """Set the damping of all links and joints to 0."""

    def ignore_collisions(self, one: Part, other: Part) -> None:
        """Let two links pass through each other."""

    # -- models ----------------------------------------------------------------------------------------------------

    def root_link(self, body: int) -> str:
        """Return the name of the first link."""

    def joints(self, body: int) -> list[Joint]:
        """Return all joints, by index."""

    def parts(self, body: int | None = None) -> list[Part]:
        """Return the links with collision shapes of a body, or of all."""

    def mass(self, part: Part) -> float:
        """Return the mass of a link."""

    # -- where things are ------------------------------------------------------------------------------------------

    def pose(self, body: int) -> Pose:
        """Return the pose of the first link's frame."""

    def place(self, body: int, pose: Pose) -> None:
        """Move the first link's frame to a pose, at rest. Joints keep their positions."""

    def link_pose(self, part: Part) -> Pose:
        """Return the pose of a link's frame."""

    def link_poses(self, body: int, links: Sequence[int]) -> list[Pose]:
        """Return the poses of the frames of links; not of the first link."""

    def mass_pose(self, part: Part) -> Pose:
        """Return the pose of a link's centre of mass."""

    def velocity(self, part: Part) -> tuple[Vector, Vector]:
        """Return the linear and angular velocity of a link."""

    def bounding_box(self, part: Part) -> tuple[Vector, Vector]:
        """Return the minimum and maximum corner of the box around a link's shapes."""

    # -- joints ----------------------------------------------------------------------------------------------------

    def joint_states(self, body: int, joints: Sequence[int]) -> list[JointState]:
        """Return the states of joints."""

    def set_joint(self, body: int, joint: int, position: float) -> None:
        """Move a joint to a position at once, at rest."""

    def drive_positions(
        self,
        body: int,
        joints: Sequence[int],
        positions: Sequence[float],
        velocities: Sequence[float],
        efforts: Sequence[float],
    ) -> None:
        """Set target positions and velocities, and maximum efforts, of motors until the next command."""

    def drive_velocities(
        self, body: int, joints: Sequence[int], velocities: Sequence[float], efforts: Sequence[float]
    ) -> None:
        """Set target velocities and maximum efforts of motors until the next command; efforts of 0 release them."""

    def drive_torques(self, body: int, joints: Sequence[int], torques: Sequence[float]) -> None:
        """Set efforts of released joints for the next step."""

    def drive_to(self, body: int, joint: int, position: float, effort: float, speed: float) -> None:
        """Set the target position, maximum effort and maximum speed of a motor until the next command."""

    def couple(self, body: int, one: int, other: int, force: float) -> int:
        """Make two joints keep equal positions, with a maximum force. Return the coupling."""

    def coupling_force(self, coupling: int) -> float:
        """Return the force of a coupling on its first joint in the last step, which no `reaction` contains."""

    def add_force_sensor(self, body: int, joint: int) -> None:
        """Measure the `reaction` of a joint from now on."""

    def mass_matrix(self, body: int, positions: Sequence[float]) -> Sequence[Sequence[float]]:
        """Return the mass matrix of all moving joints at positions."""

    def bias(self, body: int, positions: Sequence[float], velocities: Sequence[float]) -> Sequence[float]:
        """Return the efforts of gravity, Coriolis and centrifugal forces of all moving joints at a state."""

    # -- contacts --------------------------------------------------------------------------------------------------

    def contacts(self, body: int | None = None) -> list[ContactPoint]:
        """Return the contact points of a body, which is the first in each, or of all."""

    def detect_contacts(self) -> None:
        """Find the contacts of the present poses, without a step."""

    def forget_contacts(self, body: int, link: int) -> None:
        """Forget contacts and their anchors; they are found again in the next step."""

    def push(self, part: Part, force: Vector, torque: Vector) -> None:
        """Apply a force and a torque at a link's centre of mass in the next step."""

    def distance(self, one: Part, other: Part, limit: float) -> float:
        """Return the distance of two links (negative is the depth); inf if it exceeds the limit."""

    def first_hits(self, start: Vector, ends: Sequence[Sequence[float]]) -> list[int]:
        """Return the first body on each line from a point; -1 for none."""

    def render(
        self, pose: Pose, width: int, height: int, field_of_view: float, near: float, far: float, shadow: bool
    ) -> Image:
        """Render an image.

        :param pose: of the optical frame: x right, y down, z forward.
        :param field_of_view: vertical.
        :param near, far: distances of the clipping planes.
        :param shadow: whether to render shadows, which triples the time.
        """
