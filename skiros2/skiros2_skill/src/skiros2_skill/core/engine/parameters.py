"""Keeps the parameters of running nodes up to date, and writes and pushes what skills have changed."""

from __future__ import annotations

import logging
import weakref
from collections.abc import Callable, Collection, Iterable

from skiros2_common.core.abstract_skill import State
from skiros2_common.core.errors import Refused, SkirosError
from skiros2_common.core.explanation import HOLD, PARAMETER
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
from skiros2_skill.core.engine.failures import HOLD_FAILED, Failure, check_conditions
from skiros2_skill.core.tree.hook_guard import HookGuard
from skiros2_skill.core.tree.skill_node import SkillWrapper

log = logging.getLogger(__name__)

_Nodes = dict[SkillWrapper, None]


class Readers:
    """The running nodes by the elements and the blackboard keys that they read. For the thread that ticks the task.

    A marked node is `stale`: its parameters are refreshed before its next `execute`. A node without known reads is
    marked by every change; `add` begins so, because many skills end before anything changes.
    """

    def __init__(self) -> None:
        self._of_anything: _Nodes = {}
        self._of_element: dict[str, _Nodes] = {}
        self._of_key: dict[str, _Nodes] = {}
        self._revisions: dict[str, object] = {}  # of the elements, when they were last compared

    def add(self, node: SkillWrapper) -> None:
        """Adds a node that starts."""
        self.remove(node)
        self._of_anything[node] = None

    def set_reads(self, node: SkillWrapper, ids: Collection[str], revision: Callable[[str], object]) -> None:
        """Records what a node is about to read, besides the keys of its slots.

        :param ids: of elements.
        :param revision: returns the present revision of an element.
        """
        reads = (tuple(ids), tuple(slot.key for slot in node.slots))
        if node.reads == reads:
            return
        self.remove(node)
        node.reads = reads
        for eid in reads[0]:
            self._of_element.setdefault(eid, {})[node] = None
            if eid not in self._revisions:
                self._revisions[eid] = revision(eid)
        for key in reads[1]:
            self._of_key.setdefault(key, {})[node] = None

    def remove(self, node: SkillWrapper) -> None:
        """Removes a node that has ended."""
        self._of_anything.pop(node, None)
        if node.reads is None:
            return
        ids, keys = node.reads
        node.reads = None
        for eid in ids:
            if _has_last(self._of_element, eid, node):
                del self._revisions[eid]
        for key in keys:
            _has_last(self._of_key, key, node)

    def mark_changed(self, revision: Callable[[str], object]) -> None:
        """Marks the readers of the elements that have changed since the last call.

        :param revision: returns the present revision of an element.
        """
        changed = [eid for eid, seen in self._revisions.items() if revision(eid) is not seen]
        for eid in changed:
            self._revisions[eid] = revision(eid)  # before the nodes read it
            _mark(self._of_element[eid])
        _mark(self._of_anything)

    def mark_keys(self, keys: Iterable[str]) -> None:
        """Marks the readers of keys of the blackboard."""
        for key in keys:
            _mark(self._of_key.get(key, ()))
        _mark(self._of_anything)

    def mark_all(self) -> None:
        """Marks all nodes."""
        for nodes in (self._of_anything, *self._of_element.values(), *self._of_key.values()):
            _mark(nodes)


def _mark(nodes: Iterable[SkillWrapper]) -> None:
    for node in nodes:
        node.stale = True
        node.steady = False


def _has_last(index: dict[str, _Nodes], name: str, node: SkillWrapper) -> bool:
    """Removes a node from the readers of a name. Returns whether it was the last one."""
    nodes = index.get(name, {})
    nodes.pop(node, None)
    if nodes:
        return False
    index.pop(name, None)
    return True


_REFRESH = "the refresh of its elements"


class Parameters:
    """The parameters of the nodes of one task. For the thread that ticks the task.

    A change of the world model or of the blackboard marks the running nodes that read what has changed as `stale`; only
    these are refreshed.

    :param wmi: the world model as the task sees it.
    :param guard: guards the calls of the world model.
    :param wake: requests a tick at once; any thread may call it.
    """

    def __init__(self, wmi: WorldModelPort, guard: HookGuard, wake: Callable[[], None]) -> None:
        self._wmi = wmi
        self._guard = guard
        self._wake = wake
        #: For hold-conditions on signals; the task sets it before its first tick.
        self.signals: SignalSource = LocalSignals()
        self.blackboard = Blackboard(ParamHandler())  # the task's, from its first tick on
        self.local_revision = -1  # at the last `update_revision`; -1 when the world model has no version
        self.world_version = -1  # of the world model at the last `update_revision`
        #: Whether the world model has changed and the nodes that read the changed elements are not marked yet.
        self.world_changed = True
        self._revisions: Revisions | None = None
        self._readers = Readers()
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

    def start(self, node: SkillWrapper, is_current: bool) -> None:
        """Prepares the refreshes of a node that starts.

        :param is_current: whether nothing has changed since its parameters were read.
        """
        node.volatile = any(c.volatile for c in node.hold_conditions)
        node.stale = bool(node.hold_conditions) or not is_current
        self._readers.add(node)
        if node.hold_conditions:
            self._guard.call(node, "the start of its hold-conditions", self._watch, node)

    def end(self, node: SkillWrapper) -> None:
        """Ends the refreshes of a node."""
        self._readers.remove(node)
        while node.watches:
            node.watches.pop()()

    def _watch(self, node: SkillWrapper) -> None:
        for condition in node.hold_conditions:
            stop = condition.watch(node._params, self._wmi, self.signals, self._wake)
            if stop is not None:
                node.watches.append(stop)

    def refresh(self, node: SkillWrapper) -> Failure | None:
        """Refreshes the parameters of a running node if they are stale, and checks its hold-conditions.

        :returns: the failure when a condition is unsatisfied or an element was removed.
        """
        try:
            revisions = self.revisions(node)
            if node.stale:
                self.blackboard.pull(node, node.slots)
                self._set_reads(node, revisions)
                removed = self._refresh_elements(node, revisions)
                if removed and not node.is_compound:  # the children of a compound check what they need
                    text = f"{removal_text(removed[0], self._wmi)}, while {node.label} was running with it"
                    return Failure(HOLD, HOLD_FAILED, text)
                failure = self._check_hold_conditions(node)
            else:
                failure = self._check_hold_conditions(node) if node.volatile else None
        except SkirosError as error:
            return Failure(PARAMETER, HOLD_FAILED, str(error))
        if failure is None:
            node.stale = False
        return failure

    def _set_reads(self, node: SkillWrapper, revisions: Revisions | None) -> None:
        """Records what a node is about to read: a change after this call marks it again."""
        if revisions is None:
            return
        ids = {value.id for slot in node.element_slots for value in slot.param.current if value.id}
        for condition in node.hold_conditions:
            read = condition.element_ids(node._params)
            if read is not None:
                ids |= read
            elif not condition.volatile:
                self._readers.add(node)  # it may read anything
                return
        self._readers.set_reads(node, ids, revisions.element)

    def pull(self, node: SkillWrapper) -> None:
        """Refreshes the parameters of a node if they are stale; removed elements are dropped.

        :raises WmException: the world model does not answer.
        """
        revisions = self.revisions(node)
        if node.stale:
            self.blackboard.pull(node, node.slots)
            self._refresh_elements(node, revisions)

    def try_pull(self, node: SkillWrapper) -> None:
        """Same as `pull`; the node keeps its parameters when the world model does not answer."""
        self.update_revision()
        try:
            self.pull(node)
        except SkirosError as error:
            log.debug("%s keeps its parameters: %s", node.printState(), error)

    def drop_removed(self, node: SkillWrapper) -> None:
        """Drops the elements that a node, or a node below it, has removed.

        :raises WmException: the world model does not answer.
        """
        revisions = self.revisions(node)
        if revisions is None:
            self._refresh_elements(node, None)
            return
        for slot in node.element_slots:
            values = slot.param.current
            existing = [e for e in values if (revisions.element(e.id) is not None if e.id else not is_removed(e))]
            if len(existing) < len(values):
                slot.drop([e for e in values if e not in existing])

    def revisions(self, node: SkillWrapper) -> Revisions | None:
        """The world model's revisions; if it has changed, the nodes that read the changed elements are marked.

        :param node: named when the call hangs.
        :raises WmException: the world model does not answer.
        """
        if self.world_changed and self._wmi is not None:
            revisions = self._guard.call(node, _REFRESH, self._wmi.revisions)
            known, self._revisions = self._revisions, revisions
            if revisions is None or known is None or revisions.ontology is not known.ontology:
                self._readers.mark_all()
            else:
                self._readers.mark_changed(revisions.element)
        self.world_changed = False
        return self._revisions

    def _refresh_elements(self, node: SkillWrapper, revisions: Revisions | None) -> list[str]:
        return self._guard.call(node, _REFRESH, refresh_elements, node.element_slots, self._wmi, revisions)

    def _check_hold_conditions(self, node: SkillWrapper) -> Failure | None:
        if not node.hold_conditions:
            return None
        arguments = (HOLD, node.hold_conditions, node._params, self._wmi, node.evaluated)
        return self._guard.call(node, "its conditions", check_conditions, *arguments)

    # -- write back and push -----------------------------------------------------------------------------------

    def write_back(self, node: SkillWrapper, state: State, version: int) -> None:
        """Writes the elements that an `execute` has assigned to parameters, as one change, and drops removed ones.

        The values of a running node are pushed to the blackboard.

        :param version: of the world model before the `execute`.
        :raises SkirosError: the world model refuses, or does not answer.
        """
        elements = assigned_elements(node.element_slots)
        if elements:
            try:
                for element in elements:
                    present = self._wmi.find_element(element.id) if element.changes() is None else None
                    if present is not None:  # the skill has built the element itself
                        element.complete(present)
                self._wmi.update_elements(elements)
            except SkirosError as error:
                discard_changes(node.element_slots, self._wmi)
                raise Refused(f"the world model refused what the skill changed: {error}") from error
        if state is State.Running:
            self.push(node)
        self.update_revision()
        if self.world_version != version:
            self.drop_removed(node)

    def push(self, node: SkillWrapper, everything: bool = False, removes: bool = True) -> None:
        """Pushes the parameters of a node to the blackboard; see `Blackboard.push`."""
        keys = self.blackboard.push(node, node.slots, everything, removes)
        if keys:
            self._readers.mark_keys(keys)
        node.lent = [slot.param for slot in node.slots if slot.param.shared_snapshot is not None]
        if node.lent:
            node.steady = False  # its lists may change in place

    def log_unwritten(self, node: SkillWrapper) -> None:
        """Logs elements that a skill has changed in place: such changes are not written."""
        if not log.isEnabledFor(logging.DEBUG):
            return
        changed = [e for e in unwritten_elements(node.element_slots) if e not in self._logged]
        if changed:
            self._logged.update(changed)
            log.debug(
                "%s succeeded; changed in place and not written to the world model: %s. "
                "To write it, assign the parameter or call update_element.",
                node.printState(), ", ".join(map(repr, changed)),
            )  # fmt: skip
