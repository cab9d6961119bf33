"""Why a node failed, as a task tells it: one explanation for each kind of failure of a node."""

import pytest

from skiros2_common.core.abstract_skill import State
from skiros2_common.core.explanation import (
    EXCEPTION,
    EXECUTE,
    HOLD,
    INFERENCE,
    PARAMETER,
    POST,
    PRE,
    PREEMPT,
    START,
    Explanation,
)
from skiros2_skill.core.skill import ParallelFf, RetryOnFail, Selector, Serial, Skill, SkillWrapper
from unit.skiros2_skill.skills import CONTAINER, OBJECT, Take, Work, contains, describe, primitive, running_for


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
    bench.wmi.remove_element(bench.product)
    bench.wmi.remove_element(bench.other_product)
    assert only(bench.run(bench.node("take"))).stage == INFERENCE
    assert only(bench.run(bench.node("take", Object=bench.tray))).stage == PARAMETER
    assert only(bench.run(bench.node("take", Spam=1))).stage == PARAMETER


def test_a_skill_that_nobody_has_is_a_refused_start(bench):
    explanation = only(bench.run(SkillWrapper("Work", "gone", bench.library)))
    assert (explanation.stage, explanation.code, explanation.label) == (START, -404, "gone")


def test_each_implementation_that_was_tried_tells_why_not(bench):
    bench.load(primitive(Take, "take_one"), primitive(Take, "take_two"))
    node = SkillWrapper("Take", "", bench.library)
    node.specifyParam("Object", bench.product)
    node.specifyParam("Container", bench.other_tray)
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
    assert (only(task).stage, only(task).path) == (PREEMPT, ["root"])


# -- place -------------------------------------------------------------------------------------------------------------


def test_the_path_leads_to_the_node_and_the_id_is_that_of_the_progress(bench):
    bench.load(primitive(Work, "work", execute=raises))
    task = bench.run(Skill("outer", Serial())(Skill("", ParallelFf())(bench.node("work"))))
    (shown,) = (node for node in task.progress() if node.label == "work")
    assert only(task).path == ["outer", "|ff|", "work"]
    assert only(task).node == shown.id > 0


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
    bench.load(primitive(Work, "work", execute=lambda s: s.fail(f"no {next(numbers)}", 1)))
    told = bench.run(Skill("", RetryOnFail(299))(bench.node("work")), ticks=400).explanations()
    assert [e.message for e in told] == [f"no {n}" for n in range(200, 300)]


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


def test_what_failed_on_the_way_to_a_success_is_told_too(bench):
    bench.load(primitive(Work, "work", execute=lambda s: s.fail("no", 1)), primitive(describe("Rest"), "rest"))
    task = bench.run(Skill("", Selector())(bench.node("work"), bench.node("rest")))
    assert task.state is State.Success
    assert only(task).message == "no"
