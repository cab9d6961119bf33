"""The scene tab: what it shows, and what the user does there."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

from skiros2_common.core.errors import Refused, SkirosError
from skiros2_common.core.world_element import Element
from skiros2_gui.app.events import ConnectionChanged, ElementSelected, WorldChanged
from skiros2_gui.app.system import WORLD_MODEL, part_of
from skiros2_gui.app.window import Window
from skiros2_gui.world.details import Details, details_of
from skiros2_gui.world.editor import SceneEditor
from skiros2_gui.world.requests import Requests
from skiros2_gui.world.scene import TOP, SceneHierarchy
from skiros2_gui.world.vocabulary import Vocabulary, read_vocabulary
from skiros2_world_model.core.changes import RESET, Change, Operation, Outcome
from skiros2_world_model.core.scene import ROOT
from skiros2_world_model.core.world_model_client import WorldModelAbstractInterface

#: So long the changes of others are highlighted (s).
HIGHLIGHT_SECONDS = 8.0


@dataclass(frozen=True)
class Highlight:
    """Somebody else has changed an element.

    :param stamp: when this window heard of it (s of a steady clock).
    """

    author: str
    what: str
    stamp: float


class WorldView(Protocol):
    """Who shows the tab."""

    def show_scene(self) -> None:
        """The scene is another one: `hierarchy` and `vocabulary` are new."""

    def show_details(self) -> None:
        """Another element is selected, or something of the selected one is other."""

    def show_selection(self) -> None:
        """The selection was not changed by the view itself."""

    def show_undo(self) -> None:
        """What can be undone or done again is other."""

    def show_highlights(self, ids: Sequence[str]) -> None:
        """These elements are highlighted now, or not any more."""


class WorldPresenter:
    """The state of the scene tab. Used by the Qt thread alone; all that takes time is done by jobs.

    :param clock: a steady clock (s).
    """

    def __init__(self, window: Window, clock: Callable[[], float] = time.monotonic) -> None:
        self.window = window
        self.hierarchy: SceneHierarchy | None = None
        self.vocabulary: Vocabulary | None = None
        self._editor = SceneEditor(window, self._who, self._show_undo)
        self.undo_stack = self._editor.undo_stack
        self.selected = ""
        self.highlights: dict[str, Highlight] = {}
        self.view: WorldView | None = None
        self._clock = clock
        self._waiting: list[Change] | None = None  # what has come while the scene is being read
        self._is_stale = False
        self._is_replaced = False  # another scene was loaded: that of the hierarchy, and its undo_stack, are over
        self._is_missing = True  # the scene was not read, or could not be read anew
        self._element_to_select = ""  # an element that was added and has not been heard of yet
        window.subscribe(WorldChanged, self._on_changed)
        window.subscribe(ElementSelected, self._on_selected)
        window.subscribe(ConnectionChanged, lambda _: self._read_if_missing())
        if window.system.world is not None:
            self.read()

    # -- the scene ---------------------------------------------------------------------------------------------

    def read(self) -> None:
        """Reads the scene and the ontologies anew."""
        world = self.window.system.world
        if world is None:
            return
        if self._waiting is not None:
            self._is_stale = True  # what is being read may be from before
            return
        self._waiting = []
        self.window.jobs.run(
            lambda: read_scene(world), self._scene_read, self._read_failed, activity="reading the scene"
        )

    def _scene_read(self, found: tuple[SceneHierarchy, Vocabulary]) -> None:
        changes, self._waiting = self._waiting or [], None
        if self._is_stale:
            self._is_stale = False
            self.read()
            return
        self.hierarchy, self.vocabulary = found
        self._is_missing = False
        if self._is_replaced:
            self._is_replaced = False
            self._editor.clear()
        self.highlights.clear()
        if self.view is not None:
            self.view.show_scene()
            self.view.show_details()
        if self.selected and self.selected not in self.hierarchy.scene:
            self.select("")
        self._follow(changes)

    def _read_failed(self, error: Exception) -> None:
        self._waiting, self._is_stale, self._is_missing = None, False, True
        self.window.problems.report("reading the scene", error)

    def _read_if_missing(self) -> None:
        """A part has come: what could not be read before may be there now."""
        part = part_of(self.window.system, WORLD_MODEL)
        if self._is_missing and self._waiting is None and part is not None and part.is_up:
            self.read()

    def _on_changed(self, event: WorldChanged) -> None:
        if any(change.action == RESET for change in event.changes):
            self._is_replaced = True
        if self._waiting is not None:
            self._waiting.extend(event.changes)
        self._follow(event.changes)  # also while the scene is read anew: what is read tells not what an edit made other
        if event.is_reset or self.hierarchy is None:
            self.read()
        elif event.ontology:
            self._read_vocabulary()

    def _read_vocabulary(self) -> None:
        world = self.window.system.world
        if world is not None:
            self.window.jobs.run(
                lambda: read_vocabulary(world),
                self._vocabulary_read,
                activity="reading the ontologies",
                queue="ontologies",
            )

    def _vocabulary_read(self, vocabulary: Vocabulary) -> None:
        hierarchy = self.hierarchy
        if hierarchy is not None and (vocabulary.spatial, vocabulary.parts) != (hierarchy.spatial, hierarchy.parts):
            self.read()  # the tree is another one
        else:
            self.vocabulary = vocabulary
            if self.view is not None:
                self.view.show_details()

    def _follow(self, changes: Sequence[Change]) -> None:
        hierarchy = self.hierarchy
        if hierarchy is None or not changes:
            return
        author = self.author()
        update = hierarchy.follow(changes, author)
        if update is None:
            if self._waiting is None:
                self.read()
            return
        now = self._clock()
        highlighted: dict[str, None] = {}
        for change in changes:
            if change.author != author:
                for element in change.elements:
                    self.highlights[element.id] = Highlight(change.author, change.action, now)
                    highlighted[element.id] = None
                for relation in change.relations:
                    for eid in (relation["src"], relation["dst"]):
                        self.highlights[eid] = Highlight(change.author, change.action, now)
                        highlighted[eid] = None
        self._editor.on_changes(update.by_change)
        if self.selected and self.selected not in hierarchy.scene:
            self.select("")
        if self._element_to_select:
            self._select_when_added(self._element_to_select)
        if self.view is None:
            return
        self.view.show_highlights(list(highlighted))
        if self.selected in update.elements:
            self.view.show_details()

    def expire_highlights(self) -> None:
        """Ends the highlights whose time is over. Called now and then."""
        over = [eid for eid, mark in self.highlights.items() if self._clock() - mark.stamp >= HIGHLIGHT_SECONDS]
        for eid in over:
            del self.highlights[eid]
        if over and self.view is not None:
            self.view.show_highlights(over)

    # -- looking -----------------------------------------------------------------------------------------------

    def select(self, eid: str, by: object = None) -> None:
        """The user has selected an element; "" none.

        :param by: who tells it, and need not be told.
        """
        if eid == self.selected:
            return
        self.selected = eid
        self.window.publish(ElementSelected(eid, self))
        if self.view is not None:
            self.view.show_details()
            if by is not self.view:
                self.view.show_selection()

    def _on_selected(self, event: ElementSelected) -> None:
        if event.by is self or event.eid == self.selected:
            return
        if event.eid and (self.hierarchy is None or event.eid not in self.hierarchy.scene):
            return
        self.selected = event.eid
        if self.view is not None:
            self.view.show_details()
            self.view.show_selection()

    def details(self) -> Details | None:
        """What is shown of the selected element; None when none is."""
        if self.hierarchy is None or self.vocabulary is None:
            return None
        return details_of(self.hierarchy, self.vocabulary, self.selected)

    def find(self, text: str) -> list[str]:
        """The elements that have all words of a text in their id, label or values."""
        return self.hierarchy.find(text) if self.hierarchy is not None else []

    # -- changing ----------------------------------------------------------------------------------------------

    @property
    def requests(self) -> Requests | None:
        """Makes the operations of what the user wants; None while there is no scene."""
        if self.hierarchy is None or self.vocabulary is None:
            return None
        return Requests(self.hierarchy, self.vocabulary)

    def change(
        self,
        text: str,
        make: Callable[[Requests], list[Operation]],
        done: Callable[[Outcome], None] | None = None,
    ) -> str:
        """Changes the scene, in one request that can be undone.

        :param text: what it is, in words: "remove LargeBox-3".
        :param make: makes the operations; none: nothing is sent.
        :param done: called with what came of it.
        :returns: why nothing was sent, which the error bar shows too; "" when it was.
        """
        requests = self.requests
        try:
            if requests is None:
                raise Refused("there is no world model")
            operations = make(requests)
        except SkirosError as error:
            self.window.problems.report(text, error)
            return str(error)
        if operations:
            self._editor.send(text, operations, done)
        return ""

    def undo(self) -> None:
        """Takes the user's last change back, once all before it have come to their end."""
        self._editor.undo()

    def redo(self) -> None:
        """Does again what was taken back last, likewise."""
        self._editor.redo()

    def add(self, text: str, make: Callable[[Requests], list[Operation]]) -> str:
        """Adds an element as `change` does, and selects it when it is there."""
        return self.change(text, make, lambda outcome: self._select_when_added(outcome.ids[0]))

    def _select_when_added(self, eid: str) -> None:
        self._element_to_select = eid
        if self.hierarchy is not None and eid in self.hierarchy.scene:
            self._element_to_select = ""
            self.select(eid)

    def _who(self, eid: str) -> str:
        """Who has changed an element last, and when. Called by jobs: it only looks."""
        hierarchy = self.hierarchy
        node = hierarchy.scene.record(eid) if hierarchy is not None else None
        if node is None or not node.provenance.author:
            return ""
        last = node.provenance
        return f"{last.author.strip('/')} at {time.strftime('%H:%M:%S', time.localtime(last.stamp))}"

    def author(self) -> str:
        """Who makes the changes of this window, as the world model names it."""
        world = self.window.system.world
        return world.author if world is not None else ""

    def _show_undo(self) -> None:
        if self.view is not None:
            self.view.show_undo()


def read_scene(world: WorldModelAbstractInterface) -> tuple[SceneHierarchy, Vocabulary]:
    """The scene and the ontologies, made ready to be shown. Blocks for the world model.

    :raises WmException: it does not answer.
    """
    vocabulary = read_vocabulary(world)
    hierarchy = SceneHierarchy(world.resolve_elements(Element()), vocabulary.spatial, vocabulary.parts)
    for eid in (TOP, ROOT):
        hierarchy.children(eid)
    return hierarchy, vocabulary
