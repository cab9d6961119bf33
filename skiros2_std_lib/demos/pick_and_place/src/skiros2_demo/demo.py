"""Runs the pick-and-place demo: one goal, its plan, its execution, and the check of the result."""

from __future__ import annotations

import argparse
import contextlib
import queue
import sys
import time
import xmlrpc.client
from collections.abc import Sequence
from pathlib import Path
from random import Random
from typing import Any, TextIO

import actionlib
import rospy

from skiros2_bags.core.run import Finding
from skiros2_common.command_line.command import Parser
from skiros2_common.command_line.layout import next_commands
from skiros2_common.core.errors import Refused, SkirosError
from skiros2_common.core.processes import exit_status
from skiros2_common.core.world_element import Element
from skiros2_common.ros.private_system import PrivateSystem, SystemDown
from skiros2_demo.film import Film
from skiros2_demo.progress_report import ProgressReport
from skiros2_demo.run_check import Step, Thing, WorldState, changes, check, name_of, read_run
from skiros2_demo.simulation import VIEW, Disturbance, Moved, Pictures, Simulation, Slip, simulated_launch
from skiros2_motion.core.geometry import Pose, composed, from_euler
from skiros2_msgs.msg import AchieveAction, AchieveFeedback, AchieveGoal, AchieveResult, TreeProgress
from skiros2_msgs.srv import ResourceGetDescriptions
from skiros2_runs.core.progress import NodeMessage
from skiros2_std_skills.core.driver_names import COLOUR, part_name
from skiros2_world_model.core.scene import ROOT
from skiros2_world_model.ros.world_model_interface import WorldModelInterface

#: What to type next, in the folder of the clone.
NEXT = {
    "make demo DEMO_ARGS='--disturb slip'": "the product slips out of the gripper: a new plan",
    "make demo DEMO=factory": "ten jobs of a factory for this cell",
    ". install/setup.sh && roslaunch skiros2_demo_skills demo.launch gui:=false": "see docs/tutorials/01_first_goal.md",
}
#: Maximum delay of the recorder (s).
RECORDER_LAG = 1.0
#: Name of the recorder's node.
_RECORDER = "/recorder"


class System(PrivateSystem):
    """A running system; a context manager.

    :param folder: for the bag and the logs.
    :param port: of the master; 0 for a free one.
    """

    def __init__(self, folder: Path, port: int = 0) -> None:
        super().__init__("demo", folder, port)
        self.bag = folder / "run.bag"
        folder.mkdir(parents=True, exist_ok=True)
        for old in (self.bag, self.bag.with_suffix(".bag.active")):
            old.unlink(missing_ok=True)

    def start_recording(self, robot: str) -> None:
        """Starts a recorder, and waits until it has subscribed.

        :param robot: the skill manager to expect.
        :raises SystemDown: the recorder exits.
        :raises TimedOut: the recorder is not ready in time.
        """
        options = ["--force", "--no-check", "--evidence", "-o", str(self.bag), "--robots", robot]
        command = ["rosrun", "skiros2_bags", "record", *options]
        self.start("recorder", command)
        self.wait_for(lambda: "recording to" in self.log("recorder").read_text(errors="replace"), "the recorder")

    def wait_for_recorder(self, node: str, topic: str) -> None:
        """Waits until the recorder is connected to a publisher. Needs an initialised node.

        :param node, topic: of the publisher.
        :raises TimedOut: it is not connected in time.
        """
        asked = xmlrpc.client.ServerProxy(rospy.get_master().lookupNode(node)[2])

        def is_connected() -> bool:
            connections: Any = asked.getBusInfo(rospy.get_name())
            return any(each[1] == _RECORDER and each[4] == topic and each[5] for each in connections[2])

        self.wait_for(is_connected, f"the recorder of {topic}")

    def stop_recording(self) -> None:
        """Stops the recorder, which completes the bag."""
        # There is no acknowledgement: wait for the last messages. The nodes must not exit first: they remove their
        # skills from the scene, which is not part of the run.
        time.sleep(RECORDER_LAG)
        self.end("recorder")


#: A list of `SkillProgress` (a tree), an `AchieveFeedback`, or an `AchieveResult`.
Event = Any


class RunEvents:
    """Subscribes on creation, until `close`. Needs an initialised node.

    :param robot: name of the skill manager, with its leading slash.
    """

    def __init__(self, robot: str) -> None:
        self._events: queue.SimpleQueue[Event] = queue.SimpleQueue()
        self._subscriber = rospy.Subscriber(f"{robot}/monitor", TreeProgress, self._on_progress)

    def close(self) -> None:
        """Unsubscribes."""
        self._subscriber.unregister()

    def on_feedback(self, handle: Any, feedback: Any) -> None:
        """Adds feedback of a goal. Thread-safe."""
        self._events.put(feedback)

    def on_transition(self, handle: Any) -> None:
        """Adds the result of a goal, once there is one. Thread-safe."""
        if handle.get_comm_state() == actionlib.CommState.DONE:
            self._events.put(handle.get_result())

    def next_event(self, timeout: float) -> Event | None:
        """Returns the next event; None after the timeout (s)."""
        try:
            return self._events.get(timeout=timeout)
        except queue.Empty:
            return None

    def _on_progress(self, message: Any) -> None:
        if message.progress:
            self._events.put(message.progress)


ROBOT = "/mobile_manipulator"
#: Standard deviation of the depth of the robot's camera (m).
NOISE = 0.002
DISTURBANCES = ("moved", "slip")
_DISTURB = (
    "what goes wrong: somebody puts the product into another tray while the robot drives (moved), or the gripper loses "
    "its grip while the arm lifts (slip); may be given twice"
)
#: Period of waiting for events (s).
_PERIOD = 0.2
#: Maximum delay of the end of a task after the end of the goal (s).
_LATE = 1.0


class Demo:
    """One run of the demo. Subclasses run other cells.

    :param options: see `add_options`.
    :param out: for the report.
    """

    #: Name of the skill manager.
    robot = ROBOT
    view = VIEW  # of the pictures, see `camera_view`
    next = NEXT  # what to type next, and what it shows

    def __init__(self, options: argparse.Namespace, out: TextIO) -> None:
        self._options = options
        self._world = WorldState()
        self._report = ProgressReport(out, lambda thing: self._world.name(thing))
        self._pictures: Pictures | None = None
        self._film: Film | None = None
        self._disturbances: list[Disturbance] = []
        self._disturbance_log: list[str] = []
        self._goal: Any = None

    def run(self) -> bool:
        """Runs the demo. Returns whether the bag, and the simulated world if there is one, show that the goal was
        reached.

        :raises SkirosError: a part of the system fails.
        """
        with System(self._options.folder, self._options.port) as system:
            self._report.say(
                f"Starting a system of its own: master on port {system.port}, logs in {self._options.folder}"
            )
            truth = self._run(system)
        goal_run = read_run(system.bag)
        self._report.title("What changed in the world")
        for line in changes(goal_run.before, goal_run.after) or ["nothing"]:
            self._report.say(f"  {line}")
        held = self._show(f"Proof from the bag alone ({system.bag})", check(goal_run))
        if truth:
            held &= self._show("Proof from the simulated world", truth)
        if self._options.disturb:
            held &= self._show("What was disturbed", self._disturbed())
        return held

    def _run(self, system: System) -> list[Finding]:
        """Runs the system. Returns the findings in the simulated world."""
        started = time.monotonic()
        system.start_recording(self.robot)
        system.init_node("manufacturing_system")
        events = RunEvents(self.robot)
        system.launch(*self.launch_arguments())
        simulated = not getattr(self._options, "timed", False)
        simulation = Simulation() if simulated else None
        task_manager = wait_until_ready(system, simulation, self.robot)
        self._report.say(
            f"World model, skill manager {self.robot}{', simulator' if simulated else ''} and task manager are ready "
            f"({_elapsed(started)})"
        )
        scene = WorldModelInterface(rospy.get_name()).get_branch(ROOT)
        self._world = WorldState.of(scene)
        product, tray = (self._world.labelled(label) for label in (self._options.product, self._options.tray))
        if simulation is not None:
            self.prepare(simulation, scene, product, tray)
        self.take_pictures("before")
        with self._film or contextlib.nullcontext():
            self._achieve(system, events, task_manager, f"(skiros:contain {tray.id} {product.id})")
        self.take_pictures("after")
        if self._film is not None:
            self._report.say(f"  film: {self._film.save(self._options.film)}")
        truth = self.check_truth(simulation, product, tray) if simulation is not None else []
        events.close()
        system.stop_recording()
        return truth

    # -- steps ---------------------------------------------------------------------------------------------------------

    def launch_arguments(self) -> list[str]:
        """Returns package, file and arguments to launch."""
        return _launch(self._options)

    def check_truth(self, simulation: Simulation, product: Thing, tray: Thing) -> list[Finding]:
        """Checks the result in the simulated world."""
        return simulation.check_placement(product, tray)

    def is_midway(self, steps: list[Step]) -> bool:
        """Whether it is time for the picture during the run."""
        return any(name_of(step) == "pick" and step["state"] == "succeeded" for step in steps)

    def continues(self, result: AchieveResult) -> str:
        """Returns what a person does after a goal was not reached, who then sends it again; "": nobody does."""
        return ""

    def watch(self, nodes: Sequence[NodeMessage]) -> None:
        """To override: the tree of a task has changed."""

    def add_disturbance(self, disturbance: Disturbance) -> None:
        """Adds a disturbance."""
        self._disturbances.append(disturbance)

    def prepare(self, simulation: Simulation, scene: list[Element], product: Thing, tray: Thing) -> None:
        """Prepares the simulated world, the disturbances and the pictures, before the goal is sent."""
        random = Random(self._options.seed)
        if self._options.seed:
            simulation.put(product.id, _displaced(simulation.pose_of(product.id), random))
        if "moved" in self._options.disturb:
            self._disturbances.append(Moved(simulation, self._world, product.id, tray.id, random))
        if "slip" in self._options.disturb:
            grippers = (thing for thing in self._world.things.values() if thing.type == "rparts:GripperEffector")
            self._disturbances.append(Slip(simulation, next(grippers)))
        self.prepare_pictures(simulation, scene)

    def prepare_pictures(self, simulation: Simulation, scene: list[Element]) -> None:
        """Aims the cameras."""
        if self._options.pictures:
            shown = [t for t in self._world.things.values() if all(t.size) or t.type == "cora:Robot"]
            places = [simulation.pose_of(thing.id).position for thing in shown]
            cameras = [element for element in scene if element.type == "skiros:DepthCamera"]
            topic = COLOUR.of(cameras[0], self.robot.strip("/"), part_name(cameras[0])) if cameras else ""
            self._pictures = Pictures(simulation, self._options.folder, places, topic, self._report.say, self.view)
            if self._options.film:
                goal, camera = f"{self._options.product} in {self._options.tray}", self._pictures.cell
                self._film = Film(goal, camera, self._options.film_period, self._world.name, self._report.say)

    def take_pictures(self, moment: str) -> None:
        if self._pictures is not None:
            self._pictures.take(moment)

    def _achieve(self, system: System, events: RunEvents, task_manager: Any, goal: str) -> None:
        """Sends the goal and reports its execution."""
        self._report.title(f"Goal: {self._options.product} in {self._options.tray}")
        self._report.say(f"  {goal}")
        started = time.monotonic()
        self._report.begin()
        request = AchieveGoal(author="manufacturing_system", goals=goal, max_replans=-1)
        # kept, since actionlib discards a goal without a handle
        self._goal = task_manager.send_goal(request, events.on_transition, events.on_feedback)
        while True:
            system.check()
            if time.monotonic() - started > self._options.timeout:
                raise SystemDown(f"the goal was not reached within {self._options.timeout:.0f} s")
            event = events.next_event(_PERIOD)
            if isinstance(event, AchieveResult):
                break
            if event is not None:
                self._handle(event)
        while self._report.runs and (late := events.next_event(_LATE)) is not None:
            self._handle(late)
        self._report.end()
        done = self.continues(event)
        if done:
            self._disturbance_log.append(f"the goal ended, and {done}")
            self._report.say(f"\nThe goal has ended after {_elapsed(started)}: {event.message}\n  ! {done}")
            self._achieve(system, events, task_manager, goal)
        else:
            self._print_result(event, _elapsed(started))

    def _handle(self, event: Any) -> None:
        if isinstance(event, AchieveFeedback):
            steps = self._report.feedback(event)
            reports = [disturbance.steps(steps) for disturbance in self._disturbances]
            if self._film is not None:
                self._film.steps(steps)
            if self.is_midway(steps):
                self.take_pictures("during")
        else:
            reports = [disturbance.tree(event) for disturbance in self._disturbances]
            self._report.tree(event)
            if self._film is not None:
                self._film.tree(event)
            self.watch(event)
        for text in filter(None, reports):
            if self._film is not None:
                self._film.event(text)
            self._disturbance_log.append(text)
            self._report.say(f"  ! {text}")

    def _print_result(self, result: Any, seconds: str) -> None:
        if result.state == result.NOTHING_TO_DO:
            self._report.say("  nothing to do")
        elif result.state == result.SUCCEEDED:
            self._report.say(f"\nThe goal is reached after {seconds}")
        else:
            raise Refused(f"the goal was not reached ({result.state} after {seconds}): {result.message}")

    def _disturbed(self) -> list[Finding]:
        """Checks that each disturbance occurred, and caused another plan if it needs one."""
        reasons = self._report.reasons
        plans = sum(disturbance.needs_plan for disturbance in self._disturbances)
        came = all(disturbance.done for disturbance in self._disturbances)
        return [
            Finding(came, "; ".join(self._disturbance_log) or "nothing was disturbed"),
            Finding(len(reasons) >= plans, f"replanned {len(reasons)} times"),
            *(Finding(True, f"because {reason}") for reason in reasons),
        ]

    def _show(self, title: str, findings: list[Finding]) -> bool:
        self._report.title(title)
        for finding in findings:
            self._report.say(f"  {'✓' if finding.holds else '✗'} {finding.text}")
        return all(finding.holds for finding in findings)


def main(arguments: list[str]) -> int:
    """Runs the program. Returns the exit status: 0 goal reached, 1 not reached, 2 wrong arguments, 128 + n after
    signal n."""
    parser = _parser()
    options = parser.parse_args(arguments)
    if options.timed and (options.disturb or options.gui):
        parser.error("--timed has no simulated world to disturb or to show")
    return run_demo(Demo(options, sys.stdout), "pick_place_demo")


def run_demo(demo: Demo, program: str) -> int:
    """Runs a demo and reports errors. Returns the exit status of the program."""
    try:
        if not demo.run():
            return 1
        sys.stdout.write(next_commands(demo.next))
        return 0
    except KeyboardInterrupt as interrupt:
        sys.stderr.write(f"\n{program}: stopped; everything that it started has ended\n")
        return exit_status(interrupt)
    except (SkirosError, rospy.ROSException, rospy.ServiceException) as error:
        sys.stderr.write(f"{program}: {error}\n")
        return 1


def _parser() -> argparse.ArgumentParser:
    parser = Parser(prog="pick_place_demo", description=__doc__)
    parser.add_argument("--product", default="Product A", help="label of what to move (%(default)s)")
    parser.add_argument("--tray", default="Tray B", help="label of where to put it (%(default)s)")
    parser.add_argument("--timed", action="store_true", help="no simulated world: motions that only take time")
    parser.add_argument("--disturb", choices=DISTURBANCES, action="append", default=[], help=_DISTURB)
    add_options(parser, rate=3.0, timeout=120.0)
    return parser


def add_options(parser: argparse.ArgumentParser, rate: float, timeout: float) -> None:
    """Adds the options of all demos.

    :param rate: default of simulated time, times real time.
    :param timeout: default for the execution (s).
    """
    parser.add_argument(
        "--seed",
        type=int,
        default=0,
        help="of the random numbers; 0 leaves the product where the scene has it (%(default)s)",
    )
    parser.add_argument("--rate", type=float, default=rate, help="simulated time, times real time (%(default)s)")
    parser.add_argument("--gui", action="store_true", help="show the simulated world in a window")
    parser.add_argument("--no-pictures", dest="pictures", action="store_false", help="save none")
    parser.add_argument("--film", type=Path, help="make a film of the cell, the tree and the plan: a GIF of this name")
    parser.add_argument("--film-period", type=float, default=0.5, help="seconds from picture to picture (%(default)s)")
    parser.add_argument("--scene", default="", help="scene file in the demo's workspace; default: the demo's own")
    parser.add_argument(
        "--folder", type=Path, default=Path("build/demo"), help="for bag, pictures and logs (%(default)s)"
    )
    parser.add_argument("--port", type=int, default=0, help="the master's; default: a free one")
    parser.add_argument("--timeout", type=float, default=timeout, help="for the execution, in seconds (%(default)s)")


def _launch(options: argparse.Namespace) -> list[str]:
    """Returns package, file and arguments to launch."""
    if options.timed:
        scene = [f"init_scene:={options.scene}"] if options.scene else []
        return ["skiros2_demo_skills", "demo.launch", "gui:=false", *scene]
    return [*simulated_launch(options, "skiros2_demo", "demo.launch"), f"noise:={NOISE}"]


def _displaced(pose: Pose, random: Random) -> Pose:
    """Returns a pose some centimetres beside another one, with another yaw."""
    x, y, turn = (random.uniform(-reach, reach) for reach in (0.03, 0.03, 0.4))
    return composed(pose, Pose((x, y, 0.0), from_euler(0.0, 0.0, turn)))


def wait_until_ready(system: System, simulation: Simulation | None, robot: str) -> Any:
    """Returns a connected client of the task manager, once the system is ready and the recorder connected."""
    task_manager = actionlib.ActionClient("tm/achieve", AchieveAction)
    if simulation is not None:
        system.wait_for(simulation.is_ready, "the simulator")
    skills = rospy.ServiceProxy(f"{robot}/get_skills", ResourceGetDescriptions)
    system.wait_for(lambda: _is_offered(skills), f"the skill manager {robot}")
    skills()  # returns when all skills are loaded
    system.wait_for(lambda: task_manager.wait_for_server(rospy.Duration.from_sec(0.01)), "the task manager tm")
    system.wait_for(lambda: task_manager.pub_goal.get_num_connections() > 1, "the recorder of the goal")
    return task_manager


def _is_offered(service: Any) -> bool:
    try:
        service.wait_for_service(0.01)
    except rospy.ROSException:
        return False
    return True


def _elapsed(moment: float) -> str:
    return f"{time.monotonic() - moment:.1f} s"
