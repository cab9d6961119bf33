"""`skiros2 try`: a robot reaches goals, is disturbed, and explains a failure. Its motions only take time."""

from __future__ import annotations

import queue
import time
from collections.abc import Callable, Sequence
from importlib.resources import files
from pathlib import Path
from typing import TextIO

import skiros2_demo_skills
from skiros2_common.command_line.layout import Screen, styled
from skiros2_common.core.errors import Refused
from skiros2_common.core.world_element import Element
from skiros2_local.system import LocalGoal, LocalSystem
from skiros2_runs.core.progress import NodeMessage, has_ended
from skiros2_skill.command_line.views import View, view_of
from skiros2_task.core.step_record import StepState

ROBOT = "demo:mobile_manipulator"
LIBRARIES = ("skiros2_std_skills", "skiros2_demo_skills")
SKILLS = (
    *("move_base_timed", "move_arm_timed", "tuck_arm_timed", "open_gripper_timed", "close_gripper_timed"),
    *("wm_set_relation", "wm_set_properties", "wm_move_object", "drive", "pick", "place"),
)

#: Longest wait for a goal or a state of it (s).
_TIMEOUT = 120.0
#: Time from the start of a motion to a disturbance (s).
_MIDWAY = 0.5
_PERIOD = 0.05

CONTAINER_STATE = "skiros:ContainerState"


def demo_scene() -> Path:
    """The scene of the demo: in the source tree, or in an installed one.

    :raises Refused: it is in neither of them.
    """
    name = "pick_place_scene.ttl"
    package = Path(str(files(skiros2_demo_skills)))
    places = [package.parents[1] / "owl"]
    places += [folder / "share/skiros2_demo_skills/owl" for folder in package.parents]
    for folder in places:
        if (folder / name).is_file():
            return folder / name
    raise Refused(f"{name} is in none of: {', '.join(map(str, places))}")


class Tour:
    """Runs the tour.

    :param out: a terminal gets trees that are updated in place; other files one line per change.
    """

    def __init__(self, out: TextIO) -> None:
        self._out = out
        self._view: View = view_of(out, Screen())
        self._progress: queue.SimpleQueue[Sequence[NodeMessage]] = queue.SimpleQueue()
        self._running: set[int] = set()

    def run(self) -> bool:
        """Runs the tour. Returns whether each part ended as expected.

        :raises SkirosError: the scene or a skill cannot be loaded.
        """
        started = time.monotonic()
        with LocalSystem(demo_scene(), self._progress.put) as self.system:
            self.robot = self.system.add_robot(ROBOT, LIBRARIES, SKILLS)
            self._title(f"A robot, its skills and a world model run in this process ({_since(started)})")
            self._show_cell()
            return self._first_goal() and self._other_goal() and self._disturbed() and self._explained()

    # -- the parts -----------------------------------------------------------------------------------------------------

    def _first_goal(self) -> bool:
        goal = self._achieve("Product A", "Tray B")
        self._follow(goal, lambda: goal.has_ended)
        return self._end(goal)

    def _other_goal(self) -> bool:
        goal = self._achieve("Product C", "Tray A")
        self._follow(goal, lambda: _runs(goal, "drive"), _MIDWAY)
        self._say("! You want something else: the goal is cancelled, the robot stops")
        goal.cancel()
        self._follow(goal, lambda: goal.has_ended)
        return not goal.reached

    def _disturbed(self) -> bool:
        goal = self._achieve("Product B", "Tray A")
        self._follow(goal, lambda: self._holder("Product B").label == "Gripper" and _runs(goal, "drive"), _MIDWAY)
        self._say("! Somebody takes Product B out of the gripper and puts it back into Tray D")
        self._take_away("Product B", "Tray D")
        planned = len(goal.steps)
        self._follow(goal, lambda: goal.has_ended)
        return self._end(goal) and len(goal.steps) > planned

    def _explained(self) -> bool:
        self._title("A skill that cannot work here: pick Product A, which is at the other workstation")
        ended: queue.SimpleQueue[bool] = queue.SimpleQueue()
        thing = self.system.element("Product A")
        self.robot.start("skiros:Pick", "", {"Object": thing}, lambda good, *_: ended.put(good), "you")
        succeeded = ended.get(timeout=_TIMEOUT)
        self._say("\n".join(f"  {line}" for line in str(self.robot.why()).splitlines()))
        return not succeeded

    # -- steps ---------------------------------------------------------------------------------------------------------

    def _achieve(self, thing: str, container: str) -> LocalGoal:
        self._title(f"Goal: {thing} in {container}")
        self._shown = 0
        text = f"(skiros:contain {self.system.element(container).id} {self.system.element(thing).id})"
        return self.system.achieve(text)

    def _end(self, goal: LocalGoal) -> bool:
        self._say(f"{goal.message[:1].upper()}{goal.message[1:]}")
        self._show_cell()
        return goal.reached

    def _follow(self, goal: LocalGoal, until: Callable[[], bool], delay: float = 0.0) -> None:
        """Shows trees until a condition holds, the goal has ended, or the time is over; then for `delay` s more."""
        deadline = time.monotonic() + _TIMEOUT
        while not (until() or goal.has_ended):
            if time.monotonic() > deadline:
                raise Refused(f"the goal has neither ended nor got on in {_TIMEOUT:.0f} s: {goal.message}")
            self._draw(goal)
        end = time.monotonic() + delay
        while time.monotonic() < end:
            self._draw(goal)
        while goal.has_ended and (self._draw(goal) or self._running) and time.monotonic() < deadline:
            pass  # the last progress follows

    def _draw(self, goal: LocalGoal) -> bool:
        """Shows a new plan and the next progress. Returns whether there was progress."""
        try:
            nodes = self._progress.get(timeout=_PERIOD)
        except queue.Empty:
            self._view.draw()
            return False
        if nodes[0].id not in self._running:
            self._show_plan(goal)
        (self._running.discard if has_ended(nodes) else self._running.add)(nodes[0].id)
        self._view.show(nodes)
        self._view.draw()
        return True

    def _show_plan(self, goal: LocalGoal) -> None:
        """Shows the steps that are new. The executor reports a plan just after it has started the first step."""
        deadline = time.monotonic() + _PERIOD
        while not _runs(goal) and time.monotonic() < deadline:
            time.sleep(0.001)
        new = [record for record in goal.steps if record.step.number > self._shown]
        if new:
            self._say("  Plan" if not self._shown else "  A new plan, because the old one no longer works")
            self._shown = new[-1].step.number
            for record in new:
                call = record.step.call
                values = "; ".join(f"{key}: {value.label}" for key, value in call.arguments if key != "Robot")
                self._say(f"    {record.step.number}. {call.label:<6} {values}")

    def _take_away(self, thing: str, container: str) -> None:
        """Changes the world model: a thing is in another container."""
        world, moved, target = self.system.world, self.system.element(thing), self.system.element(container)
        holder = self._holder(thing)
        world.set_relation(holder.id, "skiros:contain", moved.id, False)
        world.set_relation(target.id, "skiros:contain", moved.id)
        for element, state in ((holder, "Empty"), (target, "Full")):
            changed = world.get_element(element.id)
            changed.setProperty(CONTAINER_STATE, state)
            world.update_element_properties(changed)

    def _holder(self, thing: str) -> Element:
        (relation,) = self.system.element(thing).getRelations("", ["skiros:contain"], "-1")
        return self.system.world.get_element(relation["src"])

    def _show_cell(self) -> None:
        world = self.system.world
        robot = self.system.element(ROBOT)
        here = {relation["dst"] for relation in robot.getRelations("-1", ["skiros:at"], "")}
        places = world.resolve_elements(Element("skiros:Location"))
        for place in sorted(places, key=lambda place: place.label):
            contents = [world.get_element(r["dst"]) for r in place.getRelations("-1", ["skiros:contain"], "")]
            trays = [element for element in contents if world.is_subclass(element.type, "skiros:Container")]
            texts = [f"{tray.label}: {self._contents(tray)}" for tray in trays]
            if texts or place.id in here:
                self._say(f"  {'robot at' if place.id in here else '':<9}{place.label:<18}{'   '.join(texts)}".rstrip())

    def _contents(self, tray: Element) -> str:
        held = tray.getRelations("-1", ["skiros:contain"], "")
        return ", ".join(self.system.world.get_element(relation["dst"]).label for relation in held) or "empty"

    def _title(self, text: str) -> None:
        self._say(f"\n{styled(text, '1', self._out)}")

    def _say(self, text: str) -> None:
        self._out.write(f"{text}\n")
        self._out.flush()


def _runs(goal: LocalGoal, skill: str = "") -> bool:
    running = [record.step.call.label for record in goal.steps if record.state is StepState.RUNNING]
    return bool(running) and skill in (*running, "")


def _since(moment: float) -> str:
    return f"{time.monotonic() - moment:.1f} s"
