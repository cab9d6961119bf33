"""The next step of a user whose system cannot move a robot yet."""

from __future__ import annotations

from dataclasses import dataclass

from skiros2_common.core.operations import SCENE
from skiros2_common.core.wording import label_text
from skiros2_common.core.world_element import Element
from skiros2_gui.app.system import System, part_of
from skiros2_live.core.cell import CellDocument
from skiros2_live.core.patch import MASTER, WORLD_MODEL
from skiros2_world_model.core.queries import SceneReader

#: The actions of the window: load a scene, add an element.
LOAD, ADD = "load", "add"

_ROOT = "skiros:Scene-0"
_DEMO = "roslaunch skiros2_demo_skills demo.launch gui:=false"
_SYSTEM = "roslaunch skiros2 skiros.launch gui:=false"
_MANAGER = "roslaunch skiros2 skill_mgr.launch deploy:=true"
_SKILLS = "libraries_list:=[skiros2_std_skills] primitive_list:=[wait]"


@dataclass(frozen=True)
class NextStep:
    """:param text: for people.
    :param command: for a terminal; "" if there is none.
    :param actions: of the window, `LOAD` and `ADD`.
    """

    text: str
    command: str = ""
    actions: tuple[str, ...] = ()


def next_step(system: System, cell: CellDocument) -> NextStep | None:
    """Returns the next step; None if a skill manager runs."""
    master = part_of(cell, MASTER)
    if master is not None and not master.is_up:
        return NextStep("Start a system. The demo, with a robot and its skills:", _DEMO)
    world, scene = part_of(cell, WORLD_MODEL), system.scene
    if world is None or not world.is_up or scene is None:
        return NextStep("Start the world model and a robot:", _SYSTEM)
    if system.managers:
        return None
    robots = scene.matching(Element("cora:Robot"), SCENE)
    if robots:
        return _start_manager(robots)
    if _is_empty(scene):
        return NextStep("The scene is empty. Load a scene, or add a robot from a template.", "", (LOAD, ADD))
    return NextStep("The scene has no robot. Add one from a template, or load another scene.", "", (ADD, LOAD))


def _start_manager(robots: list[Element]) -> NextStep:
    """Returns the start of a manager for the first robot with a label that a manager can find."""
    for robot in robots:
        prefix, _, name = robot.label.rpartition(":")
        if prefix:
            arguments = f"robot_ontology_prefix:={prefix} robot_name:={name} {_SKILLS}"
            text = f"Start the skill manager of {label_text(robot.label)}, here with the skill wait:"
            return NextStep(text, f"{_MANAGER} {arguments}")
    return NextStep(
        f"No skill manager finds the robot {robots[0].label or robots[0].id}: give it a label with a prefix, such as "
        "skiros:my_robot.",
        "",
        (ADD,),
    )


def _is_empty(scene: SceneReader) -> bool:
    root = scene.find(_ROOT, SCENE)
    return root is None or not root.getRelations("-1", "skiros:contain")
