"""The presenter of the tab "World model": tree, changes, undo and redo."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from skiros2_common.core.operations import RESET, Change, Outcome
from skiros2_common.core.world_element import Element
from skiros2_gui.app.events import ConnectionChanged, ElementSelected, EventQueue, WorldChanged
from skiros2_gui.app.window import Window
from skiros2_gui.world.editor import TIMEOUT
from skiros2_gui.world.presenter import HIGHLIGHT_SECONDS, RETRY_PERIOD, WorldPresenter
from skiros2_gui.world.requests import Requests
from skiros2_gui.world.scene import TOP, UNPLACED
from skiros2_world_model.core.journal import Journal
from skiros2_world_model.core.local_world_model import LocalWorldModel, source_ontologies
from skiros2_world_model.core.scene import ROOT
from skiros2_world_model.core.wm_errors import WmException
from skiros2_world_model.core.world_model import WorldModel
from support.window.local_system import LocalSystem
from support.window.synchronous import SynchronousJobs, make_window

BOX = "skiros:LargeBox"


class Clock:
    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        return self.now


class Cell:
    """A window on a world model of this process, and another author."""

    def __init__(self, wm: LocalWorldModel | None = None) -> None:
        self.wm = wm or LocalWorldModel("window")
        self.other = LocalWorldModel("vision", self.wm.model)
        self.clock = Clock()
        self.window: Window = make_window(self._connect)
        self.window.process_events()  # the world model is up
        self.tab = WorldPresenter(self.window, self.clock)

    def _connect(self, event_queue: EventQueue) -> LocalSystem:
        self.event_queue = event_queue
        return LocalSystem(event_queue, self.wm)

    def lose_messages(self) -> None:
        """Discards the published changes that the window has not processed."""
        self.event_queue.take()

    def read(self) -> None:
        """The window reads the scene, before it processes published changes."""
        self.window.publish(WorldChanged((), is_reset=True))

    def add(self, etype: str = BOX, label: str = "", parent: str = ROOT) -> str:
        """The user adds an element; returns its id."""
        added: list[str] = []
        assert not self.tab.change("add", lambda r: r.add(etype, label, parent), lambda o: added.extend(o.ids))
        self.window.process_events()
        return added[0]

    def change(self, make: object) -> str:
        error = self.tab.change("change", make)  # type: ignore[arg-type]
        self.window.process_events()
        return error

    def undo(self) -> None:
        self.tab.undo()
        self.window.process_events()

    def redo(self) -> None:
        self.tab.redo()
        self.window.process_events()

    @property
    def problem(self) -> str:
        newest = self.window.problems.newest
        return newest.line if newest is not None else ""

    def shown(self, eid: str = TOP) -> list[object]:
        """The tree under an element, as nested lists."""
        hierarchy = self.tab.hierarchy
        assert hierarchy is not None
        children = hierarchy.children(eid)
        return [[child, self.shown(child)] if hierarchy.has_children(child) else child for child in children]

    def content(self) -> dict[str, object]:
        """All that is in the scene."""
        return {
            e.id: (
                e.type,
                e.label,
                {k: p.values for k, p in e.property_view.items()},
                sorted(map(str, e.relation_view)),
            )
            for e in self.wm.resolve_elements(Element())
        }


@pytest.fixture
def cell() -> Cell:
    return Cell()


def test_tree_lists_contained_then_unplaced_elements(cell: Cell) -> None:
    box = cell.add()
    part = cell.add("skiros:Part", "skiros:starter", box)
    loose = cell.add("skiros:Skill", parent="")
    assert cell.shown() == [[ROOT, [[box, [part]]]], [UNPLACED, [loose]]]


def test_container_precedes_owner_as_parent(cell: Cell) -> None:
    box, robot = cell.add(), cell.add("cora:Robot")
    part = cell.add("skiros:Part", parent=box)
    cell.change(lambda r: r.relate(robot, "skiros:hasA", part))
    assert cell.shown(box) == [part]
    assert cell.shown(robot) == []
    cell.change(lambda r: r.unrelate(box, "skiros:contain", part))
    assert cell.shown(robot) == [part]


def test_changes_of_others_are_highlighted_for_some_seconds(cell: Cell) -> None:
    box = cell.add()
    assert cell.tab.highlights == {}
    element = cell.other.get_element(box)
    element.label = "skiros:renamed"
    cell.other.update_element(element)
    cell.window.process_events()
    assert cell.tab.highlights[box].author == "vision"
    cell.tab.select(box)
    details = cell.tab.details()
    assert details is not None and (details.label, details.author) == ("skiros:renamed", "vision")
    cell.clock.now = HIGHLIGHT_SECONDS
    cell.tab.expire_highlights()
    assert cell.tab.highlights == {}


def test_removed_element_is_deselected(cell: Cell) -> None:
    box = cell.add()
    received: list[ElementSelected] = []
    cell.window.subscribe(ElementSelected, received.append)
    cell.tab.select(box)
    cell.other.remove_element(cell.other.get_element(box))
    cell.window.process_events()
    assert cell.tab.selected == "" and cell.tab.details() is None
    assert [event.eid for event in received] == [box, ""]


def test_values_are_checked_before_they_are_sent(cell: Cell) -> None:
    box = cell.add()
    assert cell.change(lambda r: r.set_values(box, "skiros:PositionX", ["0.25 m"])) == ""
    assert cell.wm.get_element(box).value_of("skiros:PositionX") == 0.25
    for text, why in (("a lot", "expected a number (in m), got 'a lot'"), ("2 kg", "expected m"), ("nan", "finite")):
        assert why in cell.change(lambda r, text=text: r.set_values(box, "skiros:PositionX", [text]))
        assert why in cell.problem
    assert cell.wm.get_element(box).value_of("skiros:PositionX") == 0.25


@pytest.mark.parametrize(
    ("make", "why"),
    [
        (lambda r, box: r.set_values("skiros:Part-999", "skiros:Weight", ["1"]), "no longer an element"),
        (lambda r, box: r.set_values(box, "skiros:contain", ["1"]), "is a relation"),
        (lambda r, box: r.set_values(box, "skiros:Weight", ["-1"]), "expected at least 0 kg, got -1"),
        (lambda r, box: r.set_values(box, "skiros:OrientationX", ["3"]), "expected -1 to 1, got 3"),
        (lambda r, box: r.remove_property(box, "skiros:Color"), "has no property"),
        (lambda r, box: r.add("skiros:Nonsense"), "no class 'skiros:Nonsense'"),
        (lambda r, box: r.add_template("skiros:nonsense"), "no template"),
        (lambda r, box: r.remove([ROOT]), "cannot be removed"),
        (lambda r, box: r.move(ROOT, box), "cannot be moved"),
        (lambda r, box: r.move(box, box), "its descendant"),
        (lambda r, box: r.relate(box, "skiros:likes", ROOT), "know no relation"),
        (lambda r, box: r.relate(box, "skiros:at", "skiros:Nowhere"), "no element or template"),
        (lambda r, box: r.unrelate(box, "skiros:at", ROOT), "there is no relation"),
    ],
)
def test_invalid_request_is_refused_before_sending(cell: Cell, make: object, why: str) -> None:
    box = cell.add()
    before = cell.wm.model.number
    assert why in cell.change(lambda r: make(r, box))  # type: ignore[operator]
    assert cell.wm.model.number == before


def test_template_is_added_with_its_parts(cell: Cell) -> None:
    cell.change(lambda r: r.add_template("skiros:test_robot"))
    robot = next(e for e in cell.wm.resolve_elements(Element("cora:Robot")))
    assert len(cell.shown(robot.id)) == 1  # its arm, which has a camera and a gripper
    cell.undo()
    assert cell.shown() == [ROOT, UNPLACED]
    cell.redo()
    assert robot.id in str(cell.shown())


def test_removed_with_lists_descendants(cell: Cell) -> None:
    box = cell.add()
    part = cell.add("skiros:Part", parent=box)
    held = cell.add("skiros:Part", parent=box)
    cell.change(lambda r: r.relate(ROOT, "skiros:hasA", held))
    requests = cell.tab.requests
    assert isinstance(requests, Requests)
    assert set(requests.removed_with(box)) == {box, part}
    cell.change(lambda r: r.remove([part, box]))
    assert cell.shown() == [[ROOT, [held]], UNPLACED]


def test_undo_restores_removed_elements_and_relations(cell: Cell) -> None:
    box = cell.add()
    part = cell.add("skiros:Part", parent=box)
    cell.change(lambda r: r.relate(part, "skiros:at", box))
    before = cell.content()
    cell.change(lambda r: r.remove([box]))
    cell.undo()
    assert cell.content() == before
    cell.redo()
    assert cell.shown() == [ROOT, UNPLACED]
    assert cell.problem == ""


def test_undo_is_refused_if_the_value_was_changed_again(cell: Cell) -> None:
    box = cell.add()
    cell.change(lambda r: r.set_values(box, "skiros:Weight", ["1"]))
    element = cell.other.get_element(box)
    element.setProperty("skiros:Weight", 2.0)
    cell.other.update_element(element)
    cell.window.process_events()
    cell.undo()
    assert "was changed by vision at" in cell.problem and "Weight is now 2, expected 1" in cell.problem
    assert cell.wm.get_element(box).value_of("skiros:Weight") == 2.0
    assert cell.tab.undo_stack.undo_text == "change"  # it stays, and can be tried again


def test_undo_keeps_other_changes(cell: Cell) -> None:
    box = cell.add()
    cell.change(lambda r: r.set_values(box, "skiros:Weight", ["1"]))
    element = cell.other.get_element(box)
    element.setProperty("skiros:CadModel", "box.stl")
    cell.other.update_element(element)
    cell.undo()
    assert cell.problem == ""
    assert not cell.wm.get_element(box).hasProperty("skiros:Weight")
    assert cell.wm.get_element(box).value_of("skiros:CadModel") == "box.stl"


def test_undo_of_added_element_with_new_child_is_refused(cell: Cell) -> None:
    box = cell.add()
    part = Element("skiros:Part")
    part.addRelation(box, "skiros:contain", "-1")
    cell.other.add_element(part)
    cell.undo()
    assert "relation added" in cell.problem
    assert cell.wm.find_element(box) is not None


def test_loading_a_scene_clears_the_undo_stack(cell: Cell) -> None:
    cell.add()
    assert cell.tab.undo_stack.undo_text == "add"
    reset = Change(1, "other-0", "other-1", 0.0, "other", RESET, "")
    cell.window.publish(WorldChanged((reset,), True, True))
    assert cell.tab.undo_stack.undo_text == ""
    assert cell.tab.hierarchy is not None and len(cell.tab.hierarchy) == len(cell.content())


def test_reading_the_scene_again_keeps_the_undo_stack(cell: Cell) -> None:
    first = cell.add()
    jobs = cell.window.jobs
    assert isinstance(jobs, SynchronousJobs)
    jobs.deferred = True
    cell.window.publish(WorldChanged((), is_reset=True))  # as when a change was missed
    jobs.deferred = False
    second = cell.add()
    jobs.release()  # what is read has the second already
    assert len(cell.tab.undo_stack.done) == 2
    cell.undo()
    cell.undo()
    assert cell.wm.find_element(first) is None and cell.wm.find_element(second) is None
    assert cell.problem == "" and cell.tab.undo_stack.undo_text == ""


def test_orientation_is_edited_in_degrees(cell: Cell) -> None:
    box = cell.add()
    cell.tab.select(box)
    cell.change(lambda r: r.set_pose(box, (1.0, 2.0, 3.0), (0.0, 0.0, 90.0)))
    cell.change(lambda r: r.set_pose(box, (1.0, 2.0, 3.0), (-30.0, 0.0, 90.0)))
    details = cell.tab.details()
    assert details is not None and details.pose is not None
    assert details.pose.position == (1.0, 2.0, 3.0)
    assert details.pose.angles == pytest.approx((-30.0, 0.0, 90.0))
    assert not any(row.key.startswith(("skiros:Position", "skiros:Orientation")) for row in details.properties)
    assert "six finite numbers" in cell.change(lambda r: r.set_pose(box, (1.0, 2.0, 3.0), (0.0, 0.0, float("inf"))))
    cell.undo()
    after = cell.tab.details()
    assert after is not None and after.pose is not None
    assert after.pose.angles == pytest.approx((0.0, 0.0, 90.0))


def test_pose_is_removed_and_restored(cell: Cell) -> None:
    box = cell.add()
    cell.tab.select(box)
    cell.change(lambda r: r.remove_pose(box))
    details = cell.tab.details()
    assert details is not None and details.pose is None and cell.problem == ""
    assert not any(row.name.startswith(("Position", "Orientation")) for row in details.properties)
    cell.undo()
    details = cell.tab.details()
    assert details is not None and details.pose is not None


def test_external_drag_is_one_undo_command(cell: Cell) -> None:
    box = cell.add()
    element = cell.wm.get_element(box)
    for x in (1.0, 2.0, 3.0):  # as the marker in rviz writes it, under the window's name
        element.setProperty("skiros:PositionX", x)
        cell.wm.update_element(element)
        cell.window.process_events()
    assert cell.tab.undo_stack.undo_text == f"change of {box.partition(':')[2]}"
    cell.undo()
    assert cell.wm.get_element(box).value_of("skiros:PositionX") == 0.0
    cell.redo()
    assert cell.wm.get_element(box).value_of("skiros:PositionX") == 3.0
    cell.undo()
    cell.undo()
    assert cell.wm.find_element(box) is None and cell.problem == ""


def test_parts_of_a_skill_are_listed_below_it(cell: Cell) -> None:
    skill = cell.add("skiros:Skill", parent="")
    key, other = (cell.add("skiros:Parameter", parent="") for _ in range(2))
    cell.change(lambda r: r.relate(skill, "skiros:hasParam", key))
    assert cell.shown() == [ROOT, [UNPLACED, [other, [skill, [key]]]]]
    box = cell.add()
    cell.change(lambda r: r.move(skill, box))  # a skill that is somewhere after all
    assert cell.shown() == [[ROOT, [[box, [skill]]]], [UNPLACED, [key, other]]]
    cell.undo()
    assert cell.shown(UNPLACED) == [other, [skill, [key]]]


def test_failed_read_is_retried_when_the_world_model_is_back(cell: Cell, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(_: object) -> list[Element]:
        raise WmException("the world model does not answer")

    with monkeypatch.context() as gone:
        gone.setattr(cell.wm, "resolve_elements", fail)
        cell.window.publish(WorldChanged((), True, True))
    assert "reading the scene: the world model does not answer" in cell.problem
    box = Element(BOX)
    cell.other.add_element(box)
    cell.window.publish(ConnectionChanged())
    assert cell.tab.hierarchy is not None and box.id in cell.tab.hierarchy.scene


def test_edit_that_the_scene_was_read_with_can_be_undone(cell: Cell) -> None:
    box = cell.add()
    cell.tab.change("rename", lambda r: r.set_label(box, "skiros:renamed"))
    cell.read()  # the read scene has the change, which arrives afterwards
    cell.window.process_events()
    assert cell.tab.undo_stack.undo_text == "rename"
    second = cell.add(label="skiros:second")
    for _ in range(2):
        cell.undo()
    assert cell.wm.find_element(second) is None and cell.wm.get_element(box).label == ""
    cell.redo()
    assert cell.wm.get_element(box).label == "skiros:renamed" and cell.problem == ""


def test_removal_that_the_scene_was_read_without_can_be_undone(cell: Cell) -> None:
    box = cell.add(label="skiros:box")
    cell.tab.change("remove", lambda r: r.remove([box]))
    cell.read()
    cell.window.process_events()
    cell.undo()
    assert cell.wm.get_element(box).label == "skiros:box" and cell.problem == ""
    assert cell.shown() == [[ROOT, [box]], UNPLACED]


def test_edit_that_is_answered_after_the_scene_was_read_can_be_undone(cell: Cell) -> None:
    box = cell.add()
    jobs = cell.window.jobs
    assert isinstance(jobs, SynchronousJobs)
    jobs.deferred = True
    cell.tab.change("rename", lambda r: r.set_label(box, "skiros:renamed"))
    transact = cell.wm.transact

    def transact_and_read(*arguments: Any) -> Outcome:
        outcome = transact(*arguments)
        jobs.deferred = False
        cell.read()
        return outcome

    cell.wm.transact = transact_and_read  # type: ignore[method-assign]
    jobs.release()
    cell.wm.transact = transact  # type: ignore[method-assign]
    cell.window.process_events()
    assert cell.tab.undo_stack.undo_text == "rename"
    cell.undo()
    assert cell.wm.get_element(box).label == "" and cell.problem == ""


def test_edit_whose_published_change_is_lost_can_be_undone(cell: Cell) -> None:
    box = cell.add()
    cell.tab.change("rename", lambda r: r.set_label(box, "skiros:renamed"))
    cell.lose_messages()
    cell.tab.check()
    assert cell.tab.undo_stack.undo_text == "add"
    cell.clock.now += TIMEOUT + 0.1
    cell.tab.check()
    assert cell.tab.undo_stack.undo_text == "rename"
    assert cell.tab.hierarchy is not None and cell.tab.hierarchy.scene.record(box).label == "skiros:renamed"
    cell.undo()
    assert cell.wm.get_element(box).label == "" and cell.problem == ""


def test_undo_of_an_edit_among_lost_changes_keeps_those_of_others(tmp_path: Path) -> None:
    with closing(Journal(tmp_path / "wm.journal")) as journal:
        cell = Cell(LocalWorldModel("window", WorldModel(source_ontologies(), journal=journal)))
        box = cell.add()
        element = cell.other.get_element(box)
        element.setProperty("skiros:Weight", 2.0)
        cell.other.update_element(element)
        cell.tab.change("rename", lambda r: r.set_label(box, "skiros:renamed"))
        cell.lose_messages()
        cell.read()
        cell.undo()
        assert cell.wm.get_element(box).label == "" and cell.problem == ""
        assert cell.wm.get_element(box).value_of("skiros:Weight") == 2.0


def test_added_element_that_the_scene_was_read_with_is_selected(cell: Cell) -> None:
    assert not cell.tab.add("add", lambda r: r.add(BOX, "", ROOT))
    cell.lose_messages()
    cell.read()
    assert cell.tab.selected.startswith(BOX)


def test_scene_is_read_again_after_a_failure_that_nothing_reports(cell: Cell, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(_: object) -> list[Element]:
        raise WmException("the response was lost")

    with monkeypatch.context() as once:
        once.setattr(cell.wm, "resolve_elements", fail)
        cell.read()
    box = Element(BOX)
    cell.other.add_element(box)
    cell.lose_messages()
    cell.tab.check()
    assert cell.tab.hierarchy is not None and box.id not in cell.tab.hierarchy.scene
    cell.clock.now += RETRY_PERIOD + 0.1
    cell.tab.check()
    assert box.id in cell.tab.hierarchy.scene


def test_fast_undo_and_redo_are_queued(cell: Cell) -> None:
    first, second = cell.add(), cell.add()
    for step in (cell.tab.undo, cell.tab.undo, cell.tab.redo, cell.tab.undo, cell.tab.redo):
        step()
    for _ in range(5):
        cell.window.process_events()
    assert cell.wm.find_element(first) is not None and cell.wm.find_element(second) is None
    assert cell.problem == "" and (cell.tab.undo_stack.undo_text, cell.tab.undo_stack.redo_text) == ("add", "add")
