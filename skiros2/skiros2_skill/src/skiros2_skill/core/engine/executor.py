"""Starts, ticks and ends the nodes of a task.

An executor belongs to one task and is used by one thread at a time. The parameters of running nodes are refreshed only
when something has changed; see `Parameters`.

A skill that starts and succeeds in one tick costs about 190 calls of Python functions, none of which takes more than a
few percent: three quarters of the time are its start (most of that its parameters and pre-conditions), the rest its own
`execute` and its end. Each start makes its own parameters, because they are shown after its end; therefore the code
that makes, pulls and pushes them is one loop each, without calls for a value that needs nothing. What nothing can have
changed is not done: hooks that a skill does not override are not called, its elements are written, and its parameters
pushed at its end, only when something has changed since its start.
"""

from __future__ import annotations

import logging
from collections.abc import Callable

from skiros2_common.core.abstract_skill import State
from skiros2_common.core.errors import FOREIGN_ERRORS, SkirosError
from skiros2_common.core.explanation import PARAMETER, POST
from skiros2_common.core.revision import local_revision
from skiros2_common.core.world_model_port import WorldModelPort
from skiros2_skill.core.engine.blackboard import Blackboard, update_slots
from skiros2_skill.core.engine.breakpoints import BreakpointReached, Breakpoints, TaskBreakpoints
from skiros2_skill.core.engine.failures import EXECUTE_RAISED, Failure, Failures
from skiros2_skill.core.engine.final_failures import FinalFailures, is_active
from skiros2_skill.core.engine.hook_guard import HookAbandoned, HungHook
from skiros2_skill.core.engine.hooks import RAISED, Hooks
from skiros2_skill.core.engine.parameters import Parameters
from skiros2_skill.core.engine.running_nodes import tick_root, visit_children
from skiros2_skill.core.engine.selection import select
from skiros2_skill.core.engine.skill_run import Node, Progress, SkillNode, SkillRun, TickList

log = logging.getLogger(__name__)

_RUNNING: State = State.Running
_SUCCESS: State = State.Success
_FAILURE: State = State.Failure
_Wake = Callable[[], None]


class StartsBlocked(Exception):
    """The task was preempted during this tick: no more skills are started."""


class Executor:
    """Ticks the nodes of one task.

    :param wmi: the world model as the task sees it.
    :param wake: requests a tick at once; any thread may call it.
    :param breakpoints: pause the task.
    """

    def __init__(self, wmi: WorldModelPort, wake: _Wake = lambda: None, breakpoints: Breakpoints | None = None) -> None:
        self._wmi, self._wake = wmi, wake
        self.breakpoints = TaskBreakpoints(breakpoints)
        self._root: Node | None = None
        #: The runs of the running nodes. Any thread may read a copy.
        self.runs: dict[Node, SkillRun] = {}
        self.ending: list[SkillRun] = []  # preempted runs that have not ended
        self.on_preempting: Callable[[SkillRun], None] = lambda run: None  # called before each preemption
        self.failures, self.final = Failures(wmi), FinalFailures()
        self.hooks = Hooks(self.failures, self.breakpoints, wmi)
        self.guard = self.hooks.guard
        self.parameters = Parameters(wmi, self.guard, wake, self.hooks.evidence)
        self.blocks_starts = False  # whether the task was preempted and its nodes are not preempted yet
        self.changed = True  # whether a state or progress has changed; the reader resets it
        self.ticked: dict[Node, State] = {}  # see `RunningNodes`
        self.running_nodes: TickList | None = None  # below the root
        self.state_changes = 0

    def tick(self, root: Node) -> State:
        """Ticks a tree once, and the nodes that are still ending. Returns the state of the tree."""
        if self._root is not root:
            self._root, self.running_nodes = root, None
            self.parameters.blackboard = Blackboard(root.own_blackboard)
        self.parameters.update_revision()
        for run in list(self.ending):
            self._tick_ending(run)
        state = root.state
        if state is not _SUCCESS and state is not _FAILURE:
            if state is not _RUNNING:
                self.final = FinalFailures()
            state = tick_root(root, self)
        if self.breakpoints and state is _RUNNING and not self.ending:
            self.breakpoints.raise_if_reached()
        if self.final and state is not _FAILURE and not self.ending and not is_active(self.runs):
            self.preempt_all(root)
            self.set_state(root, _FAILURE)
            return _FAILURE
        return _RUNNING if self.ending else state

    # -- one node ----------------------------------------------------------------------------------------------

    def execute(self, node: Node) -> State:
        """Ticks a group; called from `visit`."""
        if node.state is not _RUNNING:
            node.begin_progress()
            node.processor.reset()
            self.set_state(node, _RUNNING)
        state = node.processor.processChildren(node.children, self)
        if state is not _RUNNING:
            self.set_state(node, state)
        return state

    def execute_skill(self, node: SkillNode) -> State:
        """Ticks a skill; called from `visit`."""
        run = self.runs.get(node)
        if (run is None or run.state is not _RUNNING) and (run := self._start(node)) is None:
            return _FAILURE
        if self.ending and run in self.ending:
            return _RUNNING
        if run.stale or run.volatile or self.parameters.world_changed:
            failure = self.parameters.refresh(run)
            if failure is not None:
                return self._fail_running(run, failure)
        local, version = local_revision.current, self.parameters.world_version
        if run.implementation.is_compound:
            state = self._tick_children(run)
        else:
            state = self.hooks.execute(run)
            run.skips_refresh = not (run.volatile or run.stale)
        if state is not _RUNNING or local_revision.current != local or (run.exposed and run.has_changed_in_place()):
            return self._finish_tick(run, state, version)
        self._note_progress(run)
        self.parameters.update_revision()
        return _RUNNING

    def finish_execute(self, run: SkillRun, answer: object, error: Exception | SystemExit | None = None) -> State:
        """Handles what the `execute` of a primitive has returned or raised; called from `visit`."""
        state = self.hooks.execute_state(run, answer) if error is None else self.hooks.execute_raised(run, error)
        return self._finish_tick(run, state, self.parameters.world_version)

    def _finish_tick(self, run: SkillRun, state: State, version: int) -> State:
        """Writes back what a tick has changed since a version of the world model, and ends the run unless Running."""
        self._note_progress(run)
        failure = self.parameters.write_back(run, state, version)
        if failure is None:
            return _RUNNING if state is _RUNNING else self.end(run, state)
        log.error("%s", failure.message)
        self.hooks.fail(run, failure)
        return self.end(run, _FAILURE) if state is not _RUNNING else self._fail_running(run)

    def preempt(self, node: Node) -> State:
        """Preempts a node, leaves first; called from `visitPreempt`. Returns Running while it is still ending."""
        if not node.hasState(_RUNNING):
            return node.state
        for child in node.children:
            if child.hasState(_RUNNING):
                child.visitPreempt(self)
        run = self.runs.get(node)
        if run is None:
            self.set_state(node, _FAILURE)
            return _FAILURE
        if run in self.ending:
            return _RUNNING
        self.on_preempting(run)
        self.parameters.try_pull(run)
        state = self.hooks.on_preempt(run)
        self._note_progress(run)
        if state is _RUNNING:
            self.ending.append(run)
            run.skips_refresh = False
            return _RUNNING
        return self.end(run, state, preempted=True)

    # -- start -------------------------------------------------------------------------------------------------

    def _start(self, node: SkillNode) -> SkillRun | None:
        """Selects an implementation and starts it. Returns None if that failed; the node's progress has the reason."""
        if self.blocks_starts:
            raise StartsBlocked
        if self.breakpoints:
            self.breakpoints.before_start(node)
        if node in self.runs:  # reset while it ran
            self.parameters.end(self.runs.pop(node))
        run = SkillRun(node)
        node.show(run)
        version = self.parameters.world_version
        failure = self.final.refusal(node) or select(run, self.parameters, self._wmi)
        if failure is not None:
            self.set_state(node, _FAILURE)
            self.hooks.fail(run, failure)
            return None
        return run if self._start_run(run, version) else None

    def _start_run(self, run: SkillRun, version: int) -> bool:
        """Expands the subtree and calls `onStart`. Its parameters were read in this version of the world model."""
        self.runs[run.node] = run
        run.instance.request_tick = self._wake
        self._set_states(run, _RUNNING)
        self.hooks.evidence.start(run)
        local = local_revision.current
        refused = self.hooks.on_start(run)
        self._note_progress(run)
        if refused:
            (self.end if refused is RAISED else self._close)(run, _FAILURE)
            return False
        run.has_started = True
        is_current = local_revision.current == local and self.parameters.world_version == version
        if local_revision.current != local:
            update_slots(run)
        self.parameters.push(run, everything=True, removes=False)
        self.parameters.start(run, is_current)
        self.parameters.update_revision()
        return True

    # -- run ---------------------------------------------------------------------------------------------------

    def _fail_running(self, run: SkillRun, failure: Failure | None = None) -> State:
        """Preempts a run and fails it, with its present progress or with a failure."""
        if failure is not None:
            self.hooks.fail(run, failure)
        self.final.note(run)
        progress = run.progress
        self.preempt(run.node)
        if run in self.ending:  # the node has failed, though its end takes more ticks
            run.failure_progress = progress
        else:
            self._fail(run, progress)
        return _FAILURE

    def _fail(self, run: SkillRun, progress: Progress) -> None:
        run.report(progress.message, progress.code)
        self.set_state(run.node, _FAILURE)

    def _tick_children(self, run: SkillRun) -> State:
        listed = run.running_nodes
        try:
            state = listed.tick(self) if listed and listed.is_current else visit_children(run.node, run, self)
        except (HookAbandoned, BreakpointReached):
            raise
        except FOREIGN_ERRORS as error:  # raised by a library's own processor or node class
            return self.hooks.record_exception(run, error, EXECUTE_RAISED)
        if state is _RUNNING:
            return state
        try:
            self.parameters.pull(run)
        except SkirosError as error:
            self.hooks.fail(run, Failure(PARAMETER, EXECUTE_RAISED, str(error)))
            return _FAILURE
        return self.hooks.execute(run, state) if run.implementation.runs_after_children else state

    def _tick_ending(self, run: SkillRun) -> None:
        """Ticks a preempted run that has not ended."""
        state = self.hooks.execute(run, _FAILURE, secondary=True)
        self._note_progress(run)
        if state is not _RUNNING:
            self.ending.remove(run)
            self.end(run, state, preempted=True)
            if run.failure_progress is not None:
                self._fail(run, run.failure_progress)

    # -- end ---------------------------------------------------------------------------------------------------

    def end(self, run: SkillRun, state: State, preempted: bool = False) -> State:
        """Ends a run: frees its devices, checks its post-conditions, calls `onEnd` and pushes its parameters."""
        for child in run.node.children:
            if child.state is _RUNNING:
                child.visitPreempt(self)
        self.hooks.free(run)
        if state is _SUCCESS and not preempted:
            failure = self.parameters.check(POST, run.post_conditions, run)
            if failure is not None:
                self.hooks.fail(run, failure)
                state = _FAILURE
        if state is _SUCCESS and self.final and self.final.below(run.node).is_final:
            state = _FAILURE
        self.hooks.report_end(run, state, preempted)
        state = self.hooks.on_end(run, state, preempted)
        self._note_progress(run)
        if state is _SUCCESS and not run.implementation.is_compound:
            self.parameters.log_unwritten(run)
        return self._close(run, state)

    def _close(self, run: SkillRun, state: State) -> State:
        """Pushes the parameters of an ended run and releases its instance."""
        if state is _FAILURE:
            self.final.note(run)
        if run.has_started:
            self.parameters.push(run, everything=True)
        self.parameters.end(run)
        self.hooks.free(run)
        del self.runs[run.node]
        self._set_states(run, state)
        # The subtree of a compound still belongs to its instance.
        (run.end_use if run.implementation.is_compound else run.release)()
        if self.breakpoints:
            self.breakpoints.after_end(run.node)
        self.parameters.update_revision()
        return state

    # -- from outside of the tree ------------------------------------------------------------------------------

    def preempt_all(self, root: Node) -> None:
        """Preempts all running nodes of a tree, even when a library's own node class raises."""
        try:
            self.preempt(root)
        except HookAbandoned:
            raise
        except Exception:
            log.exception("%s: a node could not be preempted", root.printState())
            for node in reversed(list(self.runs)):
                self.preempt(node)

    def end_hung(self, hung: HungHook[SkillRun]) -> None:
        """Ends the run whose hook was abandoned, without calling its other hooks; its instance is never used again."""
        run = hung.run
        if run in self.ending:
            self.ending.remove(run)
        else:
            self.on_preempting(run)
        self.parameters.end(run)
        self.runs.pop(run.node, None)
        run.abandon()
        self.hooks.give_up(run, hung.reason)
        self.set_state(run.node, _FAILURE)
        for child in run.node.children:
            if child.hasState(_RUNNING):
                child.visitPreempt(self)
        self.hooks.free(run)

    def abandon_ending(self) -> None:
        """Ends the preempted runs that have not ended; their instances are never used again."""
        for run in list(self.ending):
            self.ending.remove(run)
            self.hooks.give_up(run, "did not end in time after its preemption")
            run.is_abandoned = True
            self.end(run, _FAILURE, preempted=True)

    # -- helpers -----------------------------------------------------------------------------------------------

    def set_state(self, node: Node, state: State) -> None:
        node._setState(state)
        self.changed = True
        self.state_changes += 1

    def _set_states(self, run: SkillRun, state: State) -> None:
        """Sets the state of a run and of its instance."""
        run.instance._setState(state)
        self.set_state(run.node, state)

    def _note_progress(self, run: SkillRun) -> None:
        if (instance := run.instance) is not None and instance.progressed_at > run.progressed_at:
            self.changed, run.progressed_at = True, instance.progressed_at
