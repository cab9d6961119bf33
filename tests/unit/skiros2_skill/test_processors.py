"""Processors: which children a tick reaches, and what state follows."""

import pytest

from skiros2_common.core.abstract_skill import State
from skiros2_skill.core.processors import (
    Loop,
    NoFail,
    NoProcessor,
    ParallelFf,
    ParallelFs,
    RetryOnFail,
    Selector,
    SelectorStar,
    Sequential,
    Serial,
    SerialStar,
)

STATES = {"S": State.Success, "F": State.Failure, "R": State.Running}


class Child:
    """A node that gives the next of its states at each tick, and the last one from then on."""

    may_retry = True

    def __init__(self, states):
        self._states = [STATES[s] for s in states]
        self.ticks = 0
        self.preempted = 0
        self.state = State.Idle

    def visit(self, visitor):
        self.state = self._states[min(self.ticks, len(self._states) - 1)]
        self.ticks += 1
        return self.state

    def visitPreempt(self, visitor):
        self.preempted += 1
        self.state = State.Failure


def run(processor, *states):
    """Ticks until the end. The states of each tick, and the children."""
    children = [Child(s) for s in states]
    trace = ""
    while not trace or (trace[-1] == "R" and len(trace) < 20):
        trace += processor.processChildren(children, None).name[0]
    return trace, children


@pytest.mark.parametrize(
    ("processor", "states", "trace", "ticks"),
    [
        # in order, from the first each time
        (Serial(), ["S", "RS", "S"], "RS", [2, 2, 1]),
        (Serial(), ["S", "F", "S"], "F", [1, 1, 0]),
        (Serial(), [], "S", []),
        # going on at the one that was running
        (SerialStar(), ["S", "RS", "S"], "RS", [1, 2, 1]),
        (SerialStar(), ["S", "RF", "S"], "RF", [1, 2, 0]),
        (Sequential(), ["S", "RS", "S"], "RS", [1, 2, 1]),
        # until one is Success or Running
        (Selector(), ["F", "RS", "S"], "RS", [2, 2, 0]),
        (Selector(), ["F", "F"], "F", [1, 1]),
        (Selector(), [], "F", []),
        (SelectorStar(), ["F", "RS", "S"], "RS", [1, 2, 0]),
        (SelectorStar(), ["RF", "F"], "RF", [2, 1]),
        # all; those that have succeeded are not ticked again
        (ParallelFf(), ["S", "RRS"], "RRS", [1, 3]),
        (ParallelFf(), ["R", "RF"], "RF", [2, 2]),
        (ParallelFf(), [], "S", []),
        # all, until one ends
        (ParallelFs(), ["RRS", "RS"], "RS", [2, 2]),
        (ParallelFs(), ["R", "RF"], "RF", [2, 2]),
        # a failure counts as Success
        (NoFail(Sequential()), ["S", "F"], "S", [1, 1]),
        (NoFail(Sequential()), ["RS"], "RS", [2]),
        # from the first child again after a failure
        (RetryOnFail(1), ["S", "FS"], "RS", [2, 2]),
        (RetryOnFail(0), ["F"], "F", [1]),
        (RetryOnFail(2), ["F"], "RRF", [3]),
        (RetryOnFail(), ["FFFFS"], "RRRRS", [5]),
        (RetryOnFail(1, Selector()), ["F", "FS"], "RS", [2, 2]),
        (RetryOnFail(1, ParallelFf()), ["S", "FS"], "RS", [2, 2]),
        # from the first child again after a success
        (Loop(1), ["S", "S"], "S", [1, 1]),
        (Loop(3), ["S", "RSSS"], "RRRS", [3, 4]),
        (Loop(2, ParallelFf()), ["S", "S"], "RS", [2, 2]),
        (Loop(), ["SSF"], "RRF", [3]),
        (NoFail(Loop()), ["SF"], "RS", [2]),
        (NoProcessor(), ["F"], "S", [0]),
    ],
)
def test_processor_ticks_children_and_combines_states(processor, states, trace, ticks):
    got, children = run(processor, *states)
    assert got == trace
    assert [c.ticks for c in children] == ticks


@pytest.mark.parametrize(
    ("processor", "states", "preempted"),
    [
        (Serial(), ["SF", "R"], [0, 1]),  # an earlier child fails while a later one runs
        (Selector(), ["FS", "R"], [0, 1]),
        (ParallelFf(), ["R", "RF", "R"], [1, 0, 1]),
        (ParallelFs(), ["R", "RS", "R"], [1, 0, 1]),
    ],
)
def test_running_children_are_preempted_at_the_end_of_the_node(processor, states, preempted):
    _, children = run(processor, *states)
    assert [c.preempted for c in children] == preempted


@pytest.mark.parametrize(
    ("processor", "symbol"),
    [
        (Serial(), "->"), (SerialStar(), "->*"), (Sequential(), "->*"), (Selector(), "?"), (SelectorStar(), "?*"),
        (ParallelFf(), "|ff|"), (ParallelFs(), "|fs|"),
    ],
)  # fmt: skip
def test_processor_has_its_symbol(processor, symbol):
    assert processor.printType() == symbol


@pytest.mark.parametrize(
    "processor", [SerialStar(), SelectorStar(), ParallelFf(), RetryOnFail(3), NoFail(SerialStar())]
)
def test_fresh_copy_has_its_own_position(processor):
    processor.processChildren([Child("S"), Child("R")], None)
    children = [Child("R"), Child("R")]
    processor.fresh().processChildren(children, None)
    assert children[0].ticks == 1


@pytest.mark.parametrize("processor", [SerialStar(), SelectorStar(), RetryOnFail(3), NoFail(SerialStar())])
def test_reset_restarts_at_the_first_child(processor):
    first = "F" if isinstance(processor, SelectorStar) else "S"
    processor.processChildren([Child(first), Child("R")], None)
    processor.reset()
    children = [Child("R"), Child("R")]
    processor.processChildren(children, None)
    assert [c.ticks for c in children] == [1, 0]


@pytest.mark.parametrize(
    ("processor", "arguments", "preempted"),
    [
        (Serial(), (0,), [0, 1, 0]),
        (Selector(), (0,), [0, 1, 0]),
        (SelectorStar(), (1,), [0, 0, 0]),
        (ParallelFf(), (), [1, 1, 0]),
        (ParallelFs(), (), [1, 1, 0]),
    ],
)
def test_stop_all_preempts_running_children(processor, arguments, preempted):
    """Processors that tick in order preempt the children after an index."""
    children = [Child(s) for s in ("R", "R", "S")]
    for child in children:
        child.visit(None)
    processor.stopAll(children, None, *arguments)
    assert [child.preempted for child in children] == preempted
