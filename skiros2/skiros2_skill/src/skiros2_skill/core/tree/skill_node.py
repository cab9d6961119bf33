"""A node that names a skill. Its implementation is selected when the node starts."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from skiros2_common.core.abstract_skill import State
from skiros2_common.core.condition import ConditionBase
from skiros2_common.core.errors import FOREIGN_ERRORS, Refused, UnknownName
from skiros2_common.core.names import full_name
from skiros2_common.core.params import Param, ParamHandler
from skiros2_common.core.revision import local_revision
from skiros2_common.core.source_location import SourceLocation
from skiros2_runs.core.values import ConditionStatus
from skiros2_skill.core.processors import Processor, Sequential
from skiros2_skill.core.protocols import ImplementationPort, Library, Visitor
from skiros2_skill.core.tree.hook_guard import HookAbandoned
from skiros2_skill.core.tree.node import SkillInterface

#: Maximum depth of skills in a tree. Each level takes some stack frames.
MAX_DEPTH = 5000

_RUNNING: State = State.Running


class DescribedNode(SkillInterface):
    """A node for a skill of the library. Before its start it has the description of the first implementation."""

    def __init__(self, children_processor: Processor) -> None:
        super().__init__(children_processor)
        self._is_described = False
        self.asked_label = ""
        self._depth = 0  # the number of skills from the root to this node; set when it starts
        self._own_hold_conditions: list[ConditionBase] = []
        self._own_post_conditions: list[ConditionBase] = []

    @property
    def depth(self) -> int:
        """The number of skills from the root to this node; 0 before its start."""
        return self._depth

    def declared_params(self) -> dict[str, Param]:
        """The parameters that the skill declares, by its own keys. Read only.

        :raises UnknownName: the library has no such skill.
        """
        declared = self.instance if self.instance is not None else self.candidates()[0].declared
        params: dict[str, Param] = declared.params.getParamMap()
        return params

    @property
    def params(self) -> ParamHandler:
        """The parameters of the implementation; before the start those of the description, with remapped keys and
        specified values."""
        self._describe()
        return self._params

    def getParamsNoRemaps(self) -> ParamHandler:
        """The parameters by the skill's own keys."""
        if self.instance is not None:
            return self._params
        return ParamHandler({self.own_name(key): param.clone() for key, param in self.params.items()})

    def _describe(self) -> None:
        if self.instance is not None or self._is_described or self.library is None:
            return
        self._is_described = True
        declared = self.candidates()[0].declared
        for key, param in declared.params.getCopy().items():
            param.key = self.name_above(key)
            self._params._params[param.key] = param
        for name, values in (*self.suggested_values.items(), *self.specified_values.items()):
            self._params.specifyDefault(name, values)
        for own, declared_conditions in (
            (self._pre_conditions, declared.pre_conditions),
            (self._hold_conditions, declared.hold_conditions),
            (self._post_conditions, declared.post_conditions),
        ):
            copies = [c.copy() for c in declared_conditions]
            for condition in copies:
                for key in set(condition.getKeys()):
                    condition.remap(key, self.name_above(key))
            own[:0] = copies

    @property
    def pre_conditions(self) -> list[ConditionBase]:
        self._describe()
        return self._pre_conditions

    @property
    def hold_conditions(self) -> list[ConditionBase]:
        self._describe()
        return self._hold_conditions

    @property
    def post_conditions(self) -> list[ConditionBase]:
        self._describe()
        return self._post_conditions

    @property
    def present_conditions(self) -> tuple[list[ConditionBase], list[ConditionBase], list[ConditionBase]]:
        """The pre-, hold- and post-conditions that the node has so far: before its start, perhaps only its own."""
        return self._pre_conditions, self._hold_conditions, self._post_conditions

    def remap(self, initial_key: str, target_key: str, record: bool = True) -> None:
        super().remap(initial_key, target_key, record)
        if self.instance is None and self._is_described:
            self._params.remap(initial_key, target_key)

    def specifyParamDefault(self, key: str, values: Any) -> None:
        super().specifyParamDefault(key, values)
        if self.instance is None and self._is_described:
            self._params.specifyDefault(key, self.specified_values[key])

    def addPreCondition(self, condition: ConditionBase, modify_description: bool = False) -> None:
        """Adds a pre-condition to the node, with the keys as named in the parent."""
        self.own_pre_conditions.append(self._own_condition(condition))
        self._pre_conditions.append(condition)

    def addHoldCondition(self, condition: ConditionBase, modify_description: bool = False) -> None:
        """Adds a hold-condition to the node, with the keys as named in the parent."""
        self._own_hold_conditions.append(self._own_condition(condition))
        self._hold_conditions.append(condition)

    def addPostCondition(self, condition: ConditionBase, modify_description: bool = False) -> None:
        """Adds a post-condition to the node, with the keys as named in the parent."""
        self._own_post_conditions.append(self._own_condition(condition))
        self._post_conditions.append(condition)

    def _own_condition(self, condition: ConditionBase) -> ConditionBase:
        own = condition.copy()
        for name in set(own.getKeys()):
            own.remap(name, self.own_name(name))
        return own

    def candidates(self) -> Sequence[ImplementationPort]:
        """The implementations that the library has for the node.

        :raises UnknownName: there is none.
        :raises Refused: the tree is too deep.
        """
        above = self._parent
        while above is not None and not isinstance(above, DescribedNode):
            above = above.parent
        self._depth = above._depth + 1 if above is not None else 1
        if self._depth > MAX_DEPTH:
            raise Refused(f"{self.printState()} is below {MAX_DEPTH} levels of skills: one of them contains itself")
        if self.library is None:
            raise UnknownName(f"{self.printState()} has no skill library")
        return self.library.candidates(self._type, self.asked_label)

    def specifyParamsDefault(self, input_params: ParamHandler) -> None:
        """Same as `SkillInterface.specifyParamsDefault`; keys that the skill does not declare are ignored."""
        try:
            declared = self.candidates()[0].declared.params
        except UnknownName:
            super().specifyParamsDefault(input_params)  # its start reports the unknown skill
            return
        known = {key: p for key, p in input_params.items() if declared.hasParam(self.own_name(key))}
        super().specifyParamsDefault(ParamHandler(known))


class SkillWrapper(DescribedNode):
    """A node for a skill of a type and, when given, a label.

    :param ptype: the skill's type: `Pick`, `:Pick` or `skiros:Pick`.
    :param plabel: the implementation's label; "" for any.
    :param instanciator: the skill library.
    """

    def __init__(self, ptype: str, plabel: str, instanciator: Library | None = None) -> None:
        super().__init__(Sequential())
        self._type = full_name(ptype)
        self._label = plabel
        #: The requested label; "" for any implementation.
        self.asked_label = plabel
        self.library = instanciator
        #: Of the `self.skill(...)` that created it; None: not known.
        self.source_location: SourceLocation | None = None
        # State of the skill run, set by the executor.
        self.implementation: ImplementationPort  # of the instance; unset before the first selection
        self.expanded = False
        self.slots: list[Any] = []
        self.element_slots: list[Any] = []
        self.stale = True  # the parameters have to be refreshed before the next `execute`
        self.steady = False  # of a running primitive: nothing has to be done before its next `execute`
        self.reads: tuple[tuple[str, ...], tuple[str, ...]] | None = None  # ids and blackboard keys; see `Readers`
        self.lent: list[Param] = []  # parameters whose list of values the skill's code has got
        self.watches: list[Callable[[], None]] = []  # end what hold-conditions watch outside the world model
        self.has_started = False
        self.volatile = False
        self.is_compound = False
        self.runs_after_children = False
        self.locked: list[str] = []
        self.failure_progress: tuple[str, int] | None = None  # message, code; set while it is `ending`
        self._in_run = False
        self.abandoned = False  # the instance must not be used again
        #: The last evaluation of its conditions in this run, by stage.
        self.evaluated: dict[str, list[ConditionStatus]] = {}
        if instanciator is not None and instanciator.wmi is not None:
            self._wmi = instanciator.wmi
        self._setState(State.Idle)

    @property
    def label(self) -> str:
        """The label of the selected implementation; before selection, the requested one."""
        return self._label

    def getLightCopy(self) -> SkillWrapper:
        copy = SkillWrapper(self._type, self.asked_label, self.library)
        self._copy_to(copy)
        copy._label = self.asked_label
        return copy

    def hasInstance(self) -> bool:
        """Whether an implementation is selected."""
        return self.instance is not None

    def setInstance(self, instance: Any) -> None:
        """Selects an implementation: its label, parameters and conditions become the node's."""
        self.instance = instance
        self._is_described = True
        self.abandoned = False
        self._label = instance.label
        self._description = instance
        self._processor = Sequential()
        self.adopt_description()

    def adopt_description(self) -> None:
        """Copies the parameters and conditions of the implementation, which may have changed them in `onStart`."""
        instance = self.instance
        self._params: ParamHandler = instance._params
        self._options = instance._options
        self._pre_conditions = [*instance._pre_conditions, *self.own_pre_conditions]
        self._hold_conditions = [*instance._hold_conditions, *self._own_hold_conditions]
        self._post_conditions = [*instance._post_conditions, *self._own_post_conditions]

    def getInstance(self) -> Any:
        """The instance of the implementation; None before selection."""
        return self.instance

    def copy_progress(self) -> bool:
        """Copies the progress of the implementation. Returns whether it has changed."""
        instance = self.instance
        if instance is None or instance.progressed_at <= self.progressed_at:
            return False
        self._progress_code = instance._progress_code
        self._progress_msg = instance._progress_msg
        self._progress_period = instance._progress_period
        self.progressed_at = instance.progressed_at
        return True

    def release(self) -> None:
        """Returns the instance to the library for reuse; the node keeps its parameters and progress."""
        instance = self.instance
        if instance is None:
            return
        self.end_run()
        if not (self.abandoned or instance.works_in_background):
            self.implementation.release(instance)
        self.instance = None

    def abandon(self) -> None:
        """Abandons the instance, one of whose hooks has not returned: it is never used again."""
        self.abandoned = True
        self.release()

    def begin_run(self) -> None:
        """Counts the implementation as busy."""
        if not self._in_run:
            self._in_run = True
            self.implementation.count(1)

    def end_run(self) -> None:
        """Counts the implementation as free, for the selection of other nodes."""
        if self._in_run:
            self._in_run = False
            self.implementation.count(-1)
            self.instance._params = EndedParams(self._params)

    def wrapper_expand(self) -> None:
        """Replaces the children by the subtree that the implementation expands."""
        for child in self._children:
            child._parent = None
        self._children = []
        self._latched = None
        instance = self.instance
        instance.expands_into = self
        instance.expand(self)

    def visit(self, visitor: Visitor) -> State:
        """Ticks the node once.

        The fast path of a primitive that stays Running; the executor does everything else.

        :param visitor: the executor.
        """
        state: State
        parameters, instance = visitor.parameters, self.instance
        if not self.steady or parameters.world_changed:
            state = visitor.execute_skill(self)
            return state
        calls = visitor.guard.calls
        calls.append(self)
        try:
            try:
                answer: object = instance.execute()
            finally:
                try:
                    calls.pop()
                except IndexError:
                    raise HookAbandoned from None
        except HookAbandoned:
            raise
        except FOREIGN_ERRORS as error:
            state = visitor.finish_execute(self, None, error)
            return state
        if answer is not _RUNNING or local_revision.current != parameters.local_revision:
            state = visitor.finish_execute(self, answer)
            return state
        if instance.progressed_at > self.progressed_at:
            visitor.changed = True
        return _RUNNING

    def _setState(self, state: State) -> None:
        self.steady = False
        super()._setState(state)

    # The progress of a running node is that of its implementation.

    @property
    def progress_code(self) -> int:
        self.copy_progress()
        return self._progress_code

    @property
    def progress_msg(self) -> str:
        self.copy_progress()
        return self._progress_msg

    @property
    def progress_period(self) -> float:
        self.copy_progress()
        return self._progress_period

    @property
    def progress_time(self) -> float:
        self.copy_progress()
        return super().progress_time

    def onReset(self) -> None:
        if self.instance is not None:
            self.instance.onReset()

    def onPreempt(self) -> Any:
        return self.instance.onPreempt() if self.instance is not None else None

    def onStart(self) -> bool | None:
        return self.instance.onStart() if self.instance is not None else False

    def execute(self) -> State | None:
        return self.instance.execute() if self.instance is not None else State.Failure


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
