"""Keeps the parameters of running nodes up to date, and writes and pushes what skills have changed."""

from __future__ import annotations

import logging
import weakref
from typing import Any

from skiros2_common.core.abstract_skill import State
from skiros2_common.core.errors import Refused, SkirosError
from skiros2_common.core.explanation import HOLD, PARAMETER
from skiros2_common.core.revision import local_revision
from skiros2_skill.core.engine.blackboard import (
    assigned_elements,
    discard_changes,
    is_removed,
    refresh_elements,
    removal_text,
    unwritten_elements,
)
from skiros2_skill.core.engine.checks import check_conditions, depends_on_elements_only, is_volatile
from skiros2_skill.core.engine.failures import HOLD_FAILED, Failure
from skiros2_skill.core.tree.hook_guard import HookGuard
from skiros2_skill.core.tree.skill_node import SkillWrapper

log = logging.getLogger(__name__)

_REFRESH = "the refresh of its elements"


class ReadSet:
    """The revisions of what a node has read: the ontologies, and the elements in its parameters.

    :param elements: pairs of element id and revision.
    """

    __slots__ = ("elements", "ontology")

    def __init__(self, ontology: object, elements: list[tuple[str, object]]) -> None:
        self.ontology = ontology
        self.elements = elements

    def is_current(self, revisions: Any) -> bool:
        """Whether none of it has changed."""
        if revisions is None or revisions.ontology is not self.ontology:
            return False
        element = revisions.element
        for eid, seen in self.elements:  # noqa: SIM110 - all() takes twice the time
            if element(eid) is not seen:
                return False
        return True


class Parameters:
    """The parameters of the nodes of one task. For the thread that ticks the task.

    `revision` counts the changes of the task's parameters and of the world model. A node that was refreshed at this
    revision needs no refresh; at a later one, what has changed since is read again.

    :param wmi: the world model as the task sees it.
    :param guard: guards the calls of the world model.
    """

    def __init__(self, wmi: Any, guard: HookGuard) -> None:
        self._wmi = wmi
        self._guard = guard
        self.blackboard: Any = None  # the task's, from its first tick on
        self.revision = 0
        self._params_revision = 0  # of the last change of a parameter
        self.local_revision = -1  # at the last `update_revision`; -1 when the world model has no version
        self.world_version = -1  # of the world model at the last `update_revision`
        self._revisions: Any = None
        self._revisions_version = -1
        self._logged: weakref.WeakSet[Any] = weakref.WeakSet()  # elements with unwritten changes that were logged

    @property
    def is_current(self) -> bool:
        """Whether the world model has not changed since the last `update_revision`. Any thread."""
        return self._wmi is None or (self.world_version != -1 and self._wmi.version == self.world_version)

    def update_revision(self) -> None:
        """Increments the revision if the world model has changed."""
        local = local_revision.current
        if local == self.local_revision:
            return
        version = self._wmi.version if self._wmi is not None else 0
        self.local_revision = local if version != -1 else -1
        if version != self.world_version or version == -1:
            self.world_version = version
            self.revision += 1

    # -- refresh -----------------------------------------------------------------------------------------------

    def start(self, node: SkillWrapper, revision: int) -> None:
        """Prepares the refreshes of a node that starts.

        :param revision: at which its parameters were read; -1 when something has changed since.
        """
        node.volatile = any(is_volatile(c, self._wmi) for c in node._hold_conditions)
        node.read_set = None
        node.seen_revision = -1 if node._hold_conditions else revision

    def refresh(self, node: SkillWrapper) -> Failure | None:
        """Refreshes the parameters of a running node if something has changed, and checks its hold-conditions.

        :returns: the failure when a condition is unsatisfied or an element was removed.
        """
        if node.seen_revision == self.revision:
            return self._check_hold_conditions(node) if node.volatile else None
        revision = self.revision
        try:
            pulled = node.seen_revision < self._params_revision and self.blackboard.pull(node, node.slots)
            revisions = self.revisions(node)
            if pulled or node.read_set is None or not node.read_set.is_current(revisions):
                # The revisions are recorded before the elements are read: a change in between is read at the next tick.
                node.read_set = _read_set(node, revisions)
                removed = self._refresh_elements(node, revisions)
                if removed and not node.is_compound:  # the children of a compound check what they need
                    text = f"{removal_text(removed[0], self._wmi)}, while {node.label} was running with it"
                    return Failure(PARAMETER, HOLD_FAILED, text)
                failure = self._check_hold_conditions(node)
            else:
                failure = self._check_hold_conditions(node) if node.volatile else None
        except SkirosError as error:
            return Failure(PARAMETER, HOLD_FAILED, str(error))
        if failure is None:
            node.seen_revision = revision
        return failure

    def pull(self, node: SkillWrapper) -> None:
        """Refreshes the parameters of a node if something has changed; removed elements are dropped.

        :raises WmException: the world model does not answer.
        """
        if node.seen_revision != self.revision:
            self.blackboard.pull(node, node.slots)
            self._refresh_elements(node, self.revisions(node))
            node.read_set = None

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
            values = slot.param._values
            existing = [e for e in values if (revisions.element(e.id) is not None if e.id else not is_removed(e))]
            if len(existing) < len(values):
                slot.param._values = existing
                slot.shared = None

    def revisions(self, node: SkillWrapper) -> Any:
        """The world model's revisions, fetched once for each version.

        :param node: named when the call hangs.
        :raises WmException: the world model does not answer.
        """
        if self._revisions_version != self.world_version or self.world_version == -1:
            self._revisions = None
            if self._wmi is not None:
                self._revisions = self._guard.call(node, _REFRESH, self._wmi.revisions)
            self._revisions_version = self.world_version
        return self._revisions

    def _refresh_elements(self, node: SkillWrapper, revisions: Any) -> list[str]:
        return self._guard.call(node, _REFRESH, refresh_elements, node.element_slots, self._wmi, revisions)

    def _check_hold_conditions(self, node: SkillWrapper) -> Failure | None:
        if not node._hold_conditions:
            return None
        arguments = (HOLD, node._hold_conditions, node._params, self._wmi)
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
            node.read_set = None
            try:
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
        if self.blackboard.push(node, node.slots, everything, removes):
            self.revision += 1
            self._params_revision = self.revision
        node.lent = [slot.param for slot in node.slots if slot.param.shared_snapshot is not None]
        if node.lent:
            node.steady_revision = -1  # its lists may change in place

    def log_unwritten(self, node: SkillWrapper) -> None:
        """Logs elements that a skill has changed in place: such changes are not written."""
        changed = [e for e in unwritten_elements(node.element_slots) if e not in self._logged]
        if changed:
            self._logged.update(changed)
            log.debug(
                "%s succeeded; changed in place and not written to the world model: %s. "
                "To write it, assign the parameter or call update_element.",
                node.printState(), ", ".join(map(repr, changed)),
            )  # fmt: skip


def _read_set(node: SkillWrapper, revisions: Any) -> ReadSet | None:
    """What a node is about to read; None when its conditions may depend on more than its elements."""
    if revisions is None or not all(depends_on_elements_only(c, node._params._params) for c in node._hold_conditions):
        return None
    ids = [value.id for slot in node.element_slots for value in slot.param._values if value.id]
    return ReadSet(revisions.ontology, [(eid, revisions.element(eid)) for eid in ids])
