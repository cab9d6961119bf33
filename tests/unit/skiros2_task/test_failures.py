"""A catalogue of failures: a scene each, a goal or a skill that fails in it, and the sentence that says why.

The sentence is the first line of `plan`, `achieve`, `why` and `run`, in the window and in the page; details follow it.
The cell: a robot Alpha with a Hand at Table, a Shelf, and a Blue cup on Table. An operator changes the scene.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from skiros2_common.core.abstract_skill import SkillDescription
from skiros2_common.core.explanation import Explanation, cause_of
from skiros2_common.core.params import Param
from skiros2_common.core.world_element import Element
from skiros2_gui.app.tasks import failure_lines
from skiros2_gui.goal.plan import read_plan
from skiros2_skill.client.description import Why
from skiros2_skill.command_line.run_skills import _summary
from skiros2_skill.core.runtime.diagnosis import add_authors
from skiros2_skill.core.runtime.history import History, Record, record_of
from skiros2_skill.core.runtime.request import SkillRequest, TaskRefused, TaskStarter
from skiros2_skill.core.runtime.scheduler import Scheduler
from skiros2_skill.core.runtime.task import Task
from skiros2_skill.testing import SkillBench, describe
from skiros2_task.command_line.achieve import format_result
from skiros2_task.command_line.planning import _without_plan
from skiros2_task.core.engines import Limits, Outcome, PlannerAnswer
from skiros2_task.core.explain_no_plan import NoPlan
from skiros2_task.core.planning import PlanningResult, TaskPlanner, report_of
from skiros2_world_model.core.journal import Journal
from skiros2_world_model.core.local_world_model import LocalWorldModel, source_ontologies
from skiros2_world_model.core.world_model import WorldModel
from support.page import NODE, PageModule
from support.planning_world import (
    DRIVE,
    INFERRED,
    PICK,
    PLACE,
    REQUIRED,
    PlanningWorld,
    of_type,
    prop,
    related,
    skill,
)  # fmt: skip


class Cell:
    """The cell, with a journal as in the world model's node."""

    def __init__(self, folder: Path) -> None:
        journal = Journal(folder / "wm.journal")
        model = WorldModel(source_ontologies(), folder, journal=journal)
        self.close = journal.close
        self.operator = LocalWorldModel("/operator", model)
        self.world = PlanningWorld(LocalWorldModel("setup", model))
        self.table = self.world.thing("skiros:Location", "Table")
        self.shelf = self.world.thing("skiros:Location", "Shelf")
        self.cup = self.world.thing("skiros:Product", "Blue cup", inside=self.table)
        self.robot = self.hand = ""

    def alpha(self, *skills: Any) -> None:
        """Adds the robot with its hand."""
        self.robot = self.world.robot("Alpha", *skills, at=self.table)
        self.hand = self.world.gripper(self.robot)
        hand = self.operator.get_element(self.hand)
        hand.label = "Hand"
        self.operator.update_element(hand)

    def change(self, eid: str, key: str, value: object) -> None:
        element = self.operator.get_element(eid)
        element.setProperty(key, value)
        self.operator.update_element(element)

    def fill_hand(self) -> None:
        self.change(self.hand, "skiros:ContainerState", "Full")

    def take_cup(self) -> None:
        self.operator.set_relation(self.table, "skiros:contain", self.cup, False)

    def move_cup(self) -> None:
        self.take_cup()
        self.operator.set_relation(self.shelf, "skiros:contain", self.cup)


@pytest.fixture(scope="module")
def page() -> Iterator[PageModule | None]:
    """The page's code for causes; None without node, which comes with the gateway's packages."""
    if not NODE.exists():
        yield None
        return
    with PageModule("causes.js") as module:
        yield module


@pytest.fixture
def cell(tmp_path: Path) -> Iterator[Cell]:
    made = Cell(tmp_path)
    yield made
    made.close()


# -- goals without a plan ----------------------------------------------------------------------------------------------

CUP_ON_SHELF, CUP_IN_HAND = "(skiros:contain {shelf} {cup})", "(skiros:contain {hand} {cup})"
CUP_OFF_TABLE, AT_SHELF = "(not (skiros:contain {table} {cup}))", "(skiros:at {robot} {shelf})"

OPEN = skill("Open", [("Box", "skiros:LargeBox", REQUIRED)], post=[prop("Box", "skiros:ContainerState", "=", "Empty")])


def removed_from_the_table(cell: Cell) -> None:
    cell.alpha(DRIVE, PICK, PLACE)
    cell.operator.set_relation(cell.table, "skiros:contain", cell.cup, False)


def never_placed(cell: Cell) -> None:
    cell.alpha(DRIVE, PICK, PLACE)
    cell.cup = cell.operator.add_element(Element("skiros:Product", "Red cup")).id


def two_cups(cell: Cell) -> None:
    never_placed(cell)
    other = cell.operator.add_element(Element("skiros:Product", "Red cup"))
    cell.operator.set_relation(cell.table, "skiros:contain", other)


def complete(cell: Cell) -> None:
    cell.alpha(DRIVE, PICK, PLACE)


def without_a_skill_to_pick(cell: Cell) -> None:
    cell.alpha(DRIVE, PLACE)


def without_a_skill_to_drive(cell: Cell) -> None:
    cell.alpha(PICK, PLACE)


def occupied_hand(cell: Cell) -> None:
    cell.alpha(DRIVE, PICK)
    cell.fill_hand()


def without_a_hand(cell: Cell) -> None:
    cell.robot = cell.world.robot("Alpha", DRIVE, PICK, PLACE, at=cell.table)


def robot_nowhere(cell: Cell) -> None:
    cell.alpha(DRIVE, PICK, PLACE)
    cell.operator.set_relation(cell.robot, "skiros:at", cell.table, False)


def hand_of_another_robot(cell: Cell) -> None:
    cell.alpha()
    cell.world.robot("Beta", DRIVE, PICK, PLACE, at=cell.table)


def opens_nothing(cell: Cell) -> None:
    cell.alpha(DRIVE, OPEN)


def without_robots(cell: Cell) -> None:
    pass


NO_HAND = "No plan: pick needs a gripper effector for Gripper, but the scene has none."

#: By name: the scene, the goal, and the sentence.
NO_PLAN: dict[str, tuple[Callable[[Cell], None], str, str]] = {
    "removed by somebody": (
        removed_from_the_table, CUP_ON_SHELF,
        "No plan: Blue cup is nowhere: operator removed it from Table at HH:MM (0 s ago)."),
    "removed before it could be picked": (
        removed_from_the_table, CUP_IN_HAND,
        "No plan: Blue cup is nowhere: operator removed it from Table at HH:MM (0 s ago)."),
    "never in any place": (
        never_placed, CUP_ON_SHELF,
        "No plan: Red cup is nowhere."),
    "one of two with the same label": (
        two_cups, CUP_ON_SHELF,
        "No plan: Red cup (Product-N) is nowhere."),
    "unreachable for an arm that cannot drive": (
        without_a_skill_to_drive, CUP_ON_SHELF,
        "No plan: Alpha is at Table, not at Shelf, and no skill can change that."),
    "unreachable for a robot that cannot drive": (
        without_a_skill_to_drive, AT_SHELF,
        "No plan: Alpha is at Table, not at Shelf, and no skill can change that."),
    "robot at no place": (
        robot_nowhere, AT_SHELF,
        "No plan: Alpha is at no place, and no skill can change that."),
    "hand is occupied": (
        occupied_hand, CUP_IN_HAND,
        "No plan: container state of Hand is Full, not Empty, and no skill can change that."),
    "hand is occupied, and the place is to be cleared": (
        occupied_hand, CUP_OFF_TABLE,
        "No plan: container state of Hand is Full, not Empty, and no skill can change that."),
    "robot without a hand": (
        without_a_hand, CUP_ON_SHELF,
        NO_HAND),
    "robot without a hand is to clear a place": (
        without_a_hand, CUP_OFF_TABLE,
        NO_HAND),
    "wrong robot": (
        hand_of_another_robot, AT_SHELF,
        "No plan: Alpha does not offer the skill drive."),
    "hand of another robot": (
        hand_of_another_robot, CUP_IN_HAND,
        "No plan: Hand is a part of Alpha, and no skill can give it to Beta."),
    "no robot carries things": (
        opens_nothing, CUP_ON_SHELF,
        "No plan: Blue cup is in Table, and no skill can bring it to Shelf."),
    "no robot picks": (
        opens_nothing, CUP_IN_HAND,
        "No plan: Blue cup is in Table, and no skill can bring it to Hand."),
    "no robot clears a place": (
        opens_nothing, CUP_OFF_TABLE,
        "No plan: Table contains Blue cup, and no skill can change that."),
    "no robot moves furniture": (
        opens_nothing, "(skiros:contain {shelf} {table})",
        "No plan: Table is in the scene, and no skill can bring it to Shelf."),
    "no robot at all": (
        without_robots, CUP_ON_SHELF,
        "No plan: no robot in the world model offers skills."),
    "wrong class: a table is no product": (
        robot_nowhere, "(skiros:contain {shelf} {table})",
        "No plan: place needs a product for Object, but Table is a location."),
    "wrong class: a cup does not drive": (
        complete, "(skiros:at {cup} {shelf})",
        "No plan: drive needs an agent for Robot, but Blue cup is a product."),
    "wrong class: a hand is no place": (
        without_a_skill_to_pick, CUP_IN_HAND,
        "No plan: place needs a location for Place, but Hand is a gripper effector."),
    "class without elements": (
        complete, "(exists (?box - skiros:LargeBox) (skiros:contain {shelf} ?box))",
        "No plan: the goal can never hold; the scene has no element of class skiros:LargeBox, which the goal names."),
    "state that no skill makes": (
        complete, "(skiros:ContainerState_Broken {hand})",
        "No plan: container state of Hand is Empty, not Broken, and no skill can change that."),
    "value that no skill changes": (
        complete, "(> (skiros:SizeX {cup}) 2)",
        "No plan: Blue cup has no size x, and no skill can change that."),
    "contradiction": (
        complete, AT_SHELF + ", (not " + AT_SHELF + ")",
        "No plan: the goal asks for it and for the opposite: Alpha is at Shelf."),
    "parts that exclude each other": (
        complete, "(skiros:at {robot} {shelf}), (skiros:at {robot} {table})",
        "No plan: each part of the goal may be reachable alone, but not all parts together."),
}  # fmt: skip


@pytest.mark.parametrize("name", NO_PLAN)
def test_goal_without_a_plan_is_explained_in_one_sentence(cell: Cell, page: PageModule | None, name: str) -> None:
    scene, goal, sentence = NO_PLAN[name]
    scene(cell)
    planner = SimpleNamespace(name="exhaustive", solve=lambda *_: PlannerAnswer(Outcome.IMPOSSIBLE))
    result = TaskPlanner(cell.operator, planner, Limits()).plan(goal.format(**vars(cell)))  # type: ignore[arg-type]
    places = ("plan", "achieve", "window", *(("page", "page: job") if page else ()))
    assert first_lines_of_plan(result, page) == dict.fromkeys(places, sentence)
    assert result.why is not None
    assert NoPlan.from_json(result.why.to_json()).headline == result.why.headline


def first_lines_of_plan(result: PlanningResult, page: PageModule | None) -> dict[str, str]:
    """Returns the first line at each place that shows why there is no plan."""
    answer = SimpleNamespace(**report_of(result, lambda plan: pytest.fail("there is a plan")))
    achieved = SimpleNamespace(state=answer.state, message=answer.message, done="[]", explanations="[]")
    lines = {
        "plan": _without_plan(result).lines[0],
        "achieve": format_result(achieved, 0.1)[0][0],
        "window": read_plan("", answer, str).head,
    }
    if page:
        lines["page"] = page.call("causeOfNoPlan", {"message": answer.message})["sentence"]
        lines["page: job"] = page.call("causeOfJob", {"message": achieved.message})["sentence"]
    return {place: stable(line) for place, line in lines.items()}


def stable(line: str) -> str:
    """Returns a line without what differs from run to run."""
    line = re.sub(r"at \d\d:\d\d \(\d+ s ago\)", "at HH:MM (0 s ago)", line)
    return re.sub(r"(Product-|line )\d+", r"\1N", line)


# -- skills that fail --------------------------------------------------------------------------------------------------

WHERE = [("Place", Element("skiros:Location"), INFERRED), ("Object", Element("skiros:Product"), REQUIRED)]
THERE = related("Place", "skiros:contain", "Object")
GRIPPER = ("Gripper", Element("rparts:GripperEffector"), INFERRED)
SCREWDRIVER = ("Tool", Element("skiros:Tool"), INFERRED)

TAKE = describe("Take", WHERE, pre=[THERE])
GRIP = describe("Grip", [GRIPPER], pre=[prop("Gripper", "skiros:ContainerState", "=", "Empty")])
CARRY = describe("Carry", WHERE, hold=[THERE])
FETCH = describe("Fetch", WHERE, post=[related("Place", "skiros:contain", "Object", False)])
LOOK = describe("Look", [("Place", Element("skiros:Location"), REQUIRED)], pre=[related("Robot", "skiros:at", "Place")])
SCREW = describe("Screw", [("Tool", Element("skiros:Tool"), INFERRED)], pre=[related("Robot", "skiros:hasA", "Tool")])
WEIGH = describe("Weigh", WHERE, pre=[prop("Object", "skiros:SizeX", "<", 0.5)])
PRESS = describe("Press", [("Object", Element("skiros:Product"), REQUIRED)], pre=[of_type("Object", "skiros:Product")])


SAY = describe("Say", [("Text", str, REQUIRED)])


class Push(SkillDescription):
    """Has a limited speed."""

    def createDescription(self) -> None:
        self.addParam("Speed", 0.5, REQUIRED, unit="m/s", minimum=0.0, maximum=1.5)


class Insert(SkillDescription):
    """Stops when the force is too large."""

    def createDescription(self) -> None:
        self.addHoldCondition(self.getSignalCond("Soft", "skiros:ForceSignal", "Robot", maximum=10.0))


@dataclass(frozen=True)
class Run:
    """A run of a skill.

    :param params: ids of the cell's elements by the names of its attributes, and other values.
    :param script: the outcomes of its ticks.
    :param offered: whether the robot has the skill.
    :param before, meanwhile: change the scene before the start, and after the first tick; `meanwhile` has the task too.
    """

    skill: Any
    params: dict[str, Any] = field(default_factory=dict)
    script: Any = "S"
    before: Callable[[Cell], object] = lambda cell: None
    meanwhile: Callable[[Cell, Task], object] = lambda cell, task: None
    offered: bool = True


def record_of_run(cell: Cell, run: Run) -> Record:
    """Runs a skill as a manager does, until it has ended."""
    cell.alpha()
    wm = cell.world.wm
    held = {key: wm.get_element(getattr(cell, v)) if v in vars(cell) else v for key, v in run.params.items()}
    run.before(cell)
    with SkillBench(wmi=wm, robot=wm.get_element(cell.robot)) as bench:
        if run.offered:
            bench.stand_in(run.skill, run.script)
        starter = TaskStarter(bench.library, wm, Scheduler(), History(), lambda: bench.robot)
        params = {key: Param(key, "", value, REQUIRED) for key, value in held.items()}
        try:
            task = starter.make("/client", [SkillRequest(f"skiros:{run.skill.__name__}", "", params)])
        except TaskRefused as refused:
            return refused.record
        task.tick()
        run.meanwhile(cell, task)
        while not task.ended.is_set():
            task.tick()
        return record_of(task)


def fails(message: str) -> Callable[[Any], object]:
    return lambda skill: skill.fail(message, -7)


def stop(text: str) -> Callable[[Cell, Task], object]:
    return lambda cell, task: task.preempt(stop=text)


def divides_by_zero(skill: Any) -> None:
    raise ZeroDivisionError("division by zero")


#: By name: the run, and the sentence.
FAILED: dict[str, tuple[Run, str]] = {
    "object was moved": (
        Run(TAKE, {"Place": "table", "Object": "cup"}, before=Cell.move_cup),
        "take did not start: Blue cup is in Shelf, not in Table: operator changed it at HH:MM (0 s ago)."),
    "object is nowhere": (
        Run(TAKE, {"Place": "table", "Object": "cup"}, before=Cell.take_cup),
        "take did not start: Blue cup is nowhere: operator removed it from Table at HH:MM (0 s ago)."),
    "object was removed from the scene": (
        Run(TAKE, {"Place": "table", "Object": "cup"}, before=lambda cell: cell.operator.remove_element(cell.cup)),
        "take did not start: 'Object': there is no element Blue cup in the scene, "
        "it was removed by operator at HH:MM (0 s ago)."),
    "no place has the object": (
        Run(TAKE, {"Object": "cup"}, before=Cell.take_cup),
        "take did not start: for Place, no location contains Blue cup "
        "(Table: contains nothing; Shelf: contains nothing)."),
    "hand is occupied": (
        Run(GRIP, {"Gripper": "hand"}, before=Cell.fill_hand),
        "grip did not start: container state of Hand is Full, not Empty: operator changed it at HH:MM (0 s ago)."),
    "no hand is free": (
        Run(GRIP, before=Cell.fill_hand),
        "grip did not start: for Gripper, no gripper effector with container state = 'Empty' "
        "(Hand: container state is 'Full')."),
    "no tool": (
        Run(SCREW),
        "screw did not start: the scene has no tool for Tool."),
    "wrong class": (
        Run(PRESS, {"Object": "table"}),
        "press did not start: Table is a location, not a product."),
    "no value": (
        Run(SAY),
        "say did not start: required parameter 'Text' (str) is not set."),
    "value out of limits": (
        Run(Push, {"Speed": 3.0}),
        "push did not start: 'Speed': expected 0 to 1.5 m/s, got 3.0."),
    "text for a number": (
        Run(Push, {"Speed": "fast"}),
        "push did not start: Speed: expected a value of type float, got str 'fast'."),
    "robot is elsewhere": (
        Run(LOOK, {"Place": "shelf"}),
        "look did not start: Alpha is at Table, not at Shelf: setup changed it at HH:MM (0 s ago)."),
    "too large": (
        Run(WEIGH, {"Object": "cup"}, before=lambda cell: cell.change(cell.cup, "skiros:SizeX", 0.8)),
        "weigh did not start: size x of Blue cup is 0.8, expected < 0.5: operator changed it at HH:MM (0 s ago)."),
    "taken away while the skill runs": (
        Run(CARRY, {"Place": "table", "Object": "cup"}, "RRS", meanwhile=lambda cell, task: cell.take_cup()),
        "carry was interrupted: Blue cup is nowhere: operator removed it from Table at HH:MM (0 s ago)."),
    "no effect": (
        Run(FETCH, {"Place": "table", "Object": "cup"}),
        "fetch ended without its effect: Table contains Blue cup."),
    "the skill says why": (
        Run(PRESS, {"Object": "cup"}, [fails("the button is stuck")]),
        "press failed: the button is stuck."),
    "driver lost": (
        Run(PRESS, {"Object": "cup"}, ["R", fails("Action server /arm/press is not available.")]),
        "press failed: Action server /arm/press is not available."),
    "timed out": (
        Run(PRESS, {"Object": "cup"}, ["R", fails("no answer of /arm/press for 5 s")]),
        "press failed: no answer of /arm/press for 5 s."),
    "error in the code": (
        Run(PRESS, {"Object": "cup"}, [divides_by_zero]),
        "press failed with an error in its code: ZeroDivisionError: division by zero "
        "(test_failures.py, line N, in divides_by_zero)."),
    "no sensor": (
        Run(Insert, script="R"),
        "insert was interrupted: Alpha has no signal force signal; it has: none."),
    "preempted by a client": (
        Run(PRESS, {"Object": "cup"}, "R", meanwhile=lambda cell, task: task.preempt(by="/window")),
        "press was preempted by window at HH:MM (0 s ago)."),
    "emergency stop": (
        Run(PRESS, {"Object": "cup"}, "R", meanwhile=stop("emergency stop by /cell: E1")),
        "press was stopped at HH:MM (0 s ago): emergency stop by /cell: E1."),
    "unknown skill": (
        Run(SAY, {"Text": "hello"}, offered=False),
        "Say did not start: no skill of type skiros:Say; known types: none."),
}  # fmt: skip


@pytest.mark.parametrize("name", FAILED)
def test_failed_skill_is_explained_in_one_sentence(cell: Cell, page: PageModule | None, name: str) -> None:
    run, sentence = FAILED[name]
    record = record_of_run(cell, run)
    add_authors(record.explanations, cell.world.wm)
    places = ("run", "why", "achieve", "window", *(("page", "page: job") if page else ()))
    assert first_lines_of_failure(record, page) == dict.fromkeys(places, sentence)


def first_lines_of_failure(record: Record, page: PageModule | None) -> dict[str, str]:
    """Returns the first line at each place that shows why a skill failed."""
    why = Why(str(record), [Explanation.from_json(each.to_json()) for each in record.explanations])
    result = SimpleNamespace(state=2, task_id=7, code=record.code, message=record.message, params=[])
    explanations = json.dumps(why.to_dict()["explanations"])
    message = cause_of(why.explanations, record.message)
    achieved = SimpleNamespace(state="failed", message=message, done="[]", explanations=explanations)
    lines = {
        "run": _summary(result, why.explanations, "/alpha", 0.1, set())[0][0],
        "why": why.text.splitlines()[0],
        "achieve": format_result(achieved, 0.1)[0][0],
        "window": failure_lines(why)[0],
    }
    if page:
        lines["page"] = page.call("causeOfRun", why.to_dict())
        lines["page: job"] = page.call("causeOfJob", {"message": message})["sentence"]
    return {place: stable(line) for place, line in lines.items()}
