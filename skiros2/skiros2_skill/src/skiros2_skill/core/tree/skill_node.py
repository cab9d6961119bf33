"""A node that names a skill. Its implementation is selected when the node starts."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Generic, TypeVar

from skiros2_common.core.abstract_skill import State
from skiros2_common.core.condition import ConditionBase
from skiros2_common.core.errors import FOREIGN_ERRORS, Refused, UnknownName
from skiros2_common.core.names import full_name
from skiros2_common.core.params import Param, ParamHandler
from skiros2_common.core.revision import local_revision
from skiros2_common.core.source_location import SourceLocation
from skiros2_skill.core.engine.hook_guard import HookAbandoned
from skiros2_skill.core.engine.skill_run import SkillRun, Visitor
from skiros2_skill.core.processors import Processor, Sequential
from skiros2_skill.core.protocols import ImplementationPort, Library
from skiros2_skill.core.tree.node import SkillInterface

#: Maximum depth of skills in a tree. Each level takes some stack frames.
MAX_DEPTH = 5000

_RUNNING: State = State.Running


_T = TypeVar("_T")


class _OfRun(Generic[_T]):
    """A part of the description: that of the present or last run; before the first start, the node's own."""

    def __set_name__(self, owner: type, name: str) -> None:
        self._own, self._name = f"_own{name}", name.lstrip("_")

    def __get__(self, node: DescribedNode, owner: type) -> _T:
        run = node.run
        value: _T = getattr(run, self._name) if run is not None and run.is_described else getattr(node, self._own)
        return value

    def __set__(self, node: DescribedNode, value: _T) -> None:
        if node.run is not None and node.run.is_described:
            setattr(node.run, self._name, value)
        else:
            setattr(node, self._own, value)


class DescribedNode(SkillInterface):
    """A node for a skill of the library. Before its start it has the description of the first implementation, from then
    on that of its run."""

    _label = _OfRun[str]()
    _params = _OfRun[ParamHandler]()
    _options = _OfRun[dict[str, list[Any]]]()
    _pre_conditions = _OfRun[list[ConditionBase]]()
    _hold_conditions = _OfRun[list[ConditionBase]]()
    _post_conditions = _OfRun[list[ConditionBase]]()

    _is_described = False
    _depth = 0  # the number of skills from the root to this node; set when it starts

    def __init__(self, children_processor: Processor) -> None:
        self.run = None
        super().__init__(children_processor)
        self.asked_label = ""
        self.own_hold_conditions: list[ConditionBase] = []
        self.own_post_conditions: list[ConditionBase] = []

    @property
    def instance(self) -> Any:
        """The instance of the implementation; None before selection, and after the end of a primitive."""
        return self.run.instance if self.run is not None else None

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

    @property
    def is_described(self) -> bool:
        """Whether it has the description of an implementation."""
        return self._is_described or (self.run is not None and self.run.is_described)

    def _describe(self) -> None:
        if self.is_described or self.library is None:
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
        if self.instance is None and self.is_described:
            self._params.remap(initial_key, target_key)

    def specifyParamDefault(self, key: str, values: Any) -> None:
        super().specifyParamDefault(key, values)
        if self.instance is None and self.is_described:
            self._params.specifyDefault(key, self.specified_values[key])

    def addPreCondition(self, condition: ConditionBase, modify_description: bool = False) -> None:
        """Adds a pre-condition to the node, with the keys as named in the parent."""
        self.own_pre_conditions.append(self._own_condition(condition))
        self._pre_conditions.append(condition)

    def addHoldCondition(self, condition: ConditionBase, modify_description: bool = False) -> None:
        """Adds a hold-condition to the node, with the keys as named in the parent."""
        self.own_hold_conditions.append(self._own_condition(condition))
        self._hold_conditions.append(condition)

    def addPostCondition(self, condition: ConditionBase, modify_description: bool = False) -> None:
        """Adds a post-condition to the node, with the keys as named in the parent."""
        self.own_post_conditions.append(self._own_condition(condition))
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
            above = above._parent
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
        if instanciator is not None and instanciator.wmi is not None:
            self._wmi = instanciator.wmi
        self._setState(State.Idle)

    @property
    def label(self) -> str:
        """The label of the selected implementation; before selection, the requested one."""
        return self._label

    @property
    def display_name(self) -> str:
        """The label; without one, the type."""
        return self._label or self._type.partition(":")[2]

    def getLightCopy(self) -> SkillWrapper:
        copy = SkillWrapper(self._type, self.asked_label, self.library)
        self._copy_to(copy)
        copy._label = self.asked_label
        return copy

    @property
    def own_blackboard(self) -> ParamHandler:
        return ParamHandler()

    def getInstance(self) -> Any:
        """Same as `instance`."""
        return self.instance

    def hasInstance(self) -> bool:
        """Whether an implementation is selected."""
        return self.instance is not None

    def setInstance(self, instance: Any) -> None:
        """Selects an implementation: its label, parameters and conditions become the node's."""
        run = SkillRun(self)
        run.instance, run.label = instance, instance.label
        run.describe()
        self.show(run)

    def show(self, run: SkillRun) -> None:
        """Makes a run the present one: its state, progress, parameters and conditions are the node's."""
        self.run = run

    def wrapper_expand(self) -> None:
        """Replaces the children by the subtree that the implementation expands."""
        for child in self._children:
            child._parent = None
        self._children = []
        self._latched = None
        self._processor = Sequential()
        instance = self.instance
        instance.expands_into = self
        instance.expand(self)

    def visit(self, visitor: Visitor) -> State:
        """Ticks the node once.

        The fast path of a primitive that stays Running; the executor does everything else.

        :param visitor: the executor.
        """
        if visitor.ticked and self in visitor.ticked:
            return visitor.ticked.pop(self)
        run, parameters = self.run, visitor.parameters
        if run is None or not run.skips_refresh or parameters.world_changed:
            return visitor.execute_skill(self)
        instance, calls = run.instance, visitor.guard.calls
        calls.append(run)
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
            return visitor.finish_execute(run, None, error)
        if answer is not _RUNNING or local_revision.current != parameters.local_revision:
            return visitor.finish_execute(run, answer)
        if run.exposed and run.has_changed_in_place():
            return visitor.finish_execute(run, answer)
        if instance.progressed_at > run.progressed_at:
            run.progressed_at = instance.progressed_at
            visitor.changed = True
        return _RUNNING

    @property
    def has_plain_visit(self) -> bool:
        return type(self).visit is SkillWrapper.visit

    @property
    def may_retry(self) -> bool:
        return self.run is None or not self.run.failure_kind.is_final

    # -- state and progress of the run -------------------------------------------------------------------------

    @property
    def state(self) -> State:
        return self._own_state if self.run is None else self.run.state

    @property
    def _state(self) -> State:
        return self.state

    @_state.setter
    def _state(self, state: State) -> None:
        if self.run is None:
            self._own_state = state
        else:
            self.run.state = state

    def _setState(self, state: State) -> None:
        run = self.run
        if run is None:
            super()._setState(state)
            return
        run.skips_refresh = False
        if self._waiting or state.__class__ is not State:
            super()._setState(state)
            return
        run.state = state  # the same, without four calls: each start and end comes here
        if self._listener is not None:
            self._listener.discard()

    def reset(self) -> State:
        """Resets the node to Idle. Returns the state."""
        if self.run is not None:
            self.run.report("", 0)
        return super().reset()

    @property
    def progress_code(self) -> int:
        return self.run.progress.code if self.run is not None else super().progress_code

    @property
    def progress_msg(self) -> str:
        return self.run.progress.message if self.run is not None else super().progress_msg

    @property
    def progress_period(self) -> float:
        return self.run.progress.period if self.run is not None else super().progress_period

    @property
    def progress_time(self) -> float:
        return self.run.progress.time if self.run is not None else super().progress_time

    # -- hooks of the instance ---------------------------------------------------------------------------------

    def onReset(self) -> None:
        if self.instance is not None:
            self.instance.onReset()

    def onPreempt(self) -> Any:
        return self.instance.onPreempt() if self.instance is not None else None

    def onStart(self) -> bool | None:
        return self.instance.onStart() if self.instance is not None else False

    def execute(self) -> State | None:
        return self.instance.execute() if self.instance is not None else State.Failure
