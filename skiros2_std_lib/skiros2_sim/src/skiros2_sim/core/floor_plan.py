"""What of a simulated world stands on the floor, seen from above, for a base that is to drive there."""

from __future__ import annotations

import math

from skiros2_sim.core.body import Body
from skiros2_sim.core.drive_path import Footprint, Obstacle, Place
from skiros2_sim.core.robot import Robot
from skiros2_sim.core.touching import touched
from skiros2_sim.core.world import World
from skiros2_std_reasoners.core.geometry import Pose, rotated, to_euler

#: Of what a robot drives past: what hangs higher than this (m) is over it, what is lower than that is driven over.
_OVERHEAD, _FLAT = 1.2, 0.02
#: How far from all things of the scene a base is sent (m).
_AROUND = 10.0
#: Other robots farther off than this (m) do not matter: they will be elsewhere by then.
_NEAR = 4.0
#: When a robot that moves is looked for (s from now), and the speed below which it stands (m/s).
_SOON, _STANDS = (0.5, 1.0, 1.5, 2.0), 0.02
#: Half the edge of what a robot without a base stands on (m).
_POST = 0.15


def footprint(robot: Robot) -> Footprint:
    """The base's rectangle. Its arms are taken to be folded above it."""
    low, high = robot.base_box
    return Footprint(front=high[0], back=-low[0], side=max(high[1], -low[1]))


def place_of(pose: Pose) -> Place:
    """A pose, seen from above."""
    return Place(pose.position[0], pose.position[1], to_euler(pose.orientation)[2])


def obstacles(world: World, robot: Robot) -> list[Obstacle]:
    """What a base may not drive into: things, but not those that it carries, and the other robots near it."""
    carried = touched(world, robot.name + "/")
    top = robot.base_box[1][2]
    found = []
    for body in world.bodies.values():
        low, high = world.bullet.getAABB(body.body)
        # what can be moved lies around, or in a hand: only what is as low as the base itself is in its way
        overhead = top if body.movable else _OVERHEAD
        if high[2] < _FLAT or low[2] > overhead or (body.movable and body.id in carried):
            continue
        found.append(_of_body(body, low, high))
    here = robot.pose().position
    for other in world.robots.values():
        if other is not robot and (math.dist(other.pose().position, here) < _NEAR or not other.mobile):
            found.append(_of_robot(other, other.pose()))
    return found


def fixed_obstacles(world: World, robot: Robot) -> list[Obstacle]:
    """Those of them that will always be there."""
    fixed = {body.id for body in world.bodies.values() if not body.movable}
    fixed |= {other.id for other in world.robots.values() if not other.mobile}
    return [obstacle for obstacle in obstacles(world, robot) if obstacle.id in fixed]


def robots_to_come(world: World, robot: Robot) -> list[Obstacle]:
    """Where the robots that this one gives way to will be soon, if they go on as they do: those with smaller ids, so
    that of two one goes first."""
    found = []
    for other in world.robots.values():
        vx, vy, _ = other.velocity()
        if other.id >= robot.id or math.hypot(vx, vy) < _STANDS:
            continue
        pose = other.pose()
        dx, dy, _ = rotated(pose.orientation, (vx, vy, 0.0))
        x, y, z = pose.position
        found += [_of_robot(other, Pose((x + t * dx, y + t * dy, z), pose.orientation)) for t in _SOON]
    return found


def outside(world: World, place: Place) -> str:
    """Why a place is beyond what the robots of this world drive on; "" when it is not."""
    boxes = [world.bullet.getAABB(body.body) for body in world.bodies.values()]
    places = [robot.pose().position for robot in world.robots.values()]
    for i, (name, value) in enumerate((("x", place.x), ("y", place.y))):
        low = min([box[0][i] for box in boxes] + [at[i] for at in places]) - _AROUND
        high = max([box[1][i] for box in boxes] + [at[i] for at in places]) + _AROUND
        if not low <= value <= high:
            return f"{name} {value:.2f} is outside of the world, which goes from {low:.2f} to {high:.2f}"
    return ""


def _of_body(body: Body, low: tuple[float, float, float], high: tuple[float, float, float]) -> Obstacle:
    pose = body.pose()
    up = rotated(pose.orientation, (0.0, 0.0, 1.0))[2]
    if body.spec.model or body.spec.size is None or abs(up) < 0.99:
        x, y = (low[0] + high[0]) / 2, (low[1] + high[1]) / 2
        return Obstacle(body.id, x, y, 0.0, (high[0] - low[0]) / 2, (high[1] - low[1]) / 2)
    return Obstacle(body.id, *place_of(pose), body.spec.size[0] / 2, body.spec.size[1] / 2)


def _of_robot(robot: Robot, pose: Pose) -> Obstacle:
    low, high = robot.base_box
    if low[0] == high[0]:  # no base, only an arm
        low, high = (-_POST, -_POST, 0.0), (_POST, _POST, 0.0)
    x, y, yaw = place_of(pose)
    c, s = math.cos(yaw), math.sin(yaw)
    mx, my = (low[0] + high[0]) / 2, (low[1] + high[1]) / 2
    half_x, half_y = (high[0] - low[0]) / 2, (high[1] - low[1]) / 2
    return Obstacle(robot.id, x + c * mx - s * my, y + s * mx + c * my, yaw, half_x, half_y)
