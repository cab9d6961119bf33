"""Moves the reference of a compliant arm on a straight line: skiros2_sim_msgs/CartesianTrajectory.

The tool follows as its stiffness and its contacts let it; wrench, stiffness and overlay motion may change meanwhile.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from skiros2_common.core.errors import Refused, SkirosError, WrongValue
from skiros2_motion.core.arm_kinematics import distances
from skiros2_motion.core.geometry import Pose, between
from skiros2_motion.core.motion import Outcome, State
from skiros2_motion.core.time_scaling import PEAK_SPEED, minimum_jerk
from skiros2_motion.core.wrench_guard import is_limit
from skiros2_sim.core.arm_controller import ArmController

#: Codes of the action's result.
SUCCESSFUL = 0
INVALID_GOAL = -1
CONTROLLER_INACTIVE = -2
FORCE_LIMIT = -3
STALE_SENSOR = -4
GOAL_TOLERANCE_VIOLATED = -5
PREEMPTED = -7

#: Defaults for 0 in a goal: speeds (m/s, rad/s), tolerances (m, rad), time (s).
SPEED, ANGULAR_SPEED = 0.1, 0.5
TRANSLATIONAL_TOLERANCE, ROTATIONAL_TOLERANCE = 0.005, 0.03
GOAL_TIME_TOLERANCE = 2.0
#: Maximum speeds of a goal (m/s, rad/s), and maximum length and rotation of a line (m, rad).
_FASTEST, _FASTEST_TURN = 1.0, 3.0
_MAX_LENGTH = 3.0
#: Maximum distance of the start from the current reference (m, rad).
_MAX_JUMP, _MAX_TURN = 0.02, 0.1


@dataclass(frozen=True)
class TrajectoryGoal:
    """A goal, with poses in the robot's frame. 0 stands for the defaults; negative tolerances are unlimited.

    :param start: None for the current reference.
    :param translational_tolerance: of the tool at the goal (m).
    :param rotational_tolerance: rad.
    :param goal_time_tolerance: time that the tool may need after its reference (s).
    """

    goal: Pose
    start: Pose | None = None
    speed: float = 0.0
    angular_speed: float = 0.0
    translational_tolerance: float = 0.0
    rotational_tolerance: float = 0.0
    goal_time_tolerance: float = 0.0


class ReferenceMotion:
    """A motion with a minimum-jerk profile."""

    def __init__(self, controller: ArmController, goal: TrajectoryGoal) -> None:
        self.outcome: Outcome | None = None
        self._controller, self._goal = controller, goal
        self._time = 0.0
        self._start = goal.start or controller.impedance.reference
        self._duration = 0.0
        try:
            self._check()
            controller.check_active()
        except Refused as error:
            self.outcome = Outcome(State.REJECTED, str(error), self._code())
        except SkirosError as error:
            self.outcome = Outcome(State.REJECTED, str(error), INVALID_GOAL)
        else:
            length, turn = distances(self._start, goal.goal)
            speeds = goal.speed or SPEED, goal.angular_speed or ANGULAR_SPEED
            self._duration = PEAK_SPEED * max(length / speeds[0], turn / speeds[1])

    @property
    def progress(self) -> float:
        """Completed fraction of the line, of the reference."""
        return minimum_jerk(self._time, self._duration)

    def errors(self) -> tuple[float, float]:
        """Returns the distance (m) and the angle (rad) between the tool and its reference, without overlay motion."""
        return distances(self._controller.tool_pose(), self._controller.impedance.reference)

    def update(self, dt: float) -> None:
        """Advances the reference by `dt` seconds."""
        if self.outcome is not None:
            return
        try:
            self._controller.check_active()
        except Refused as error:
            self.outcome = Outcome(State.ABORTED, str(error), self._code())
            return
        self._time += dt
        self._controller.set_reference(between(self._start, self._goal.goal, self.progress))
        if self._time >= self._duration:
            self._check_arrival()

    def cancel(self) -> None:
        """Keeps the current reference."""
        self.outcome = Outcome(State.PREEMPTED, "cancelled", PREEMPTED)

    def _code(self) -> int:
        """Returns the code for a controller that refuses commands."""
        stop = self._controller.stop
        if stop is None:
            return CONTROLLER_INACTIVE
        return FORCE_LIMIT if is_limit(stop.quantity) else STALE_SENSOR

    def _check_arrival(self) -> None:
        goal = self._goal
        off, turned = distances(self._controller.tool_pose(), goal.goal)
        far, tilted = (
            tolerance if tolerance > 0.0 else default if tolerance == 0.0 else math.inf
            for tolerance, default in (
                (goal.translational_tolerance, TRANSLATIONAL_TOLERANCE),
                (goal.rotational_tolerance, ROTATIONAL_TOLERANCE),
            )
        )
        if off <= far and turned <= tilted:
            self.outcome = Outcome(State.SUCCEEDED, "", SUCCESSFUL)
        elif self._time > self._duration + (goal.goal_time_tolerance or GOAL_TIME_TOLERANCE):
            text = f"the tool is {off:.4f} m and {turned:.3f} rad from the goal: expected {far:g} m and {tilted:g} rad"
            self.outcome = Outcome(State.ABORTED, text, GOAL_TOLERANCE_VIOLATED)

    def _check(self) -> None:
        """Checks the goal.

        :raises WrongValue: a number is out of range; the text lists all of them.
        """
        goal = self._goal
        problems = [
            f"{name} {getattr(goal, name)}: expected a number from {least:g} to {most:g}"
            for name, least, most in (
                ("speed", 0.0, _FASTEST),
                ("angular_speed", 0.0, _FASTEST_TURN),
                ("translational_tolerance", -math.inf, math.inf),
                ("rotational_tolerance", -math.inf, math.inf),
                ("goal_time_tolerance", 0.0, 3600.0),
            )
            if not least <= getattr(goal, name) <= most
        ]
        if not max(map(abs, goal.goal.position)) <= _MAX_LENGTH:
            problems.append(f"goal at {goal.goal.position} in the robot's frame: expected up to {_MAX_LENGTH:g} m")
        if goal.start is not None:
            off, turned = distances(goal.start, self._controller.impedance.reference)
            if not (off <= _MAX_JUMP and turned <= _MAX_TURN):
                limit = f"expected up to {_MAX_JUMP:g} m and {_MAX_TURN:g} rad"
                problems.append(f"start is {off:.3f} m and {turned:.3f} rad from the current reference: {limit}")
        if self._controller.impedance.is_guided:
            problems.append("the stiffness is 0 in all directions: the reference follows the tool")
        if problems:
            raise WrongValue("; ".join(problems))
