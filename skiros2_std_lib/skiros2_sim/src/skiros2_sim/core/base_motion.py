"""A mobile base to a place on the floor: what a driver's move_base_msgs/MoveBase does.

The base turns, drives a straight leg, turns, and so on (`drive_path`). Ten times a second it looks along the way that
is left. When something stands there it brakes, looks for another way, waits for it to go away, and gives up at last.
"""

from __future__ import annotations

import math
from enum import Enum, auto

from skiros2_common.core.errors import Refused
from skiros2_sim.core.drive_path import Floor, Leg, Place, heading, wrapped
from skiros2_sim.core.floor_plan import fixed_obstacles, footprint, obstacles, outside, place_of, robots_to_come
from skiros2_sim.core.motion import Outcome, State
from skiros2_sim.core.robot import Robot
from skiros2_sim.core.touching import because, new_touches, touched
from skiros2_sim.core.world import World
from skiros2_std_reasoners.core.geometry import Pose, to_euler

#: At most (m/s, rad/s), and how fast it gets there (m/s2, rad/s2).
SPEED, TURN_SPEED = 0.8, 1.2
_ACCELERATION, _TURN_ACCELERATION = 0.8, 2.5
#: How hard it brakes for what it sees before it (m/s2).
_BRAKES_HARD = 3.0
#: How exactly it gets there (m, rad), and how exactly it ends each leg and each turn to be sure of that.
POSITION_TOLERANCE, ANGLE_TOLERANCE = 0.01, 0.01
_EXACT, _EXACT_ANGLE = 0.002, 0.003
#: It stands when it is told to (m/s, rad/s), and has moved less than that (m, rad) for so long (s). Not by its speed:
#: what it carries may shake it.
_STANDS, _STANDS_TURN = 0.005, 0.01
_MOVED, _MOVED_ANGLE, _STANDS_AFTER = 0.002, 0.003, 0.1
#: It does not get on when it is told to move and has moved less for so long (s).
_STUCK_AFTER = 5.0
#: How far it looks ahead (m) and how often (s).
_AHEAD, _LOOK_EVERY = 1.5, 0.1
#: How long things may be in its way, in all (s); how often it looks for another way (s), and how long it lets a robot
#: with a smaller id go first (s).
PATIENCE, _TRY_EVERY, _GIVE_WAY = 15.0, 1.0, 3.0
#: How often it corrects where it came to, before it gives up.
_CORRECTIONS = 3
#: A force of that much (N) from something new ends the way.
_BUMP = 5.0


class _Phase(Enum):
    SLOWS = auto()  # from what it did before
    PLANS = auto()
    TURNS = auto()  # towards its next leg, or the goal's yaw
    DRIVES = auto()  # along its leg
    BRAKES = auto()
    WAITS = auto()  # for what is in its way


class BaseMotion:
    """A motion of a robot's base to a place in the map."""

    def __init__(self, world: World, robot: Robot, goal: Place) -> None:
        self.outcome: Outcome | None = None
        self._world, self._robot, self._goal = world, robot, goal
        self._phase = _Phase.SLOWS
        self._legs: list[Leg] = []
        self._line = 0.0  # the yaw with which it is on its leg (rad)
        self._speed, _, self._turn = robot.velocity()  # what the base is told now
        self._looked = self._wait = self._blocked = 0.0  # s: since it looked, until it plans, in which it was blocked
        self._corrections = 0
        self._mark, self._still = self.place(), _STANDS_AFTER  # where it was last, and for how long it is there (s)
        self._stuck = 0.0  # s in which it should have moved, and has not
        self._ending: Outcome | None = None  # what comes out when it stands
        self._touched = touched(world, robot.name + "/")
        refusal = self._refusal()
        if refusal:
            self.outcome = Outcome(State.REJECTED, refusal)

    @classmethod
    def to_pose(cls, world: World, robot: Robot, pose: Pose) -> BaseMotion:
        """To a pose in the map; one that is no number, or tilted, is refused."""
        if not all(map(math.isfinite, pose.orientation)) or abs(math.hypot(*pose.orientation) - 1.0) > 0.01:
            return cls(world, robot, Place(*pose.position[:2], math.nan))
        roll, pitch, _ = to_euler(pose.orientation)
        motion = cls(world, robot, place_of(pose))
        if max(abs(roll), abs(pitch)) > 0.1 and motion.outcome is None:
            text = f"the goal is tilted by {max(abs(roll), abs(pitch)):.2f} rad, the base drives upright"
            motion.outcome = Outcome(State.REJECTED, text)
        return motion

    def place(self) -> Place:
        """Where the base is now."""
        return place_of(self._robot.pose())

    def update(self, dt: float) -> None:
        """Goes on by `dt` seconds."""
        if self.outcome is not None:
            return
        place = self.place()
        self._notice(place, dt)
        self._look(place, dt)
        if self._ending is not None:
            self._command(0.0, 0.0, dt)
            if self._stands():
                self._robot.set_base_velocity(0.0)
                self.outcome = self._ending
            return
        match self._phase:
            case _Phase.SLOWS:
                self._command(0.0, 0.0, dt)
                if self._stands():
                    self._phase = _Phase.PLANS
            case _Phase.PLANS:
                self._plan(place)
            case _Phase.TURNS:
                self._turn_there(place, dt)
            case _Phase.DRIVES:
                self._drive(place, dt)
            case _Phase.BRAKES:
                self._command(0.0, 0.0, dt, _BRAKES_HARD)
                if self._stands():
                    self._phase = _Phase.WAITS
            case _Phase.WAITS:
                self._wait -= dt
                if self._wait <= 0.0:
                    self._phase = _Phase.PLANS

    def cancel(self) -> None:
        """Brakes."""
        if self._ending is None:
            self._ending = Outcome(State.PREEMPTED, "cancelled")

    def _plan(self, place: Place) -> None:
        things = obstacles(self._world, self._robot)
        try:
            self._legs = Floor(footprint(self._robot), things).way(place, self._goal)
        except Refused as error:
            self._wait_for(str(error), _TRY_EVERY)
            self._phase = _Phase.WAITS
            if self._blocked <= PATIENCE and not self._can_ever(place):
                self._ending = Outcome(State.ABORTED, str(error))
            return
        self._phase = _Phase.TURNS

    def _can_ever(self, place: Place) -> bool:
        """Whether there is a way when all that moves is gone."""
        fixed = Floor(footprint(self._robot), fixed_obstacles(self._world, self._robot))
        try:
            fixed.way(place, self._goal)
        except Refused:
            return False
        return True

    def _wait_for(self, reason: str, how_long: float) -> None:
        """Waits for what is in its way; gives up when it has done so for too long in all."""
        self._wait = how_long
        self._blocked += how_long
        if self._blocked > PATIENCE:
            self._ending = Outcome(State.ABORTED, f"blocked for {PATIENCE:g} s: {reason}")

    def _look(self, place: Place, dt: float) -> None:
        """Looks ahead from time to time, and brakes for what it sees; ends when it has hit something."""
        self._looked += dt
        if self._looked < _LOOK_EVERY or self._ending is not None:
            return
        self._looked = 0.0
        hits = new_touches(self._world, self._robot.name + "/", self._touched)
        if any(force > _BUMP for force in hits.values()):
            self._ending = Outcome(State.ABORTED, f"the robot has run into something{because(hits)}")
        elif self._phase is _Phase.DRIVES:
            things = obstacles(self._world, self._robot) + robots_to_come(self._world, self._robot)
            hit = Floor(footprint(self._robot), things).first_hit(place, self._legs, _AHEAD)
            if hit is not None:
                goes_first = hit in self._world.robots and hit < self._robot.id
                self._wait_for(f"{hit!r} is in the way", _GIVE_WAY if goes_first else 0.1)
                self._phase = _Phase.BRAKES

    def _notice(self, place: Place, dt: float) -> None:
        """Notices whether it moves; ends when it does not, but should."""
        moved = math.hypot(place.x - self._mark.x, place.y - self._mark.y)
        if moved > _MOVED or abs(wrapped(place.yaw - self._mark.yaw)) > _MOVED_ANGLE:
            self._mark, self._still, self._stuck = place, 0.0, 0.0
            return
        self._still += dt
        drives = self._phase in (_Phase.TURNS, _Phase.DRIVES) and self._ending is None
        self._stuck = self._stuck + dt if drives else 0.0
        if self._stuck > _STUCK_AFTER:
            touches = new_touches(self._world, self._robot.name + "/", {})
            self._ending = Outcome(State.ABORTED, f"the base does not get on{because(touches)}")

    def _turn_there(self, place: Place, dt: float) -> None:
        yaw = heading(place, self._legs[0]) if self._legs else self._goal.yaw
        left = wrapped(yaw - place.yaw)
        wanted = math.copysign(_reachable(abs(left), TURN_SPEED, _TURN_ACCELERATION), left)
        self._command(0.0, wanted, dt)
        if abs(left) > _EXACT_ANGLE or not self._stands():
            return
        if self._legs:
            self._line = yaw
            self._phase = _Phase.DRIVES
        else:
            self._arrive(place)

    def _drive(self, place: Place, dt: float) -> None:
        """Along the leg; when it is beside the line, it steers back to it."""
        leg = self._legs[0]
        sign = -1.0 if leg.backward else 1.0
        c, s = sign * math.cos(self._line), sign * math.sin(self._line)
        dx, dy = leg.x - place.x, leg.y - place.y
        left, beside = c * dx + s * dy, s * dx - c * dy
        turn = 4.0 * wrapped(self._line - math.atan(1.5 * beside) - place.yaw)
        speed = sign * _reachable(max(left, 0.0), SPEED, _ACCELERATION)
        self._command(speed, min(max(turn, -TURN_SPEED), TURN_SPEED) if left > 0.05 else 0.0, dt)
        if left < _EXACT and self._stands():
            self._legs.pop(0)
            self._phase = _Phase.TURNS

    def _arrive(self, place: Place) -> None:
        """Ends when it is where it is to be, or tries once more."""
        off = math.hypot(self._goal.x - place.x, self._goal.y - place.y)
        turned = abs(wrapped(self._goal.yaw - place.yaw))
        if off <= POSITION_TOLERANCE and turned <= ANGLE_TOLERANCE:
            self._ending = Outcome(State.SUCCEEDED)
        elif self._corrections == _CORRECTIONS:
            self._ending = Outcome(State.ABORTED, f"it came to {off:.3f} m and {turned:.3f} rad beside its goal")
        else:
            self._corrections += 1
            self._phase = _Phase.PLANS

    def _command(self, speed: float, turn: float, dt: float, acceleration: float = _ACCELERATION) -> None:
        """What the base is told, no more suddenly than it can accelerate."""
        self._speed += min(max(speed - self._speed, -acceleration * dt), acceleration * dt)
        self._turn += min(max(turn - self._turn, -_TURN_ACCELERATION * dt), _TURN_ACCELERATION * dt)
        self._robot.set_base_velocity(self._speed, 0.0, self._turn)

    def _stands(self) -> bool:
        told = abs(self._speed) < _STANDS and abs(self._turn) < _STANDS_TURN
        return told and self._still >= _STANDS_AFTER

    def _refusal(self) -> str:
        """Why the goal cannot be; "" when it may."""
        if not self._robot.mobile:
            return f"robot {self._robot.id} has no base that drives"
        if not all(map(math.isfinite, self._goal)):
            return f"the goal {tuple(self._goal)} has numbers that are none"
        beyond = outside(self._world, self._goal)
        if beyond:
            return beyond
        fixed = Floor(footprint(self._robot), fixed_obstacles(self._world, self._robot))
        inside = fixed.in_the_way(self._goal)
        return f"the goal is inside {inside!r}" if inside else ""


def _reachable(left: float, most: float, acceleration: float) -> float:
    """The speed from which it still stops within what is left, with some reserve."""
    return min(most, 0.9 * math.sqrt(2 * acceleration * left), 10.0 * left)
