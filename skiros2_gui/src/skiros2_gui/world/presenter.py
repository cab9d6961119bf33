"""The presenter of the tab "World model"."""

from __future__ import annotations

import enum
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from skiros2_common.core.changeset import ChangeSet
from skiros2_common.core.errors import Refused, SkirosError
from skiros2_common.core.operations import RESET, Change, Operation, Outcome
from skiros2_common.core.world_element import Element
from skiros2_gui.app.events import ConnectionChanged, ElementSelected, WorldChanged
from skiros2_gui.app.system import part_of
from skiros2_gui.app.window import Window
from skiros2_gui.world.details import Details, details_of
from skiros2_gui.world.editor import SceneEditor
from skiros2_gui.world.requests import Requests
from skiros2_gui.world.scene import TOP, SceneHierarchy
from skiros2_live.core.patch import WORLD_MODEL
from skiros2_world_model.core.scene import ROOT
from skiros2_world_model.core.vocabulary import Vocabulary, read_vocabulary
from skiros2_world_model.core.world_model_client import WorldModelClient

#: The duration of highlights (s).
HIGHLIGHT_SECONDS = 8.0
#: The time between attempts to read the scene, if one has failed while the world model is up (s).
RETRY_PERIOD = 10.0


@dataclass(frozen=True)
class Highlight:
    """A recent change of an element by another author.

    :param stamp: when it was received (s of a monotonic clock).
    """

    author: str
    action: str
    stamp: float


class Redraw(enum.Flag):
    """The parts of the tab to redraw."""

    SCENE = enum.auto()  # `hierarchy` and `vocabulary` have been replaced
    DETAILS = enum.auto()
    SELECTION = enum.auto()  # changed by other than the tree
    UNDO = enum.auto()
    HIGHLIGHTS = enum.auto()


class WorldPresenter:
    """The state of the tab. Used by the Qt thread only; jobs make the blocking calls.

    :param clock: monotonic (s).
    :ivar on_change: called with the parts to redraw.
    :ivar text_of_change: returns the text of the undo command for a change that a skill has made for the user; "" for
        any other change by another author.
    """

    def __init__(self, window: Window, clock: Callable[[], float] = time.monotonic) -> None:
        self.window = window
        self.hierarchy: SceneHierarchy | None = None
        self.vocabulary: Vocabulary | None = None
        self._editor = SceneEditor(window, lambda: self.on_change(Redraw.UNDO), clock)
        self.undo_stack = self._editor.undo_stack
        self.selected = ""
        self.highlights: dict[str, Highlight] = {}
        self.on_change: Callable[[Redraw], None] = lambda part: None
        self.text_of_change: Callable[[ChangeSet], str] = lambda change: ""
        self._clock = clock
        self._waiting: list[Change] | None = None  # received while the scene is being read
        self._is_stale = False
        self._is_replaced = False  # another scene was loaded: discard the undo stack
        self._is_missing = True  # reading the scene failed, or has not been tried
        self._failed_at = 0.0
        self._element_to_select = ""  # added, but not received yet
        window.subscribe(WorldChanged, self._on_changed)
        window.subscribe(ElementSelected, self._on_selected)
        window.subscribe(ConnectionChanged, lambda _: self._read_if_missing())
        if window.system.world is not None:
            self.read()

    # -- the scene ---------------------------------------------------------------------------------------------

    def read(self) -> None:
        """Reads the scene and the ontologies."""
        world = self.window.system.world
        if world is None:
            return
        if self._waiting is not None:
            self._is_stale = True  # the read in progress may be out of date
            return
        self._waiting = []
        self._editor.begin_read()
        self.window.jobs.run(
            lambda: read_scene(world), self._scene_read, self._read_failed, activity="reading the scene"
        )

    def _scene_read(self, found: tuple[SceneHierarchy, Vocabulary]) -> None:
        changes, self._waiting = self._waiting or [], None
        if self._is_stale:
            self._is_stale = False
            self.read()
            return
        before = self.hierarchy
        self.hierarchy, self.vocabulary = found
        self._is_missing = False
        if self._is_replaced:
            self._is_replaced = False
            self._editor.clear()
        self.highlights.clear()
        self.on_change(Redraw.SCENE | Redraw.DETAILS)
        self._editor.end_read(before.scene if before is not None else None, self.hierarchy.newest)
        if self._element_to_select:
            self._select_when_added(self._element_to_select)
        if self.selected and self.selected not in self.hierarchy.scene:
            self.select("")
        self._follow(changes)

    def _read_failed(self, error: Exception) -> None:
        self._waiting, self._is_stale, self._is_missing = None, False, True
        self._failed_at = self._clock()
        self.window.problems.report("reading the scene", error)

    def _read_if_missing(self) -> None:
        """Reads the scene when the world model is back, if reading it failed."""
        part = part_of(self.window.tasks.cell, WORLD_MODEL)
        if self._is_missing and self._waiting is None and part is not None and part.is_up:
            self.read()

    def check(self) -> None:
        """Reads the scene if a change is overdue, or reading it failed. To be called periodically."""
        if self._is_missing:
            if self._clock() - self._failed_at > RETRY_PERIOD:
                self._read_if_missing()
        elif self._waiting is None and self.undo_stack.is_overdue:
            self.read()

    def _on_changed(self, event: WorldChanged) -> None:
        if any(change.action == RESET for change in event.changes):
            self._is_replaced = True
        if self._waiting is not None:
            self._waiting.extend(event.changes)
        self._follow(event.changes)  # also while the scene is read, for the undo stack
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
            self.read()  # the tree has changed
        else:
            self.vocabulary = vocabulary
            self.on_change(Redraw.DETAILS)

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
        now, part = self._clock(), Redraw(0)
        for change in changes:
            if change.author != author:
                ends = (relation[side] for relation in change.relations for side in ("src", "dst"))
                ids = [*(element.id for element in change.elements), *ends]
                self.highlights.update(dict.fromkeys(ids, Highlight(change.author, change.action, now)))
                part |= Redraw.HIGHLIGHTS
        self._editor.on_changes(update.by_change)
        for change_set in update.by_others:
            if text := self.text_of_change(change_set):
                self._editor.adopt(text, change_set)
        if self.selected and self.selected not in hierarchy.scene:
            self.select("")
        if self._element_to_select:
            self._select_when_added(self._element_to_select)
        self.on_change(part | Redraw.DETAILS if self.selected in update.elements else part)

    def expire_highlights(self) -> None:
        """Removes old highlights. To be called periodically."""
        oldest = self._clock() - HIGHLIGHT_SECONDS
        expired = [eid for eid, highlight in self.highlights.items() if highlight.stamp <= oldest]
        for eid in expired:
            del self.highlights[eid]
        if expired:
            self.on_change(Redraw.HIGHLIGHTS)

    # -- selection ---------------------------------------------------------------------------------------------

    def select(self, eid: str, in_tree: bool = False) -> None:
        """Selects an element; "" for none.

        :param in_tree: whether it was selected in the tree, which is not notified.
        """
        if eid == self.selected:
            return
        self.selected = eid
        self.window.publish(ElementSelected(eid, self))
        self.on_change(Redraw.DETAILS if in_tree else Redraw.DETAILS | Redraw.SELECTION)

    def _on_selected(self, event: ElementSelected) -> None:
        if event.by is self or event.eid == self.selected:
            return
        if event.eid and (self.hierarchy is None or event.eid not in self.hierarchy.scene):
            return
        self.selected = event.eid
        self.on_change(Redraw.DETAILS | Redraw.SELECTION)

    def details(self) -> Details | None:
        """Returns the details of the selected element, or None."""
        if self.hierarchy is None or self.vocabulary is None:
            return None
        return details_of(self.hierarchy, self.vocabulary, self.selected)

    def find(self, text: str) -> list[str]:
        """Returns the elements whose id, label or values contain all words of a text."""
        return self.hierarchy.find(text) if self.hierarchy is not None else []

    # -- changing ----------------------------------------------------------------------------------------------

    @property
    def requests(self) -> Requests | None:
        """Makes the operations of the user's changes; None without a scene."""
        if self.hierarchy is None or self.vocabulary is None:
            return None
        return Requests(self.hierarchy, self.vocabulary)

    def change(
        self,
        text: str,
        make: Callable[[Requests], list[Operation]],
        done: Callable[[Outcome], None] | None = None,
    ) -> str:
        """Changes the scene in one request that can be undone.

        :param text: what the user does: "remove LargeBox-3".
        :param make: returns the operations; if there are none, nothing is sent.
        :param done: called with the outcome.
        :returns: the error, which the error bar shows too; "" on success.
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
        """Undoes the last command, after all running requests have ended."""
        self._editor.undo()

    def redo(self) -> None:
        """Redoes the command undone last, after all running requests have ended."""
        self._editor.redo()

    def add(self, text: str, make: Callable[[Requests], list[Operation]]) -> str:
        """Adds an element like `change`, and selects it."""
        return self.change(text, make, lambda outcome: self._select_when_added(outcome.ids[0]))

    def _select_when_added(self, eid: str) -> None:
        self._element_to_select = eid
        if self.hierarchy is not None and eid in self.hierarchy.scene:
            self._element_to_select = ""
            self.select(eid)

    def author(self) -> str:
        """Returns the author of this window's changes."""
        world = self.window.system.world
        return world.author if world is not None else ""


def read_scene(world: WorldModelClient) -> tuple[SceneHierarchy, Vocabulary]:
    """Returns the scene and the ontologies. Blocks for the world model.

    :raises WmException: it does not answer.
    """
    vocabulary = read_vocabulary(world)
    hierarchy = SceneHierarchy(world.resolve_elements(Element()), vocabulary.spatial, vocabulary.parts)
    for eid in (TOP, ROOT):
        hierarchy.children(eid)
    return hierarchy, vocabulary
