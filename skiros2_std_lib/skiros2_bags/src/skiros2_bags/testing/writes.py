"""Compares the changes of the world model that a re-run makes with those that the managers have made."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from skiros2_bags.core.diff import POSE, diff_changes, summary, unchanged_keys
from skiros2_bags.testing.field_tolerances import FieldTolerances
from skiros2_bags.testing.recorded_world import recorded_unchanged
from skiros2_bags.testing.recording import RecordedTask, Recording, WorldChange, task_changes
from skiros2_common.core.operations import Change
from skiros2_world_model.core.replica import apply_change, scene_of
from skiros2_world_model.core.scene import Scene


@dataclass(frozen=True)
class WriteDifference:
    """A change that differs.

    :param event: the recorded one; None: a further one was made.
    """

    event: WorldChange | None
    author: str
    expected: str
    got: str


class Writes:
    """The recorded changes by the managers of tasks, and which of them a re-run has made.

    Changes of one element are compared in order; the order between elements within a tick may differ.

    :param scene: the scene before the first change.
    """

    def __init__(
        self, recording: Recording, runs: Sequence[RecordedTask], tolerances: FieldTolerances, scene: Scene
    ) -> None:
        self._unchanged = recorded_unchanged(recording)
        self._own = {event.order for event in task_changes(recording, runs)}
        #: The recorded changes that were not made yet.
        self.waiting = [event for event in recording.changes if event.order in self._own]
        self.has_any = bool(self.waiting)
        first = min(run.begin for run in runs)
        #: Whether others have moved elements: skills that work with their poses do not get exactly the same again.
        self.has_measured_poses = any(
            self._moves(event) for event in recording.changes if event.order >= first and event.order not in self._own
        )
        self._tolerances = tolerances
        self._shadow = scene_of([e for node in scene if (e := scene.element(node.id)) is not None])
        #: The first difference.
        self.difference: WriteDifference | None = None

    def is_own(self, event: WorldChange) -> bool:
        """Whether a manager has made a recorded change."""
        return event.order in self._own

    def drop(self, event: WorldChange) -> None:
        """Does not wait for a change any more."""
        self.waiting.remove(event)

    def apply(self, change: Change, is_own: bool) -> None:
        """Takes a change that the re-run has made.

        :param is_own: whether a manager has made it.
        """
        unchanged = unchanged_keys(change, self._shadow)
        apply_change(self._shadow, change)
        if not is_own:
            return
        # By content: a change may be recorded after the progress of its tick, and with it after others.
        same = [event for event in self.waiting if subject(event.change) == subject(change)]
        if not same:
            self._differs(None, change.author, "no further change", summary(change))
            return
        differences = self._differences(same[0], change, unchanged)
        if differences and len(same) > 1 and not self._differences(same[1], change, unchanged):
            self._differs(same[0], change.author, summary(same[0].change), "nothing")
        elif differences:
            self._differs(same[0], change.author, summary(same[0].change), "\n".join(differences))
        self.waiting.remove(same[0])

    def missing(self, is_due: Callable[[WorldChange], bool]) -> WriteDifference | None:
        """Returns the first change that is due, and was not made; None without one."""
        event = next(filter(is_due, self.waiting), None)
        return event and WriteDifference(event, event.change.author, summary(event.change), "nothing")

    def _differs(self, event: WorldChange | None, author: str, expected: str, got: str) -> None:
        self.difference = self.difference or WriteDifference(event, author, expected, got)

    def _differences(self, event: WorldChange, change: Change, unchanged: dict[str, set[str]]) -> list[str]:
        recorded = self._unchanged[event.order]
        neither = {eid: keys & recorded.get(eid, set()) for eid, keys in unchanged.items()}
        tolerance_of = self._tolerances.of_property(self.has_measured_poses)
        return diff_changes(event.change, change, tolerance_of, neither)

    def _moves(self, event: WorldChange) -> bool:
        """Whether a recorded change moves an element that was there before."""
        unchanged = self._unchanged[event.order]
        moved = (e for e in event.change.elements if e.id in unchanged)
        return any(POSE.fullmatch(key) and key not in unchanged[e.id] for e in moved for key in e.property_view)


def subject(change: Change) -> str:
    """Returns the ids of the elements of a change; else its relations."""
    return ", ".join([e.id for e in change.elements] or [str(sorted(r.items())) for r in change.relations])
