"""A skill run, one start of a skill's implementation in a node; and nodes and the executor as each sees the other.

A node is structure: the engine reads it and assigns nothing to it. What a start, its ticks and its end change is in the
run. The executor has the run of each running node; the node refers to its present or last run for those who look at it.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple, Protocol

from skiros2_common.core.abstract_skill import State
from skiros2_common.core.condition import ConditionBase
from skiros2_common.core.failure_kind import FailureKind
from skiros2_common.core.params import Param, ParamHandler
from skiros2_runs.core.values import ConditionStatus
from skiros2_skill.core.engine.hook_guard import HookGuard
from skiros2_skill.core.engine.slot import Slot, is_same
from skiros2_skill.core.processors import Processor, TreeNode
from skiros2_skill.core.protocols import ImplementationPort, Library


class Freshness(Protocol):
    """Whether the parameters of a task are up to date."""

    @property
    def world_changed(self) -> bool:
        """Whether the world model has changed and the runs that read it are not marked yet."""

    @property
    def local_revision(self) -> int:
        """The revision of the process when it was last compared."""


class Visitor(Protocol):
    """The visitor that ticks a tree: the executor of a task."""

    changed: bool
    #: How often the state of a node was set.
    state_changes: int
    #: The states of nodes that this tick has ticked already, and does not visit again. See `RunningNodes`.
    ticked: dict[Node, State]

    @property
    def parameters(self) -> Freshness: ...
    @property
    def guard(self) -> HookGuard[SkillRun]: ...
    def execute(self, node: Node) -> State:
        """Ticks a group."""

    def execute_skill(self, node: SkillNode) -> State:
        """Ticks a skill."""

    def finish_execute(self, run: SkillRun, answer: object, error: Exception | SystemExit | None = None) -> State:
        """Handles what the `execute` of a primitive has returned or raised. Returns the state."""

    def preempt(self, node: Node) -> State:
        """Preempts a node, leaves first."""

    def set_state(self, node: Node, state: State) -> None:
        """Sets the state of a node."""


class TickList(Protocol):
    """A list of running nodes."""

    @property
    def is_current(self) -> bool: ...
    def tick(self, visitor: Visitor) -> State:
        """Ticks the nodes once. Returns the state of the processor above them."""


class StructureListener(Protocol):
    """The list of running nodes that a group is part of."""

    def discard(self) -> None:
        """The group has another processor, state or fewer children."""

    def grow(self) -> None:
        """The group has another child."""


class Node(TreeNode[Visitor], Protocol):
    """A node as the engine sees it."""

    @property
    def id(self) -> int: ...
    @property
    def type(self) -> str: ...
    @property
    def label(self) -> str: ...
    @property
    def display_name(self) -> str: ...
    @property
    def parent(self) -> Node | None: ...
    @property
    def children(self) -> Sequence[Node]: ...
    @property
    def child_index(self) -> int: ...
    @property
    def processor(self) -> Processor: ...
    @property
    def remaps(self) -> Mapping[str, str]: ...
    @property
    def present_params(self) -> ParamHandler:
        """The parameters that it has so far: of a skill before its start, perhaps none."""

    @property
    def own_blackboard(self) -> ParamHandler:
        """Stores the blackboard when the node is the root."""

    @property
    def has_plain_visit(self) -> bool:
        """Whether `visit` is that of this package, not of a library's own node class."""

    def report_structure_to(self, running: StructureListener) -> None:
        """Reports changes of the processor, the children and the state of a group from now on."""

    def declared_params(self) -> Mapping[str, Param]: ...
    @property
    def run(self) -> SkillRun | None:
        """The present or last run; None before the first start, and for a group."""

    def inSubtreeOf(self, skill: Node) -> bool: ...
    def hasState(self, state: State) -> bool: ...
    def printState(self) -> str: ...
    def begin_progress(self) -> None: ...
    def _setState(self, state: State) -> None: ...


class SkillNode(Node, Protocol):
    """A node for a skill as the engine sees it."""

    @property
    def library(self) -> Library | None: ...
    @property
    def depth(self) -> int: ...
    @property
    def own_pre_conditions(self) -> Sequence[ConditionBase]: ...
    @property
    def own_hold_conditions(self) -> Sequence[ConditionBase]: ...
    @property
    def own_post_conditions(self) -> Sequence[ConditionBase]: ...
    @property
    def asked_label(self) -> str:
        """The requested label of the implementation; "" for any."""

    @property
    def specified_values(self) -> Mapping[str, list[Any]]: ...
    @property
    def suggested_values(self) -> Mapping[str, list[Any]]: ...
    def own_name(self, name: str) -> str: ...
    def name_above(self, key: str) -> str: ...
    def candidates(self) -> Sequence[ImplementationPort]: ...
    def show(self, run: SkillRun) -> None:
        """Refers to a run from now on."""

    def wrapper_expand(self) -> None: ...


class Progress(NamedTuple):
    """The last progress report.

    :param period: from the report before it (s).
    :param time: from the start (s).
    """

    code: int = 0
    message: str = ""
    period: float = 0.0
    time: float = 0.0


_NO_PROGRESS = Progress()


class FastPath:
    """What a tick of a running primitive reads: together, so that it is one line of the processor's cache."""

    __slots__ = ("exposed", "instance", "progressed_at", "skips_refresh")

    #: The parameters whose list of values the skill's code has got.
    exposed: Sequence[Param]
    instance: Any
    #: When the instance had reported progress when the executor last looked (s, monotonic).
    progressed_at: float
    #: Of a running primitive: whether nothing has to be done before its next `execute`.
    skips_refresh: bool


class SkillRun(FastPath):
    """One start of a skill's implementation in a node. For the thread that ticks the task; any thread may read.

    `claim` gives it an instance; a start that no implementation fits ends without one.
    """

    __slots__ = (
        "_is_counted", "_reported", "_started_at", "element_slots", "evaluated", "failure_kind",
        "failure_progress", "has_started", "hold_conditions", "implementation", "is_abandoned",
        "is_described", "is_expanded", "keys", "label", "locks", "node", "options", "params",
        "post_conditions", "pre_conditions", "pushed_at", "reads", "running_nodes", "slots", "stale", "state",
        "volatile", "warning", "watches",
    )  # fmt: skip

    implementation: ImplementationPort  # unset until it is selected
    params: ParamHandler
    options: dict[str, list[Any]]
    pre_conditions: list[ConditionBase]
    hold_conditions: list[ConditionBase]
    post_conditions: list[ConditionBase]

    def __init__(self, node: SkillNode) -> None:
        self.node = node
        self.instance = None
        last = node.run
        self.state = node.state
        #: Of the implementation; before one is claimed, as in `is_described`.
        self.label = node.asked_label
        #: Whether there are parameters and conditions: of the implementation, or still of that of the last run.
        self.is_described = False
        #: Whether the node has the subtree of this instance.
        self.is_expanded = False
        #: The ids of the devices that it has locked.
        self.locks: Sequence[str] = ()
        self._is_counted = False
        if last is not None:
            self._continue(last)
        #: The keys on the blackboard by own key, where they differ.
        self.keys = blackboard_keys(node)
        self.slots: list[Slot] = []
        self.element_slots: list[Slot] = []
        #: The state of the blackboard and of the parameters when all were pushed; None: not all have a value.
        self.pushed_at: tuple[object, int] | None = None
        #: Whether `onStart` has succeeded.
        self.has_started = False
        #: Whether a hold-condition has to be checked at each tick.
        self.volatile = False
        #: Whether the parameters have to be refreshed before the next `execute`.
        self.stale = True
        #: Of a running compound: what it ticks, if that is known.
        self.running_nodes: TickList | None = None
        self.skips_refresh = False
        #: The ids and blackboard keys that it reads; None: not known. See `DependencyIndex`.
        self.reads: tuple[tuple[str, ...], tuple[str, ...]] | None = None
        self.exposed = ()
        #: End what hold-conditions watch outside the world model.
        self.watches: Sequence[Callable[[], None]] = ()
        #: The last evaluation of its conditions, by stage.
        self.evaluated: dict[str, list[ConditionStatus]] = {}
        #: Of a failed run: the most severe kind of its failures.
        self.failure_kind = FailureKind.RETRYABLE
        #: Shown with each progress message; "" for none.
        self.warning = ""
        #: Of a failed run that is still ending.
        self.failure_progress: Progress | None = None
        #: Whether a hook has not returned: the instance must not be used again.
        self.is_abandoned = False
        self._started_at = time.monotonic()
        self._reported = _NO_PROGRESS  # without an instance
        self.progressed_at = 0.0

    # -- the instance ------------------------------------------------------------------------------------------

    def _continue(self, last: SkillRun) -> None:
        """Takes over the description and the instance: of a compound, to which the subtree belongs, or of a node that
        was reset while it ran, with its devices."""
        self.instance, last.instance = last.instance, None
        self.locks, last.locks = last.locks, ()
        self._is_counted, last._is_counted = last._is_counted, False
        if self.instance is not None:
            self.implementation, self.is_expanded = last.implementation, last.is_expanded
            self.instance.begin_progress()
        if last.is_described:
            self.label = last.label
            self.params, self.options, self.is_described = last.params, last.options, True
            self.pre_conditions, self.hold_conditions = last.pre_conditions, last.hold_conditions
            self.post_conditions = last.post_conditions

    def claim(self, implementation: ImplementationPort, params: ParamHandler, slots: list[Slot]) -> None:
        """Takes an instance of an implementation, with these parameters.

        :raises ConfigurationError: no instance can be created.
        """
        instance = self.instance
        if instance is None or self.implementation is not implementation:
            if instance is not None:
                self.release()
            self.is_expanded = False
            self.instance = instance = implementation.acquire()
        instance.restore_declared(params)
        self.implementation, self.label = implementation, implementation.label
        self.set_slots(slots)
        for slot in slots:
            slot.start_values = tuple(slot.param.current)
        if not self._is_counted:
            self._is_counted = True
            implementation.count(1)
        instance.begin_progress()
        self.progressed_at = instance.progressed_at
        self.describe()

    def set_slots(self, slots: list[Slot]) -> None:
        """Sets the slots of all parameters."""
        self.slots = slots
        self.element_slots = [slot for slot in slots if slot.is_element]

    def describe(self) -> None:
        """Reads the parameters and conditions of the instance, which may have changed them in `onStart`."""
        instance, node = self.instance, self.node
        self.params, self.options = instance.params, instance.options
        self.pre_conditions = [*instance.pre_conditions, *node.own_pre_conditions]
        self.hold_conditions = [*instance.hold_conditions, *node.own_hold_conditions]
        self.post_conditions = [*instance.post_conditions, *node.own_post_conditions]
        self.is_described = True

    def start(self) -> object:
        """Expands the subtree and calls `onStart`. Returns what this has returned."""
        if self.implementation.is_compound and (not self.is_expanded or self.instance.expand_on_start):
            self.node.wrapper_expand()
            self.is_expanded = True
        self.node.processor.reset()
        answer: object = self.instance.onStart()
        self.describe()  # onStart may declare parameters
        return answer

    def release(self) -> None:
        """Returns the instance to the library for reuse. The run keeps its parameters and progress."""
        instance = self.instance
        if instance is None:
            return
        self.end_use()
        self._reported = self.progress
        self.instance = None
        if not (self.is_abandoned or instance.works_in_background):
            self.implementation.release(instance)

    def abandon(self) -> None:
        """Abandons the instance, one of whose hooks has not returned: it is never used again."""
        self.is_abandoned = True
        self.release()

    def end_use(self) -> None:
        """Counts the implementation as free, for the selection of other nodes. The instance keeps a copy of the
        parameters."""
        if self._is_counted:
            self._is_counted = False
            self.implementation.count(-1)
            self.instance._params = EndedParams(self.params)

    def has_changed_in_place(self) -> bool:
        """Whether the skill's code has changed a list of values that it has got."""
        return any(not is_same(param.current, param.shared_snapshot) for param in self.exposed)

    # -- state and progress ------------------------------------------------------------------------------------

    @property
    def name(self) -> str:
        return f"{self.node.type}-{self.label}"

    def report(self, message: str, code: int) -> None:
        """Reports progress: that of the instance, as long as there is one."""
        if self.instance is not None:
            self.instance._setProgress(message, code)
        else:
            self._reported = Progress(code, message, 0.0, time.monotonic() - self._started_at)

    @property
    def progress(self) -> Progress:
        """The last progress report. Any thread."""
        source = self.instance
        if source is None:
            return self._reported
        message = source.progress_msg
        if self.warning:
            message = f"{message} (warning: {self.warning})".lstrip()
        return Progress(source.progress_code, message, source.progress_period, source.progress_time)


class EndedParams(ParamHandler):
    """The parameters of a skill after its end, for threads of the skill that still run: copies, made on first access,
    so that changes do not reach the task.
    """

    def __init__(self, params: ParamHandler) -> None:
        self._ended = params
        self._is_strict = True

    def __getattr__(self, name: str) -> Any:
        if name != "_params":
            raise AttributeError(name)
        self._params = self._ended.getCopy()
        return self._params


def blackboard_keys(node: Node) -> Mapping[str, str]:
    """The keys on the blackboard by the keys of a node, where they differ: the composed remaps from the root."""
    remaps, above = [node.remaps] if node.remaps else [], node.parent
    while above is not None and above.run is None:
        if above.remaps:
            remaps.append(above.remaps)
        above = above.parent
    keys: Mapping[str, str] = above.run.keys if above is not None and above.run is not None else {}
    for each in reversed(remaps):
        keys = scope(keys, each)
    return keys


def scope(outer: Mapping[str, str], remaps: Mapping[str, str]) -> Mapping[str, str]:
    """Composes remaps: maps the keys of a node to keys on the blackboard, where they differ.

    :param outer: the result for the parent.
    :param remaps: of the node.
    """
    return {**outer, **{key: outer.get(name, name) for key, name in remaps.items()}} if remaps else outer
