"""A catalogue of failures: a small scene each, a goal that cannot be reached, and the sentence that says why.

The sentence is the first line of `plan` and `achieve`, in the window and in the page; the details follow it.
The cell: a robot Alpha with a gripper at Table, a Shelf, and a Blue cup on Table.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from skiros2_common.core.world_element import Element
from skiros2_task.core.compiler import make_task
from skiros2_task.core.engines import Outcome
from skiros2_task.core.explain_no_plan import NoPlan, explain_no_plan, unusable_skills
from skiros2_task.core.goal_reader import GoalReader
from skiros2_task.core.world import WorldView
from skiros2_world_model.core.journal import Journal
from skiros2_world_model.core.local_world_model import LocalWorldModel, source_ontologies
from skiros2_world_model.core.world_model import WorldModel
from support.planning_world import DRIVE, PICK, PLACE, REQUIRED, PlanningWorld, prop, skill

OPEN = skill("Open", [("Box", "skiros:LargeBox", REQUIRED)], post=[prop("Box", "skiros:ContainerState", "=", "Empty")])


class Cell:
    """The cell, with a journal as in the world model's node."""

    def __init__(self, folder: Path) -> None:
        journal = Journal(folder / "wm.journal")
        model = WorldModel(source_ontologies(), folder, journal=journal)
        self.close = journal.close
        self.root = LocalWorldModel("root", model)
        self.world = PlanningWorld(LocalWorldModel("setup", model))
        self.table = self.world.thing("skiros:Location", "Table")
        self.shelf = self.world.thing("skiros:Location", "Shelf")
        self.cup = self.world.thing("skiros:Product", "Blue cup", inside=self.table)
        self.robot, self.gripper = "", ""

    def alpha(self, *skills: object) -> None:
        """Adds the robot with its gripper."""
        self.robot = self.world.robot("Alpha", *skills, at=self.table)  # type: ignore[arg-type]
        self.gripper = self.world.gripper(self.robot)
        gripper = self.root.get_element(self.gripper)
        gripper.label = "Hand"
        self.root.update_element(gripper)

    def change(self, eid: str, key: str, value: object) -> None:
        element = self.root.get_element(eid)
        element.setProperty(key, value)
        self.root.update_element(element)

    def plan(self, goal: str) -> NoPlan:
        """Explains why there is no plan; the text names elements by their attributes here."""
        view = WorldView(self.root)
        task = make_task(view, GoalReader(view, set()).read(goal.format(**vars(self))))
        assert not task.satisfied
        return explain_no_plan(task, Outcome.IMPOSSIBLE, left_out=unusable_skills(view, task), world=view)


@pytest.fixture
def cell(tmp_path: Path) -> Iterator[Cell]:
    made = Cell(tmp_path)
    yield made
    made.close()


CUP_ON_SHELF, CUP_IN_HAND = "(skiros:contain {shelf} {cup})", "(skiros:contain {gripper} {cup})"


def removed_from_the_table(cell: Cell) -> None:
    cell.alpha(DRIVE, PICK, PLACE)
    cell.root.set_relation(cell.table, "skiros:contain", cell.cup, False)


def never_placed(cell: Cell) -> None:
    cell.alpha(DRIVE, PICK, PLACE)
    cell.cup = cell.root.add_element(Element("skiros:Product", "Red cup")).id


def without_a_skill_to_pick(cell: Cell) -> None:
    cell.alpha(DRIVE, PLACE)


def without_a_skill_to_drive(cell: Cell) -> None:
    cell.alpha(PICK, PLACE)


def occupied_hand(cell: Cell) -> None:
    cell.alpha(DRIVE, PICK)
    cell.change(cell.gripper, "skiros:ContainerState", "Full")


def without_a_hand(cell: Cell) -> None:
    cell.robot = cell.world.robot("Alpha", DRIVE, PICK, PLACE, at=cell.table)


def robot_nowhere(cell: Cell) -> None:
    cell.alpha(DRIVE, PICK, PLACE)
    cell.root.set_relation(cell.robot, "skiros:at", cell.table, False)


def hand_of_another_robot(cell: Cell) -> None:
    cell.alpha()
    cell.world.robot("Beta", DRIVE, PICK, PLACE, at=cell.table)


def opens_nothing(cell: Cell) -> None:
    cell.alpha(DRIVE, OPEN)


AT_SHELF = "(skiros:at {robot} {shelf})"
NO_HAND = "skiros:Pick (pick) cannot help: the scene has no element for Gripper (rparts:GripperEffector)."

#: By name: the scene, the goal, and the sentence.
FAILURES: dict[str, tuple[Callable[[Cell], None], str, str]] = {
    "removed by somebody": (
        removed_from_the_table, CUP_ON_SHELF,
        "Blue cup is nowhere: root removed it from Table at HH:MM (0 s ago)."),
    "removed before it could be picked": (
        removed_from_the_table, CUP_IN_HAND,
        "Blue cup is nowhere: root removed it from Table at HH:MM (0 s ago)."),
    "never in any place": (
        never_placed, CUP_ON_SHELF,
        "Red cup is nowhere."),
    "unreachable for an arm that cannot drive": (
        without_a_skill_to_drive, CUP_ON_SHELF,
        "(at Alpha Shelf) does not hold, and no skill changes that."),
    "unreachable for a robot that cannot drive": (
        without_a_skill_to_drive, AT_SHELF,
        "(at Alpha Shelf) does not hold, and no skill changes that."),
    "robot at no place": (
        robot_nowhere, AT_SHELF,
        "(at Alpha Table) does not hold, and no skill changes that."),
    "hand is occupied": (
        occupied_hand, CUP_IN_HAND,
        "Hand has ContainerState = Full; = Empty is needed, and no skill brings it about."),
    "hand is occupied, and the place is to be cleared": (
        occupied_hand, "(not (skiros:contain {table} {cup}))",
        "Hand has ContainerState = Full; = Empty is needed, and no skill brings it about."),
    "robot without a hand": (
        without_a_hand, CUP_ON_SHELF,
        NO_HAND),
    "robot without a hand is to clear a place": (
        without_a_hand, "(not (skiros:contain {table} {cup}))",
        NO_HAND),
    "wrong robot": (
        hand_of_another_robot, AT_SHELF,
        "Alpha does not offer the skill drive."),
    "hand of another robot": (
        hand_of_another_robot, CUP_IN_HAND,
        "Hand is a part of Alpha, and no skill can give it to Beta."),
    "no robot carries things": (
        opens_nothing, CUP_ON_SHELF,
        "Blue cup is in Table, and no skill can bring it to Shelf."),
    "no robot picks": (
        opens_nothing, CUP_IN_HAND,
        "Blue cup is in Table, and no skill can bring it to Hand."),
    "no robot clears a place": (
        opens_nothing, "(not (skiros:contain {table} {cup}))",
        "(contain Table Blue cup) holds, and no skill changes that."),
    "no robot moves furniture": (
        opens_nothing, "(skiros:contain {shelf} {table})",
        "Table is in the scene, and no skill can bring it to Shelf."),
    "wrong class: a table is no product": (
        robot_nowhere, "(skiros:contain {shelf} {table})",
        "skiros:Place (place) cannot help: Table is no skiros:Product."),
    "wrong class: a cup does not drive": (
        removed_from_the_table, "(skiros:at {cup} {shelf})",
        "skiros:Drive (drive) cannot help: Blue cup is no sumo:Agent."),
    "wrong class: a hand is no place": (
        without_a_skill_to_pick, CUP_IN_HAND,
        "skiros:Place (place) cannot help: Hand is no skiros:Location."),
    "state that no skill makes": (
        never_placed, "(skiros:ContainerState_Broken {gripper})",
        "Hand has ContainerState = Empty; = Broken is needed, and no skill brings it about."),
}  # fmt: skip


@pytest.mark.parametrize("name", FAILURES)
def test_failure_is_said_in_one_sentence(cell: Cell, name: str) -> None:
    scene, goal, sentence = FAILURES[name]
    scene(cell)
    why = cell.plan(goal)
    first = next(why.lines())
    assert re.sub(r"at \d\d:\d\d \(\d+ s ago\)", "at HH:MM (0 s ago)", first) == sentence
    assert NoPlan.from_json(why.to_json()).sentence == first
