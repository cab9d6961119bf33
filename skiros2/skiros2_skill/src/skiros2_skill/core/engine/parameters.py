"""Keeps the parameters of running nodes up to date, and writes and pushes what skills have changed."""

from __future__ import annotations

import logging
import weakref
from collections.abc import Callable, Collection, Iterable, Sequence

from skiros2_common.core.abstract_skill import State
from skiros2_common.core.condition import ConditionBase
from skiros2_common.core.errors import Refused, SkirosError
from skiros2_common.core.explanation import EXCEPTION, HOLD, PARAMETER
from skiros2_common.core.params import ParamHandler
from skiros2_common.core.revision import local_revision
from skiros2_common.core.signals import LocalSignals, SignalSource
from skiros2_common.core.world_element import Element
from skiros2_common.core.world_model_port import Revisions, WorldModelPort
from skiros2_skill.core.engine.blackboard import Blackboard
from skiros2_skill.core.engine.elements import (
    assigned_elements,
    discard_changes,
    is_removed,
    refresh_elements,
    removal_text,
    unwritten_elements,
)
from skiros2_skill.core.engine.evidence import Evidence
from skiros2_skill.core.engine.failures import EXECUTE_RAISED, HOLD_FAILED, Failure, check_conditions
from skiros2_skill.core.engine.hook_guard import HookGuard
from skiros2_skill.core.engine.skill_run import SkillRun

log = logging.getLogger(__name__)

_Runs = dict[SkillRun, None]


class DependencyIndex:
    """The skill runs by the elements and the blackboard keys that they read. For the thread that ticks the task.

    A marked run is `stale`: its parameters are refreshed before its next `execute`. A run without known reads is marked
    by every change; `add` begins so, because many skills end before anything changes.
    """

    def __init__(self) -> None:
        self._of_anything: _Runs = {}
        self._of_element: dict[str, _Runs] = {}
        self._of_key: dict[str, _Runs] = {}
        self._revisions: dict[str, object] = {}  # of the elements, when they were last compared

    def add(self, run: SkillRun) -> None:
        """Adds a run that starts."""
        if run.reads is not None:
            self.remove(run)
        self._of_anything[run] = None

    def set_reads(self, run: SkillRun, ids: Collection[str], revision: Callable[[str], object]) -> None:
        """Records what a run is about to read, besides the keys of its slots.

        :param ids: of elements.
        :param revision: returns the present revision of an element.
        """
        reads = (tuple(ids), tuple(slot.key for slot in run.slots))
        if run.reads == reads:
            return
        self.remove(run)
        run.reads = reads
        for eid in reads[0]:
            self._of_element.setdefault(eid, {})[run] = None
            if eid not in self._revisions:
                self._revisions[eid] = revision(eid)
        for key in reads[1]:
            self._of_key.setdefault(key, {})[run] = None

    def remove(self, run: SkillRun) -> None:
        """Removes a run that has ended."""
        self._of_anything.pop(run, None)
        if run.reads is None:
            return
        ids, keys = run.reads
        run.reads = None
        for eid in ids:
            if _has_last(self._of_element, eid, run):
                del self._revisions[eid]
        for key in keys:
            _has_last(self._of_key, key, run)

    def mark_changed(self, ids: Iterable[str], revision: Callable[[str], object]) -> None:
        """Marks the runs that read elements that have changed since the last call.

        :param ids: of the elements that may have changed.
        :param revision: returns the present revision of an element.
        """
        for eid in ids:
            if eid not in self._revisions:
                continue
            seen, self._revisions[eid] = self._revisions[eid], revision(eid)  # before the runs read it
            if self._revisions[eid] is not seen:
                _mark(self._of_element[eid])
        _mark(self._of_anything)

    def mark_keys(self, keys: Iterable[str]) -> None:
        """Marks the runs that read keys of the blackboard."""
        for key in keys:
            _mark(self._of_key.get(key, ()))
        _mark(self._of_anything)

    def mark_all(self) -> None:
        """Marks all runs."""
        for runs in (self._of_anything, *self._of_element.values(), *self._of_key.values()):
            _mark(runs)


def _mark(runs: Iterable[SkillRun]) -> None:
    for run in runs:
        run.stale = True
        run.skips_refresh = False


def _has_last(index: dict[str, _Runs], name: str, run: SkillRun) -> bool:
    """Removes a run from those that read a name. Returns whether it was the last one."""
    runs = index.get(name, {})
    runs.pop(run, None)
    if runs:
        return False
    index.pop(name, None)
    return True


_REFRESH = "the refresh of its elements"


class Parameters:
    """The parameters of the skill runs of one task. For the thread that ticks the task.

    A change of the world model or of the blackboard marks the runs that read what has changed as `stale`; only
    these are refreshed.

    :param wmi: the world model as the task sees it.
    :param guard: guards the calls of the world model.
    :param wake: requests a tick at once; any thread may call it.
    :param evidence: collects the results of conditions, and what is pushed.
    """

    def __init__(
        self, wmi: WorldModelPort, guard: HookGuard[SkillRun], wake: Callable[[], None], evidence: Evidence
    ) -> None:
        self._wmi = wmi
        self.evidence = evidence
        self.guard = guard
        self._wake = wake
        #: For hold-conditions on signals; the task sets it before its first tick.
        self.signals: SignalSource = LocalSignals()
        self.blackboard = Blackboard(ParamHandler())  # the task's, from its first tick on
        self.local_revision = -1  # at the last `update_revision`; -1 when the world model has no version
        self.world_version = -1  # of the world model at the last `update_revision`
        #: Whether the world model has changed and the runs that read the changed elements are not marked yet.
        self.world_changed = True
        self._revisions: Revisions | None = None
        self._seen = 0  # how many recent changes the runs are marked for
        self._dependencies = DependencyIndex()
        self._logged: weakref.WeakSet[Element] = weakref.WeakSet()  # elements with unwritten changes that were logged

    @property
    def is_current(self) -> bool:
        """Whether the world model has not changed since the last `update_revision`. Any thread."""
        return self._wmi is None or (self.world_version != -1 and self._wmi.version == self.world_version)

    def update_revision(self) -> None:
        """Notices whether the world model has changed."""
        local = local_revision.current
        if local == self.local_revision:
            return
        version = self._wmi.version if self._wmi is not None else 0
        self.local_revision = local if version != -1 else -1
        if version != self.world_version or version == -1:
            self.world_version = version
            self.world_changed = True

    # -- refresh -----------------------------------------------------------------------------------------------

    def start(self, run: SkillRun, is_current: bool) -> None:
        """Prepares the refreshes of a run that starts.

        :param is_current: whether nothing has changed since its parameters were read.
        """
        run.stale = not is_current
        self._dependencies.add(run)
        if run.hold_conditions:
            run.volatile = any(c.volatile for c in run.hold_conditions)
            run.stale = True
            self.guard.call(run, "the start of its hold-conditions", self._watch, run)

    def end(self, run: SkillRun) -> None:
        """Ends the refreshes of a run."""
        self._dependencies.remove(run)
        if self.evidence.is_on:
            self.evidence.end(run)
        watches, run.watches = run.watches, ()
        for stop in reversed(watches):
            stop()

    def _watch(self, run: SkillRun) -> None:
        for condition in run.hold_conditions:
            stop = condition.watch(run.params, self._wmi, self.signals, self._wake)
            if stop is not None:
                run.watches = [*run.watches, stop]

    def refresh(self, run: SkillRun) -> Failure | None:
        """Refreshes the parameters of a run if they are stale, and checks its hold-conditions.

        :returns: the failure when a condition is unsatisfied or an element was removed.
        """
        try:
            revisions = self.revisions(run)
            if run.stale:
                self.blackboard.pull(run.node, run.slots)
                self._set_reads(run, revisions)
                removed = self._refresh_elements(run, revisions)
                if removed and not run.implementation.is_compound:  # the children of a compound check their own
                    text = f"{removal_text(removed[0], self._wmi)}, while {run.label} was running with it"
                    return Failure(HOLD, HOLD_FAILED, text)
                failure = self.check(HOLD, run.hold_conditions, run)
            else:
                failure = self.check(HOLD, run.hold_conditions, run) if run.volatile else None
        except SkirosError as error:
            return Failure(PARAMETER, HOLD_FAILED, str(error))
        if failure is None:
            run.stale = False
        return failure

    def _set_reads(self, run: SkillRun, revisions: Revisions | None) -> None:
        """Records what a run is about to read: a change after this call marks it again."""
        if revisions is None:
            return
        ids = {value.id for slot in run.element_slots for value in slot.param.current if value.id}
        for condition in run.hold_conditions:
            read = condition.element_ids(run.params)
            if read is not None:
                ids |= read
            elif not condition.volatile:
                self._dependencies.add(run)  # it may read anything
                return
        self._dependencies.set_reads(run, ids, revisions.element)

    def pull(self, run: SkillRun) -> None:
        """Refreshes the parameters of a run if they are stale; removed elements are dropped.

        :raises WmException: the world model does not answer.
        """
        revisions = self.revisions(run)
        if run.stale:
            self.blackboard.pull(run.node, run.slots)
            self._refresh_elements(run, revisions)

    def try_pull(self, run: SkillRun) -> None:
        """Same as `pull`; the run keeps its parameters when the world model does not answer."""
        self.update_revision()
        try:
            self.pull(run)
        except SkirosError as error:
            log.debug("%s keeps its parameters: %s", run.node.printState(), error)

    def drop_removed(self, run: SkillRun) -> None:
        """Drops the elements that a skill, or a skill below it, has removed.

        :raises WmException: the world model does not answer.
        """
        revisions = self.revisions(run)
        if revisions is None:
            self._refresh_elements(run, None)
            return
        for slot in run.element_slots:
            values = slot.param.current
            existing = [e for e in values if (revisions.element(e.id) is not None if e.id else not is_removed(e))]
            if len(existing) < len(values):
                slot.drop([e for e in values if e not in existing])

    def revisions(self, run: SkillRun) -> Revisions | None:
        """The world model's revisions; if it has changed, the runs that read the changed elements are marked.

        :param run: named when the call hangs.
        :raises WmException: the world model does not answer.
        """
        if self.world_changed and self._wmi is not None:
            revisions = self.guard.call(run, _REFRESH, self._wmi.revisions)
            known, self._revisions = self._revisions, revisions
            changed = self._changed_since(known, revisions) if revisions is not None else None
            if changed is None or revisions is None:
                self._dependencies.mark_all()
            else:
                self._dependencies.mark_changed(changed, revisions.element)
        self.world_changed = False
        return self._revisions

    def _changed_since(self, known: Revisions | None, revisions: Revisions) -> list[str] | None:
        """The elements that may have changed since the last revisions; None: any of them, or the ontologies."""
        recent, seen = revisions.recent, self._seen
        changed = recent.since(seen) if known is not None and recent is known.recent else None
        self._seen = recent.count if changed is None else seen + len(changed)
        return changed if known is not None and revisions.ontology is known.ontology else None

    def _refresh_elements(self, run: SkillRun, revisions: Revisions | None) -> list[str]:
        return self.guard.call(run, _REFRESH, refresh_elements, run.element_slots, self._wmi, revisions)

    def check(self, stage: str, conditions: Sequence[ConditionBase], run: SkillRun) -> Failure | None:
        """Checks hold- or post-conditions of a run; see `check_conditions`."""
        if not conditions:
            return None
        note = self.evidence.conditions(run, stage)
        arguments = (stage, conditions, run.params, self._wmi, run.evaluated, note)
        return self.guard.call(run, "its conditions", check_conditions, *arguments)

    # -- write back and push -----------------------------------------------------------------------------------

    def write_back(self, run: SkillRun, state: State, version: int) -> Failure | None:
        """Same as `_write_back`. Returns the failure when the world model refuses or does not answer."""
        is_current = local_revision.current == self.local_revision and version == self.world_version
        if is_current and state is not State.Running and not assigned_elements(run.element_slots):
            return None
        try:
            self.guard.call(run, "the writing of its elements", self._write_back, run, state, version)
        except SkirosError as error:
            return Failure(EXCEPTION, EXECUTE_RAISED, f"{run.label}: {error}")
        return None

    def _write_back(self, run: SkillRun, state: State, version: int) -> None:
        """Writes the elements that an `execute` has assigned to parameters, as one change, and drops removed ones.

        The values of a skill that continues are pushed to the blackboard.

        :param version: of the world model before the `execute`.
        :raises SkirosError: the world model refuses, or does not answer.
        """
        elements = assigned_elements(run.element_slots)
        if elements:
            try:
                for element in elements:
                    present = self._wmi.find_element(element.id) if element.changes() is None else None
                    if present is not None:  # the skill has built the element itself
                        element.complete(present)
                self._wmi.update_elements(elements)
            except SkirosError as error:
                discard_changes(run.element_slots, self._wmi)
                raise Refused(f"the world model refused what the skill changed: {error}") from error
        if state is State.Running:
            self.push(run)
        self.update_revision()
        if self.world_version != version:
            self.drop_removed(run)

    def push(self, run: SkillRun, everything: bool = False, removes: bool = True) -> None:
        """Pushes the parameters of a run to the blackboard; see `Blackboard.push`."""
        keys = self.blackboard.push(run, everything, removes)
        if self.evidence.is_on:
            self.evidence.push(run, keys, self.blackboard.values, everything)
        if keys:
            self._dependencies.mark_keys(keys)

    def log_unwritten(self, run: SkillRun) -> None:
        """Logs elements that a skill has changed in place: such changes are not written."""
        if not log.isEnabledFor(logging.DEBUG):
            return
        changed = [e for e in unwritten_elements(run.element_slots) if e not in self._logged]
        if changed:
            self._logged.update(changed)
            log.debug(
                "%s succeeded; changed in place and not written to the world model: %s. "
                "To write it, assign the parameter or call update_element.",
                run.node.printState(), ", ".join(map(repr, changed)),
            )  # fmt: skip
