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
from skiros2_skill.core.engine.failures import Failures
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
def test_failed_skill_has_stage_code_and_message(bench, hooks, stage, code, message):
    bench.load(primitive(Work, "work", **hooks))
    explanation = only(bench.run(bench.node("work")))
    assert (explanation.stage, explanation.code) == (stage, code)
    assert message in explanation.message
    assert (explanation.type, explanation.label) == ("skiros:Work", "work")


@pytest.mark.parametrize(("kind", "stage", "code"), [("pre", PRE, -1), ("hold", HOLD, -2), ("post", POST, -3)])
def test_unsatisfied_condition_has_its_stage(bench, kind, stage, code):
    bench.load(primitive(describe("Move", [CONTAINER, OBJECT], **{kind: [contains()]}), "move"))
    explanation = only(bench.run(bench.node("move", Object=bench.product, Container=bench.other_tray)))
    assert (explanation.stage, explanation.code) == (stage, code)
    assert "[Contains]" in explanation.message


def test_inference_failure_differs_from_a_wrong_parameter(bench):
    bench.load(primitive(Take, "take"))
    gone = bench.wmi.get_element(bench.product.id)
    bench.wmi.remove_element(bench.product)
    bench.wmi.remove_element(bench.other_product)
    assert only(bench.run(bench.node("take"))).stage == INFERENCE
    assert only(bench.run(bench.node("take", Object=gone))).stage == PARAMETER


def test_unknown_skill_is_a_refused_start(bench):
    explanation = only(bench.run(SkillWrapper("Work", "gone", bench.library)))
    assert (explanation.stage, explanation.code, explanation.label) == (START, -404, "gone")


def test_each_rejected_implementation_has_its_reason(bench):
    bench.load(primitive(Take, "take_one"), primitive(Take, "take_two"))
    node = SkillWrapper("Take", "", bench.library)
    node.specifyParamDefault("Object", bench.product)
    node.specifyParamDefault("Container", bench.other_tray)
    explanation = only(bench.run(node))
    assert explanation.stage == START
    assert [(tried.label, tried.stage) for tried in explanation.tried] == [("take_one", PRE), ("take_two", PRE)]
    assert explanation.path == ["Take"]


def test_preempted_task_is_explained(bench):
    bench.load(primitive(Work, "work", execute=running_for(9)))
    task = bench.task(bench.node("work"))
    task.tick()
    task.preempt()
    task.tick()
    assert (only(task).stage, only(task).path) == (PREEMPT, ["task_0"])


# -- place -------------------------------------------------------------------------------------------------------------


def test_explanation_has_path_and_id_of_the_node(bench):
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


def test_provenance_of_a_requested_value_is_given(bench):
    failing(bench)
    task = bench.run(bench.node("failing", Text="hi"))
    assert origin(task) == ("'hi'", GIVEN, [])
    assert origin(task, "Robot") == (repr(bench.robot), GIVEN, [])
    assert "parameter Text = 'hi' (given)" in str(task.explanations()[0])


def test_provenance_of_a_value_in_the_tree_is_specified(bench):
    failing(bench)
    outer = within(bench, lambda self, skill: skill(self.skill("Failing", "", specify={"Text": "fixed"})))
    assert origin(bench.run(bench.node(outer))) == ("'fixed'", SPECIFIED, [])


def test_provenance_is_default_or_unset(bench):
    failing(bench, describe("Failing", [("Text", "hello", REQUIRED), ("Other", str, OPTIONAL)]))
    task = bench.run(bench.node("failing"))
    assert origin(task) == ("'hello'", DEFAULT, [])
    assert origin(task, "Other") == ("", UNSET, [])


def test_provenance_of_a_default_that_a_client_sends_again_is_default(bench):
    failing(bench, describe("Failing", [("Text", "hello", REQUIRED)]))
    for value, provenance in (("hello", DEFAULT), ("hi", GIVEN)):
        assert origin(bench.run(bench.node("failing", Text=value))) == (repr(value), provenance, [])


def test_provenance_of_a_parents_value_names_the_parent(bench):
    failing(bench)
    outer = within(bench, lambda self, skill: skill(self.skill("Failing", "", remap={"Text": "Words"})),
                   [("Words", str, REQUIRED)])  # fmt: skip
    assert origin(bench.run(bench.node(outer, Words="hi"))) == ("'hi'", PULLED, ["outer"])


def test_provenance_of_a_siblings_value_names_the_sibling(bench):
    def produce(self):
        self.params["Text"].value = "made"
        return self.success()

    failing(bench)
    bench.load(primitive(describe("Produce", [TEXT]), "produce", execute=produce))
    assert origin(bench.run(bench.node("produce"), bench.node("failing"))) == ("'made'", PULLED, ["produce"])
    outer = within(bench, lambda self, skill: skill(self.skill("Produce"), self.skill("Failing")))
    assert origin(bench.run(bench.node(outer))) == ("'made'", PULLED, ["produce"])


def test_provenance_of_an_inferred_value_names_the_conditions(bench):
    never = lambda d: d.getPropCond("Heavy", "skiros:Weight", "Object", ">", 1.0, True)  # noqa: E731
    failing(bench, describe("Failing", [CONTAINER, OBJECT], pre=[contains()], post=[never]), execute=State.Success)
    task = bench.run(bench.node("failing", Object=bench.product))
    assert task.explanations()[0].stage == POST
    assert origin(task, "Container") == (repr(bench.tray), INFERRED, ["Contains"])
    assert origin(task, "Object") == (repr(bench.product), GIVEN, [])


def test_provenance_of_a_value_inferred_by_a_compound_names_it(bench):
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


def test_provenance_of_a_changed_value_names_the_skill_or_descendant(bench):
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


def test_refused_start_has_provenance_for_each_implementation(bench):
    bench.load(primitive(Take, "take_one"), primitive(Take, "take_two"))
    node = SkillWrapper("Take", "", bench.library)
    node.specifyParamDefault("Object", bench.product)
    node.specifyParamDefault("Container", bench.other_tray)
    (explanation,) = bench.run(node).explanations()
    for tried in explanation.tried:
        assert {o.key: o.source for o in tried.params} == {"Object": GIVEN, "Container": GIVEN, "Robot": GIVEN}


# -- what a condition says of itself -----------------------------------------------------------------------------------


def test_unsatisfied_condition_is_explained_in_one_line(bench):
    bench.load(primitive(Take, "take"))
    explanation = only(bench.run(bench.node("take", Object=bench.product, Container=bench.other_tray)))
    (finding,) = explanation.findings
    assert (finding.kind, finding.label) == ("ConditionRelation", "Contains")
    assert finding.values == {"Container": repr(bench.other_tray), "Object": repr(bench.product)}
    assert finding.found in explanation.message
    assert "\n" not in explanation.message


def test_inference_failure_has_candidates_of_each_parameter(bench):
    empty = bench.add("skiros:LargeBox", "empty")
    bench.load(primitive(Take, "take"))
    explanation = only(bench.run(bench.node("take", Container=empty)))
    (candidates,) = explanation.candidates
    assert (candidates.key, candidates.total, candidates.emptied) == ("Object", 2, True)
    assert str(candidates) in explanation.message


def test_condition_whose_explanation_raises_is_described(bench):
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


def test_repeated_failure_is_counted(bench):
    bench.load(primitive(Work, "work", execute=lambda s: s.fail("no", 1)))
    assert only(bench.run(Skill("", RetryOnFail(4))(bench.node("work")))).times == 5


def test_different_failures_are_listed_by_their_last_occurrence(bench):
    answers = iter(["a", "b", "a"])
    bench.load(primitive(Work, "work", execute=lambda s: s.fail(next(answers), 1)))
    told = bench.run(Skill("", RetryOnFail(2))(bench.node("work"))).explanations()
    assert [(e.message, e.times) for e in told] == [("b", 1), ("a", 2)]


def test_equal_failures_of_two_nodes_are_listed_separately(bench):
    bench.load(primitive(Work, "work", execute=lambda s: s.fail("no", 1)))
    task = bench.run(Skill("", Selector())(bench.node("work"), bench.node("work")))
    task.progress()
    assert sorted(e.node for e in task.explanations()) == [2, 3]


def test_last_failures_are_kept(bench):
    numbers = iter(range(1000))
    bench.load(primitive(Work, "work", execute=lambda s: s.fail("no" * next(numbers), 1)))
    told = bench.run(Skill("", RetryOnFail(299))(bench.node("work")), ticks=400).explanations()
    assert [len(e.message) for e in told] == [2 * n for n in range(200, 300)]


def test_failures_that_differ_in_numbers_are_counted(bench):
    numbers = iter([1, 2.5, 1e-7, 12])
    bench.load(primitive(Work, "work", execute=lambda s: s.fail(f"{next(numbers)} N are too many", 1)))
    explanation = only(bench.run(Skill("", RetryOnFail(3))(bench.node("work"))))
    assert (explanation.message, explanation.times) == ("12 N are too many", 4)


def test_failure_whose_number_changes_in_each_tick_is_explained_once_until_it_is_read(bench, monkeypatch):
    explained = []
    counted = Failures._findings
    monkeypatch.setattr(Failures, "_findings", lambda self, failure: explained.append(1) or counted(self, failure))
    numbers = iter(range(1000))
    bench.load(primitive(Work, "work", execute=lambda s: s.fail(f"{next(numbers)} N are too many", 1)))
    explanation = only(bench.run(Skill("", RetryOnFail(99))(bench.node("work")), ticks=200))
    assert (explanation.message, explanation.times) == ("99 N are too many", 100)
    assert len(explained) == 2  # the first time, and at the end of the task


def test_condition_on_a_changing_value_is_explained_with_the_last_value(bench):
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


def test_root_names_the_deepest_cause(bench):
    bench.load(primitive(Work, "work", execute=lambda s: s.fail("no grip", 1)))
    task = bench.run(Skill("outer", Serial())(Skill("inner", Serial())(bench.node("work"))))
    assert task.root.progress_msg == "skiros:Work-work(Failure): no grip"


def test_root_names_the_failed_node_instead_of_preempted_ones(bench):
    bench.load(
        primitive(Work, "work", execute=lambda s: s.step("") if s.progress_code < 2 else s.fail("no grip", 1)),
        primitive(describe("Wait"), "wait", execute=running_for(9), onPreempt=raises),
    )
    task = bench.run(Skill("", ParallelFf())(bench.node("work"), bench.node("wait")))
    assert task.root.progress_msg == "skiros:Work-work(Failure): no grip"
    assert [e.stage for e in task.explanations()] == [EXCEPTION, EXECUTE]


def test_root_names_the_hold_condition_instead_of_ended_children(bench):
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
    assert [e.stage for e in task.explanations()] == [EXCEPTION, HOLD]
    assert task.root.progress_msg.startswith("skiros:Hold-hold(Failure): Hold-condition failed: [Contains]")
    assert f"but {bench.tray!r} skiros:contain nothing" in task.root.progress_msg


def test_root_names_the_failure_before_a_late_one(bench):
    tidy = primitive(describe("Tidy"), "tidy", execute=lambda s: s.fail("tidied up", 1))
    tidy.fails_late = True
    bench.load(primitive(Work, "work", execute=lambda s: s.fail("no grip", 1)), tidy)
    task = bench.run(Skill("", Serial())(Skill("", Selector())(bench.node("work"), bench.node("tidy"))))
    assert task.root.progress_msg == "skiros:Work-work(Failure): no grip"
    assert [e.message for e in task.explanations()] == ["tidied up", "no grip"]


def test_exception_in_on_end_does_not_hide_the_failure(bench):
    bench.load(primitive(Work, "work", execute=lambda s: s.fail("no grip", 1), onEnd=raises))
    task = bench.run(bench.node("work"))
    assert [e.stage for e in task.explanations()] == [EXCEPTION, EXECUTE]
    assert task.root.progress_msg == "skiros:Work-work(Failure): no grip"


def test_failures_of_a_succeeded_task_are_listed(bench):
    bench.load(primitive(Work, "work", execute=lambda s: s.fail("no", 1)), primitive(describe("Rest"), "rest"))
    task = bench.run(Skill("", Selector())(bench.node("work"), bench.node("rest")))
    assert task.state is State.Success
    assert only(task).message == "no"
