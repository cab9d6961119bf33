"""The running nodes below a node in one list, ticked without a visit of the groups between.

A group whose children stay Running does nothing in a tick but visit them again. The nodes that it would visit are
therefore listed once, in the order of the tree, and ticked from the list as long as all of them stay Running. When one
ends, the groups are visited as usual: a node that this tick has ticked already only returns its state
(`Visitor.ticked`), so that the result is that of a visit. A list is made after a visit in which no state has changed:
it costs about as much as the visit.

A compound is one node of the list, because its parameters and hold-conditions are checked before its children; its
children have a list of their own. A group whose processor does more in a tick, such as `Selector`, is visited.

The loop of `tick` is the fast path of the engine: a leaf costs the call of its `execute` and about as much again. Most
of it is memory that is not in the cache: the loop touches the instance and one line of the run, see `FastPath`.
"""

from __future__ import annotations

from typing import Protocol, cast

from skiros2_common.core.abstract_skill import State
from skiros2_common.core.errors import FOREIGN_ERRORS
from skiros2_common.core.revision import local_revision
from skiros2_skill.core.engine.hook_guard import Call, HookAbandoned
from skiros2_skill.core.engine.skill_run import Node, SkillNode, SkillRun, TickList, Visitor

_RUNNING: State = State.Running


class _Visited(SkillRun):
    """Stands for a group or a compound, which is visited."""

    __slots__ = ()

    def __init__(self, node: Node) -> None:
        self.node, self.skips_refresh = cast(SkillNode, node), False


class RunningNodes:
    """The running nodes below a node, in the order of the tree. For the thread that ticks the task.

    :param owner: the root of a tree, or the node of a compound.
    """

    __slots__ = ("_has_grown", "_only", "_owner", "_runs", "is_current")

    def __init__(self, owner: Node) -> None:
        self._owner = owner
        self._runs: list[SkillRun] = []
        self._has_grown = False
        #: Whether the list is that of the present groups.
        self.is_current = self._add_children(owner)
        node = self._runs[0].node if len(self._runs) == 1 else None
        #: A compound alone: ticked without all that the fast path of leaves needs.
        self._only = node if node is not None and node.run is not None and node.run.implementation.is_compound else None

    def _add_children(self, node: Node) -> bool:
        """Lists what the next tick visits below a node. Returns False if that is not known in advance."""
        children = node.processor.next_visits(node.children)
        if not children or not all(child.state is _RUNNING and child.has_plain_visit for child in children):
            return False
        node.report_structure_to(self)
        for child in children:
            if child.run is not None and not child.run.implementation.is_compound:
                self._runs.append(child.run)
            elif child.run is not None or not self._add_children(child):
                self._runs.append(_Visited(child))
        return True

    def discard(self) -> None:
        """A group has another processor, state or fewer children: the next tick visits it."""
        self.is_current = False

    def grow(self) -> None:
        """A group has another child, which this tick may have to visit."""
        self.is_current, self._has_grown = False, True
        local_revision.advance()  # ends the fast path

    def tick(self, visitor: Visitor) -> State:
        """Ticks the nodes once. Returns the state that the processor of the owner returns."""
        if self._only is not None:
            state = visitor.execute_skill(self._only)
            done = state is _RUNNING and not self._has_grown
            return state if done else self._visit(visitor, self._runs[0], state)
        parameters, calls, revision, running = visitor.parameters, visitor.guard.calls, local_revision, _RUNNING
        known, world_changed = parameters.local_revision, parameters.world_changed
        is_guarded = False  # the guard has one entry for consecutive leaves
        try:
            for run in self._runs:
                if not run.skips_refresh or world_changed:
                    if is_guarded:
                        is_guarded = False
                        _leave(calls)
                    node = run.node
                    state = node.visit(visitor) if node.run is None else visitor.execute_skill(node)
                else:
                    if is_guarded:
                        try:
                            calls[0] = run
                        except IndexError:
                            raise HookAbandoned from None
                    else:
                        calls.append(run)
                        is_guarded = True
                    instance = run.instance
                    try:
                        answer = instance.execute()
                    except HookAbandoned:
                        raise
                    except FOREIGN_ERRORS as error:
                        is_guarded = False
                        _leave(calls)
                        state = visitor.finish_execute(run, None, error)
                    else:
                        if (
                            answer is running
                            and revision.current == known
                            and not (run.exposed and run.has_changed_in_place())
                        ):
                            if instance.progressed_at is not run.progressed_at:
                                run.progressed_at = instance.progressed_at
                                visitor.changed = True
                            continue
                        is_guarded = False
                        _leave(calls)
                        state = visitor.finish_execute(run, answer)
                known, world_changed = parameters.local_revision, parameters.world_changed
                if state is not _RUNNING or self._has_grown:
                    return self._visit(visitor, run, state)
                if run.__class__ is SkillRun and run.node.run is not run:  # it has ended and started again
                    self.is_current = False
            return _RUNNING
        finally:
            if is_guarded:
                _leave(calls)

    def _visit(self, visitor: Visitor, last: SkillRun, state: State) -> State:
        """Visits the groups and the remaining nodes.

        :param last: of the node that was ticked last, with this state.
        """
        self.is_current = False
        ticked = visitor.ticked
        for run in self._runs:
            if run is last:
                break
            ticked[run.node] = _RUNNING
        ticked[last.node] = state
        try:
            return self._owner.processor.processChildren(self._owner.children, visitor)
        finally:
            ticked.clear()


class _Owner(Protocol):
    running_nodes: TickList | None


class _Executor(_Owner, Visitor, Protocol): ...


def tick_root(root: Node, executor: _Executor) -> State:
    """Ticks the root of a tree once. Returns its state."""
    if root.state is not _RUNNING or root.run is not None or not root.has_plain_visit:
        return root.visit(executor)
    running = executor.running_nodes
    if running is not None and running.is_current:
        state = running.tick(executor)
    else:
        state = visit_children(root, executor, executor)
    if state is not _RUNNING:
        executor.set_state(root, state)
    return state


def visit_children(node: Node, owner: _Owner, visitor: Visitor) -> State:
    """Visits the children of a running node, for which there is no list. Returns the state that its processor returns.

    :param owner: gets a list for the next ticks, if no state has changed.
    """
    changes = visitor.state_changes
    state = node.processor.processChildren(node.children, visitor)
    if state is _RUNNING and visitor.state_changes == changes:
        owner.running_nodes = RunningNodes(node)
    return state


def _leave(calls: list[Call[SkillRun]]) -> None:
    """Ends the guard of a hook that has returned.

    :raises HookAbandoned: another thread has abandoned it.
    """
    try:
        calls.pop()
    except IndexError:
        raise HookAbandoned from None
