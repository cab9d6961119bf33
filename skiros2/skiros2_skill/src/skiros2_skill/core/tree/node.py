"""A node of a behaviour tree: its parent and children, its processor, its remaps and specified parameters."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from typing import Any

from skiros2_common.core.abstract_skill import SkillCore, SkillDescription, State
from skiros2_common.core.condition import ConditionBase
from skiros2_common.core.errors import Refused, WrongValue
from skiros2_common.core.params import Param, ParamHandler, ParamTypes
from skiros2_common.core.world_model_port import WorldModelPort
from skiros2_skill.core.engine.executor import Executor
from skiros2_skill.core.engine.skill_run import Node, SkillRun, StructureListener, Visitor
from skiros2_skill.core.processors import Processor, Sequential
from skiros2_skill.core.protocols import Library

log = logging.getLogger(__name__)

_RUNNING: State = State.Running


class NodeParams(SkillCore):
    """The part of a node that remaps and specifies parameters."""

    def __init__(self) -> None:
        super().__init__()
        self.remaps: dict[str, str] = {}
        self.specified_values: dict[str, list[Any]] = {}
        self.suggested_values: dict[str, list[Any]] = {}

    def remap(self, initial_key: str, target_key: str, record: bool = True) -> None:
        """Renames a key of this node, or of a node below it, for the nodes above.

        A key that is remapped already keeps its name, with a warning.
        """
        if initial_key in self.remaps:
            log.warning(
                "%s: %r is remapped to %r already; the remap to %r is ignored",
                self.printState(), initial_key, self.remaps[initial_key], target_key,
            )  # fmt: skip
            return
        key = next((key for key, above in self.remaps.items() if above == initial_key), initial_key)
        if record or key in self.remaps:
            self.remaps[key] = target_key
        for values in (self.specified_values, self.suggested_values):
            if initial_key in values:
                values[target_key] = values.pop(initial_key)

    def get_remap(self, key: str) -> str:
        """The name of a key of this node in its parent."""
        return self.remaps.get(key, key)

    name_above = get_remap

    def own_name(self, name: str) -> str:
        """The key of this node with that name in its parent."""
        return next((key for key, above in self.remaps.items() if above == name), name) if self.remaps else name

    def getParamsNoRemaps(self) -> ParamHandler:
        """The parameters under the keys that the skill itself uses."""
        return self._params

    # -- specified parameters --------------------------------------------------------------------------------------

    def specifyParam(self, key: str, values: Any) -> None:
        """Sets a parameter, by its name in the parent, until the node starts; see `specifyParamDefault`."""
        self.params.specify(key, values)

    def specifyParamDefault(self, key: str, values: Any) -> None:
        """Specifies a parameter, by its name in the parent: every start of the node begins with these values.

        A key that the skill does not declare is logged and ignored when the node starts.
        """
        self.specified_values[key] = [] if values is None else values if isinstance(values, list) else [values]

    def specifyParamsDefault(self, input_params: ParamHandler) -> None:
        """Specifies parameters, such as those of a plan, by their names in the parent.

        An element for an Inferred parameter is only a suggestion: inference tries it first, and replaces it when a
        pre-condition is unsatisfied.
        """
        for key, param in input_params.items():
            if param.values and param.is_element and param.paramTypeIs(ParamTypes.Inferred):
                self.suggested_values[key] = list(param.values)
            elif param.values:
                self.specifyParamDefault(key, list(param.values))

    def specifyParams(self, input_params: ParamHandler, keep_default: bool = True) -> None:
        """Specifies parameters; with `keep_default`, those that are specified already keep their values."""
        for key, param in input_params.items():
            if param.values and not (keep_default and key in self.specified_values):
                self.specifyParamDefault(key, list(param.values))


class SkillInterface(NodeParams):
    """A node of a tree.

    Running nodes share parameters through the task's blackboard. `name_above` maps a key of the node, or of a node
    below it, to its name in the parent, which may remap it again; the name in the root is the key on the blackboard.

    :param children_processor: how the children are ticked; the node uses a copy.
    """

    #: The present or last run of a skill; None before the first start, and for a group.
    run: SkillRun | None = None
    _executor: Executor | None = None  # of a node that is ticked without a task
    _listener: StructureListener | None = None
    _latched: SkillInterface | None = None

    def __init__(self, children_processor: Processor = Sequential()) -> None:  # noqa: B008 - the contract's default
        super().__init__()
        self._parent: SkillInterface | None = None
        self.child_index = 0
        self._processor = children_processor.fresh()
        self.library: Library | None = None
        #: The pre-conditions added to the node, without those of the implementation.
        self.own_pre_conditions: list[ConditionBase] = []

    # -- position in the tree ----------------------------------------------------------------------------------

    @property
    def parent(self) -> SkillInterface | None:
        """The parent; None for the root."""
        return self._parent

    def getParent(self) -> SkillInterface | None:
        return self._parent

    @property
    def children(self) -> list[SkillInterface]:
        return self._children

    def __call__(self, *children: SkillInterface) -> SkillInterface:
        """Adds children in this order. Returns the node."""
        for child in children:
            self.addChild(child)
        return self

    def addChild(self, p: SkillInterface, latch: bool = False) -> SkillInterface:
        """Adds a child at the end.

        :param latch: children added later become children of `p`.
        :raises Refused: `p` is in a tree already.
        """
        if self._latched is not None:
            self._latched.addChild(p, latch)
            return self
        if p._parent is not None:
            raise Refused(f"{p.printState()} is a child of {p._parent.printState()} already")
        p._parent = self
        p.child_index = len(self._children)
        self._children.append(p)
        if self._listener is not None:
            self._listener.grow()
        if latch:
            self._latched = p
        return self

    def last(self) -> SkillInterface:
        """The child added last.

        :raises WrongValue: there is none.
        """
        if not self._children:
            raise WrongValue(f"{self.printState()} has no children")
        child: SkillInterface = self._children[-1]
        return child

    def popChild(self) -> SkillInterface:
        """Removes the child added last and returns it.

        :raises WrongValue: there is none.
        :raises Refused: it is running.
        """
        child = self.last()
        if child.state is State.Running:
            raise Refused(f"{child.printState()} cannot be taken out of the tree while it runs")
        self._children.pop()
        child._parent = None
        self._restructured()
        if self._latched is child:
            self._latched = None
        return child

    def hasChildren(self) -> bool:
        return bool(self._children)

    def inSubtreeOf(self, skill: Node) -> bool:
        """Whether `skill` is this node or one of its ancestors."""
        node: SkillInterface | None = self
        while node is not None:
            if node is skill:
                return True
            node = node._parent
        return False

    def getLightCopy(self) -> SkillInterface:
        """A copy with the same description, remaps and specified parameters, without parent and children."""
        copy = self.__class__.__new__(self.__class__)
        SkillInterface.__init__(copy, self._processor)
        self._copy_to(copy)
        return copy

    def _copy_to(self, copy: SkillInterface) -> None:
        SkillDescription.setDescription(copy, *self.getDescription())
        copy._label = self._label
        copy._wmi = self._wmi
        copy.library = self.library
        copy._description = self._description
        copy.remaps = dict(self.remaps)
        copy.specified_values = dict(self.specified_values)
        copy.suggested_values = dict(self.suggested_values)
        copy.own_pre_conditions = [c.copy() for c in self.own_pre_conditions]

    def report_structure_to(self, running: StructureListener) -> None:
        """Reports changes of the processor, the children and the state from now on."""
        self._listener = running

    def _restructured(self) -> None:
        if self._listener is not None:
            self._listener.discard()

    def _setState(self, state: State) -> None:
        self._restructured()
        super()._setState(state)

    # -- processor ---------------------------------------------------------------------------------------------

    @property
    def processor(self) -> Processor:
        return self._processor

    def setProcessor(self, processor_type: Processor) -> None:
        """Replaces the processor by a copy of this one."""
        self._processor = processor_type.fresh()
        self._restructured()

    def processChildren(self, visitor: Visitor) -> State:
        """One tick of the children."""
        return self._processor.processChildren(self._children, visitor)

    # -- what it is for those who look at it -------------------------------------------------------------------

    @property
    def display_name(self) -> str:
        """The label; without one, the symbol of the processor."""
        return self._label or self._processor.printType()

    def declared_params(self) -> dict[str, Param]:
        """The parameters that the node declares, by its own keys; a group declares none."""
        return {}

    @property
    def own_blackboard(self) -> ParamHandler:
        """Stores the blackboard of the task when the node is its root."""
        return self._params

    @property
    def present_params(self) -> ParamHandler:
        """The parameters that the node has so far: of a skill before its start, perhaps none."""
        return self._params

    # -- description and parameters ---------------------------------------------------------------------------

    def revertInput(self) -> None:
        """Restores the parameters to their values at the start of the skill."""
        for slot in self.run.slots if self.run is not None else ():
            if slot.start_values is not None and self._params.hasParam(slot.param.key):
                self._params.getParamMap()[slot.param.key].assign(list(slot.start_values))

    def resetDescription(self, other: SkillDescription | None = None) -> None:
        """Replaces parameters and conditions by those of another skill; None: by those of the own description."""
        source = other if other is not None else self._description
        SkillDescription.setDescription(self, self._type, *source.getDescription()[1:])

    def mergeDescription(self, other: SkillDescription) -> None:
        """Adds the parameters and conditions of another skill."""
        for key, param in other.params.getCopy().items():
            self._params.getParamMap()[key] = param
        self._pre_conditions += [c.copy() for c in other.pre_conditions]
        self._hold_conditions += [c.copy() for c in other.hold_conditions]
        self._post_conditions += [c.copy() for c in other.post_conditions]

    def addPreCondition(self, condition: ConditionBase, modify_description: bool = False) -> None:
        """Adds a pre-condition; with `modify_description` to the description too."""
        super().addPreCondition(condition)
        if modify_description:
            self._description.addPreCondition(condition.copy())

    def addHoldCondition(self, condition: ConditionBase, modify_description: bool = False) -> None:
        """Adds a hold-condition; with `modify_description` to the description too."""
        super().addHoldCondition(condition)
        if modify_description:
            self._description.addHoldCondition(condition.copy())

    def addPostCondition(self, condition: ConditionBase, modify_description: bool = False) -> None:
        """Adds a post-condition; with `modify_description` to the description too."""
        super().addPostCondition(condition)
        if modify_description:
            self._description.addPostCondition(condition.copy())

    # -- simulation of effects ---------------------------------------------------------------------------------

    def hold(self) -> bool:
        """Makes the hold-conditions true in the world model. Returns False if one could not be made true."""
        made = [c.setTrue(self._params, self._wmi) for c in self._hold_conditions]
        return all(made)

    def revertHold(self) -> None:
        """Reverts the changes of `hold`."""
        for condition in reversed(self._hold_conditions):
            condition.revert(self._params, self._wmi)

    def simulate(self) -> bool:
        """Makes the post-conditions true in the world model. Returns False if one could not be made true."""
        made = [c.setTrue(self._params, self._wmi) for c in self._post_conditions]
        return all(made)

    def revertSimulation(self) -> None:
        """Reverts the changes of `simulate`."""
        for condition in reversed(self._post_conditions):
            condition.revert(self._params, self._wmi)

    # -- running -----------------------------------------------------------------------------------------------

    def init(self, wmi: WorldModelPort) -> bool:
        """Sets the world model and creates the description."""
        self._wmi = wmi
        self.declare()
        self._setState(State.Idle)
        return True

    def hasInstance(self) -> bool:
        """Whether an implementation is selected, where the node needs one."""
        return True

    def wrapper_expand(self) -> None:
        """Expands the subtree of the implementation; does nothing for a node without one."""

    def visit(self, visitor: Visitor) -> State:
        """Ticks the node once.

        :param visitor: the executor.
        """
        if visitor.ticked and self in visitor.ticked:
            return visitor.ticked.pop(self)
        if self._state is not _RUNNING:
            return visitor.execute(self)
        state = self._processor.processChildren(self._children, visitor)
        if state is not _RUNNING:
            visitor.set_state(self, state)
        return state

    @property
    def has_plain_visit(self) -> bool:
        """Whether `visit` is that of the platform, not of a library's own node class."""
        return type(self).visit is SkillInterface.visit

    @property
    def may_retry(self) -> bool:
        """Whether no failure of the node or below it is final: see `FailureKind`."""
        return all(child.may_retry for child in self._children)

    def visitPreempt(self, visitor: Visitor) -> State:
        """Preempts the node.

        :param visitor: the executor.
        """
        return visitor.preempt(self)

    def tick(self) -> State:
        """Ticks the node once without a task, with an executor of its own."""
        if self._executor is None:
            self._executor = Executor(self._wmi)
        return self._executor.tick(self)

    def start(self, params: ParamHandler | None = None) -> State:
        """Specifies parameters and resets the node. Returns the state."""
        if params is not None:
            self.specifyParams(params, False)
        return self.reset()

    def execute(self) -> State | None:
        """To override in compounds: called after the children; None keeps their state."""
        return None


def all_nodes(root: SkillInterface) -> Iterator[SkillInterface]:
    """The nodes of a tree in depth-first order, parents before children."""
    pending = [root]
    while pending:
        node = pending.pop()
        yield node
        pending.extend(reversed(node.children))


class _Group(SkillInterface):
    def __init__(self, ptype: str, name: str, children_processor: Processor, wmi: WorldModelPort | None) -> None:
        super().__init__(children_processor)
        self._type = ptype
        self._label = name
        if wmi is not None:
            self._wmi = wmi
        self._setState(State.Idle)

    def createDescription(self) -> None:
        """A group has no description."""

    def execute(self) -> State | None:
        return None


class Root(_Group):
    """The root of a task. Its parameters are the task's blackboard.

    :param name: shown to people.
    """

    def __init__(self, name: str, wmi: WorldModelPort | None = None) -> None:
        super().__init__(":Root", name, Sequential(), wmi)


class ControlNode(_Group):
    """A group: a node with a processor and no skill.

    :param name: shown to people.
    :param children_processor: how the children are ticked.
    """

    def __init__(
        self,
        name: str,
        children_processor: Processor = Sequential(),  # noqa: B008 - the contract's default
        wmi: WorldModelPort | None = None,
    ) -> None:
        super().__init__(":Skill", name, children_processor, wmi)
