"""Drives a mobile base to a pose on the floor, as a driver of move_base_msgs/MoveBase does.

The base turns, drives a straight leg, turns, and so on (`drive_path`). Ten times per second it checks the path ahead.
If an obstacle is on it, the base brakes, plans another path, waits for the obstacle to leave, and finally aborts.
"""

from __future__ import annotations

import math
from enum import Enum, auto
from typing import NamedTuple

from skiros2_common.core.errors import Refused
from skiros2_motion.core.geometry import Pose, rotated, to_euler
from skiros2_motion.core.motion import Outcome, Pieces, State, advance
from skiros2_sim.core.body import Body
from skiros2_sim.core.drive_path import Floor, Footprint, Leg, Obstacle, Pose2D, heading, wrapped
from skiros2_sim.core.part_contacts import PartContacts, contacts_of_part, format_contacts
from skiros2_sim.core.physics import Part
from skiros2_sim.core.robot import Robot
from skiros2_sim.core.world import World

#: Heights (m) of obstacles that a robot passes under or drives over.
_OVERHEAD, _FLAT = 1.2, 0.02
#: Maximum distance (m) of a goal from all bodies of the scene.
_AROUND = 10.0
#: Robots farther away than this (m) are ignored; they will have moved.
_NEAR = 4.0
#: Times (s from now) for which the position of a moving robot is predicted.
_SOON = (0.5, 1.0, 1.5, 2.0)
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
        low, high = world.physics.bounding_box(Part(body.body))
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
    boxes = [world.physics.bounding_box(Part(body.body)) for body in world.bodies.values()]
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


#: Maximum speeds (m/s, rad/s) and accelerations (m/s2, rad/s2).
SPEED, TURN_SPEED = 0.8, 1.2
_ACCELERATION, _TURN_ACCELERATION = 0.8, 2.5
#: Deceleration in front of an obstacle (m/s2).
_BRAKES_HARD = 3.0
#: Tolerances of the goal (m, rad), and of each leg and turn, which are smaller.
POSITION_TOLERANCE, ANGLE_TOLERANCE = 0.01, 0.01
_EXACT, _EXACT_ANGLE = 0.002, 0.003
#: The base is at rest if its commanded speed is below this (m/s, rad/s) and it has moved less than this (m, rad) for
#: this time (s). Its measured speed is not used: a carried object may shake it.
_STANDS, _STANDS_TURN = 0.005, 0.01
_MOVED, _MOVED_ANGLE, _STANDS_AFTER = 0.002, 0.003, 0.1
#: The base is stuck if it has moved less for this time (s), although it is commanded to.
_STUCK_AFTER = 5.0
#: Look-ahead distance (m) and period (s).
_AHEAD, _LOOK_EVERY = 1.5, 0.1
#: Maximum total time of waiting for obstacles (s), period of planning attempts (s), and waiting time for a robot with
#: priority (s).
BLOCKED_TIMEOUT, _TRY_EVERY, _GIVE_WAY = 15.0, 1.0, 3.0
#: Pieces of path planning in a step (about 0.5 ms each).
_PIECES = 3
#: Maximum number of corrections of the final pose.
_CORRECTIONS = 3
#: Contact force (N) of a collision.
_BUMP = 5.0


class _Phase(Enum):
    STOPPING = auto()  # the previous motion
    PLANNING = auto()
    TURNING = auto()  # towards the next leg, or to the goal's yaw
    DRIVING = auto()  # along a leg
    BRAKING = auto()
    WAITING = auto()  # for an obstacle to leave


class _Plan(NamedTuple):
    """A path, or why there is none. `is_possible`: there is one without the movable obstacles."""

    legs: list[Leg]
    fault: str = ""
    is_possible: bool = True


class BaseMotion:
    """A motion of a robot's base to a pose in the map."""

    def __init__(self, world: World, robot: Robot, goal: Pose2D) -> None:
        self.outcome: Outcome | None = None
        self._world, self._robot, self._goal = world, robot, goal
        self._phase = _Phase.STOPPING
        self._legs: list[Leg] = []
        self._planning: Pieces[_Plan] | None = None
        self._line = 0.0  # yaw on the current leg (rad)
        self._speed, _, self._turn = robot.velocity()  # commanded velocity
        self._since_look = 0.0  # time since the last look ahead (s)
        self._wait = 0.0  # remaining waiting time (s)
        self._blocked = 0.0  # total waiting time (s)
        self._corrections = 0
        self._last_pose = self.pose()  # the last pose that differs
        self._still_time = _STANDS_AFTER  # time since then (s)
        self._stuck_time = 0.0  # time without motion, although commanded (s)
        self._final_outcome: Outcome | None = None  # outcome once the base is at rest
        self._contacts = PartContacts(world, robot.name + "/")
        rejection = self._rejection()
        if rejection:
            self.outcome = Outcome(State.REJECTED, rejection)

    @classmethod
    def to_pose(cls, world: World, robot: Robot, pose: Pose) -> BaseMotion:
        """Creates a motion to a pose in the map; a tilted or invalid pose is rejected."""
        if not all(map(math.isfinite, pose.orientation)) or abs(math.hypot(*pose.orientation) - 1.0) > 0.01:
            return cls(world, robot, Pose2D(*pose.position[:2], math.nan))
        roll, pitch, _ = to_euler(pose.orientation)
        motion = cls(world, robot, pose2d_of(pose))
        if max(abs(roll), abs(pitch)) > 0.1 and motion.outcome is None:
            text = f"the goal is tilted by {max(abs(roll), abs(pitch)):.2f} rad, the base stays upright"
            motion.outcome = Outcome(State.REJECTED, text)
        return motion

    def pose(self) -> Pose2D:
        """Current pose of the base on the floor."""
        return pose2d_of(self._robot.pose())

    def update(self, dt: float) -> None:
        """Advances by `dt` seconds."""
        if self.outcome is not None:
            return
        pose = self.pose()
        self._check_progress(pose, dt)
        self._look_ahead(pose, dt)
        if self._final_outcome is not None:
            self._command(0.0, 0.0, dt)
            if self._is_at_rest():
                self._robot.set_base_velocity(0.0)
                self.outcome = self._final_outcome
            return
        match self._phase:
            case _Phase.STOPPING:
                self._command(0.0, 0.0, dt)
                if self._is_at_rest():
                    self._phase = _Phase.PLANNING
            case _Phase.PLANNING:
                self._plan(pose)
            case _Phase.TURNING:
                self._turn_to_heading(pose, dt)
            case _Phase.DRIVING:
                self._drive(pose, dt)
            case _Phase.BRAKING:
                self._command(0.0, 0.0, dt, _BRAKES_HARD)
                if self._is_at_rest():
                    self._phase = _Phase.WAITING
            case _Phase.WAITING:
                self._wait -= dt
                if self._wait <= 0.0:
                    self._phase = _Phase.PLANNING

    def cancel(self) -> None:
        """Brakes."""
        if self._final_outcome is None:
            self._final_outcome = Outcome(State.PREEMPTED, "cancelled")

    def _plan(self, pose: Pose2D) -> None:
        """Plans for one step of the world. Then drives; without a path, waits and tries again, or aborts."""
        if self._planning is None:
            self._planning = self._planned(pose)
        plan = advance(self._planning, _PIECES)
        if plan is None:
            return
        self._planning = None
        self._legs, self._phase = plan.legs, _Phase.TURNING
        if plan.fault:
            self._block(plan.fault, _TRY_EVERY)
            self._phase = _Phase.WAITING
            if self._blocked <= BLOCKED_TIMEOUT and not plan.is_possible:
                self._final_outcome = Outcome(State.ABORTED, plan.fault)

    def _planned(self, pose: Pose2D) -> Pieces[_Plan]:
        base, world, robot = footprint(self._robot), self._world, self._robot
        try:
            return _Plan((yield from Floor(base, obstacles(world, robot)).plan(pose, self._goal)))
        except Refused as error:
            fault = str(error)
        try:
            yield from Floor(base, fixed_obstacles(world, robot)).plan(pose, self._goal)
        except Refused:
            return _Plan([], fault, is_possible=False)
        return _Plan([], fault)

    def _block(self, reason: str, how_long: float) -> None:
        """Waits for an obstacle; aborts after `BLOCKED_TIMEOUT` in total."""
        self._wait = how_long
        self._blocked += how_long
        if self._blocked > BLOCKED_TIMEOUT:
            self._final_outcome = Outcome(State.ABORTED, f"blocked for {BLOCKED_TIMEOUT:g} s: {reason}")

    def _look_ahead(self, pose: Pose2D, dt: float) -> None:
        """Periodically checks the path ahead: brakes for obstacles, aborts after a collision."""
        self._since_look += dt
        if self._since_look < _LOOK_EVERY or self._final_outcome is not None:
            return
        self._since_look = 0.0
        hits = self._contacts.new()
        if any(force > _BUMP for force in hits.values()):
            self._final_outcome = Outcome(State.ABORTED, f"the robot has collided{format_contacts(hits)}")
        elif self._phase is _Phase.DRIVING:
            things = obstacles(self._world, self._robot) + predicted_robots(self._world, self._robot)
            hit = Floor(footprint(self._robot), things).first_collision(pose, self._legs, _AHEAD)
            if hit is not None:
                goes_first = hit in self._world.robots and hit < self._robot.id
                self._block(f"{hit!r} is in the way", _GIVE_WAY if goes_first else 0.1)
                self._phase = _Phase.BRAKING

    def _check_progress(self, pose: Pose2D, dt: float) -> None:
        """Detects rest; aborts if the base is stuck."""
        moved = math.hypot(pose.x - self._last_pose.x, pose.y - self._last_pose.y)
        if moved > _MOVED or abs(wrapped(pose.yaw - self._last_pose.yaw)) > _MOVED_ANGLE:
            self._last_pose, self._still_time, self._stuck_time = pose, 0.0, 0.0
            return
        self._still_time += dt
        drives = self._phase in (_Phase.TURNING, _Phase.DRIVING) and self._final_outcome is None
        self._stuck_time = self._stuck_time + dt if drives else 0.0
        if self._stuck_time > _STUCK_AFTER:
            touches = contacts_of_part(self._world, self._robot.name + "/")
            self._final_outcome = Outcome(State.ABORTED, f"the base makes no progress{format_contacts(touches)}")

    def _turn_to_heading(self, pose: Pose2D, dt: float) -> None:
        yaw = heading(pose, self._legs[0]) if self._legs else self._goal.yaw
        left = wrapped(yaw - pose.yaw)
        wanted = math.copysign(_reachable(abs(left), TURN_SPEED, _TURN_ACCELERATION), left)
        self._command(0.0, wanted, dt)
        if abs(left) > _EXACT_ANGLE or not self._is_at_rest():
            return
        if self._legs:
            self._line = yaw
            self._phase = _Phase.DRIVING
        else:
            self._arrive(pose)

    def _drive(self, pose: Pose2D, dt: float) -> None:
        """Drives along the leg; corrects lateral errors."""
        leg = self._legs[0]
        sign = -1.0 if leg.backward else 1.0
        c, s = sign * math.cos(self._line), sign * math.sin(self._line)
        dx, dy = leg.x - pose.x, leg.y - pose.y
        left, lateral = c * dx + s * dy, s * dx - c * dy
        turn = 4.0 * wrapped(self._line - math.atan(1.5 * lateral) - pose.yaw)
        speed = sign * _reachable(max(left, 0.0), SPEED, _ACCELERATION)
        self._command(speed, min(max(turn, -TURN_SPEED), TURN_SPEED) if left > 0.05 else 0.0, dt)
        if left < _EXACT and self._is_at_rest():
            self._legs.pop(0)
            self._phase = _Phase.TURNING

    def _arrive(self, pose: Pose2D) -> None:
        """Ends at the goal, or corrects the final pose."""
        off = math.hypot(self._goal.x - pose.x, self._goal.y - pose.y)
        turned = abs(wrapped(self._goal.yaw - pose.yaw))
        if off <= POSITION_TOLERANCE and turned <= ANGLE_TOLERANCE:
            self._final_outcome = Outcome(State.SUCCEEDED)
        elif self._corrections == _CORRECTIONS:
            self._final_outcome = Outcome(State.ABORTED, f"the base is {off:.3f} m and {turned:.3f} rad off its goal")
        else:
            self._corrections += 1
            self._phase = _Phase.PLANNING

    def _command(self, speed: float, turn: float, dt: float, acceleration: float = _ACCELERATION) -> None:
        """Sets the velocity of the base, limited by the acceleration."""
        self._speed += min(max(speed - self._speed, -acceleration * dt), acceleration * dt)
        self._turn += min(max(turn - self._turn, -_TURN_ACCELERATION * dt), _TURN_ACCELERATION * dt)
        self._robot.set_base_velocity(self._speed, 0.0, self._turn)

    def _is_at_rest(self) -> bool:
        commanded_rest = abs(self._speed) < _STANDS and abs(self._turn) < _STANDS_TURN
        return commanded_rest and self._still_time >= _STANDS_AFTER

    def _rejection(self) -> str:
        """Returns why the goal is rejected; "" if it is not."""
        if not self._robot.mobile:
            return f"robot {self._robot.id} has no mobile base"
        if not all(map(math.isfinite, self._goal)):
            return f"the goal {tuple(self._goal)} has numbers that are not finite"
        beyond = outside(self._world, self._goal)
        if beyond:
            return beyond
        fixed = Floor(footprint(self._robot), fixed_obstacles(self._world, self._robot))
        inside = fixed.collision_at(self._goal)
        return f"the goal is inside {inside!r}" if inside else ""


def _reachable(left: float, most: float, acceleration: float) -> float:
    """Returns the highest speed that allows stopping within the remaining distance, with a margin."""
    return min(most, 0.9 * math.sqrt(2 * acceleration * left), 10.0 * left)
