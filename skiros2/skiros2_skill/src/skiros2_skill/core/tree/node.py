"""A node of a behaviour tree: its place, its processor, its remaps and its fixed parameters."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from skiros2_common.core.abstract_skill import SkillDescription, State
from skiros2_common.core.errors import Refused, WrongValue
from skiros2_common.core.params import ParamHandler
from skiros2_skill.core.processors import Sequential
from skiros2_skill.core.tree.node_params import NodeParams

_RUNNING: State = State.Running


class SkillInterface(NodeParams):
    """A node of a tree.

    The parameters of running nodes meet on the task's blackboard. `name_above` gives the name that a key of the node,
    or of a node below it, has one level up, where it may be renamed again; the last name is the key on the blackboard.

    :param children_processor: how the children are ticked; the node takes one of the same kind for itself.
    """

    def __init__(self, children_processor: Any = Sequential()) -> None:  # noqa: B008 - the contract's default
        super().__init__()
        self._parent: SkillInterface | None = None
        self._place = 0  # among the children of the parent
        self._processor = children_processor.fresh()
        self._instance: Any = None
        self._instanciator: Any = None
        self._own_pre_conditions: list[Any] = []
        self._latched: SkillInterface | None = None
        self._input: dict[str, list[Any]] = {}

    # -- place in the tree -------------------------------------------------------------------------------------

    @property
    def parent(self) -> Any:
        """The node above, None for a root."""
        return self._parent

    def getParent(self) -> Any:
        return self._parent

    @property
    def children(self) -> list[Any]:
        return self._children

    def __call__(self, *children: Any) -> SkillInterface:
        """Adds children, in this order. Returns the node."""
        for child in children:
            self.addChild(child)
        return self

    def addChild(self, p: Any, latch: bool = False) -> SkillInterface:
        """Adds a child at the end.

        :param latch: the children added after it go under it.
        :raises Refused: `p` is in a tree already.
        """
        if self._latched is not None:
            self._latched.addChild(p, latch)
            return self
        if p._parent is not None:
            raise Refused(f"{p.printState()} is a child of {p._parent.printState()} already")
        p._parent = self
        p._place = len(self._children)
        self._children.append(p)
        if latch:
            self._latched = p
        return self

    def last(self) -> Any:
        """The child added last.

        :raises WrongValue: there is none.
        """
        if not self._children:
            raise WrongValue(f"{self.printState()} has no children")
        return self._children[-1]

    def popChild(self) -> Any:
        """Takes the child added last away and returns it.

        :raises WrongValue: there is none.
        :raises Refused: it runs.
        """
        child = self.last()
        if child._state is State.Running:
            raise Refused(f"{child.printState()} cannot be taken out of the tree while it runs")
        self._children.pop()
        child._parent = None
        if self._latched is child:
            self._latched = None
        return child

    def hasChildren(self) -> bool:
        return bool(self._children)

    def inSubtreeOf(self, skill: Any) -> bool:
        """Whether `skill` is this node or above it."""
        node: SkillInterface | None = self
        while node is not None:
            if node is skill:
                return True
            node = node._parent
        return False

    def getLightCopy(self) -> SkillInterface:
        """A node with the same description, remaps and fixed parameters, without children and in no tree."""
        copy = self.__class__.__new__(self.__class__)
        SkillInterface.__init__(copy, self._processor)
        self._copy_to(copy)
        return copy

    def _copy_to(self, copy: SkillInterface) -> None:
        SkillDescription.setDescription(copy, *self.getDescription())
        copy._label = self._label
        copy._wmi = self._wmi
        copy._instanciator = self._instanciator
        copy._description = self._description
        copy._remaps = dict(self._remaps)
        copy._specified = dict(self._specified)
        copy._suggested = dict(self._suggested)
        copy._own_pre_conditions = [c.copy() for c in self._own_pre_conditions]

    # -- processor ---------------------------------------------------------------------------------------------

    @property
    def processor(self) -> Any:
        return self._processor

    def setProcessor(self, processor_type: Any) -> None:
        """Takes a processor of that kind."""
        self._processor = processor_type.fresh()

    def processChildren(self, visitor: Any) -> State:
        """One tick of the children."""
        state: State = self._processor.processChildren(self._children, visitor)
        return state

    # -- description and parameters ---------------------------------------------------------------------------

    def revertInput(self) -> None:
        """Sets the parameters back to what they were at the start of the skill."""
        for key, values in self._input.items():
            if self._params.hasParam(key):
                self._params.getParamMap()[key].assign(list(values))

    def resetDescription(self, other: Any = None) -> None:
        """Takes the parameters and conditions of another skill, or those it was described with."""
        source = other if other is not None else self._description
        SkillDescription.setDescription(self, self._type, *source.getDescription()[1:])

    def mergeDescription(self, other: Any) -> None:
        """Adds the parameters and conditions of another skill."""
        for key, param in other.params.getCopy().items():
            self._params.getParamMap()[key] = param
        self._pre_conditions += [c.copy() for c in other.pre_conditions]
        self._hold_conditions += [c.copy() for c in other.hold_conditions]
        self._post_conditions += [c.copy() for c in other.post_conditions]

    def addPreCondition(self, condition: Any, modify_description: bool = False) -> None:
        """Adds a pre-condition; with `modify_description` to the description too."""
        super().addPreCondition(condition)
        if modify_description:
            self._description.addPreCondition(condition.copy())

    def addHoldCondition(self, condition: Any, modify_description: bool = False) -> None:
        """Adds a hold-condition; with `modify_description` to the description too."""
        super().addHoldCondition(condition)
        if modify_description:
            self._description.addHoldCondition(condition.copy())

    def addPostCondition(self, condition: Any, modify_description: bool = False) -> None:
        """Adds a post-condition; with `modify_description` to the description too."""
        super().addPostCondition(condition)
        if modify_description:
            self._description.addPostCondition(condition.copy())

    # -- simulation of effects ---------------------------------------------------------------------------------

    def hold(self) -> bool:
        """Makes the hold-conditions true in the world model. False when one could not be."""
        made = [c.setTrue(self._params, self._wmi) for c in self._hold_conditions]
        return all(made)

    def revertHold(self) -> None:
        """Takes back what `hold` changed."""
        for condition in reversed(self._hold_conditions):
            condition.revert(self._params, self._wmi)

    def simulate(self) -> bool:
        """Makes the post-conditions true in the world model. False when one could not be."""
        made = [c.setTrue(self._params, self._wmi) for c in self._post_conditions]
        return all(made)

    def revertSimulation(self) -> None:
        """Takes back what `simulate` changed."""
        for condition in reversed(self._post_conditions):
            condition.revert(self._params, self._wmi)

    # -- running -----------------------------------------------------------------------------------------------

    def init(self, wmi: Any) -> bool:
        """Gives the node the world model and declares what it is."""
        self._wmi = wmi
        self._create()
        self._setState(State.Idle)
        return True

    def hasInstance(self) -> bool:
        """Whether an implementation is chosen, where the node needs one."""
        return True

    def wrapper_expand(self) -> None:
        """Makes the subtree of the implementation; nothing for a node without one."""

    def visit(self, visitor: Any) -> State:
        """One tick of the node by an executor."""
        state: State
        if self._state is not _RUNNING:
            state = visitor.execute(self)
            return state
        state = self._processor.processChildren(self._children, visitor)
        if state is not _RUNNING:
            visitor.set_state(self, state)
        return state

    def visitPreempt(self, visitor: Any) -> State:
        """Preemption of the node by an executor."""
        state: State = visitor.preempt(self)
        return state

    def tick(self) -> State:
        """One tick of the node with an executor of its own, for use without a task."""
        if "_executor" not in self.__dict__:
            from skiros2_skill.core.engine.executor import Executor  # the executor's types are built on this module

            self._executor = Executor(self._wmi)
        return self._executor.tick(self)

    def _setState(self, state: State) -> None:
        super()._setState(state)

    def start(self, params: ParamHandler | None = None) -> State:
        """Fixes the given parameters and makes the node ready for its first tick. Returns the state."""
        if params is not None:
            self.specifyParams(params, False)
        return self.reset()

    def execute(self) -> State | None:
        """To override in compounds: runs after the children; None keeps their state."""
        return None


def all_nodes(root: Any) -> Iterator[Any]:
    """The nodes of a tree, each before its children."""
    waiting = [root]
    while waiting:
        node = waiting.pop()
        yield node
        waiting.extend(reversed(node.children))
