"""The floor plan of a simulated world for a mobile base."""

from __future__ import annotations

import math

from skiros2_sim.core.body import Body
from skiros2_sim.core.contacts import contacts_of_part
from skiros2_sim.core.drive_path import Footprint, Obstacle, Pose2D
from skiros2_sim.core.robot import Robot
from skiros2_sim.core.world import World
from skiros2_std_reasoners.core.geometry import Pose, rotated, to_euler

#: Heights (m) of obstacles that a robot passes under or drives over.
_OVERHEAD, _FLAT = 1.2, 0.02
#: Maximum distance (m) of a goal from all bodies of the scene.
_AROUND = 10.0
#: Robots farther away than this (m) are ignored; they will have moved.
_NEAR = 4.0
#: Times (s from now) for which the position of a moving robot is predicted; maximum speed (m/s) of a standing robot.
_SOON, _STANDS = (0.5, 1.0, 1.5, 2.0), 0.02
#: Half the edge length of the floor area of a robot without a base (m).
_POST = 0.15


def footprint(robot: Robot) -> Footprint:
    """Returns the rectangle of the base. Arms are assumed to be folded above it."""
    low, high = robot.base_box
    return Footprint(front=high[0], back=-low[0], side=max(high[1], -low[1]))


def pose2d_of(pose: Pose) -> Pose2D:
    """Projects a pose onto the floor."""
    return Pose2D(pose.position[0], pose.position[1], to_euler(pose.orientation)[2])


def obstacles(world: World, robot: Robot) -> list[Obstacle]:
    """Returns the obstacles for a base: bodies that it does not carry, and other robots nearby."""
    carried = contacts_of_part(world, robot.name + "/")
    top = robot.base_box[1][2]
    found = []
    for body in world.bodies.values():
        low, high = world.bullet.getAABB(body.body)
        # movable bodies lie around or are held: only those as low as the base are obstacles
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
    """Returns the obstacles that never move."""
    fixed = {body.id for body in world.bodies.values() if not body.movable}
    fixed |= {other.id for other in world.robots.values() if not other.mobile}
    return [obstacle for obstacle in obstacles(world, robot) if obstacle.id in fixed]


def predicted_robots(world: World, robot: Robot) -> list[Obstacle]:
    """Returns the predicted obstacles of moving robots with priority over this one: those with smaller ids, so that one
    of two robots goes first."""
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


def outside(world: World, pose: Pose2D) -> str:
    """Returns why a pose is outside the area of this world; "" if it is inside."""
    boxes = [world.bullet.getAABB(body.body) for body in world.bodies.values()]
    poses = [robot.pose().position for robot in world.robots.values()]
    for i, (name, value) in enumerate((("x", pose.x), ("y", pose.y))):
        low = min([box[0][i] for box in boxes] + [at[i] for at in poses]) - _AROUND
        high = max([box[1][i] for box in boxes] + [at[i] for at in poses]) + _AROUND
        if not low <= value <= high:
            return f"{name} {value:.2f} is outside of the world, which goes from {low:.2f} to {high:.2f}"
    return ""


def _of_body(body: Body, low: tuple[float, float, float], high: tuple[float, float, float]) -> Obstacle:
    pose = body.pose()
    up = rotated(pose.orientation, (0.0, 0.0, 1.0))[2]
    if body.spec.model or body.spec.size is None or abs(up) < 0.99:
        x, y = (low[0] + high[0]) / 2, (low[1] + high[1]) / 2
        return Obstacle(body.id, x, y, 0.0, (high[0] - low[0]) / 2, (high[1] - low[1]) / 2)
    return Obstacle(body.id, *pose2d_of(pose), body.spec.size[0] / 2, body.spec.size[1] / 2)


def _of_robot(robot: Robot, pose: Pose) -> Obstacle:
    low, high = robot.base_box
    if low[0] == high[0]:  # no base, only an arm
        low, high = (-_POST, -_POST, 0.0), (_POST, _POST, 0.0)
    x, y, yaw = pose2d_of(pose)
    c, s = math.cos(yaw), math.sin(yaw)
    mx, my = (low[0] + high[0]) / 2, (low[1] + high[1]) / 2
    half_x, half_y = (high[0] - low[0]) / 2, (high[1] - low[1]) / 2
    return Obstacle(robot.id, x + c * mx - s * my, y + s * mx + c * my, yaw, half_x, half_y)
