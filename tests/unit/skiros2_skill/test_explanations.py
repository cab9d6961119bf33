"""Why a node failed, as a task tells it: one explanation for each kind of failure of a node."""

import pytest

from skiros2_common.core.abstract_skill import State
from skiros2_common.core.conditions import ConditionBase
from skiros2_common.core.explanation import (
    CHANGED,
    DEFAULT,
    EXCEPTION,
    EXECUTE,
    GIVEN,
    HOLD,
    INFERENCE,
    INFERRED,
    PARAMETER,
    POST,
    PRE,
    PREEMPT,
    PULLED,
    SPECIFIED,
    START,
    UNSET,
    Explanation,
)
from skiros2_common.core.world_element import Element
from skiros2_skill.core.skill import ParallelFf, RetryOnFail, Selector, Serial, Skill, SkillBase, SkillWrapper
from unit.skiros2_skill.skills import (
    CONTAINER,
    OBJECT,
    OPTIONAL,
    REQUIRED,
    Take,
    Work,
    contains,
    describe,
    primitive,
    running_for,
)


def raises(skill):
    raise RuntimeError("broken")


def only(task):
    """The one explanation of a task."""
    (explanation,) = task.explanations()
    assert Explanation.from_json(explanation.to_json()) == explanation
    return explanation


# -- stages ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("hooks", "stage", "code", "message"),
    [
        ({"execute": lambda s: s.fail("no grip", 7)}, EXECUTE, -7, "no grip"),
        ({"execute": lambda s: s.fail("no grip", 7.0)}, EXECUTE, -7, "no grip"),
        ({"execute": False}, EXECUTE, -405, "work: execute returned False"),
        ({"execute": 5}, EXECUTE, -405, "work: execute returned 5"),
        ({"execute": raises}, EXCEPTION, -405, "RuntimeError: broken"),
        ({"onStart": raises}, EXCEPTION, -404, "RuntimeError: broken"),
        ({"onStart": False}, START, -1, "work: onStart returned False"),
        ({"onEnd": False, "execute": State.Success}, EXECUTE, -3, "work: onEnd returned False"),
    ],
)
def test_a_skill_that_fails_by_itself_tells_stage_code_and_message(bench, hooks, stage, code, message):
    bench.load(primitive(Work, "work", **hooks))
    explanation = only(bench.run(bench.node("work")))
    assert (explanation.stage, explanation.code) == (stage, code)
    assert message in explanation.message
    assert (explanation.type, explanation.label) == ("skiros:Work", "work")


@pytest.mark.parametrize(("kind", "stage", "code"), [("pre", PRE, -1), ("hold", HOLD, -2), ("post", POST, -3)])
def test_a_condition_that_does_not_hold_tells_which_kind_it_is(bench, kind, stage, code):
    bench.load(primitive(describe("Move", [CONTAINER, OBJECT], **{kind: [contains()]}), "move"))
    explanation = only(bench.run(bench.node("move", Object=bench.product, Container=bench.other_tray)))
    assert (explanation.stage, explanation.code) == (stage, code)
    assert "[Contains]" in explanation.message


def test_an_empty_inference_and_a_wrong_parameter_are_told_apart(bench):
    bench.load(primitive(Take, "take"))
    gone = bench.wmi.get_element(bench.product.id)
    bench.wmi.remove_element(bench.product)
    bench.wmi.remove_element(bench.other_product)
    assert only(bench.run(bench.node("take"))).stage == INFERENCE
    assert only(bench.run(bench.node("take", Object=gone))).stage == PARAMETER


def test_a_skill_that_nobody_has_is_a_refused_start(bench):
    explanation = only(bench.run(SkillWrapper("Work", "gone", bench.library)))
    assert (explanation.stage, explanation.code, explanation.label) == (START, -404, "gone")


def test_each_implementation_that_was_tried_tells_why_not(bench):
    bench.load(primitive(Take, "take_one"), primitive(Take, "take_two"))
    node = SkillWrapper("Take", "", bench.library)
    node.specifyParamDefault("Object", bench.product)
    node.specifyParamDefault("Container", bench.other_tray)
    explanation = only(bench.run(node))
    assert explanation.stage == START
    assert [(tried.label, tried.stage) for tried in explanation.tried] == [("take_one", PRE), ("take_two", PRE)]
    assert explanation.path == ["Take"]


def test_a_task_that_was_preempted_says_so(bench):
    bench.load(primitive(Work, "work", execute=running_for(9)))
    task = bench.task(bench.node("work"))
    task.tick()
    task.preempt()
    task.tick()
    assert (only(task).stage, only(task).path) == (PREEMPT, ["task_0"])


# -- place -------------------------------------------------------------------------------------------------------------


def test_the_path_leads_to_the_node_and_the_id_is_that_of_the_progress(bench):
    bench.load(primitive(Work, "work", execute=raises))
    task = bench.run(Skill("outer", Serial())(Skill("", ParallelFf())(bench.node("work"))))
    (shown,) = (node for node in task.progress() if node.label == "work")
    assert only(task).path == ["outer", "|ff|", "work"]
    assert only(task).node == shown.id > 0


# -- where the values came from ----------------------------------------------------------------------------------------


TEXT = ("Text", str, OPTIONAL)
FAILING = describe("Failing", [TEXT])


def failing(bench, description=FAILING, **hooks):
    """A skill that fails."""
    bench.load(primitive(description, "failing", **{"execute": lambda s: s.fail("no", 1), **hooks}))


def within(bench, expand, params=(TEXT,)):
    """A compound with this `expand`."""
    described = describe("Outer", params)

    class outer(SkillBase):
        def createDescription(self):
            self.setDescription(described(), "outer")

        def expand(self, skill):
            expand(self, skill)

    bench.load(outer)
    return "outer"


def origin(task, key="Text"):
    """Where the last failing node's parameter came from."""
    (found,) = (o for o in task.explanations()[-1].params if o.key == key)
    return (found.value, found.source, found.by)


def test_a_value_was_given_by_the_one_who_started_the_task(bench):
    failing(bench)
    task = bench.run(bench.node("failing", Text="hi"))
    assert origin(task) == ("'hi'", GIVEN, [])
    assert origin(task, "Robot") == (repr(bench.robot), GIVEN, [])
    assert "parameter Text = 'hi' (given)" in str(task.explanations()[0])


def test_a_value_was_fixed_in_the_tree(bench):
    failing(bench)
    outer = within(bench, lambda self, skill: skill(self.skill("Failing", "", specify={"Text": "fixed"})))
    assert origin(bench.run(bench.node(outer))) == ("'fixed'", SPECIFIED, [])


def test_a_value_is_the_default_or_missing(bench):
    failing(bench, describe("Failing", [("Text", "hello", REQUIRED), ("Other", str, OPTIONAL)]))
    task = bench.run(bench.node("failing"))
    assert origin(task) == ("'hello'", DEFAULT, [])
    assert origin(task, "Other") == ("", UNSET, [])


def test_a_value_came_from_the_compound_around(bench):
    failing(bench)
    outer = within(bench, lambda self, skill: skill(self.skill("Failing", "", remap={"Text": "Words"})),
                   [("Words", str, REQUIRED)])  # fmt: skip
    assert origin(bench.run(bench.node(outer, Words="hi"))) == ("'hi'", PULLED, ["outer"])


def test_a_value_came_from_a_sibling(bench):
    def produce(self):
        self.params["Text"].value = "made"
        return self.success()

    failing(bench)
    bench.load(primitive(describe("Produce", [TEXT]), "produce", execute=produce))
    assert origin(bench.run(bench.node("produce"), bench.node("failing"))) == ("'made'", PULLED, ["produce"])
    outer = within(bench, lambda self, skill: skill(self.skill("Produce"), self.skill("Failing")))
    assert origin(bench.run(bench.node(outer))) == ("'made'", PULLED, ["produce"])


def test_a_value_was_inferred_by_the_conditions_that_speak_of_it(bench):
    never = lambda d: d.getPropCond("Heavy", "skiros:Weight", "Object", ">", 1.0, True)  # noqa: E731
    failing(bench, describe("Failing", [CONTAINER, OBJECT], pre=[contains()], post=[never]), execute=State.Success)
    task = bench.run(bench.node("failing", Object=bench.product))
    assert task.explanations()[0].stage == POST
    assert origin(task, "Container") == (repr(bench.tray), INFERRED, ["Contains"])
    assert origin(task, "Object") == (repr(bench.product), GIVEN, [])


def test_what_a_compound_inferred_reaches_its_children_with_its_name(bench):
    failing(bench, describe("Failing", [("Container", Element("skiros:Container"), OPTIONAL)]))
    described = describe("Fetch", [CONTAINER, OBJECT], pre=[contains()])

    class fetch(SkillBase):
        def createDescription(self):
            self.setDescription(described(), "fetch")

        def expand(self, skill):
            skill(self.skill("Failing"))

    bench.load(fetch)
    task = bench.run(bench.node("fetch", Object=bench.product))
    assert origin(task, "Container") == (repr(bench.tray), PULLED, ["fetch"])


def test_a_value_was_changed_by_the_skill_s_own_code_or_by_a_node_below(bench):
    def change(self):
        self.params["Text"].value = "mine"
        return self.fail("no", 1)

    failing(bench, execute=change)
    assert origin(bench.run(bench.node("failing", Text="hi"))) == ("'mine'", CHANGED, [])
    never = lambda d: d.getPropCond("Heavy", "skiros:Weight", "Robot", ">", 1.0, True)  # noqa: E731
    described = describe("Outer", [TEXT], post=[never])

    class outer(SkillBase):
        def createDescription(self):
            self.setDescription(described(), "outer")

        def expand(self, skill):
            skill(self.skill("Produce"))

    def produce(self):
        self.params["Text"].value = "made"
        return self.success()

    bench.load(outer, primitive(describe("Produce", [TEXT]), "produce", execute=produce))
    assert origin(bench.run(bench.node("outer"))) == ("'made'", CHANGED, ["produce"])


def test_a_refused_start_tells_where_the_values_came_from_for_each_implementation(bench):
    bench.load(primitive(Take, "take_one"), primitive(Take, "take_two"))
    node = SkillWrapper("Take", "", bench.library)
    node.specifyParamDefault("Object", bench.product)
    node.specifyParamDefault("Container", bench.other_tray)
    (explanation,) = bench.run(node).explanations()
    for tried in explanation.tried:
        assert {o.key: o.source for o in tried.params} == {"Object": GIVEN, "Container": GIVEN, "Robot": GIVEN}


# -- what a condition says of itself -----------------------------------------------------------------------------------


def test_a_failed_condition_is_explained_and_told_in_one_line(bench):
    bench.load(primitive(Take, "take"))
    explanation = only(bench.run(bench.node("take", Object=bench.product, Container=bench.other_tray)))
    (finding,) = explanation.findings
    assert (finding.kind, finding.label) == ("ConditionRelation", "Contains")
    assert finding.values == {"Container": repr(bench.other_tray), "Object": repr(bench.product)}
    assert finding.found in explanation.message
    assert "\n" not in explanation.message


def test_an_empty_inference_has_the_candidates_of_each_parameter(bench):
    empty = bench.add("skiros:LargeBox", "empty")
    bench.load(primitive(Take, "take"))
    explanation = only(bench.run(bench.node("take", Container=empty)))
    (candidates,) = explanation.candidates
    assert (candidates.key, candidates.total, candidates.emptied) == ("Object", 2, True)
    assert str(candidates) in explanation.message


def test_a_condition_whose_explanation_raises_is_told_by_its_description(bench):
    class Broken(ConditionBase):
        def holds(self, ph, wmi):
            return False

        def fact(self):
            return "it is so"

        def _near_matches(self, ph, wmi):
            raise RuntimeError("broken")

    bench.load(primitive(describe("Odd", pre=[lambda d: Broken("Broken", "Robot", True)]), "odd"))
    explanation = only(bench.run(bench.node("odd")))
    assert explanation.message == "Pre-condition failed: [Broken] it is so"
    assert [f.expected for f in explanation.findings] == ["[Broken] it is so"]


# -- memory ------------------------------------------------------------------------------------------------------------


def test_a_node_that_fails_so_again_is_counted(bench):
    bench.load(primitive(Work, "work", execute=lambda s: s.fail("no", 1)))
    assert only(bench.run(Skill("", RetryOnFail(4))(bench.node("work")))).times == 5


def test_a_node_that_fails_otherwise_is_told_anew_in_the_order_of_the_last_failures(bench):
    answers = iter(["a", "b", "a"])
    bench.load(primitive(Work, "work", execute=lambda s: s.fail(next(answers), 1)))
    told = bench.run(Skill("", RetryOnFail(2))(bench.node("work"))).explanations()
    assert [(e.message, e.times) for e in told] == [("b", 1), ("a", 2)]


def test_two_nodes_that_fail_alike_are_told_apart(bench):
    bench.load(primitive(Work, "work", execute=lambda s: s.fail("no", 1)))
    task = bench.run(Skill("", Selector())(bench.node("work"), bench.node("work")))
    task.progress()
    assert sorted(e.node for e in task.explanations()) == [2, 3]


def test_only_the_last_failures_are_kept(bench):
    numbers = iter(range(1000))
    bench.load(primitive(Work, "work", execute=lambda s: s.fail("no" * next(numbers), 1)))
    told = bench.run(Skill("", RetryOnFail(299))(bench.node("work")), ticks=400).explanations()
    assert [len(e.message) for e in told] == [2 * n for n in range(200, 300)]


def test_failures_that_are_other_in_numbers_alone_are_counted_and_the_last_is_told(bench):
    numbers = iter([1, 2.5, 1e-7, 12])
    bench.load(primitive(Work, "work", execute=lambda s: s.fail(f"{next(numbers)} N are too many", 1)))
    explanation = only(bench.run(Skill("", RetryOnFail(3))(bench.node("work"))))
    assert (explanation.message, explanation.times) == ("12 N are too many", 4)


def test_a_condition_on_a_value_that_changes_is_told_with_the_last_value(bench):
    def drain(skill):
        element = bench.wmi.get_element(bench.product.id)
        element.setProperty("skiros:Weight", next(values))
        bench.wmi.update_element_properties(element)
        return skill.success()

    values = iter([4.5, 3.0, 2.25])
    heavy = lambda d: d.getPropCond("Heavy", "skiros:Weight", "Object", ">", 9.0, True)  # noqa: E731
    bench.load(
        primitive(describe("Drain"), "drain", execute=drain), primitive(describe("Lift", [OBJECT], pre=[heavy]), "lift")
    )
    lift = bench.node("lift", Object=bench.product)
    explanation = only(bench.run(Skill("", RetryOnFail(2))(bench.node("drain"), lift)))
    assert explanation.times == 3
    assert explanation.findings[0].found == f"{bench.product!r}: skiros:Weight is 2.25"
    assert explanation.message == lift.progress_msg


# -- the task's verdict ------------------------------------------------------------------------------------------------


def test_the_root_points_at_the_deepest_cause(bench):
    bench.load(primitive(Work, "work", execute=lambda s: s.fail("no grip", 1)))
    task = bench.run(Skill("outer", Serial())(Skill("inner", Serial())(bench.node("work"))))
    assert task.root.progress_msg == "skiros:Work-work(Failure): no grip"


def test_the_root_points_at_what_failed_not_at_what_was_preempted_then(bench):
    bench.load(
        primitive(Work, "work", execute=lambda s: s.step("") if s.progress_code < 2 else s.fail("no grip", 1)),
        primitive(describe("Wait"), "wait", execute=running_for(9), onPreempt=raises),
    )
    task = bench.run(Skill("", ParallelFf())(bench.node("work"), bench.node("wait")))
    assert task.root.progress_msg == "skiros:Work-work(Failure): no grip"
    assert [e.stage for e in task.explanations()] == [EXECUTE, EXCEPTION]


def test_the_root_points_at_a_hold_condition_not_at_the_children_that_it_ended(bench):
    held = describe("Hold", [CONTAINER, OBJECT], hold=[contains()])

    class hold(SkillBase):
        def createDescription(self):
            self.setDescription(held(), "hold")

        def expand(self, skill):
            skill(self.skill("Work"))

    bench.load(hold, primitive(Work, "work", execute=running_for(9), onPreempt=raises))
    task = bench.task(bench.node("hold", Object=bench.product, Container=bench.tray))
    task.tick()
    bench.wmi.set_relation(bench.tray.id, "skiros:contain", bench.product.id, False)
    task.tick()
    assert [e.stage for e in task.explanations()] == [HOLD, EXCEPTION]
    assert task.root.progress_msg.startswith("skiros:Hold-hold(Failure): Hold-condition failed: [Contains]")
    assert f"but {bench.tray!r} skiros:contain nothing" in task.root.progress_msg


def test_an_end_that_raises_after_a_failure_does_not_hide_the_failure(bench):
    bench.load(primitive(Work, "work", execute=lambda s: s.fail("no grip", 1), onEnd=raises))
    task = bench.run(bench.node("work"))
    assert [e.stage for e in task.explanations()] == [EXECUTE, EXCEPTION]
    assert task.root.progress_msg == "skiros:Work-work(Failure): no grip"


def test_what_failed_on_the_way_to_a_success_is_told_too(bench):
    bench.load(primitive(Work, "work", execute=lambda s: s.fail("no", 1)), primitive(describe("Rest"), "rest"))
    task = bench.run(Skill("", Selector())(bench.node("work"), bench.node("rest")))
    assert task.state is State.Success
    assert only(task).message == "no"
