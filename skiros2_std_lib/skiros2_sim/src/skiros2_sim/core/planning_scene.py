"""Collision checks of an arm in a copy of the simulated world.

The copy is in a world of its own, which is never stepped: a check does not touch the running physics.
The engine's distances ignore its collision filters, so the links of one arm are checked against each other too, which
the physics does not do.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from skiros2_motion.core.geometry import composed, inverted
from skiros2_sim.core.arm import Arm, links_after
from skiros2_sim.core.body import Body
from skiros2_sim.core.physics import Part
from skiros2_sim.core.robot import Robot
from skiros2_sim.core.scene_spec import BodySpec, SceneSpec
from skiros2_sim.core.world import World

Array = npt.NDArray[np.float64]

#: Depth (m) up to which a contact at the start is accepted: the physics presses bodies into each other.
_PRESSED = 0.003
#: A pair that is closer than the clearance at the start may come closer by this distance (m).
_GIVE = 0.001
#: Maximum number of pairs in a text.
_MOST_NAMED = 3


class Collision(NamedTuple):
    """Two parts that are too close, named as in contacts, and their distance (m; negative is the depth)."""

    first: str
    second: str
    distance: float

    def __str__(self) -> str:
        state = f"{-self.distance:.4f} m inside" if self.distance < 0.0 else f"{self.distance:.4f} m from"
        return f"{self.first} is {state} {self.second}"


def format_collisions(found: Sequence[Collision]) -> str:
    """Formats the deepest collisions."""
    more = f" and {len(found) - _MOST_NAMED} more pairs" if len(found) > _MOST_NAMED else ""
    return "; ".join(str(one) for one in sorted(found, key=lambda one: one.distance)[:_MOST_NAMED]) + more


class PlanningScene:
    """A copy of a simulated world for collision checks. Used by one thread at a time.

    Creating it loads all models again: 0.25 s per robot.

    :param scene: the scene of the world.
    """

    def __init__(self, scene: SceneSpec) -> None:
        self._copy = World(scene)
        #: Pairs of links that overlap in the initial posture, by design of the model.
        self._overlapping: dict[str, frozenset[tuple[Part, Part]]] = {}
        for robot in self._copy.robots.values():
            for arm in robot.arms.values():
                checker = ArmCollisions(self._copy, robot, arm, (), 0.0)
                self._overlapping[arm.id] = frozenset(pair for pair, _ in checker.close_pairs(arm.rest, own=True))

    def close(self) -> None:
        """Discards the copy. Further calls do nothing."""
        self._copy.close()

    def collisions_of(self, world: World, robot: str, arm: str, clearance: float) -> ArmCollisions:
        """Copies the current state of a world and returns the checks of an arm with the objects that it holds. They are
        valid until the next call.

        :param robot: id of the robot of the arm.
        :param clearance: minimum distance (m) from everything that is not a part of the robot.
        """
        copy = self._copy
        for eid in sorted(copy.bodies):
            if eid not in world.bodies or _shape(world.bodies[eid].spec) != _shape(copy.bodies[eid].spec):
                copy.remove_body(eid)
        for eid, body in world.bodies.items():
            if eid not in copy.bodies:
                copy.add_body(body.spec)
            if eid in copy.bodies:
                _copy_state(world, body, copy, copy.bodies[eid])
        for eid, its in world.robots.items():
            _copy_state(world, its, copy, copy.robots[eid])
        held = held_objects(world, world.robots[robot], world.arms[arm])
        checks = ArmCollisions(copy, copy.robots[robot], copy.arms[arm], held, clearance)
        checks.allow_overlaps(self._overlapping[arm])
        return checks


class ArmCollisions:
    """The collision checks of one arm; everything else stands still, except for held objects.

    :param held: ids of the bodies that move with the tool.
    """

    def __init__(self, copy: World, robot: Robot, arm: Arm, held: Sequence[str], clearance: float) -> None:
        self.held = tuple(held)
        self._world, self._physics, self._arm = copy, copy.physics, arm
        self._indices = [joint.index for joint in arm.joints]
        back = inverted(arm.tool_pose())
        self._carried = [(copy.bodies[eid], composed(back, copy.bodies[eid].pose())) for eid in held]
        physics = self._physics
        links = links_after(physics, robot.body, self._indices[0])
        hand = {*links_after(physics, robot.body, self._indices[-1])}
        mine = [part for part in physics.parts(robot.body) if part.link in links]
        self._moving = mine + [part for body, _ in self._carried for part in physics.parts(body.body)]
        moving = set(self._moving)
        self._fixed = [part for part in physics.parts() if part not in moving]
        self._fixed_boxes = self._boxes(self._fixed)
        neighbours = _neighbours(copy, robot, arm)

        def limit(one: Part, other: Part) -> float:
            """Minimum distance of a pair (m); -inf for pairs that are not checked."""
            if one.body == other.body == robot.body:
                return -np.inf if frozenset((one.link, other.link)) in neighbours else 0.0
            if one in moving and other in moving:  # a held object and the arm, or two held objects
                return 0.0 if {one.body, other.body} & {robot.body} and not {one.link, other.link} & hand else -np.inf
            return clearance

        #: Minimum distance of each pair of a moving part with a fixed one, and with a later moving one.
        self._outer = np.array([[limit(one, other) for other in self._fixed] for one in self._moving])
        self._inner = np.full((len(self._moving), len(self._moving)), -np.inf)
        for i, j in itertools.combinations(range(len(self._moving)), 2):
            self._inner[i, j] = limit(self._moving[i], self._moving[j])
        self._robot_body = robot.body

    def collisions(self, positions: Sequence[float] | Array) -> list[Collision]:
        """Returns all pairs that are closer than allowed, with the arm at joint positions."""
        return [self._collision(pair, distance) for pair, distance in self.close_pairs(positions)]

    def is_free(self, positions: Sequence[float] | Array) -> bool:
        """Whether no pair is closer than allowed (0.15 to 0.25 ms)."""
        return next(self.close_pairs(positions), None) is None

    def accept_start(self, positions: Sequence[float] | Array) -> list[Collision]:
        """Accepts that pairs touch at the start, as a gripped object its support: from there on they may come closer by
        1 mm at most. Returns the collisions that are deeper than contacts are."""
        deep = []
        for (one, other), distance in list(self.close_pairs(positions)):
            if distance < -_PRESSED:
                deep.append(self._collision((one, other), distance))
            else:
                self._set_limit(one, other, distance - _GIVE)
        return deep

    def allow_overlaps(self, pairs: frozenset[tuple[Part, Part]]) -> None:
        """Ignores pairs of links."""
        for one, other in pairs:
            self._set_limit(one, other, -np.inf)

    def close_pairs(
        self, positions: Sequence[float] | Array, own: bool = False
    ) -> Iterator[tuple[tuple[Part, Part], float]]:
        """Yields the pairs that are closer than allowed, and their distance (m).

        :param own: only pairs of links of the robot.
        """
        for index, position in zip(self._indices, positions, strict=True):
            self._physics.set_joint(self._arm.body, index, float(position))
        if self._carried:
            tool = self._arm.tool_pose()
            for body, offset in self._carried:
                body.place(composed(tool, offset))
        low, high = self._boxes(self._moving)
        for others, (lows, highs), limits in (
            (self._fixed, self._fixed_boxes, self._outer),
            (self._moving, (low, high), self._inner),
        ):
            reach = np.maximum(limits, 0.0)[:, :, None]
            apart = (low[:, None] - reach > highs[None]) | (lows[None] > high[:, None] + reach)
            for i, j in np.argwhere(~apart.any(axis=2) & (limits > -np.inf)):
                one, other, least = self._moving[i], others[j], limits[i, j]
                if own and not one.body == other.body == self._robot_body:
                    continue
                distance = self._physics.distance(one, other, max(least, 0.0))
                if distance < least:
                    yield (one, other), distance

    def _set_limit(self, one: Part, other: Part, least: float) -> None:
        i = self._moving.index(one)
        if other in self._fixed:
            self._outer[i, self._fixed.index(other)] = least
        else:
            self._inner[i, self._moving.index(other)] = least

    def _boxes(self, parts: Sequence[Part]) -> tuple[Array, Array]:
        """Returns the minimum and maximum corners of the bounding boxes of parts in the map."""
        boxes = np.array([self._physics.bounding_box(part) for part in parts], dtype=float).reshape(-1, 2, 3)
        return boxes[:, 0], boxes[:, 1]

    def _collision(self, pair: tuple[Part, Part], distance: float) -> Collision:
        one, other = (self._world.name_of(*part) for part in pair)
        return Collision(one, other, distance)


def held_objects(world: World, robot: Robot, arm: Arm) -> list[str]:
    """Returns the ids of the movable bodies that all fingers of an arm touch."""
    if arm.gripper is None or not arm.gripper.joints:
        return []
    fingers = {f"{robot.name}/{joint.child}" for joint in arm.gripper.joints}
    touched: dict[str, set[str]] = {}
    for contact in world.contacts(robot.id):
        for finger, other in ((contact.first, contact.second), (contact.second, contact.first)):
            if finger in fingers and other in world.bodies and world.bodies[other].movable:
                touched.setdefault(other, set()).add(finger)
    return sorted(eid for eid, its in touched.items() if its == fingers)


def _shape(spec: BodySpec) -> tuple[object, ...]:
    return spec.model, spec.size, spec.movable


def _copy_state(world: World, thing: Body | Robot, copy: World, its_copy: Body | Robot) -> None:
    """Copies the pose and the joint positions of a body or a robot."""
    copy.physics.place(its_copy.body, world.physics.pose(thing.body))
    joints = [joint.index for joint in world.physics.joints(thing.body)]
    for index, state in zip(joints, world.physics.joint_states(thing.body, joints), strict=True):
        copy.physics.set_joint(its_copy.body, index, state.position)


def _neighbours(world: World, robot: Robot, arm: Arm) -> frozenset[frozenset[int]]:
    """Returns the pairs of links with at most one moving joint between them, and the pairs of fingers."""
    root, parent = {-1: -1}, {-1: -1}  # of each link: first link of its rigid group; of a group: the one before
    for joint in world.physics.joints(robot.body):
        root[joint.index] = joint.index if joint.moves else root[joint.parent]
        parent[joint.index] = root[joint.parent]
    fingers = {joint.index for joint in arm.gripper.joints} if arm.gripper is not None else set()
    return frozenset(
        frozenset((one, other))
        for one, other in itertools.combinations(root, 2)
        if root[one] in (root[other], parent[root[other]])
        or root[other] == parent[root[one]]
        or {root[one], root[other]} <= fingers
    )
