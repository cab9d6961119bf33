"""Failures that must not be retried: nothing but a reaction starts after one, and the task fails."""

import pytest

from skiros2_common.core.abstract_skill import State
from skiros2_common.core.explanation import HOLD
from skiros2_common.core.failure_kind import FailureKind
from skiros2_runs.core.states import TaskState
from skiros2_skill.core.processors import Processor
from skiros2_skill.core.skill import (
    Loop,
    NoFail,
    ParallelFf,
    RetryOnFail,
    Selector,
    SelectorStar,
    Sequential,
    Serial,
    SerialStar,
    Skill,
    SkillBase,
)
from unit.skiros2_skill.skills import CONTAINER, OBJECT, contains, describe, primitive, running_for

LIMIT, CONTROLLER = FailureKind.LIMIT, FailureKind.CONTROLLER
Press = describe("Press")
Other = describe("Other")
Group = describe("Group")


class Retreat(describe("Retreat")):
    def createDescription(self):
        super().createDescription()
        self.is_reaction = True


class Cell:
    """Skills that note their starts: `press` fails, `other` and the reaction `retreat` succeed."""

    def __init__(self, bench):
        self.bench = bench
        self.starts = []
        self.kind = LIMIT

    def load(self, **hooks):
        for description, label, execute in (
            (Press, "press", lambda s: s.fail("30 N", 21, self.kind)),
            (Other, "other", lambda s: s.success("done")),
            (Retreat, "retreat", lambda s: s.success("back")),
        ):
            self.bench.load(primitive(description, label, onStart=self._note, execute=hooks.get(label, execute)))
        return self

    def _note(self, skill):
        self.starts.append(skill.label)
        return True

    def compound(self, processor, *names, description=Group, label="group"):
        nodes = [self.bench.node(name) if isinstance(name, str) else name for name in names]

        class group(SkillBase):
            def createDescription(self):
                self.setDescription(description(), label)

            def expand(self, skill):
                skill.setProcessor(processor)
                skill(*nodes)

        self.bench.load(group)
        return self.bench.node(description.__name__, label)

    def run(self, *nodes, ticks=50):
        task = self.bench.task(*[self.bench.node(node) if isinstance(node, str) else node for node in nodes])
        task.tick(ticks)
        assert task.ended.is_set(), f"the task still runs after {ticks} ticks"
        return task

    def group(self, processor, *names):
        return Skill("", processor)(*[self.bench.node(name) if isinstance(name, str) else name for name in names])


@pytest.fixture
def cell(bench):
    return Cell(bench).load()


class RetryForever(Processor):
    """Of a library that knows no final failures."""

    def processChildren(self, children, visitor):
        for child in children:
            if child.visit(visitor) is State.Failure:
                return State.Running
        return State.Success


@pytest.mark.parametrize(
    "processor",
    [RetryOnFail(5), RetryOnFail(), RetryOnFail(3, Selector()), RetryOnFail(2, ParallelFf()), RetryForever(), Loop()],
)
def test_final_failure_is_not_retried(cell, processor):
    task = cell.run(cell.group(processor, "press"))
    assert cell.starts == ["press"]
    assert task.state is State.Failure


def test_other_failure_is_retried_as_before(cell):
    cell.kind = FailureKind.RETRYABLE
    cell.run(cell.group(RetryOnFail(2), "press"))
    assert cell.starts == ["press"] * 3


def test_fail_without_a_kind_may_be_retried(bench):
    cell = Cell(bench).load(press=lambda s: s.fail("30 N", 21))
    task = cell.run(cell.group(SelectorStar(), "press", "other"))
    assert task.state is State.Success


def test_refused_start_is_not_retried(bench):
    starts = []
    bench.load(primitive(Press, "press", onStart=lambda s: starts.append(1) or s.startError("no", 20, CONTROLLER)))
    task = bench.run(Skill("", RetryOnFail(5))(bench.node("press")))
    assert starts == [1]
    assert task.cause().failure_kind is CONTROLLER


@pytest.mark.parametrize("processor", [SelectorStar(), Selector(), Serial(), ParallelFf(), NoFail(ParallelFf())])
def test_no_other_skill_starts_after_a_final_failure(cell, processor):
    task = cell.run(cell.group(processor, "press", "other"))
    assert cell.starts == ["press"]
    assert task.state is State.Failure


@pytest.mark.parametrize("processor", [NoFail(Sequential()), NoFail(RetryOnFail(3))])
def test_following_skill_does_not_start_after_a_hidden_final_failure(cell, processor):
    task = cell.run(cell.group(SerialStar(), cell.group(processor, "press"), "other"))
    assert cell.starts == ["press"]
    assert task.state is State.Failure


def test_reaction_starts_after_a_limit_and_the_task_fails(cell):
    task = cell.run(cell.group(SelectorStar(), "press", "retreat"), "other")
    assert cell.starts == ["press", "retreat"]
    assert task.state is State.Failure
    assert task.root.progress_msg == "skiros:Press-press(Failure): 30 N"


def test_compound_with_a_final_failure_does_not_succeed(cell):
    node = cell.compound(SelectorStar(), "press", "retreat")
    task = cell.run(cell.group(NoFail(Serial()), node), "other")
    assert cell.starts == ["press", "retreat"]
    assert node.state is State.Failure
    assert (node.progress_code, node.progress_msg) == (-21, "press: 30 N")
    assert task.state is State.Failure


def test_retry_around_a_compound_stops_when_a_reaction_has_ended(cell):
    cell.run(cell.group(RetryOnFail(5), cell.compound(SelectorStar(), "press", "retreat")))
    assert cell.starts == ["press", "retreat"]


@pytest.mark.parametrize("kind", [FailureKind.SENSOR, CONTROLLER, FailureKind.SAFETY])
def test_no_reaction_starts_when_the_robot_cannot_be_moved_safely(cell, kind):
    cell.kind = kind
    task = cell.run(cell.group(SelectorStar(), "press", "retreat"))
    assert cell.starts == ["press"]
    assert task.state is State.Failure


def test_children_of_a_reaction_start(cell):
    retreat = cell.compound(SerialStar(), "other", "other", description=Retreat, label="long way")
    cell.run(cell.group(SelectorStar(), "press", retreat))
    assert cell.starts == ["press", "other", "other"]


def test_failed_reaction_is_not_retried(bench):
    cell = Cell(bench).load(retreat=lambda s: s.fail("90 N", 21, LIMIT))
    inner = cell.compound(SelectorStar(), "retreat", "other", description=Retreat, label="long way")
    task = cell.run(cell.group(SelectorStar(), "press", cell.group(RetryOnFail(5), inner)))
    assert cell.starts == ["press", "retreat"]
    assert task.root.progress_msg == "skiros:Press-press(Failure): 30 N"


def test_skill_is_no_reaction_to_its_own_failure(bench):
    cell = Cell(bench).load(retreat=lambda s: s.fail("90 N", 21, LIMIT))
    cell.run(cell.group(RetryForever(), "retreat"))
    assert cell.starts == ["retreat"]


def test_second_reaction_starts_after_a_failed_one(bench):
    cell = Cell(bench).load(retreat=lambda s: s.fail("90 N", 21, LIMIT))
    second = cell.compound(SerialStar(), "other", description=Retreat, label="second")
    task = cell.run(cell.group(SerialStar(), cell.group(NoFail(Serial()), "retreat"), second))
    assert cell.starts == ["retreat", "other"]
    assert task.state is State.Failure


def test_running_branch_continues_but_starts_nothing(bench):
    cell = Cell(bench).load(other=running_for(3))
    first = bench.node("other")
    others = cell.group(SerialStar(), first, "other")
    task = cell.run(cell.group(ParallelFf(), others, cell.group(NoFail(Serial()), "press")))
    assert cell.starts == ["other", "press"]
    assert first.progress_msg == "done"
    assert task.state is State.Failure


def test_hold_condition_may_be_a_limit(bench):
    def condition(description):
        made = contains()(description)
        made.failure_kind = LIMIT
        return made

    bench.load(primitive(describe("Hold", [CONTAINER, OBJECT], hold=[condition]), "hold", execute=running_for(9)))
    task = bench.task(Skill("", RetryOnFail())(bench.node("hold", Object=bench.product, Container=bench.tray)))
    task.tick()
    bench.wmi.set_relation(bench.tray.id, "skiros:contain", bench.product.id, False)
    task.tick()
    assert task.ended.is_set()
    assert (task.cause().stage, task.cause().failure_kind) == (HOLD, LIMIT)


def test_explanation_has_the_kind(cell):
    task = cell.run(cell.group(SelectorStar(), "press", "other"))
    kinds = {why.label: why.failure_kind for why in task.explanations()}
    assert kinds == {"press": LIMIT, "other": LIMIT}
    assert task.cause().label == "press"
    assert "it is not retried: a limit was exceeded" in "\n".join(task.cause().lines())


def test_on_end_cannot_make_a_final_failure_retryable(bench):
    starts = []
    bench.load(
        primitive(
            Press, "press", onStart=lambda s: starts.append(1) or True,
            execute=lambda s: s.fail("30 N", 21, LIMIT), onEnd=lambda s: s.fail("no answer", 20),
        )
    )  # fmt: skip
    bench.run(Skill("", RetryOnFail(3))(bench.node("press")))
    assert starts == [1]


def test_next_task_starts_the_skill_again(cell):
    cell.run("press")
    cell.run("press")
    assert cell.starts == ["press", "press"]


@pytest.mark.parametrize(("kind", "starts"), [(LIMIT, ["carry", "press", "other"]), (CONTROLLER, ["carry", "press"])])
def test_on_preempt_runs_after_a_limit_only(cell, kind, starts):
    class Carry(describe("Carry")):
        def createDescription(self):
            super().createDescription()
            self.set_on_preempt("Other")

    cell.bench.load(primitive(Carry, "carry", onStart=cell._note, execute=lambda s: s.step("")))
    cell.kind = kind
    task = cell.bench.task(cell.group(ParallelFf(), "carry", cell.group(NoFail(Serial()), "press")))
    task.tick()
    task.preempt()
    task.run()
    assert cell.starts == starts
    assert task.status is TaskState.PREEMPTED
    assert (kind is LIMIT) == (task.root.progress_msg == "Preempted")
