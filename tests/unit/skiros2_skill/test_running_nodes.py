"""Ticks of running nodes from their list: the same calls in the same order as visits of the whole tree."""

import copy

from hypothesis import given, settings
from hypothesis import strategies as st

from skiros2_common.core.abstract_skill import State
from skiros2_common.core.primitive import PrimitiveBase
from skiros2_common.core.world_element import Element
from skiros2_skill.core.processors import (
    Loop,
    NoFail,
    ParallelFf,
    ParallelFs,
    RetryOnFail,
    Selector,
    SelectorStar,
    Sequential,
    Serial,
)
from skiros2_skill.core.skill import Skill, SkillBase
from skiros2_skill.testing import SkillBench
from support.fuzz import examples
from unit.skiros2_skill.skills import OPTIONAL, REQUIRED, describe

PROCESSORS = [
    Sequential(), Serial(), Selector(), SelectorStar(), ParallelFf(), ParallelFs(), NoFail(ParallelFf()),
    RetryOnFail(2), RetryOnFail(1, ParallelFf()), Loop(2), Loop(3, ParallelFf()),
]  # fmt: skip
TICKS = 12

#: What the ticks of a leaf do (run, succeed, fail, raise, change the world, its element or a parameter, also
#: in place, wait for a heavy element, add a sibling), the last one for good.
leaf = st.text("RRRRRRRRSFXWEPIHA", min_size=1, max_size=TICKS)
tree = st.recursive(
    leaf,
    lambda child: st.tuples(st.sampled_from(PROCESSORS), st.booleans(), st.lists(child, min_size=1, max_size=4)),
    max_leaves=10,
)


class Trace:
    """The calls of hooks in their order."""

    def __init__(self):
        self.calls = []
        self.nodes = []


def light(description):
    return description.getPropCond("Light", "skiros:Weight", "Object", "<", 5.0, True)


class act(PrimitiveBase):
    trace: Trace

    def createDescription(self):
        params = [("Script", str, REQUIRED), ("Object", Element("skiros:Product"), REQUIRED), ("Note", int, OPTIONAL)]
        self.setDescription(describe("Act", params, hold=[light])(), "act")

    def onStart(self):
        self.ticks = 0
        self.trace.calls.append(("start", self.params["Script"].value))
        return True

    def execute(self):
        script = self.params["Script"].value
        letter = script[min(self.ticks, len(script) - 1)]
        self.ticks += 1
        weight = self.params["Object"].value.value_of("skiros:Weight")
        self.trace.calls.append((letter, script, weight, self.params["Note"].value))
        if letter == "X":
            raise RuntimeError("script")
        if letter == "W":
            product = self._wmi.get_element(self.params["Object"].value.id)
            product.setProperty("skiros:Weight", weight + 1)
            self._wmi.update_element(product)
        elif letter == "E":
            self.params["Object"].value.setProperty("skiros:Weight", weight + 1)
            self.params["Object"].value = self.params["Object"].value
        elif letter == "P":
            self.params["Note"].value = (self.params["Note"].value or 0) + 1
        elif letter == "I" and self.params["Note"].values:
            self.params["Note"].values[0] += 10
        elif letter == "H" and weight >= 2:
            return self.success("heavy")
        elif letter == "A":
            parent = self.trace.nodes[0].parent
            if len(parent.children) < 8:
                node = type(self.trace.nodes[0])("Act", "act", self.trace.nodes[0].library)
                node.specifyParamDefault("Script", "RS")
                node.specifyParamDefault("Object", self.params["Object"].value)
                parent.addChild(node)
        return {"S": State.Success, "F": State.Failure}.get(letter, self.step(letter))

    def onPreempt(self):
        self.trace.calls.append(("preempt", self.params["Script"].value))
        return super().onPreempt()

    def onEnd(self):
        self.trace.calls.append(("end", self.params["Script"].value))
        return True


def visiting(processor):
    """The processor, which is asked at each tick, as one of a library is."""
    kind = type(processor)

    def process_children(self, children, visitor):
        return kind.processChildren(self, children, visitor)

    asked = copy.copy(processor)
    asked.__class__ = type(kind.__name__, (kind,), {"processChildren": process_children})
    return asked


def planted(bench, shape, product, convert):
    """The nodes of a shape."""
    if isinstance(shape, str):
        node = bench.node("act", Script=shape, Object=product)
        act.trace.nodes.append(node)
        return node
    processor, named, children = shape
    nodes = [planted(bench, child, product, convert) for child in children]
    if not named:
        return Skill("", convert(processor))(*nodes)
    label = f"group {len(bench.library.implementations())}"

    def expand(self, skill):
        skill.setProcessor(convert(processor))
        skill(*nodes)

    body = {"createDescription": lambda self: self.setDescription(describe("Group")(), label), "expand": expand}
    bench.load(type("group", (SkillBase,), body))
    return bench.node("Group", label)


def run(shape, changed_at, preempted_at, convert):
    """The calls and, after each tick, the states and progress of all nodes."""
    act.trace = Trace()
    with SkillBench(wmi=WORLD.wmi, robot=WORLD.robot) as bench:
        bench.load(act)
        product = bench.add("skiros:Product", "product", Weight=0.0)
        task = bench.task(planted(bench, shape, product, convert))
        seen = []
        for tick in range(TICKS):
            if tick == changed_at:
                fresh = bench.wmi.get_element(product.id)
                fresh.setProperty("skiros:Weight", 2.0)
                bench.wmi.update_element(fresh)
            if tick == preempted_at:
                task.preempt()
            task.tick()
            seen.append(
                [
                    (
                        node.state.name,
                        node.progress_code,
                        node.progress_msg.partition("\n")[0].replace(product.id, "it"),
                    )
                    for node in task.nodes()
                ]
            )
            if task.ended.is_set():
                break
        task.preempt()
        task.tick()
        return act.trace.calls, seen


@settings(max_examples=examples(60))
@given(shape=tree, changed_at=st.integers(0, TICKS), preempted_at=st.integers(3, 2 * TICKS))
def test_listed_nodes_are_ticked_as_visited_ones(shape, changed_at, preempted_at):
    shape = (ParallelFf(), False, ["R" * TICKS, shape])
    listed = run(shape, changed_at, preempted_at, lambda processor: processor)
    visited = run(shape, changed_at, preempted_at, visiting)
    assert listed == visited


WORLD = SkillBench()
