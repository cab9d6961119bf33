"""Two compliant arms of the piston cell: the control rate that the simulator node holds in real time, what a simulated
second costs headless, and the time from an exceeded limit of the force to the stop.

A row has the required figure as its peer, where no other project does the same.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from pathlib import Path

from benchmarks.measurement import Measurement
from skiros2_learning.local.insertion_study import ARM, GRIPPER
from skiros2_sim.core.arm_controller import CONTROL_RATE, ArmController
from skiros2_sim.core.scene_reader import load_scene
from skiros2_sim.core.world import World
from skiros2_std_skills.core.driver_names import SWITCH_CONTROLLER, controller_topics
from support.ros import Ros

SCENE = Path(__file__).resolve().parents[2] / "skiros2_std_lib/demos/piston/scene/piston_scene.ttl"
#: Steps of the world per second, and steps between two updates of the torques.
RATE, PERIOD = 1000, 2
RUNS = 3
#: Wall time over which the node is measured (s).
REAL_TIME = 5.0
#: Tolerance of the measured rate: start and end are seen with the period of the clock.
_TOLERANCE = 1.02
_LIMIT = 20.0  # N


def measure(ros: Ros, folder: Path) -> Iterator[Measurement]:
    """Headless in this process, then by the node in real time."""
    yield from _measure_in_process()
    yield from _measure_node(ros)


def _measure_in_process() -> Iterator[Measurement]:
    with World(load_scene(SCENE, SCENE.parent), rate=RATE) as world:
        controllers = {
            eid: ArmController(world, robot, arm) for robot in world.robots.values() for eid, arm in robot.arms.items()
        }
        for controller in controllers.values():
            controller.switch(controller.names[1])
        world.step(RATE)
        seconds = sorted(_seconds_of(world, RATE) for _ in range(RUNS))[RUNS // 2]
        yield _required("CPU time of a simulated second of two compliant arms", seconds, "s", "real time", 1.0, RUNS)
        delays = sorted(_delay_of_stop(world, controllers[ARM]) for _ in range(RUNS))
        yield _required("force limit to stop, the worst", 1000 * delays[-1], "ms", "a control period", 2.0, RUNS)


def _measure_node(ros: Ros) -> Iterator[Measurement]:
    from rosgraph_msgs.msg import Clock

    from controller_manager_msgs.srv import SwitchController, SwitchControllerRequest
    from skiros2_sim_msgs.msg import ImpedanceState

    ros.launch("skiros2_sim", "sim.launch", scene=SCENE.name, workspace_dir=SCENE.parent, step_rate=RATE, rate=1.0)
    (robot,) = load_scene(SCENE, SCENE.parent).robots
    start = [arm.compliant_controller for arm in robot.arms]
    stop = [arm.position_controller for arm in robot.arms]
    switch = ros.service(SWITCH_CONTROLLER.format(robot=robot.name), SwitchController, 60.0)
    assert switch(start, stop, SwitchControllerRequest.STRICT, True, 0.0).ok
    for arm in robot.arms:
        space = controller_topics(robot.name, arm.name, arm.compliant_controller)
        ros.messages(f"{space}/state", ImpedanceState).wait_for(lambda state: state.active)
    clock = ros.messages("/clock", Clock)
    clock.wait_for()
    clock.clear()
    first, began = clock.wait_for(), time.perf_counter()
    last = clock.wait_for(lambda message: time.perf_counter() - began >= REAL_TIME, REAL_TIME + 30.0)
    wall, simulated = time.perf_counter() - began, (last.clock - first.clock).to_sec()
    period = 1000.0 * wall / (simulated * RATE / PERIOD)
    required = 1000.0 / CONTROL_RATE * _TOLERANCE
    yield _required("period of the control law, the node in real time, two arms", period, "ms", "500 Hz", required, 1)


def _seconds_of(world: World, steps: int) -> float:
    """Returns the CPU time of some steps (s)."""
    start = time.thread_time()
    world.step(steps)
    return time.thread_time() - start


def _delay_of_stop(world: World, controller: ArmController) -> float:
    """Returns the simulated time between a force above the limit at the wrist and the stop (s)."""
    controller.set_limits(_LIMIT, 0.0)
    world.push(GRIPPER, (2 * _LIMIT, 0.0, 0.0), duration=0.2)
    above = None
    while controller.stop is None:
        world.step()
        if above is None and math.hypot(*world.arms[ARM].measured_wrench()[:3]) > _LIMIT:
            above = world.time
    assert above is not None
    delay = controller.stop.time - above
    world.step(RATE)
    controller.set_limits(0.0, 0.0)
    return delay


def _required(name: str, figure: float, unit: str, peer: str, required: float, runs: int) -> Measurement:
    return Measurement(name, figure, unit, runs, peer, required, figure / required, 1.0)
