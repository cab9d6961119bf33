"""Plans collision-free trajectories of an arm: skiros2_sim_msgs/PlanMotion.

A plan is made for the world as it is at its start, in which everything but the arm and the objects that it holds stands
still. Of several plans that are requested at the same time, the first is made first.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from skiros2_common.core.errors import Refused, SkirosError, WrongValue
from skiros2_motion.core.arm_kinematics import Solution
from skiros2_motion.core.geometry import Pose, composed, inverted
from skiros2_motion.core.motion import Outcome, Pieces, State, advance
from skiros2_motion.core.timed_path import timed_path
from skiros2_sim.core.arm_controller import ArmController
from skiros2_sim.core.joint_motion import JointGoal, JointPoint, order_of
from skiros2_sim.core.path_search import CHECKS, search_path
from skiros2_sim.core.planning_scene import ArmCollisions, PlanningScene, format_collisions
from skiros2_sim.core.world import RATE

Array = npt.NDArray[np.float64]

#: Codes of the action's result.
SUCCESSFUL = 0
INVALID_GOAL = -1
UNREACHABLE = -2
START_IN_COLLISION = -3
GOAL_IN_COLLISION = -4
NO_PATH = -5
PREEMPTED = -6

#: Planning time for 0 in a goal, and maximum (s of simulated time).
PLANNING_TIME, _MAX_PLANNING_TIME = 5.0, 60.0
#: Maximum clearance (m).
_MAX_CLEARANCE = 0.5
#: Fractions of the limits for 0 in a goal.
_VELOCITY_SCALING, _ACCELERATION_SCALING = 0.5, 0.5
#: Velocity limit of a joint whose model has none (rad/s or m/s).
_VELOCITY = 1.0
#: Models have no limits of acceleration: the time (s) in which a joint reaches its maximum velocity.
_REACHES_SPEED_IN = 0.4
#: Joint positions for a pose: number of random starts, maximum number of goals, distance of two different ones (rad).
_STARTS, _GOALS, _DIFFERENT = 40, 8, 0.1
#: Tolerance of the joint limits (rad or m).
_ROUNDING = 1e-3


class PlanningFailed(Refused):
    """There is no plan. `error_code` is that of the action's result."""

    def __init__(self, error_code: int, text: str) -> None:
        super().__init__(text)
        self.error_code = error_code


@dataclass(frozen=True)
class PlanningGoal:
    """A goal of skiros2_sim_msgs/PlanMotion: either positions of all joints, or the pose of the tool in the map.

    :param joints: names, with or without the prefix of the arm.
    :param positions: rad or m.
    :param planning_time: s of simulated time; 0: default.
    :param clearance: minimum distance (m) of the arm and held objects from everything else.
    :param velocity_scaling: fraction of the velocity limits, 0 to 1; 0: default.
    :param acceleration_scaling: fraction of the acceleration limits, 0 to 1; 0: default.
    :param seed: of the random search.
    """

    joints: Sequence[str] = ()
    positions: Sequence[float] = ()
    tool: Pose | None = None
    planning_time: float = 0.0
    clearance: float = 0.01
    velocity_scaling: float = 0.0
    acceleration_scaling: float = 0.0
    seed: int = 0


@dataclass(frozen=True)
class Plan:
    """A trajectory from the current positions of an arm.

    :param joints: names without the prefix of the arm.
    """

    joints: tuple[str, ...] = ()
    points: tuple[JointPoint, ...] = field(default=())


class ArmPlanning:
    """A search for a trajectory. It computes a few pieces in each step, and moves nothing.

    :param scene: a copy of the world of the controller; used by one search at a time.
    """

    def __init__(self, controller: ArmController, goal: PlanningGoal, scene: PlanningScene) -> None:
        self.outcome: Outcome | None = None
        #: The result; empty before success.
        self.plan = Plan()
        #: Duration of the search until now (s of simulated time).
        self.spent = 0.0
        self._controller, self._arm, self._world = controller, controller.arm, controller.world
        self._goal = goal
        self._scene = scene
        self._search: Pieces[Plan] | None = None
        self._wanted: Array | None = None
        try:
            self._wanted = self._checked()
        except SkirosError as error:
            self.outcome = Outcome(State.REJECTED, str(error), INVALID_GOAL)

    def update(self, dt: float) -> None:
        """Advances the search. Called before each step of the world."""
        if self.outcome is not None or not self._is_first():
            return
        self.spent += dt
        if self._search is None:
            self._search = self._planned()
        try:
            plan = advance(self._search, 1)
        except PlanningFailed as error:
            self.outcome = Outcome(State.ABORTED, str(error), error.error_code)
        else:
            if plan is not None:
                self.plan = plan
                duration = plan.points[-1].time
                self.outcome = Outcome(State.SUCCEEDED, f"a motion of {duration:.2f} s", SUCCESSFUL)

    def cancel(self) -> None:
        """Ends the search."""
        if self._search is not None:
            self._search.close()
        if self.outcome is None:
            self.outcome = Outcome(State.PREEMPTED, "cancelled", PREEMPTED)

    def _is_first(self) -> bool:
        """Whether no earlier search is active."""
        return next((motion for motion in self._world.motions if isinstance(motion, ArmPlanning)), self) is self

    # -- the goal ---------------------------------------------------------------------------------------------

    def _checked(self) -> Array | None:
        """Checks the goal. Returns the wanted joint positions in the order of the arm; None for a pose.

        :raises WrongValue: the goal is invalid; the text lists all problems.
        """
        goal, problems = self._goal, []
        for what, value, most in (
            ("planning time", goal.planning_time, _MAX_PLANNING_TIME),
            ("clearance", goal.clearance, _MAX_CLEARANCE),
            ("velocity scaling", goal.velocity_scaling, 1.0),
            ("acceleration scaling", goal.acceleration_scaling, 1.0),
        ):
            if not 0.0 <= value <= most:
                problems.append(f"{what} {value}: expected 0 to {most:g}")
        if goal.seed < 0:
            problems.append(f"seed {goal.seed}: expected 0 or more")
        wanted: Array | None = None
        if (goal.tool is None) == (not goal.joints and not goal.positions):
            problems.append("expected either joint positions or a pose of the tool")
        elif goal.tool is None:
            try:
                wanted = self._joint_positions()
            except SkirosError as error:
                problems.append(str(error))
        elif not all(map(math.isfinite, (*goal.tool.position, *goal.tool.orientation))):
            problems.append(f"the pose of the tool {goal.tool} is not finite")
        if problems:
            raise WrongValue("; ".join(problems))
        return wanted

    def _joint_positions(self) -> Array:
        goal, joints = self._goal, self._arm.joints
        prefix = self._arm.name + "/"
        names = tuple(name if name.startswith(prefix) else prefix + name for name in goal.joints)
        order = order_of(JointGoal(names, ()), joints)
        if len(goal.positions) != len(names):
            raise WrongValue(f"{len(goal.positions)} positions for {len(names)} joints")
        wanted = np.array([goal.positions[i] for i in order], dtype=float)
        lower, upper = self._controller.kinematics.lower, self._controller.kinematics.upper
        wrong = [
            f"{joint.name} at {value:.4f} is beyond its limits {low:.4f} to {high:.4f}"
            for joint, value, low, high in zip(joints, wanted, lower, upper, strict=True)
            if not low - _ROUNDING <= value <= high + _ROUNDING
        ]
        if wrong:
            raise WrongValue("; ".join(wrong))
        clipped: Array = np.clip(wanted, lower, upper)
        return clipped

    # -- the search -------------------------------------------------------------------------------------------

    def _planned(self) -> Pieces[Plan]:
        """Plans for the current state of the world.

        :raises PlanningFailed: there is no plan.
        """
        goal, kinematics, arm = self._goal, self._controller.kinematics, self._arm
        start = np.clip(arm.positions(), kinematics.lower, kinematics.upper)
        target = None if goal.tool is None else composed(inverted(self._controller.robot.pose()), goal.tool)
        checks = self._scene.collisions_of(self._world, self._controller.robot.id, arm.id, goal.clearance)
        deep = checks.accept_start(start)
        if deep:
            raise PlanningFailed(START_IN_COLLISION, f"the arm is in collision at the start: {format_collisions(deep)}")
        yield
        goals = yield from self._goals(checks, start, target)
        most = round((goal.planning_time or PLANNING_TIME) * RATE)
        try:
            corners = yield from search_path(
                checks.is_free, kinematics.lower, kinematics.upper, start, goals, goal.seed, most
            )
        except PlanningFailed:
            raise
        except Refused as error:
            raise PlanningFailed(NO_PATH, str(error)) from None
        velocities, accelerations = self._limits()
        timed = timed_path(corners, velocities, accelerations, checks.is_free)
        while (points := advance(timed, CHECKS)) is None:
            yield
        names = tuple(joint.name.removeprefix(arm.name + "/") for joint in arm.joints)
        return Plan(names, tuple(JointPoint(p.time, _floats(p.positions), _floats(p.velocities)) for p in points))

    def _goals(self, checks: ArmCollisions, start: Array, target: Pose | None) -> Pieces[list[Array]]:
        """Returns joint positions for the goal that are free of collisions.

        :raises PlanningFailed: there are none.
        """
        if target is None:
            assert self._wanted is not None
            candidates = [self._wanted]
        else:
            candidates = yield from self._solutions(start, target)
        free: list[Array] = []
        for positions in candidates:
            yield
            if checks.is_free(positions):
                free.append(positions)
        if not free:
            text = format_collisions(checks.collisions(candidates[0]))
            raise PlanningFailed(
                GOAL_IN_COLLISION,
                f"the arm would be in collision at the goal (clearance {self._goal.clearance:g} m): {text}",
            )
        return free

    def _solutions(self, start: Array, target: Pose) -> Pieces[list[Array]]:
        """Returns different joint positions for a pose of the tool, those near the start first.

        :raises PlanningFailed: the pose is out of reach.
        """
        kinematics = self._controller.kinematics
        best: Solution = yield from kinematics.search(target, start)
        if not best.converged:
            raise PlanningFailed(
                UNREACHABLE,
                f"no joint positions reach the target: the nearest are off by {best.off:.3f} m "
                f"and {best.turned:.3f} rad",
            )
        found = [best.positions]
        draw = np.random.default_rng(self._goal.seed)
        for _ in range(_STARTS):
            yield
            posture = kinematics.lower + (kinematics.upper - kinematics.lower) * draw.random(len(start))
            other = kinematics.inverse(target, posture, restarts=0)
            if other.converged and min(np.max(np.abs(other.positions - q)) for q in found) > _DIFFERENT:
                found.append(other.positions)
        first, *others = found
        others.sort(key=lambda q: float(np.linalg.norm(q - start)))
        return [first, *others[: _GOALS - 1]]

    def _limits(self) -> tuple[Array, Array]:
        """Returns the limits of velocity and acceleration of the joints."""
        goal = self._goal
        fastest = np.array([joint.velocity or _VELOCITY for joint in self._arm.joints])
        return (
            fastest * (goal.velocity_scaling or _VELOCITY_SCALING),
            fastest / _REACHES_SPEED_IN * (goal.acceleration_scaling or _ACCELERATION_SCALING),
        )


def _floats(values: Array) -> tuple[float, ...]:
    return tuple(float(value) for value in values)
