"""Trees of any shape, with skills that end, fail and raise anywhere, preempted at any tick: they end as they should,
and no skill starts after a final failure."""

from hypothesis import given, settings
from hypothesis import strategies as st

from skiros2_common.core.abstract_skill import State
from skiros2_common.core.failure_kind import FailureKind
from skiros2_common.core.primitive import PrimitiveBase
from skiros2_skill.core.skill import (
    NoFail,
    ParallelFf,
    ParallelFs,
    RetryOnFail,
    Selector,
    SelectorStar,
    Sequential,
    Serial,
    SerialStar,
    Skill,
    SkillBase,
)
from skiros2_skill.testing import SkillBench
from support.fuzz import examples
from unit.skiros2_skill.skills import REQUIRED, describe

PROCESSORS = [
    Sequential(), Serial(), SerialStar(), Selector(), SelectorStar(), ParallelFf(), ParallelFs(), NoFail(Sequential()),
    NoFail(ParallelFf()), RetryOnFail(1), RetryOnFail(0), RetryOnFail(),
]  # fmt: skip

#: What the ticks of a leaf do (run, succeed, fail, exceed a limit, raise), the last one for good; and where else it
#: raises.
leaf = st.tuples(st.text("RSFLX", min_size=1, max_size=4), st.sampled_from(["", "onStart", "onPreempt", "onEnd"]))
tree = st.recursive(
    leaf,
    lambda child: st.tuples(st.sampled_from(PROCESSORS), st.booleans(), st.lists(child, max_size=4)),
    max_leaves=12,
)


class Balance:
    """How often skills were begun and ended, and how often they were begun after a final failure."""

    def __init__(self):
        self.begun = self.ended = 0
        self.has_final_failure = False
        self.begun_too_late = 0


class act(PrimitiveBase):
    balance: Balance

    def createDescription(self):
        self.setDescription(describe("Act", [("Script", str, REQUIRED), ("Fault", "", REQUIRED)])(), "act")

    def onStart(self):
        self.balance.begun += 1
        self.balance.begun_too_late += self.balance.has_final_failure
        self.ticks = 0
        return self._unless("onStart", True)

    def execute(self):
        script = self.params["Script"].value
        letter = script[min(self.ticks, len(script) - 1)]
        self.ticks += 1
        if letter == "X":
            raise RuntimeError("script")
        if letter == "L":
            self.balance.has_final_failure = True
            return self.fail("30 N", 21, FailureKind.LIMIT)
        return {"R": State.Running, "S": State.Success, "F": State.Failure}[letter]

    def onPreempt(self):
        return self._unless("onPreempt", State.Failure)

    def onEnd(self):
        self.balance.ended += 1
        return self._unless("onEnd", True)

    def _unless(self, hook, answer):
        if self.params["Fault"].value == hook:
            raise RuntimeError(hook)
        return answer


def planted(bench, shape):
    """The nodes of a shape."""
    if len(shape) == 2:
        script, fault = shape
        return bench.node("act", Script=script, Fault=fault)
    processor, named, children = shape
    nodes = [planted(bench, child) for child in children]
    if not named:
        return Skill("", processor)(*nodes)
    return compound(bench, processor, nodes)


def compound(bench, processor, nodes):
    def expand(self, skill):
        skill.setProcessor(processor)
        skill(*nodes)

    label = f"group {len(bench.library.implementations())}"
    body = {"createDescription": lambda self: self.setDescription(describe("Group")(), label), "expand": expand}
    bench.load(type("group", (SkillBase,), body))
    return bench.node("Group", label)


@settings(max_examples=examples(150))
@given(shape=tree, preempted_at=st.integers(0, 12))
def test_ended_tree_has_no_running_nodes_and_no_locks(shape, preempted_at):
    act.balance = Balance()
    with SkillBench(wmi=WORLD.wmi, robot=WORLD.robot) as bench:
        bench.load(act)
        task = bench.task(planted(bench, shape))
        task.tick(preempted_at)
        task.preempt()
        task.tick()
        assert task.ended.is_set()
        assert act.balance.begun_too_late == 0
        assert not (act.balance.has_final_failure and task.state is State.Success)
        assert State.Running not in [node.state for node in task.nodes()]
        assert act.balance.begun == act.balance.ended
        assert not any(implementation.busy for implementation in bench.library.implementations())
        assert "the tick raised" not in task.root.progress_msg


WORLD = SkillBench()
