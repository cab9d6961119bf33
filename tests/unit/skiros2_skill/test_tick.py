"""One tick of a node: start, hold-conditions, execute, end. Contract, section 5."""

import pytest

from skiros2_common.core.abstract_skill import State
from skiros2_common.core.world_element import Element
from skiros2_skill.core.skill import (
    ParallelFf,
    ParallelFs,
    Selector,
    Skill,
    SkillBase,
    SkillPreempted,
    SkillWrapper,
)
from unit.skiros2_skill.skills import (
    LOCKED_ARM,
    OBJECT,
    OPTIONAL,
    REQUIRED,
    Note,
    Speak,
    Take,
    Work,
    contains,
    describe,
    primitive,
    running_for,
)


def message(task, index=0):
    return task.root.children[index].progress_msg


def code(task, index=0):
    return task.root.children[index].progress_code


# -- states and progress -----------------------------------------------------------------------------------------------


def test_execute_is_called_in_the_tick_of_the_start(bench):
    bench.load(primitive(Work, "work"))
    task = bench.task(bench.node("work"))
    assert task.tick() is State.Success
    assert message(task) == "done"


def test_progress_code_is_incremented_and_negative_after_a_failure(bench):
    def execute(self):
        return self.step("on it") if self.progress_code < 3 else self.fail("broken", 7)

    bench.load(primitive(Work, "work", execute=execute))
    task = bench.task(bench.node("work"))
    codes = []
    while task.tick() is State.Running:
        codes.append(code(task))
    assert codes == [1, 2, 3]
    assert (code(task), message(task)) == (-7, "broken")


def test_root_has_the_state_of_an_ended_task(bench):
    bench.load(primitive(Work, "work"), primitive(Work, "fails", execute=lambda self: self.fail("no", 3)))
    assert bench.run(bench.node("work")).root.progress_code == 1
    failed = bench.run(bench.node("fails"))
    assert failed.root.progress_code == -1
    assert "no" in failed.root.progress_msg


def test_skills_of_a_task_run_in_sequence(bench):
    order = []
    bench.load(
        primitive(Work, "first", execute=lambda self: order.append(1) or self.success()),
        primitive(Work, "second", execute=lambda self: order.append(2) or self.success()),
    )
    bench.run(bench.node("first"), bench.node("second"))
    assert order == [1, 2]


# -- hooks -------------------------------------------------------------------------------------------------------------


def test_hooks_are_called_in_order(bench):
    calls = []

    def hook(name, answer=None):
        return lambda self: calls.append(name) or (self.success() if answer is None else answer)

    bench.load(primitive(Work, "work", onStart=hook("start", True), execute=hook("execute"), onEnd=hook("end", True)))
    bench.run(bench.node("work"))
    assert calls == ["start", "execute", "end"]


def test_on_start_false_fails_with_its_reason(bench):
    calls = []
    bench.load(primitive(Work, "work", onStart=lambda self: self.startError("no battery", 12), execute=calls.append))
    task = bench.run(bench.node("work"))
    assert task.state is State.Failure
    assert (code(task), message(task)) == (-12, "no battery")
    assert calls == []


def test_on_end_false_fails_a_successful_skill(bench):
    bench.load(primitive(Work, "work", onEnd=False))
    assert bench.run(bench.node("work")).state is State.Failure


@pytest.mark.parametrize(("hook", "expected"), [("onStart", -404), ("execute", -405), ("onEnd", -405)])
def test_exception_of_a_hook_is_the_failure_message(bench, hook, expected):
    def raises(self):
        raise RuntimeError("out of coffee")

    bench.load(primitive(Work, "work", **{hook: raises}))
    task = bench.run(bench.node("work"))
    assert task.state is State.Failure
    assert code(task) == expected
    assert "out of coffee" in message(task)
    assert "Traceback" in message(task)


@pytest.mark.parametrize("hook", ["onStart", "execute"])
def test_on_end_runs_after_an_exception(bench, hook):
    ended = []

    def raises(self):
        raise RuntimeError("out of coffee")

    bench.load(primitive(Work, "work", onEnd=lambda self: ended.append(1), **{hook: raises}))
    bench.run(bench.node("work"))
    assert ended == [1]


def test_next_task_runs_after_an_exception(bench):
    def raises(self):
        raise RuntimeError("out of coffee")

    bench.load(primitive(Work, "bad", execute=raises), primitive(Work, "good"))
    bench.run(bench.node("bad"))
    assert bench.run(bench.node("good")).state is State.Success


@pytest.mark.parametrize(("answer", "state"), [(None, State.Failure), (7, State.Failure), (True, State.Success)])
def test_execute_without_a_state_fails(bench, answer, state):
    bench.load(primitive(Work, "work", execute=answer))
    task = bench.run(bench.node("work"))
    assert task.state is state
    if state is State.Failure:
        assert f"execute returned {answer!r}" in message(task)


def test_skill_preempted_exception_has_no_traceback(bench):
    def execute(self):
        raise SkillPreempted("enough")

    bench.load(primitive(Work, "work", execute=execute))
    assert message(bench.run(bench.node("work"))) == "enough"


@pytest.mark.parametrize(
    ("how", "called"),
    [
        ("success", ["onEnd"]),
        ("failure", ["onEnd"]),
        ("raised", ["onEnd"]),
        ("hold", ["onPreempt", "onEnd"]),
        ("post", ["onEnd"]),
        ("preempted", ["onPreempt", "onEnd"]),
        ("sibling", ["onPreempt", "onEnd"]),
        ("refused", []),  # it has not begun
        ("start raised", ["onEnd"]),
    ],
)
def test_on_end_is_called_once(bench, how, called):
    calls = []
    execute = {
        "success": lambda self: self.success(),
        "post": lambda self: self.success(),
        "failure": lambda self: self.fail("no", 1),
        "raised": lambda self: 1 / 0,
    }.get(how, lambda self: self.step())
    hooks = {"onPreempt": lambda self: calls.append("onPreempt"), "onEnd": lambda self: calls.append("onEnd")}
    if how in ("refused", "start raised"):
        hooks["onStart"] = lambda self: self.startError("no", 1) if how == "refused" else 1 / 0
    conditions = {"hold": [contains()]} if how == "hold" else {"post": [contains(state=False)]} if how == "post" else {}
    kept = describe("Kept", [OBJECT, ("Container", Element("skiros:Container"), REQUIRED)], **conditions)
    bench.load(primitive(kept, "kept", execute=execute, **hooks), primitive(Work, "work", execute=running_for(2)))
    node = bench.node("kept", Object=bench.product, Container=bench.tray)
    task = bench.task(Skill("", ParallelFs())(node, bench.node("work")) if how == "sibling" else node)
    task.tick()
    if how == "hold":
        bench.wmi.set_relation(bench.tray.id, "skiros:contain", bench.product.id, False)
    if how == "preempted":
        task.preempt()
    task.tick(2)
    assert node.state is (State.Success if how == "success" else State.Failure)
    assert calls == called


# -- conditions --------------------------------------------------------------------------------------------------------


def test_unsatisfied_pre_condition_names_the_elements(bench):
    bench.load(primitive(Take, "take"))
    task = bench.run(bench.node("take", Container=bench.other_tray, Object=bench.product))
    assert task.state is State.Failure
    assert code(task) == -1
    for part in ("Pre-condition failed", bench.other_tray.id, "skiros:contain", bench.product.id):
        assert part in message(task)


def test_unsatisfied_hold_condition_preempts_and_fails(bench):
    calls = []
    watched = describe("Watched", [OBJECT, ("Container", Element("skiros:Container"), REQUIRED)], hold=[contains()])
    bench.load(
        primitive(
            watched,
            "watched",
            execute=lambda self: self.step(),
            onPreempt=lambda self: calls.append("preempt"),
            onEnd=lambda self: calls.append("end"),
        )
    )
    task = bench.task(bench.node("watched", Object=bench.product, Container=bench.tray))
    assert task.tick() is State.Running
    assert task.tick() is State.Running
    bench.wmi.set_relation(bench.tray.id, "skiros:contain", bench.product.id, False)
    assert task.tick() is State.Failure
    assert calls == ["preempt", "end"]
    assert code(task) == -2
    assert bench.product.id in message(task)


def test_children_are_not_ticked_after_a_failed_hold_condition(bench):
    ticks = []

    class Guarded(SkillBase):
        def createDescription(self):
            params = [OBJECT, ("Container", Element("skiros:Container"), REQUIRED)]
            guarded = describe("Guarded", params, hold=[contains()])
            self.setDescription(guarded(), "guarded")

        def expand(self, skill):
            skill(self.skill("Work", "work"))

    bench.load(primitive(Work, "work", execute=lambda self: ticks.append(1) or self.step()), Guarded)
    task = bench.task(bench.node("guarded", Object=bench.product, Container=bench.tray))
    task.tick()
    bench.wmi.set_relation(bench.tray.id, "skiros:contain", bench.product.id, False)
    assert task.tick() is State.Failure
    assert len(ticks) == 1
    assert task.root.children[0].children[0].state is State.Failure


def test_unsatisfied_post_condition_fails_a_successful_skill(bench):
    gone = describe(
        "Gone", [OBJECT, ("Container", Element("skiros:Container"), REQUIRED)], post=[contains(state=False)]
    )
    bench.load(primitive(gone, "gone"))
    task = bench.run(bench.node("gone", Object=bench.product, Container=bench.tray))
    assert task.state is State.Failure
    assert "Post-condition failed" in message(task)


def test_pre_conditions_of_the_node_are_checked(bench):
    class Guarded(SkillBase):
        def createDescription(self):
            self.setDescription(describe("Guarded", [OBJECT])(), "guarded")

        def expand(self, skill):
            condition = self.getPropCond("Heavy", "skiros:Weight", "Thing", ">", 2.0, True)
            skill(self.skill("Hold", "hold", remap={"Object": "Thing"}, preconditions=[condition]))

    bench.load(primitive(describe("Hold", [OBJECT]), "hold"), Guarded)
    task = bench.run(bench.node("guarded", Object=bench.product), Thing=bench.product)
    assert task.state is State.Failure
    assert "skiros:Weight > 2.0" in task.root.children[0].children[0].progress_msg


# -- choosing an implementation ----------------------------------------------------------------------------------------


def test_empty_label_selects_the_first_matching_implementation(bench):
    heavy = lambda self: self.addPreCondition(self.getPropCond("Heavy", "skiros:Weight", "Object", ">", 2.0, True))  # noqa: E731
    lifted = describe("Lift", [OBJECT])

    def create(label, more=None):
        def createDescription(self):
            self.setDescription(lifted(), label)
            if more:
                more(self)

        return createDescription

    lift_heavy = type("lift_heavy", (primitive(lifted, "a"),), {"createDescription": create("lift_heavy", heavy)})
    lift_light = type("lift_light", (primitive(lifted, "b"),), {"createDescription": create("lift_light")})
    bench.load(lift_heavy, lift_light)

    def chosen(product):
        node = SkillWrapper("Lift", "", bench.library)
        node.specifyParamDefault("Object", product)
        assert bench.run(node).state is State.Success
        return node.label

    assert chosen(bench.product) == "lift_light"
    assert chosen(bench.add("skiros:Product", "anvil", Weight=50.0)) == "lift_heavy"


def test_each_rejected_implementation_states_its_reason(bench):
    bench.load(primitive(Take, "take_left"), primitive(Take, "take_right"))
    node = SkillWrapper("Take", "", bench.library)
    node.specifyParamDefault("Object", bench.product)
    node.specifyParamDefault("Container", bench.other_tray)
    bench.run(node)
    assert "take_left: Pre-condition failed" in node.progress_msg
    assert "take_right: Pre-condition failed" in node.progress_msg


def test_unknown_type_or_label_fails_with_its_name(bench):
    bench.load(primitive(Take, "take"))
    unknown = SkillWrapper("Tke", "", bench.library)
    assert bench.run(unknown).state is State.Failure
    assert "no skill of type skiros:Tke; near: skiros:Take" in unknown.progress_msg
    unlabelled = SkillWrapper("Take", "takes", bench.library)
    bench.run(unlabelled)
    assert "skiros:Take has no implementation 'takes'; it has: 'take'" in unlabelled.progress_msg


def test_one_skill_runs_several_times_in_parallel(bench):
    bench.load(primitive(Work, "work", execute=running_for(3)))
    both = Skill("", ParallelFf())(bench.node("work"), bench.node("work"))
    task = bench.run(both)
    assert task.state is State.Success
    assert both.children[0].progress_code == both.children[1].progress_code == 3


# -- elements ----------------------------------------------------------------------------------------------------------


def test_assigned_element_is_written(bench):
    def execute(self):
        product = self.params["Object"].value
        product.setProperty("skiros:Weight", 4.0)
        self.params["Object"].value = product
        return self.success()

    bench.load(primitive(describe("Weigh", [OBJECT]), "weigh", execute=execute))
    bench.run(bench.node("weigh", Object=bench.product))
    assert bench.wmi.get_element(bench.product.id).getProperty("skiros:Weight").value == 4.0


def test_only_changed_properties_are_written(bench):
    def execute(self):
        # somebody else changes another property meanwhile
        other = self.wmi.get_element(self.params["Object"].value.id)
        other.setProperty("skiros:CadModel", "theirs")
        self.wmi.update_element(other)
        product = self.params["Object"].value
        product.setProperty("skiros:Weight", 4.0)
        self.params["Object"].value = product
        return self.success()

    bench.load(primitive(describe("Weigh", [OBJECT]), "weigh", execute=execute))
    bench.run(bench.node("weigh", Object=bench.product))
    after = bench.wmi.get_element(bench.product.id)
    assert after.getProperty("skiros:Weight").value == 4.0
    assert after.getProperty("skiros:CadModel").value == "theirs"


def test_assigned_abstract_element_is_not_added(bench):
    def execute(self):
        found = self.params["Found"].value
        found.setProperty("skiros:Weight", 1.0)
        self.params["Found"].value = found
        return self.success()

    look = describe("Look", [("Found", Element("skiros:Starter"), OPTIONAL)])
    bench.load(primitive(look, "look", execute=execute))
    assert bench.run(bench.node("look")).state is State.Success
    assert not bench.wmi.resolve_elements(Element("skiros:Starter"))


def test_elements_are_refreshed_before_execute(bench):
    seen = []

    def execute(self):
        seen.append(self.params["Object"].value.value_of("skiros:Weight"))
        return self.step() if len(seen) < 3 else self.success()

    bench.load(primitive(describe("Watch", [OBJECT]), "watch", execute=execute))
    task = bench.task(bench.node("watch", Object=bench.product))
    task.tick()
    changed = bench.wmi.get_element(bench.product.id)
    changed.setProperty("skiros:Weight", 9.0)
    bench.wmi.update_element(changed)
    task.tick()
    assert seen == [None, 9.0]


def test_removal_of_an_element_fails_the_running_skill(bench):
    seen = []

    def execute(self):
        seen.append(self.params["Object"].value.id)
        return self.step()

    bench.load(primitive(describe("Watch", [OBJECT]), "watch", execute=execute))
    node = bench.node("watch", Object=bench.product)
    task = bench.task(node)
    task.tick()
    eid = bench.product.id
    bench.wmi.remove_element(eid)
    assert task.tick() is State.Failure
    assert seen == [eid]
    assert f"element {eid} was removed by test at " in node.progress_msg
    assert node.progress_msg.endswith("while watch was running with it")


def test_given_element_that_does_not_exist_is_refused(bench):
    bench.load(primitive(describe("Watch", [OBJECT]), "watch"))
    ghost = Element("skiros:Product", "ghost", "skiros:Product-9999")
    task = bench.run(bench.node("watch", Object=ghost))
    assert task.state is State.Failure
    assert "skiros:Product-9999-ghost, which is not in the scene" in message(task)


# -- locks -------------------------------------------------------------------------------------------------------------


@pytest.fixture
def arm(bench):
    return bench.add("rparts:ArmDevice", "arm", StateProperty="Idle")


def device_state(bench, arm):
    return bench.wmi.get_element(arm.id).getProperty("skiros:StateProperty").value


def test_locked_device_is_busy_while_the_skill_runs(bench, arm):
    bench.load(primitive(describe("Move", [LOCKED_ARM]), "move", execute=running_for(3)))
    task = bench.task(bench.node("move"))
    task.tick()
    assert device_state(bench, arm) != "Idle"
    while task.tick() is State.Running:
        pass
    assert task.state is State.Success
    assert device_state(bench, arm) == "Idle"


def test_second_skill_cannot_lock_a_locked_device(bench, arm):
    bench.load(primitive(describe("Move", [LOCKED_ARM]), "move", execute=running_for(3)))
    first, second = bench.node("move"), bench.node("move")
    bench.run(Skill("", ParallelFs())(first, second))
    assert "skiros:StateProperty = 'Idle'" in second.progress_msg


@pytest.mark.parametrize("how", ["exception", "failure", "preempt", "start"])
def test_device_is_released_at_any_end(bench, arm, how):
    def raises(self):
        raise RuntimeError("!")

    endings = {
        "exception": {"execute": raises},
        "failure": {"execute": lambda self: self.fail("no", 1)},
        "preempt": {"execute": lambda self: self.step()},
        "start": {"onStart": False},
    }
    bench.load(primitive(describe("Move", [LOCKED_ARM]), "move", **endings[how]))
    task = bench.task(bench.node("move"))
    task.tick()
    task.preempt()
    task.tick()
    assert task.state is State.Failure
    assert device_state(bench, arm) == "Idle"


# -- preemption --------------------------------------------------------------------------------------------------------


class Outer(SkillBase):
    def createDescription(self):
        self.setDescription(describe("Outer")(), "outer")

    def expand(self, skill):
        skill.setProcessor(ParallelFf())
        skill(self.skill("Work", "work"), self.skill("Work", "work"))

    def onPreempt(self):
        self.wmi.calls.append("outer")

    def onEnd(self):
        self.wmi.calls.append("outer end")


def test_preemption_starts_at_the_leaves_and_calls_on_end(bench):
    bench.wmi.calls = calls = []
    bench.load(
        primitive(
            Work,
            "work",
            execute=lambda self: self.step(),
            onPreempt=lambda self: calls.append("work"),
            onEnd=lambda self: calls.append("work end"),
        ),
        Outer,
    )
    task = bench.task(bench.node("outer"))
    task.tick()
    task.preempt()
    assert task.tick() is State.Failure
    assert calls == ["work", "work end", "work", "work end", "outer", "outer end"]
    assert task.root.progress_msg == "Preempted"


def test_running_on_preempt_is_continued(bench):
    def execute(self):
        self.count = getattr(self, "count", 0) + 1
        return self.step("braking") if self.count < 4 else self.fail("stopped", 1)

    ended = []
    bench.load(primitive(Work, "work", execute=execute, onPreempt=State.Running, onEnd=lambda self: ended.append(1)))
    task = bench.task(bench.node("work"))
    task.tick()
    task.preempt()
    assert task.tick() is State.Running
    assert ended == []
    while task.tick() is State.Running:
        pass
    assert task.ended.is_set()
    assert ended == [1]
    assert message(task) == "stopped"


@pytest.mark.parametrize(
    ("answer", "state"), [(True, State.Success), (False, State.Failure), (State.Success, State.Success)]
)
def test_on_preempt_returns_a_state_or_a_bool(bench, answer, state):
    bench.load(primitive(Work, "work", execute=lambda self: self.step(), onPreempt=answer))
    task = bench.task(bench.node("work"))
    task.tick()
    task.preempt()
    task.tick()
    assert task.root.children[0].state is state
    assert task.state is State.Failure


def test_exception_in_on_preempt_is_reported_and_the_task_ends(bench):
    def raises(self):
        raise RuntimeError("stuck")

    bench.load(primitive(Work, "work", execute=lambda self: self.step(), onPreempt=raises))
    task = bench.task(bench.node("work"))
    task.tick()
    task.preempt()
    assert task.tick() is State.Failure
    assert code(task) == -406
    assert "stuck" in message(task)


def test_selector_returns_to_an_earlier_child_and_preempts_the_running_one(bench):
    watched = describe("Guard", [OBJECT, ("Container", Element("skiros:Container"), REQUIRED)], pre=[contains()])
    bench.load(
        primitive(watched, "guard", execute=lambda self: self.step()),
        primitive(Work, "work", execute=lambda self: self.step()),
    )
    guard = bench.node("guard", Object=bench.product, Container=bench.other_tray)
    work = bench.node("work")
    task = bench.task(Skill("", Selector())(guard, work))
    task.tick()
    assert (guard.state, work.state) == (State.Failure, State.Running)
    bench.wmi.set_relation(bench.other_tray.id, "skiros:contain", bench.product.id, True)
    task.tick()
    assert (guard.state, work.state) == (State.Running, State.Failure)


# -- trees -------------------------------------------------------------------------------------------------------------


def test_tree_of_a_thousand_levels_is_ticked(bench, deep_stack):
    bench.load(primitive(Work, "work", execute=running_for(2)))
    top = node = Skill("top")
    for _ in range(1000):
        below = Skill("")
        node(below)
        node = below
    node(bench.node("work"))
    assert bench.run(top).state is State.Success


def test_ten_thousand_children_are_ticked_and_numbered(bench):
    bench.load(primitive(Work, "work"))
    task = bench.run(Skill("", ParallelFf())(*(bench.node("work") for _ in range(10_000))))
    assert task.state is State.Success
    ids = [p.id for p in task.progress()]
    assert len(set(ids)) == len(ids) == 10_002
    assert ids[0] == task.id


def test_progress_of_a_task_has_only_its_nodes(bench):
    bench.load(primitive(Speak, "speak", execute=running_for(2)), primitive(Note, "note"))
    one = bench.task(bench.node("speak"))
    other = bench.task(bench.node("note", Text="x"))
    one.tick()
    other.tick()
    assert [p.label for p in one.progress()] == ["task_0", "speak"]
    assert [p.label for p in other.progress()] == ["task_0", "note"]
    assert one.progress()[1].parent_id == one.id
