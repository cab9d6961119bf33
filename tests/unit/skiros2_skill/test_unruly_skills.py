"""Skills with faulty code: only the skill fails, with a clear message, and the next task runs."""

import sys
import threading

import numpy as np
import pytest

from skiros2_common.core.abstract_skill import State
from skiros2_common.core.conditions import ConditionFunction
from skiros2_common.core.errors import ConfigurationError, Refused
from skiros2_common.core.primitive_thread import PrimitiveThreadBase
from skiros2_common.core.world_element import Element
from skiros2_skill.core.skill import ParallelFf, Selector, Sequential, Skill, SkillBase
from unit.skiros2_skill.skills import (
    CONTAINER,
    OBJECT,
    OPTIONAL,
    REQUIRED,
    Work,
    describe,
    primitive,
    running_for,
)


def raises(*_):
    raise RuntimeError("out of coffee")


def exits(*_):
    sys.exit("I am off")


def compound(**body):
    """A compound class labelled `unruly` with one child, `work`, and these methods."""
    body.setdefault("expand", lambda self, skill: skill(self.skill("Work", "work")))
    body["createDescription"] = lambda self: self.setDescription(describe("Unruly")(), "unruly")
    return type("unruly", (SkillBase,), body)


def node_of(task):
    return task.root.children[0]


def runs_on(bench):
    """Whether the next task runs."""
    if "after" not in [i.label for i in bench.library.implementations()]:
        bench.load(primitive(describe("After"), "after"))
    return bench.run(bench.node("after")).state is State.Success


# -- hooks that raise --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("hook", "code"), [("expand", -404), ("onStart", -404), ("execute", -405), ("onEnd", -405), ("onPreempt", -406)]
)
def test_exception_in_compound_has_traceback_and_ends_children(bench, hook, code):
    bench.load(primitive(Work, "work", execute=running_for(2)), compound(**{hook: raises}))
    task = bench.task(bench.node("unruly"))
    task.tick()
    if hook == "onPreempt":
        task.preempt()
    while task.state is State.Running:
        task.tick()
    assert node_of(task).progress_code == code
    assert "RuntimeError: out of coffee" in node_of(task).progress_msg
    assert State.Running not in [node.state for node in task.nodes()]
    assert runs_on(bench)


def test_selector_tries_sibling_after_exception(bench):
    bench.load(primitive(Work, "bad", execute=raises), primitive(Work, "good"))
    assert bench.run(Skill("", Selector())(bench.node("bad"), bench.node("good"))).state is State.Success


@pytest.mark.parametrize(
    ("hook", "code"), [("onStart", -404), ("execute", -405), ("onEnd", -405), ("onPreempt", -406), ("run", -405)]
)
def test_sys_exit_in_skill_ends_only_that_skill(bench, hook, code):
    """`sys.exit()` is not an `Exception`; it would end the thread that ticks, silently."""
    if hook == "run":
        create = lambda self: self.setDescription(describe("Off")(), "off")  # noqa: E731
        bench.load(type("off", (PrimitiveThreadBase,), {"createDescription": create, "run": exits}))
    else:
        hooks = {"execute": lambda self: self.step() if hook == "onPreempt" else self.success(), hook: exits}
        bench.load(primitive(describe("Off"), "off", **hooks))
    task = bench.task(bench.node("off"))
    task.tick()
    if hook == "onPreempt":
        task.preempt()
    task.run()
    assert task.state is State.Failure
    assert node_of(task).progress_code == code
    assert "SystemExit: I am off" in node_of(task).progress_msg
    assert runs_on(bench)


@pytest.mark.parametrize("hook", ["onStart", "execute", "onEnd", "onPreempt"])
def test_changes_before_exception_are_not_written(bench, hook):
    """A half-written element."""

    def half(self):
        self.params["Object"].value.setProperty("skiros:Weight", 5.0)
        self.params["Made"].value.setProperty("skiros:Weight", 5.0)
        raises()

    weigh = describe("Weigh", [OBJECT, ("Made", Element("skiros:Starter"), OPTIONAL)])
    hooks = {"execute": lambda self: self.step() if hook == "onPreempt" else self.success(), hook: half}
    bench.load(primitive(weigh, "weigh", **hooks))
    task = bench.task(bench.node("weigh", Object=bench.product))
    task.tick()
    if hook == "onPreempt":
        task.preempt()
        task.tick()
    assert "out of coffee" in node_of(task).progress_msg
    assert not bench.wmi.get_element(bench.product.id).hasProperty("skiros:Weight")
    assert bench.wmi.resolve_elements(Element("skiros:Starter")) == []


@pytest.mark.parametrize(("kind", "code"), [("pre", -404), ("hold", -405), ("post", -405)])
def test_exception_in_condition_fails_only_its_skill(bench, kind, code):
    """Like exceptions in hooks: the remaining task continues."""
    condition = lambda d: ConditionFunction("Fresh", ["Text"], raises)  # noqa: E731
    unruly = describe("Unruly", [("Text", "x", REQUIRED)], **{kind: [condition]})
    bench.load(primitive(unruly, "unruly", execute=running_for(3)), primitive(Work, "work"))
    unruly_node = bench.node("unruly")
    task = bench.run(Skill("", Selector())(unruly_node, bench.node("work")))
    assert task.state is State.Success
    assert unruly_node.progress_code == code
    assert "RuntimeError: out of coffee" in unruly_node.progress_msg


def test_exception_in_condition_during_inference_is_reported(bench):
    unruly = describe(
        "Unruly", [CONTAINER, OBJECT], pre=[lambda d: ConditionFunction("Near", ["Object", "Container"], raises)]
    )
    bench.load(primitive(unruly, "unruly"))
    task = bench.run(bench.node("unruly"))
    assert task.state is State.Failure
    assert "RuntimeError: out of coffee" in node_of(task).progress_msg


def test_exception_in_processor_fails_only_its_node(bench):
    class Lottery(Sequential):
        def processChildren(self, children, visitor):
            super().processChildren(children, visitor)
            raises()

    def expand(self, skill):
        skill.setProcessor(Lottery())
        skill(self.skill("Work", "work"))

    bench.load(primitive(Work, "work", execute=running_for(5)), compound(expand=expand), primitive(Work, "other"))
    unruly = bench.node("unruly")
    task = bench.run(Skill("", Selector())(unruly, bench.node("other")))
    assert task.state is State.Success
    assert unruly.progress_code == -405
    assert "out of coffee" in unruly.progress_msg
    assert unruly.children[0].state is State.Failure


@pytest.mark.parametrize(("what", "said"), [(raises, "RuntimeError: out of coffee"), (exits, "SystemExit: I am off")])
@pytest.mark.parametrize("hook", ["createDescription", "onInit", "modifyDescription", "__init__"])
def test_skill_that_cannot_be_loaded_is_skipped_with_source_location(bench, hook, what, said):
    unruly = primitive(Work, "unruly")
    setattr(unruly, hook, what)
    with pytest.raises(ConfigurationError, match="unruly cannot be loaded") as refused:
        bench.load(unruly)
    assert said in str(refused.value)
    assert f"{__file__}, line " in str(refused.value)
    assert runs_on(bench)


def test_on_init_false_skips_skill_and_none_loads_it(bench):
    with pytest.raises(ConfigurationError, match="onInit returned False"):
        bench.load(primitive(Work, "unwilling", onInit=False))
    bench.load(primitive(Work, "silent", onInit=None))
    assert bench.run(bench.node("silent")).state is State.Success


# -- hooks that answer something else ----------------------------------------------------------------------------------


@pytest.mark.parametrize("answer", [False, State.Failure, np.bool_(False)])
def test_failure_without_progress_names_hook(bench, answer):
    bench.load(primitive(Work, "work", execute=answer))
    task = bench.run(bench.node("work"))
    assert task.state is State.Failure
    assert node_of(task).progress_code < 0
    assert f"work: execute returned {answer!r}" in node_of(task).progress_msg
    assert f"work: execute returned {answer!r}" in task.root.progress_msg


def test_failure_without_progress_keeps_last_progress(bench):
    def execute(self):
        self.step("looking for the cup")
        return State.Failure

    bench.load(primitive(Work, "work", execute=execute))
    task = bench.run(bench.node("work"))
    assert "looking for the cup" in node_of(task).progress_msg
    assert node_of(task).progress_code < 0


@pytest.mark.parametrize("answer", [State.Idle, State.Uninitialized])
def test_invalid_return_value_of_execute_is_named(bench, answer):
    bench.load(primitive(Work, "work", execute=answer))
    task = bench.run(bench.node("work"))
    assert node_of(task).state is State.Failure
    assert f"execute returned {answer!r}" in task.root.progress_msg


@pytest.mark.parametrize("answer", [np.bool_(True), True])
def test_execute_returning_true_succeeds(bench, answer):
    bench.load(primitive(Work, "work", execute=answer))
    assert bench.run(bench.node("work")).state is State.Success


@pytest.mark.parametrize("answer", [False, np.bool_(False), State.Failure])
def test_refusal_of_on_start_prevents_start(bench, answer):
    calls = []
    bench.load(primitive(Work, "work", onStart=answer, execute=lambda self: calls.append(1) or self.success()))
    task = bench.run(bench.node("work"))
    assert task.state is State.Failure
    assert node_of(task).progress_code < 0
    assert "work: onStart returned" in task.root.progress_msg
    assert calls == []


@pytest.mark.parametrize("answer", [None, True, State.Success, State.Running])
def test_other_return_values_of_on_start_start_skill(bench, answer):
    bench.load(primitive(Work, "work", onStart=answer))
    assert bench.run(bench.node("work")).state is State.Success


def test_on_start_may_return_fail(bench):
    bench.load(primitive(Work, "work", onStart=lambda self: self.fail("no battery", 12)))
    task = bench.run(bench.node("work"))
    assert (node_of(task).progress_code, node_of(task).progress_msg) == (-12, "no battery")
    assert task.state is State.Failure


@pytest.mark.parametrize("answer", [False, np.bool_(False), State.Failure])
def test_refusal_of_on_end_fails_skill(bench, answer):
    bench.load(primitive(Work, "work", onEnd=answer))
    task = bench.run(bench.node("work"))
    assert task.state is State.Failure
    assert node_of(task).progress_code < 0
    assert "work: onEnd returned" in node_of(task).progress_msg
    assert "work: onEnd returned" in task.root.progress_msg


def test_on_end_may_return_fail(bench):
    bench.load(primitive(Work, "work", onEnd=lambda self: self.fail("cannot park", 5)))
    task = bench.run(bench.node("work"))
    assert (node_of(task).progress_code, node_of(task).progress_msg) == (-5, "cannot park")
    assert "cannot park" in task.root.progress_msg


@pytest.mark.parametrize("answer", [None, False, np.bool_(False), State.Failure, State.Idle])
def test_preempted_skill_without_progress_has_message_preempted(bench, answer):
    bench.load(primitive(Work, "work", execute=lambda self: self.step("busy"), onPreempt=answer))
    task = bench.task(bench.node("work"))
    task.tick()
    task.preempt()
    task.tick()
    assert (node_of(task).state, node_of(task).progress_code) == (State.Failure, -1)
    assert node_of(task).progress_msg == "Preempted"


# -- parameters and trees that are not the skill's own -----------------------------------------------------------------


def test_skill_accesses_only_its_own_parameters(bench, caplog):
    def reads(self):
        return self.success(self.params["Words"].value)

    def sets(self):
        self.params.specify("Words", "mine")
        return self.success()

    bench.load(primitive(Work, "reads", execute=reads), primitive(Work, "sets", execute=sets))
    for label, state in (("reads", State.Failure), ("sets", State.Success)):
        task = bench.run(bench.node(label), Words="theirs")
        assert task.state is state
        assert "no parameter 'Words'" in (node_of(task).progress_msg if label == "reads" else caplog.text)
        assert task.root.params.getParamValue("Words") == "theirs"


def test_value_of_wrong_type_is_not_pushed(bench):
    def execute(self):
        self.params["Text"].value = 5
        return self.success()

    bench.load(primitive(describe("Put", [("Text", str, OPTIONAL)]), "put", execute=execute))
    task = bench.run(bench.node("put"), Text="words")
    assert task.root.params.getParamValue("Text") == "words"


def test_thread_of_ended_skill_changes_nothing(bench):
    ended, done = threading.Event(), threading.Event()

    def execute(self):
        def late():
            ended.wait(5)
            self.params["Text"].value = "late"
            self.success("late")
            done.set()

        if not ended.is_set():
            threading.Thread(target=late, daemon=True).start()
        return self.success("at once")

    say = describe("Say", [("Text", str, OPTIONAL)])
    bench.load(primitive(say, "say", execute=execute), primitive(Work, "work"))
    first = bench.run(bench.node("say"), Text="words")
    ended.set()
    assert done.wait(5)
    second = bench.run(bench.node("say"), Text="words")
    for task in (first, second):
        assert (node_of(task).state, node_of(task).progress_msg) == (State.Success, "at once")
        assert task.root.params.getParamValue("Text") == "words"


def test_thread_of_preempted_skill_does_not_block_skill(bench):
    """Its instance is not used again: what the thread does later reaches nobody."""
    go_on, started = threading.Event(), threading.Semaphore(0)

    class slow(PrimitiveThreadBase):
        def createDescription(self):
            self.setDescription(describe("Slow", [("Text", str, OPTIONAL)])(), "slow")

        def run(self):
            started.release()
            if not go_on.wait(5):
                return self.fail("nobody came", 1)
            self.params["Text"].value = "from the thread"
            return self.success("done")

    bench.load(slow)
    first, second = bench.task(bench.node("slow")), bench.task(bench.node("slow"), Text="words")
    first.tick()
    assert started.acquire(timeout=5)
    first.preempt()
    assert first.tick() is State.Failure
    assert not bench.library.by_label("slow").busy
    second.tick()
    assert started.acquire(timeout=5)
    second.preempt()
    second.tick()
    go_on.set()
    third = bench.task(bench.node("slow"))
    while third.tick() is State.Running:
        started.acquire(timeout=0.01)
    assert (third.state, node_of(third).progress_msg) == (State.Success, "done")
    assert second.root.params.getParamValue("Text") == "words"


def test_running_child_cannot_be_removed(bench):
    """It would never end: its device would stay locked, its instance in use."""
    bench.load(primitive(Work, "work", execute=lambda self: self.step()), compound())
    task = bench.task(bench.node("unruly"))
    task.tick()
    with pytest.raises(Refused, match="cannot be taken out of the tree while it runs"):
        node_of(task).popChild()


def test_running_subtree_may_grow(bench):
    def execute(self):
        if len(self.expands_into.children) < 4:
            self.addChild(self.skill("Work", "work"))
            return self.step("one more")
        return None

    bench.load(primitive(Work, "work"), compound(execute=execute))
    task = bench.run(bench.node("unruly"))
    assert task.state is State.Success
    assert [child.state for child in node_of(task).children] == [State.Success] * 4


def test_node_has_only_one_parent(bench):
    def expand(self, skill):
        child = self.skill("Work", "work")
        skill(child, child)

    bench.load(primitive(Work, "work"), compound(expand=expand))
    task = bench.run(bench.node("unruly"))
    assert "is a child of skiros:Unruly-unruly(State.Running) already" in node_of(task).progress_msg


def test_compound_that_contains_itself_fails(bench, deep_stack):
    bench.load(compound(expand=lambda self, skill: skill(self.skill("Unruly", "unruly"))))
    task = bench.run(bench.node("unruly"), ticks=3)
    assert task.state is State.Failure
    assert "is below 5000 levels of skills: one of them contains itself" in task.root.progress_msg
    assert runs_on(bench)


@pytest.mark.parametrize("processor", [Sequential, ParallelFf, Selector])
def test_compound_without_children_ends_at_once(bench, processor):
    bench.load(compound(expand=lambda self, skill: skill.setProcessor(processor())))
    assert bench.run(bench.node("unruly"), ticks=1).state is not State.Running
