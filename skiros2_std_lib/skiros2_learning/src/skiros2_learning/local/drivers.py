"""The drivers of the robots of a simulated world, in this process: clients of skills reach them without a ROS master.

Goals become motions by the same code as in the simulator's node (`skiros2_sim.ros.jobs`). The owner steps the world;
the result of a goal is delivered at the end of the step call in which its motion has ended.
"""

from __future__ import annotations

import itertools
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from typing import Any, cast

import actionlib
import rospy
from actionlib import CommState
from actionlib_msgs.msg import GoalStatus

from controller_manager_msgs.srv import SwitchControllerResponse
from skiros2_common.core.errors import Refused, SkirosError
from skiros2_common.ros.connections import ServerWatch
from skiros2_learning.core.sections import near
from skiros2_motion.core.motion import Outcome, State
from skiros2_sim.core.arm_controller import ArmController
from skiros2_sim.core.robot import Robot
from skiros2_sim.core.scene_spec import ArmSpec
from skiros2_sim.core.world import World
from skiros2_sim.ros.device_server import Job
from skiros2_sim.ros.frames import Frames
from skiros2_sim.ros.jobs import BaseJob, CartesianJob, GripperJob, JointJob
from skiros2_sim.ros.publishers import SimulatedClock
from skiros2_skill.testing.faults import replaced
from skiros2_std_skills.core import driver_names as names


class LocalDrivers:
    """The actions and services of all robots of a world.

    :ivar controllers: by id of the arm.
    """

    def __init__(self, world: World) -> None:
        self.world = world
        self.controllers: dict[str, ArmController] = {}
        self._frames = Frames(world)
        #: Action -> id of its device and what makes a job of a goal.
        self._actions: dict[str, tuple[str, Callable[[Any], Job]]] = {}
        self._services: dict[str, Callable[[Any], Any]] = {}
        #: Id of the device -> the goal that it executes.
        self._running: dict[str, tuple[LocalClient, Job, Any]] = {}
        self._lock = threading.Lock()  # services are called in threads of their own
        for robot in world.robots.values():
            self._add_robot(robot)

    @property
    def now(self) -> rospy.Time:
        """The simulated time; not 0, which rospy takes for "no time"."""
        return rospy.Time.from_sec(self.seconds)

    @property
    def seconds(self) -> float:
        return (self.world.steps + 1) / self.world.rate

    def step(self, count: int) -> None:
        """Makes steps of the world, then delivers the results of the motions that have ended."""
        with self._lock:
            self.world.step(count)
        for device, (client, job, motion) in list(self._running.items()):
            if motion.outcome is not None:
                del self._running[device]
                client.end(motion.outcome, job.result(motion.outcome))

    @contextmanager
    def installed(self) -> Iterator[None]:
        """Inside the `with` block, action clients and service proxies that this process makes reach these drivers."""
        with ExitStack() as stack:
            stack.enter_context(replaced(actionlib, "SimpleActionClient", self.client))
            stack.enter_context(replaced(rospy, "ServiceProxy", self.service))
            stack.enter_context(replaced(ServerWatch, "is_connected", lambda watch: self.has(watch.name)))
            yield

    def client(self, name: str, kind: Any) -> LocalClient:
        """Replaces `actionlib.SimpleActionClient(name, kind)`."""
        return LocalClient(self, name if name.startswith("/") else f"/{name}")

    def service(self, name: str, kind: Any) -> LocalService:
        """Replaces `rospy.ServiceProxy(name, kind)`."""
        return LocalService(self, name if name.startswith("/") else f"/{name}")

    # -- for the clients -------------------------------------------------------------------------------------------

    def has(self, action: str) -> bool:
        """Whether an action exists."""
        return action in self._actions

    def start(self, client: LocalClient, goal: Any) -> None:
        """Starts the motion of a goal; one that the device executes is preempted."""
        device, make = self._actions[client.ns]
        try:
            job = make(goal)
            motion = job.begin(self.world)
        except SkirosError as error:
            client.end(Outcome(State.REJECTED, str(error)), None)
            return
        before = self._running.pop(device, None)
        if before is not None:
            self.world.motions.remove(before[2])
            ended = Outcome(State.PREEMPTED, "another goal took its place")
            before[0].end(ended, before[1].result(ended))
        if motion.outcome is not None:
            client.end(motion.outcome, job.result(motion.outcome))
            return
        self.world.motions.add(motion)
        self._running[device] = client, job, motion

    def cancel(self, client: LocalClient) -> None:
        """Cancels the goal of a client, if it is still executed."""
        for running, _, motion in self._running.values():
            if running is client:
                motion.cancel()

    def call(self, service: str, request: Any) -> Any:
        """Calls a service. Any thread.

        :raises Refused: there is no such service.
        """
        if service not in self._services:
            raise Refused(f"no service {service!r} in the simulation without ROS; {near(service, self._services)}")
        with self._lock:
            return self._services[service](request)

    # -- internal --------------------------------------------------------------------------------------------------

    def _add_robot(self, robot: Robot) -> None:
        spec, clock = robot.spec, cast(SimulatedClock, self)
        move = spec.move_action or names.MOVE.rule.format(robot=spec.name)
        if spec.base is not None and spec.base.model:
            self._actions[move] = spec.id, lambda goal: BaseJob(goal, spec.id, clock, self._frames)
        for eid, arm in robot.arms.items():
            self.controllers[eid] = ArmController(self.world, robot, arm)
            self._add_arm(spec.name, eid, arm.spec, clock)
        self._services[names.SWITCH_CONTROLLER.format(robot=spec.name)] = self._switch(robot)

    def _add_arm(self, robot: str, eid: str, spec: ArmSpec, clock: SimulatedClock) -> None:
        trajectory = spec.trajectory_action or names.TRAJECTORY.rule.format(robot=robot, part=spec.name)
        straight = spec.cartesian_action or names.CARTESIAN.rule.format(robot=robot, part=spec.name)
        self._actions[trajectory] = eid, lambda goal: JointJob(goal, eid, self.controllers, clock)
        self._actions[straight] = eid, lambda goal: CartesianJob(goal, eid, self.controllers, clock, self._frames)
        if spec.gripper is not None:
            gripper = spec.gripper.id
            action = spec.gripper.action or names.GRIPPER.rule.format(robot=robot, part=spec.gripper.name)
            self._actions[action] = gripper, lambda goal: GripperJob(goal, gripper)

    def _switch(self, robot: Robot) -> Callable[[Any], Any]:
        def switch(request: Any) -> Any:
            for controller in (self.controllers[eid] for eid in robot.arms):
                for name in request.start_controllers:
                    short = name.removeprefix(f"{controller.arm.name}/")
                    if short in controller.names:
                        controller.switch(short)
            return SwitchControllerResponse(ok=True)

        return switch


class LocalClient:
    """The part of `actionlib.SimpleActionClient` that skills use."""

    _counter = itertools.count(1)

    def __init__(self, drivers: LocalDrivers, name: str) -> None:
        self.ns = name
        self.action_client = self
        self.gh: LocalClient | None = None  # the handle of the goal, which is the client itself
        self._drivers = drivers
        self._done: Callable[[int, Any], None] | None = None
        self._outcome: Outcome | None = None
        self._result: Any = None

    @property
    def last_status_msg(self) -> Any:
        """Another value at each access if the action exists: such a server never counts as silent."""
        return next(self._counter) if self.is_connected() else None

    def is_connected(self) -> bool:
        """Whether the action exists."""
        return self._drivers.has(self.ns)

    def wait_for_server(self, timeout: Any = None) -> bool:
        return self.is_connected()

    def send_goal(self, goal: Any, done_cb: Any = None, active_cb: Any = None, feedback_cb: Any = None) -> None:
        """Starts a goal. There is no feedback."""
        self.gh, self._outcome, self._result, self._done = self, None, None, done_cb
        self._drivers.start(self, goal)

    def end(self, outcome: Outcome, result: Any) -> None:
        """Delivers the result of the goal."""
        if self.gh is None:
            return
        self._outcome, self._result = outcome, result
        if self._done is not None:
            self._done(int(outcome.state), result)

    def cancel_goal(self) -> None:
        self._drivers.cancel(self)

    cancel_all_goals = cancel_goal

    def stop_tracking_goal(self) -> None:
        self.gh = self._done = None

    def stop(self) -> None:
        """Does nothing: there is no connection."""

    def get_state(self) -> int:
        if self._outcome is not None:
            return int(self._outcome.state)
        return int(GoalStatus.ACTIVE if self.gh is not None else GoalStatus.LOST)

    get_terminal_state = get_state

    def get_comm_state(self) -> int:
        return int(CommState.DONE if self._outcome is not None else CommState.ACTIVE)

    def get_result(self) -> Any:
        return self._result

    def get_goal_status_text(self) -> str:
        return self._outcome.text if self._outcome is not None else ""


class LocalService:
    """The part of `rospy.ServiceProxy` that skills use."""

    def __init__(self, drivers: LocalDrivers, name: str) -> None:
        self.resolved_name = name
        self._drivers = drivers

    def __call__(self, request: Any) -> Any:
        return self._drivers.call(self.resolved_name, request)
