"""The port `System` of the window, in process and over ROS."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from skiros2_common.core.errors import SkirosError
from skiros2_common.core.operations import Add
from skiros2_common.core.world_element import Element
from skiros2_gui.app.events import Event, EventQueue, WorldChanged
from skiros2_gui.app.system import MANAGER, System, part_of
from skiros2_live.core.cell import CellDocument
from skiros2_live.core.patch import WORLD_MODEL, Patch, TaskProgress
from skiros2_runs.core.progress import has_ended
from skiros2_runs.core.states import SUCCESS
from skiros2_skill.client.description import Step
from skiros2_skill.core.breakpoint import Breakpoint
from skiros2_world_model.core.local_world_model import LocalWorldModel, source_ontologies
from skiros2_world_model.core.world_model import WorldModel
from support import hand_skills
from support.ros import Ros
from support.window.local_system import LocalSystem

ROBOT = "/test_robot"
SCENE = "skiros:Scene-0"
SKILLS = ["add", "stay", "give_up"]
TESTS = Path(__file__).resolve().parents[1]
TIMEOUT = 30.0  # s


class Desk:
    """A system, its events, and the document that they make."""

    def __init__(self) -> None:
        self._event_posted = threading.Event()
        self.event_queue = EventQueue(self._event_posted.set)
        self.cell = CellDocument()
        self.system: System = None  # type: ignore[assignment]

    def events(self) -> Iterator[Event]:
        """Yields events until the timeout."""
        end = time.monotonic() + TIMEOUT
        while self._event_posted.wait(max(0.0, end - time.monotonic())):
            self._event_posted.clear()
            batch = self.event_queue.take()
            for event in batch:
                if isinstance(event, Patch):
                    self.cell.apply(event)
            yield from batch
        pytest.fail("no further event was received")

    def is_up(self) -> bool:
        parts = [part_of(self.cell, kind) for kind in (WORLD_MODEL, MANAGER)]
        return all(part is not None and part.is_up for part in parts)

    def until(self, condition: Callable[[], Any]) -> None:
        if not condition():
            next(event for event in self.events() if condition())

    def wait_for(self, kind: type[Event], fits: Callable[[Any], bool]) -> Any:
        return next(event for event in self.events() if isinstance(event, kind) and fits(event))

    @property
    def manager(self) -> Any:
        return self.system.managers[ROBOT]

    def start(self, label: str, **values: Any) -> int:
        skill = next(s for s in self.manager.read_skills() if s.label == label)
        params = [skill.parameters[key].wire([value]) for key, value in values.items()]
        return int(self.manager.command("start", -1, [Step(skill.type, label, params)]))

    def end_of(self, task: int) -> TaskProgress:
        return self.wait_for(TaskProgress, lambda e: e.task == task and has_ended(e.nodes))


@pytest.fixture(scope="module", params=["in process", "over ROS"])
def desk(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Desk]:
    made = Desk()
    workspace = tmp_path_factory.mktemp("workspace")
    if request.param == "in process":
        model = WorldModel(source_ontologies(), workspace)
        system = LocalSystem(made.event_queue, LocalWorldModel("window", model))
        system.add_manager(ROBOT, [getattr(hand_skills, name) for name in SKILLS])
        made.system = system
        made.until(made.is_up)
        yield made
        system.close()
        return
    from skiros2_gui.app.ros.system import RosSystem

    ros = Ros(request.getfixturevalue("ros_master"))
    env = {**ros.master.env, "PYTHONPATH": f"{TESTS}:{ros.master.env['PYTHONPATH']}"}
    try:
        ros.launch(
            "skiros2", "skiros.launch", gui=False, task_mgr_on=False, libraries_list="[support.hand_skills]",
            primitive_list=f"[{', '.join(SKILLS)}]", workspace_dir=str(workspace), env=env,
        )  # fmt: skip
        made.system = RosSystem(made.event_queue)
        made.until(lambda: made.system.scene is not None and ROBOT in made.system.managers)
        made.until(made.is_up)
        yield made
        made.system.close()
    finally:
        ros.stop()


def test_parts_are_up(desk: Desk) -> None:
    for kind in (WORLD_MODEL, MANAGER):
        part = part_of(desk.cell, kind)
        assert part is not None
        assert part.is_up
        assert part.since <= time.time()
    assert part_of(desk.cell, MANAGER).name == ROBOT
    assert desk.manager.name == ROBOT


def test_manager_returns_its_skills(desk: Desk) -> None:
    skills = {skill.label: skill for skill in desk.manager.read_skills()}
    assert sorted(skills) == sorted(SKILLS)
    assert skills["add"].parameters["A"].wire_type == "float"


def test_started_task_reports_its_end(desk: Desk) -> None:
    task = desk.start("add", A=2.0, B=3.0)
    end = desk.end_of(task)
    assert end.manager == ROBOT
    assert end.nodes[0].state == SUCCESS
    assert [(node.parent_id, node.label) for node in end.nodes[1:]] == [(end.nodes[0].id, "add")]
    assert desk.manager.read_tasks() == []


def test_task_is_paused_stepped_and_stopped(desk: Desk) -> None:
    task = desk.start("stay")
    desk.wait_for(TaskProgress, lambda e: e.task == task)
    desk.manager.command("pause", task)
    desk.manager.command("tick_once", task)
    assert [nodes[0].id for nodes in desk.manager.read_tasks(task)] == [task]
    desk.manager.command("preempt", task)
    end = desk.end_of(task)
    assert end.nodes[0].state != SUCCESS
    assert desk.manager.why(task).explanations[-1].stage == "preempt"


@pytest.mark.parametrize("action", ["start", "pause", "preempt", "dance"])
def test_refused_command_raises(desk: Desk, action: str) -> None:
    with pytest.raises(SkirosError, match=r"999|dance"):
        desk.manager.command(action, 999)


def test_refused_start_is_explained(desk: Desk) -> None:
    with pytest.raises(SkirosError, match="required parameter 'B'"):
        desk.start("add")
    assert "required parameter 'B'" in desk.manager.why(-1).text


def test_task_without_limits_has_no_bounds(desk: Desk) -> None:
    task = desk.start("stay")
    desk.wait_for(TaskProgress, lambda e: e.task == task)
    assert desk.manager.signal_bounds(task).bounds == []
    desk.manager.command("preempt", task)
    desk.end_of(task)
    with pytest.raises(SkirosError, match="999"):
        desk.manager.signal_bounds(999)


def test_breakpoints_are_added_listed_and_removed(desk: Desk) -> None:
    number = desk.manager.set_breakpoint("node", "stay")
    assert desk.manager.breakpoints() == {number: Breakpoint("node", "stay", "start")}
    task = desk.start("stay")
    desk.wait_for(TaskProgress, lambda e: e.task == task and "breakpoint" in e.nodes[0].progress_message)
    desk.manager.command("preempt", task)
    desk.end_of(task)
    desk.manager.remove_breakpoint(number)
    assert desk.manager.breakpoints() == {}


def test_scene_change_is_reported_after_it_can_be_read(desk: Desk) -> None:
    element = Element("skiros:Product", "bolt")
    element.addRelation(SCENE, "skiros:contain", "-1")
    eid = desk.system.world.add_element(element).id
    change = desk.wait_for(WorldChanged, lambda e: any(x.id == eid for c in e.changes for x in c.elements))
    assert not change.is_reset
    assert desk.system.scene.find(eid, "scene").label == "bolt"
    assert [r["src"] for r in desk.system.scene.related("", "skiros:contain", eid, "scene")] == [SCENE]
    assert eid in {e.id for e in desk.system.scene.matching(Element("skiros:Product"), "scene")}


def test_loaded_scene_is_reported_as_reset(desk: Desk) -> None:
    desk.system.world.save("kept.ttl")
    desk.system.world.load("kept.ttl")
    desk.wait_for(WorldChanged, lambda e: e.is_reset)
    assert desk.system.scene.find(SCENE, "scene") is not None


def test_added_class_is_known_when_reported(desk: Desk) -> None:
    desk.system.world.add_class("skiros:Bolt", "skiros:Product")
    desk.wait_for(WorldChanged, lambda e: e.ontology and desk.system.world.is_subclass("skiros:Bolt", "skiros:Product"))


def test_changes_without_content_are_reported_in_their_order(desk: Desk) -> None:
    """After a gap the scene tab reads the scene again, and cannot undo the changes in the gap."""
    world = desk.system.world
    world.add_class("skiros:Probe", "sumo:Object")  # of the ontologies alone
    outcome = world.transact([Add(Element("skiros:Product"))])
    wanted, known = outcome.changes[-1].snapshot_id, []
    desk.wait_for(WorldChanged, lambda e: known.extend(e.changes) or any(c.snapshot_id == wanted for c in known))
    newest = known[[c.snapshot_id for c in known].index(wanted)]
    assert newest.prev_snapshot_id in [c.snapshot_id for c in known]
