"""The main job, as a manufacturing system would have it done: one goal, a plan, its execution, and the proof."""

from __future__ import annotations

import argparse
import signal
import sys
import time
from pathlib import Path
from types import FrameType
from typing import Any, NoReturn, TextIO

import actionlib
import rospy

from skiros2_common.command_line.layout import Screen
from skiros2_common.core.errors import SkirosError, UnknownName
from skiros2_demo import run_check
from skiros2_demo.changes import changes
from skiros2_demo.onlooker import Onlooker
from skiros2_demo.plan_text import plan_lines
from skiros2_demo.system import END_SIGNALS, System, SystemDown
from skiros2_demo.world_state import WorldState
from skiros2_msgs.msg import AssignTaskAction, AssignTaskGoal
from skiros2_msgs.srv import ResourceGetDescriptions, SkillCommand, SkillCommandRequest
from skiros2_skill.command_line.watching import LineView, LiveView, View
from skiros2_skill.ros.utils import deserialize_skill

ROBOT = "/mobile_manipulator"
#: What the bag holds.
TOPICS = (
    "/wm/monitor",
    f"{ROBOT}/monitor",
    "/skill_managers/description",
    "/tm/task_plan/goal",
    "/tm/task_plan/cancel",
    "/tm/task_plan/status",
    "/tm/task_plan/feedback",
    "/tm/task_plan/result",
    "/tf",
    "/tf_static",
    "/rosout",
)
PLAN_TIMEOUT = 30.0


class Demo:
    """One run.

    :param options: see `_parser`.
    :param out: where to show it.
    """

    def __init__(self, options: argparse.Namespace, out: TextIO) -> None:
        self._options = options
        self._out = out

    def run(self) -> bool:
        """Runs it and returns whether the goal was reached, as the bag proves.

        :raises SkirosError: a part of the system fails; the text says which and why.
        """
        with System(self._options.folder, self._options.port) as system:
            self._say(f"Starting a system of its own: master on port {system.port}, logs in {self._options.folder}")
            try:
                self._run(system)
            finally:
                rospy.signal_shutdown("the demo is over")
            bag = system.bag
        return self._prove(bag)

    def _run(self, system: System) -> None:
        began_at = time.monotonic()
        system.start_master()
        system.start_recording(TOPICS)
        rospy.init_node("manufacturing_system", disable_signals=True)
        onlooker = Onlooker(ROBOT)
        arguments = [f"init_scene:={self._options.scene}"] if self._options.scene else []
        system.launch("skiros2_demo_skills", "demo.launch", "gui:=false", *arguments)
        self._wait_until_ready(system)
        self._say(f"World model, skill manager {ROBOT} and task manager are ready ({_since(began_at)})")

        before = onlooker.world()
        plan = self._plan(system, before)
        if plan:
            self._execute(system, onlooker, plan)
        self._title("What changed in the world")
        for line in changes(before, onlooker.world()) or ["nothing"]:
            self._say(f"  {line}")
        onlooker.close()
        system.stop_recording()

    # -- steps ---------------------------------------------------------------------------------------------------------

    def _wait_until_ready(self, system: System) -> None:
        self._task_manager = actionlib.ActionClient("tm/task_plan", AssignTaskAction)
        skills = rospy.ServiceProxy(f"{ROBOT}/get_skills", ResourceGetDescriptions)
        system.wait_for(lambda: _is_offered(skills), f"the skill manager {ROBOT}")
        skills()  # answers when all skills are loaded
        system.wait_for(
            lambda: self._task_manager.wait_for_server(rospy.Duration.from_sec(0.01)), "the task manager tm"
        )

    def _plan(self, system: System, world: WorldState) -> str:
        """Sends the goal and shows the plan. Returns it, "" when there is nothing to do."""
        product, tray = self._options.product, self._options.tray
        goal = f"(skiros:contain {_id_of(tray, world)} {_id_of(product, world)})"
        self._title(f"Goal: {product} in {tray}")
        self._say(f"  {goal}")
        began_at = time.monotonic()
        request = self._task_manager.send_goal(AssignTaskGoal(author="manufacturing_system", goals=goal))
        system.wait_for(lambda: request.get_result() is not None, "the task manager's answer", PLAN_TIMEOUT)
        result = request.get_result()
        self._title(f"Plan ({_since(began_at)})")
        if result.progress_code == run_check.NOTHING_TO_DO:
            self._say("  nothing to do")
            return ""
        if result.progress_code != run_check.PLAN_FOUND:
            raise SystemDown(f"no plan for {goal}: {result.progress_message}")
        for line in plan_lines(result.progress_message, world.name):
            self._say(f"  {line}")
        return str(result.progress_message)

    def _execute(self, system: System, onlooker: Onlooker, plan: str) -> None:
        """Has the skill manager run the plan, and shows its tree."""
        command = rospy.ServiceProxy(f"{ROBOT}/command", SkillCommand)
        skills = [step.toMsg() for step in deserialize_skill(plan).children]
        self._title("The tree as it runs")
        answer = command(
            author="manufacturing_system", action=SkillCommandRequest.START, execution_id=-1, skills=skills
        )
        if not answer.ok:
            raise SystemDown(f"the skill manager {ROBOT} refused the plan")
        deadline = time.monotonic() + self._options.timeout

        def check() -> None:
            system.check()
            if time.monotonic() > deadline:
                raise SystemDown(f"the task has not ended within {self._options.timeout:.0f} s")

        live = self._out.isatty()
        view: View = LiveView(self._out, lambda skill_type, label: ()) if live else LineView(self._out, Screen())

        def show(nodes: list[Any]) -> None:
            view.show(nodes)
            view.draw()

        nodes = onlooker.follow(answer.execution_id, show, check)
        if nodes[0].state != nodes[0].SUCCESS:
            self._say(f"  The task failed: {nodes[0].progress_message}")

    def _prove(self, bag: Path) -> bool:
        self._title(f"Proof from the bag alone ({bag})")
        findings = run_check.check(run_check.read_run(bag))
        for finding in findings:
            self._say(f"  {'✓' if finding.holds else '✗'} {finding.text}")
        return all(finding.holds for finding in findings)

    def _title(self, text: str) -> None:
        self._say(f"\n\033[1m{text}\033[0m" if self._out.isatty() else f"\n{text}")

    def _say(self, text: str) -> None:
        self._out.write(f"{text}\n")
        self._out.flush()


def main(arguments: list[str]) -> int:
    """The program. Returns the exit status: 0 goal reached, 1 not, 2 wrong arguments, 128 + n ended by signal n."""
    options = _parser().parse_args(arguments)
    ended_by = 0

    def end(number: int, _: FrameType | None) -> NoReturn:
        nonlocal ended_by
        ended_by = number
        raise KeyboardInterrupt

    for number in END_SIGNALS:
        signal.signal(number, end)
    try:
        return 0 if Demo(options, sys.stdout).run() else 1
    except KeyboardInterrupt:
        sys.stderr.write("\npick_place_demo: stopped; everything that it started has ended\n")
        return 128 + ended_by
    except (SkirosError, rospy.ROSException, rospy.ServiceException) as error:
        sys.stderr.write(f"pick_place_demo: {error}\n")
        return 1


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="pick_place_demo", description=__doc__)
    parser.add_argument("--product", default="Product A", help="label of what to move (%(default)s)")
    parser.add_argument("--tray", default="Tray B", help="label of where to put it (%(default)s)")
    parser.add_argument("--scene", default="", help="scene file in the demo's workspace; default: the demo's own")
    parser.add_argument("--folder", type=Path, default=Path("build/demo"), help="for bag and logs (%(default)s)")
    parser.add_argument("--port", type=int, default=0, help="the master's; default: a free one")
    parser.add_argument("--timeout", type=float, default=120.0, help="for the execution, in seconds (%(default)s)")
    return parser


def _id_of(label: str, world: WorldState) -> str:
    """The id of the element with that label.

    :raises UnknownName: there is none, or there are several.
    """
    found = [thing.id for thing in world.things.values() if thing.label == label]
    if len(found) != 1:
        labels = ", ".join(sorted({t.label for t in world.things.values() if t.label})) or "none"
        problem = "several elements are" if found else "no element is"
        raise UnknownName(f"{problem} labelled {label!r} in the scene; labels there: {labels}")
    return found[0]


def _is_offered(service: Any) -> bool:
    try:
        service.wait_for_service(0.01)
    except rospy.ROSException:
        return False
    return True


def _since(moment: float) -> str:
    return f"{time.monotonic() - moment:.1f} s"
