"""Processors: the control flow of a node, which decides how its children are ticked.

A processor belongs to one node and may keep state between ticks. `children` are tree nodes; `visitor` is the executor,
which ticks a node (`child.visit(visitor)` returns its state) and preempts one (`child.visitPreempt(visitor)`).
"""

from __future__ import annotations

import copy
from collections.abc import Sequence as Children
from typing import Protocol, Self, TypeVar

from skiros2_common.core.abstract_skill import State
from skiros2_common.core.errors import WrongValue

_Visitor = TypeVar("_Visitor")
_AnyVisitor = TypeVar("_AnyVisitor", contravariant=True)
_Node = TypeVar("_Node")

_SUCCESS: State = State.Success
_FAILURE: State = State.Failure
_RUNNING: State = State.Running


class TreeNode(Protocol[_AnyVisitor]):
    """A node as a processor sees it."""

    @property
    def state(self) -> State: ...
    @property
    def may_retry(self) -> bool:
        """Whether no failure of the node or below it is final: see `FailureKind`."""

    def visit(self, visitor: _AnyVisitor) -> State:
        """Ticks the node once. Returns its state."""

    def visitPreempt(self, visitor: _AnyVisitor) -> State:
        """Preempts the node. Returns its state, Running while it is still ending."""


class Processor:
    """Base class of processors."""

    symbol = ""

    def __init_subclass__(cls) -> None:
        """A processor with a `processChildren` of its own is asked at each tick, unless it has `next_visits` too."""
        super().__init_subclass__()
        if "processChildren" in vars(cls) and "next_visits" not in vars(cls):
            cls.next_visits = Processor.next_visits  # type: ignore[method-assign]

    def printType(self) -> str:
        """The symbol of the processor in a printed tree."""
        return self.symbol

    def reset(self) -> None:
        """Called when the node starts: restarts at the first child."""

    def processChildren(self, children: Children[TreeNode[_Visitor]], visitor: _Visitor) -> State:
        """Ticks the children once. Returns the resulting state of the node."""
        raise NotImplementedError(f"{self.__class__.__name__} has to define processChildren")

    def next_visits(self, children: Children[_Node]) -> Children[_Node] | None:
        """The children that the next tick visits, in this order, if it does nothing else as long as all of them are
        Running; None if it does."""
        return None

    def fresh(self) -> Self:
        """A copy in its initial state, for another node."""
        new = copy.copy(self)
        new.reset()
        return new


def _preempt_running(children: Children[TreeNode[_Visitor]], visitor: _Visitor) -> None:
    for child in children:
        if child.state is _RUNNING:
            child.visitPreempt(visitor)


class NoProcessor(Processor):
    """Ticks no children."""

    def processChildren(self, children: Children[TreeNode[_Visitor]], visitor: _Visitor) -> State:
        return _SUCCESS


class _InOrder(Processor):
    """Ticks the children in order while each has `_continue_on`; starts at the first child at every tick."""

    _continue_on: State

    def processChildren(self, children: Children[TreeNode[_Visitor]], visitor: _Visitor) -> State:
        for index, child in enumerate(children):
            state = child.visit(visitor)
            if state is not self._continue_on:
                self.stopAll(children, visitor, index)
                return state
        return self._continue_on

    def stopAll(self, children: Children[TreeNode[_Visitor]], visitor: _Visitor, index: int) -> None:
        """Preempts the running children after `index`."""
        _preempt_running(children[index + 1 :], visitor)


class Serial(_InOrder):
    """Ticks the children in order until one is not Success; starts at the first child at every tick."""

    symbol = "->"
    _continue_on = _SUCCESS


class Selector(_InOrder):
    """Ticks the children in order until one is Success or Running; starts at the first child at every tick."""

    symbol = "?"
    _continue_on = _FAILURE


class _InOrderStar(Processor):
    """Ticks the children in order while each has `_continue_on`; resumes at the running child."""

    _continue_on: State

    def __init__(self) -> None:
        self._index = 0

    def reset(self) -> None:
        self._index = 0

    def processChildren(self, children: Children[TreeNode[_Visitor]], visitor: _Visitor) -> State:
        # The list may grow meanwhile: a skill may add children to its node.
        while self._index < len(children):
            state = children[self._index].visit(visitor)
            if state is not self._continue_on:
                return state
            self._index += 1
        return self._continue_on

    def next_visits(self, children: Children[_Node]) -> Children[_Node] | None:
        return children[self._index : self._index + 1]


class SerialStar(_InOrderStar):
    """Ticks the children in order until one is not Success; resumes at the running child."""

    symbol = "->*"
    _continue_on = _SUCCESS


class Sequential(SerialStar):
    """Same as `SerialStar`; the default."""


class SelectorStar(_InOrderStar):
    """Ticks the children in order until one is Success or Running; resumes at the running child."""

    symbol = "?*"
    _continue_on = _FAILURE

    def stopAll(self, children: Children[TreeNode[_Visitor]], visitor: _Visitor, index: int) -> None:
        """Preempts the running children after `index`."""
        _preempt_running(children[index + 1 :], visitor)


class _Parallel(Processor):
    def __init__(self) -> None:
        self._succeeded: set[int] = set()

    def reset(self) -> None:
        self._succeeded = set()

    def stopAll(self, children: Children[TreeNode[_Visitor]], visitor: _Visitor) -> None:
        """Preempts all running children."""
        _preempt_running(children, visitor)


class ParallelFf(_Parallel):
    """Ticks all children. Fails when one fails and preempts the others; succeeds when all have succeeded."""

    symbol = "|ff|"

    def processChildren(self, children: Children[TreeNode[_Visitor]], visitor: _Visitor) -> State:
        succeeded = self._succeeded
        is_running = False
        for index, child in enumerate(children):
            if succeeded and index in succeeded:
                continue
            state = child.visit(visitor)
            if state is _RUNNING:
                is_running = True
            elif state is _FAILURE:
                self.stopAll(children, visitor)
                return _FAILURE
            elif state is _SUCCESS:
                succeeded.add(index)
        return _RUNNING if is_running or len(succeeded) != len(children) else _SUCCESS

    def next_visits(self, children: Children[_Node]) -> Children[_Node] | None:
        return [child for index, child in enumerate(children) if index not in self._succeeded]


class ParallelFs(_Parallel):
    """Ticks all children. Ends with the state of the first child that ends and preempts the others."""

    symbol = "|fs|"

    def processChildren(self, children: Children[TreeNode[_Visitor]], visitor: _Visitor) -> State:
        for child in children:
            state = child.visit(visitor)
            if state is not _RUNNING:
                self.stopAll(children, visitor)
                return state
        return _RUNNING if children else _SUCCESS

    def next_visits(self, children: Children[_Node]) -> Children[_Node] | None:
        return children


class _Decorator(Processor):
    """Changes the result of another processor."""

    def __init__(self, processor: Processor) -> None:
        self._processor = processor

    def reset(self) -> None:
        self._processor.reset()

    def fresh(self) -> Self:
        new = copy.copy(self)
        new._processor = self._processor.fresh()
        new.reset()
        return new


class NoFail(_Decorator):
    """Runs another processor and turns its Failure into Success; the task still fails after a final failure.

    :param processor: the other processor.
    """

    def printType(self) -> str:
        return f"nofail({self._processor.printType()})"

    def processChildren(self, children: Children[TreeNode[_Visitor]], visitor: _Visitor) -> State:
        state = self._processor.processChildren(children, visitor)
        return State.Success if state is State.Failure else state

    def next_visits(self, children: Children[_Node]) -> Children[_Node] | None:
        return self._processor.next_visits(children)


class _Repeat(_Decorator):
    """Restarts the children while they end with `_repeat_on`, at most `times` times; Running in between."""

    _repeat_on: State

    def __init__(self, times: int, processor: Processor | None = None) -> None:
        super().__init__(processor.fresh() if processor is not None else Sequential())
        self._times = times
        self._done = 0

    def reset(self) -> None:
        super().reset()
        self._done = 0

    def may_repeat(self, children: Children[TreeNode[_Visitor]]) -> bool:
        """Whether the children may restart."""
        return True

    def processChildren(self, children: Children[TreeNode[_Visitor]], visitor: _Visitor) -> State:
        state = self._processor.processChildren(children, visitor)
        if state is not self._repeat_on or (0 <= self._times <= self._done) or not self.may_repeat(children):
            return state
        self._done += 1
        _preempt_running(children, visitor)
        self._processor.reset()
        return _RUNNING

    def next_visits(self, children: Children[_Node]) -> Children[_Node] | None:
        return self._processor.next_visits(children)


class RetryOnFail(_Repeat):
    """Runs another processor; after a failure it restarts at the first child and is Running in between. A final failure
    (`FailureKind`) is not retried.

    :param max_retries: maximum number of restarts; -1: unlimited.
    :param processor: the other processor; None: `Sequential`.
    """

    _repeat_on = _FAILURE

    def __init__(self, max_retries: int = -1, processor: Processor | None = None) -> None:
        super().__init__(max_retries, processor)

    def may_repeat(self, children: Children[TreeNode[_Visitor]]) -> bool:
        return all(child.may_retry for child in children)

    def printType(self) -> str:
        inside = "" if isinstance(self._processor, Sequential) else f",{self._processor.printType()}"
        return f"retry({self._times}{inside})"


class Loop(_Repeat):
    """Runs another processor; after a success it restarts at the first child and is Running in between.

    Fails as soon as the other processor does.

    :param times: how often the children run, including the first time; -1: unlimited.
    :param processor: the other processor; None: `Sequential`.
    :raises WrongValue: `times` is neither positive nor -1.
    """

    _repeat_on = _SUCCESS

    def __init__(self, times: int = -1, processor: Processor | None = None) -> None:
        if times < 1 and times != -1:
            raise WrongValue(f"Loop({times}): expected how often the children run, at least 1, or -1 for no limit")
        super().__init__(times if times == -1 else times - 1, processor)

    def printType(self) -> str:
        inside = "" if isinstance(self._processor, Sequential) else f",{self._processor.printType()}"
        return f"loop({self._times + 1 if self._times >= 0 else -1}{inside})"
