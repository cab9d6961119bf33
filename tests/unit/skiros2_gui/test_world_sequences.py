"""Random sequences of changes by the user and others: tree, undo and redo match the world model."""

from __future__ import annotations

from typing import Any

from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule

from skiros2_common.core.errors import SkirosError
from skiros2_common.core.world_element import Element
from skiros2_gui.app.events import EventQueue, WorldChanged
from skiros2_gui.app.window import Window
from skiros2_gui.world.presenter import WorldPresenter
from skiros2_gui.world.requests import Requests
from skiros2_gui.world.scene import TOP, SceneHierarchy
from skiros2_world_model.core.local_world_model import LocalWorldModel
from support.fuzz import examples
from support.window.local_system import LocalSystem
from support.window.synchronous import make_window

_PICK = st.integers(0, 5)


class UndoStack(RuleBasedStateMachine):
    """The window's user undo_stack alone: undo and redo lead through the same states of the scene, both ways."""

    with_others = False

    def __init__(self) -> None:
        super().__init__()
        self.wm = LocalWorldModel("window")
        self.other = LocalWorldModel("vision", self.wm.model)
        self.window: Window = make_window(self.connect)
        self.delivery = "published"
        self.tab = WorldPresenter(self.window)
        self.history: list[dict[str, Any]] = []
        self.future: list[dict[str, Any]] = []

    def connect(self, event_queue: EventQueue) -> LocalSystem:
        self.event_queue = event_queue
        return LocalSystem(event_queue, self.wm)

    def deliver(self) -> None:
        """The window gets the change of its request."""
        if self.delivery == "lost":
            self.event_queue.take()
        if self.delivery != "published":
            self.window.publish(WorldChanged((), is_reset=True))
        self.window.process_events()

    @rule(how=st.sampled_from(["published", "read", "lost"]))
    def change_delivery(self, how: str) -> None:
        """From now on published changes come at once, after the scene was read with them, or not at all."""
        self.delivery = how

    def content(self) -> dict[str, Any]:
        return {
            e.id: (
                e.type,
                e.label,
                {k: p.values for k, p in e.property_view.items()},
                sorted(map(str, e.relation_view)),
            )
            for e in self.wm.resolve_elements(Element())
        }

    def pick(self, number: int) -> str:
        ids = sorted(self.content())
        return ids[number % len(ids)]

    def edit(self, make: Any) -> None:
        before, number = self.content(), self.wm.model.number
        self.tab.change("edit", make)
        self.deliver()
        if self.wm.model.number != number and self.content() != before:
            self.history.append(before)
            self.future.clear()

    @rule(parent=_PICK, loose=st.booleans())
    def add(self, parent: int, loose: bool) -> None:
        under = "" if loose else self.pick(parent)
        self.edit(lambda r: r.add("skiros:Part", "", under))

    @rule(parent=_PICK)
    def add_template(self, parent: int) -> None:
        under = self.pick(parent)
        self.edit(lambda r: r.add_template("skiros:test_arm", under))

    @rule(number=_PICK, key=st.sampled_from(["skiros:Weight", "skiros:CadModel"]), text=st.sampled_from(["1", "x"]))
    def set_value(self, number: int, key: str, text: str) -> None:
        eid = self.pick(number)
        self.edit(lambda r: r.set_values(eid, key, [text]))

    @rule(number=_PICK, label=st.sampled_from(["", "skiros:a", "skiros:b"]))
    def set_label(self, number: int, label: str) -> None:
        eid = self.pick(number)
        self.edit(lambda r: r.set_label(eid, label))

    @rule(number=_PICK, parent=_PICK)
    def move(self, number: int, parent: int) -> None:
        eid, under = self.pick(number), self.pick(parent)
        self.edit(lambda r: r.move(eid, under))

    @rule(one=_PICK, other=_PICK, predicate=st.sampled_from(["skiros:at", "skiros:hasA", "skiros:hasParam"]))
    def relate(self, one: int, other: int, predicate: str) -> None:
        src, dst = self.pick(one), self.pick(other)

        def make(requests: Requests) -> Any:
            assert self.tab.hierarchy is not None
            related = self.tab.hierarchy.scene.related(src, predicate, dst)
            return (requests.unrelate if related else requests.relate)(src, predicate, dst)

        self.edit(make)

    @rule(number=_PICK)
    def remove(self, number: int) -> None:
        eid = self.pick(number)
        self.edit(lambda r: r.remove([eid]))

    @precondition(lambda self: self.tab.undo_stack.done)
    @rule()
    def undo(self) -> None:
        before = self.content()
        self.window.problems.clear()
        self.tab.undo()
        self.deliver()
        if self.with_others:
            assert self.window.problems.newest is None or self.content() == before
            return
        assert self.window.problems.newest is None
        self.future.append(before)
        assert self.content() == self.history.pop()

    @precondition(lambda self: self.tab.undo_stack.undone)
    @rule()
    def redo(self) -> None:
        before = self.content()
        self.window.problems.clear()
        self.tab.redo()
        self.deliver()
        if self.with_others:
            assert self.window.problems.newest is None or self.content() == before
            return
        assert self.window.problems.newest is None
        self.history.append(before)
        assert self.content() == self.future.pop()

    @invariant()
    def the_tree_is_that_of_the_scene(self) -> None:
        hierarchy = self.tab.hierarchy
        assert hierarchy is not None
        scene = {node.id: sorted(map(str, hierarchy.scene.relations_of(node.id))) for node in hierarchy.scene}
        assert scene == {eid: content[3] for eid, content in self.content().items()}
        shown = hierarchy.below(TOP)
        assert len(shown) == len(set(shown)) == len(hierarchy) + 2  # the top, and the node of what is nowhere
        anew = SceneHierarchy(self.wm.resolve_elements(Element()), hierarchy.spatial, hierarchy.parts)
        assert [list(hierarchy.children(eid)) for eid in shown] == [list(anew.children(eid)) for eid in shown]
        assert all(hierarchy.children(hierarchy.parent(eid))[hierarchy.row(eid)] == eid for eid in shown if eid != TOP)


class EditsAmongOthers(UndoStack):
    """Others change the scene too: an undo that is refused changes nothing."""

    with_others = True

    @rule(number=_PICK, label=st.sampled_from(["", "skiros:theirs"]))
    def other_label(self, number: int, label: str) -> None:
        element = self.other.get_element(self.pick(number))
        element.label = label
        self.other.update_element(element)
        self.window.process_events()

    @rule(number=_PICK)
    def other_remove(self, number: int) -> None:
        try:
            self.other.remove_element(self.other.get_element(self.pick(number)))
        except SkirosError:
            return  # it is the root, or has it below
        self.window.process_events()

    @rule(number=_PICK, parent=_PICK)
    def other_place(self, number: int, parent: int) -> None:
        src, dst = self.pick(parent), self.pick(number)
        try:
            self.other.set_relation(src, "skiros:contain", dst)
        except SkirosError:
            return  # it would be in itself
        self.window.process_events()


_FEW = settings(max_examples=examples(15), stateful_step_count=20, suppress_health_check=[HealthCheck.too_slow])
TestEdits = UndoStack.TestCase
TestEdits.settings = _FEW
TestEditsAmongOthers = EditsAmongOthers.TestCase
TestEditsAmongOthers.settings = _FEW
