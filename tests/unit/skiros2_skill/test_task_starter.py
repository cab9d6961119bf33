"""From the skills in a message to a task; what of a task travels."""

import io
import json

import pytest

from skiros2_common.core.abstract_skill import State
from skiros2_common.core.errors import UnknownName
from skiros2_common.core.explanation import INFERENCE, PARAMETER, PRE
from skiros2_common.core.params import Param, ParamTypes
from skiros2_common.core.task_context import current_task
from skiros2_common.ros.utils import serializeParamMap
from skiros2_msgs import msg as msgs
from skiros2_skill.core.runtime.history import History
from skiros2_skill.core.runtime.request import TaskRefused, TaskStarter
from skiros2_skill.core.runtime.scheduler import Scheduler
from skiros2_skill.ros.messages import param_messages, skill_request, wire_code, wire_text
from skiros2_world_model.core.wm_errors import WmException
from unit.skiros2_skill.skills import CONTAINER, OBJECT, Note, Work, contains, describe, primitive


@pytest.fixture
def scheduler():
    scheduler = Scheduler()
    yield scheduler
    scheduler.stop()


@pytest.fixture
def history():
    return History()


@pytest.fixture
def starter(bench, scheduler, history):
    bench.load(primitive(Note, "note", execute=State.Success))
    return TaskStarter(bench.library, bench.wmi, scheduler, history, lambda: bench.robot)


def description(stype="Note", **values):
    params = {key: Param(key, "", value, ParamTypes.Required) for key, value in values.items()}
    return skill_request(msgs.ResourceDescription(stype, "", serializeParamMap(params)))


def test_created_task_is_not_started(starter, scheduler, history):
    task = starter.make("tests", [description(Text="a"), description(Text="b")])
    assert [node.type for node in task.root.children] == ["skiros:Note", "skiros:Note"]
    assert task.paused
    assert history.get(task.id).author == "tests"
    scheduler.start(task.id)
    assert task.ended.wait(10)
    assert task.state is State.Success


def test_tasks_of_one_goal_start_their_skills_in_the_same_context(bench, starter, scheduler):
    seen = []

    def note(skill):
        seen.append(current_task())
        return True

    bench.load(primitive(Work, "work", onStart=note, execute=State.Success))
    for goal in ("one", "one", "other", "", ""):
        task = starter.make("tests", [description("Work")], goal)
        scheduler.start(task.id)
        assert task.ended.wait(10)
    assert seen[0] == seen[1]
    assert len(set(seen)) == 4, "without a goal, each task stands for itself"


def test_refused_task_is_recorded_with_the_reason(starter, scheduler, history):
    with pytest.raises(TaskRefused, match="required parameter 'Text' \\(str\\) is not set") as refused:
        starter.make("tests", [description()])
    assert history.get(-1) is refused.value.record
    (why,) = refused.value.record.explanations
    assert (why.stage, why.type, why.node) == (PARAMETER, "skiros:Note", -1)
    assert scheduler.tasks() == []


def test_first_wrong_skill_of_several_is_named(starter, history):
    with pytest.raises(TaskRefused, match="no skill of type skiros:Nothing"):
        starter.make("tests", [description(Text="a"), description("Nothing")])
    assert history.get(-1).explanations[0].type == "skiros:Nothing"


def test_internal_error_is_reported_to_the_client(starter, bench, monkeypatch, caplog):
    def fail():
        raise ZeroDivisionError("of our own")

    monkeypatch.setattr(bench.wmi, "catch_up", fail)
    with pytest.raises(TaskRefused, match="internal error: ZeroDivisionError: of our own"):
        starter.make("tests", [description(Text="a")])
    assert "creating a task for tests" in caplog.text


def test_unavailable_world_model_is_reported(starter, bench, monkeypatch):
    def fail():
        raise WmException("service /wm/get does not answer")

    monkeypatch.setattr(bench.wmi, "catch_up", fail)
    with pytest.raises(TaskRefused, match="service /wm/get does not answer"):
        starter.make("tests", [description(Text="a")])


# -- preview ----------------------------------------------------------------------------------------------------------


@pytest.fixture
def hold(bench):
    """Loads a skill whose parameters are inferred: a product in a container."""
    bench.load(primitive(describe("Hold", [CONTAINER, OBJECT], pre=[contains()]), "hold"))


def test_preview_returns_the_inferred_elements(starter, bench, hold):
    preview = starter.preview([written("Hold")])
    assert (preview.label, preview.refusal) == ("hold", None)
    assert {key: e.id for key, e in preview.elements.items()} == {
        "Container": bench.tray.id,
        "Object": bench.product.id,
        "Robot": bench.robot.id,
    }


def test_preview_returns_all_values_of_the_start(starter, bench, hold):
    bench.load(primitive(describe("Press", [OBJECT, ("Force", 2.5, ParamTypes.Optional)]), "press"))
    given = {"key": "Object", "values": bench.product.label or bench.product.id}
    preview = starter.preview([written("Press", given)])
    assert preview.values == {"Object": [bench.product.id], "Force": [2.5], "Robot": [bench.robot.id]}


def test_preview_starts_nothing(starter, scheduler, history, bench, hold):
    version = bench.wmi.version
    starter.preview([written("Hold")])
    starter.preview([written("Nothing")])
    assert scheduler.tasks() == []
    assert bench.wmi.version == version
    assert not any(implementation.busy for implementation in bench.library.implementations())
    with pytest.raises(UnknownName):
        history.get(-1)


def test_preview_explains_an_unsatisfied_pre_condition(starter, bench, hold):
    given = [{"key": "Object", "values": bench.product.id}, {"key": "Container", "values": bench.other_tray.id}]
    refusal = starter.preview([written("Hold", *given)]).refusal
    assert (refusal.stage, len(refusal.findings)) == (PRE, 1)


def test_preview_explains_a_failed_inference(starter, bench, hold):
    bench.wmi.set_relation(bench.other_tray.id, "skiros:contain", bench.other_product.id, False)
    refusal = starter.preview([written("Hold", {"key": "Object", "values": bench.other_product.id})]).refusal
    assert refusal.stage == INFERENCE
    assert [c.key for c in refusal.candidates] == ["Container"]


def test_object_that_names_no_element_is_refused(starter, bench, hold):
    refusal = starter.preview([written("Hold", {"key": "Object", "values": [{"a": 1}]})]).refusal
    assert "expected texts as id, label and type of an element, got {'a': 1}" in refusal.message


def test_preview_explains_a_wrong_request(starter):
    assert starter.preview([written("Note", {"key": "Text", "values": 7})]).refusal.stage == PARAMETER
    assert "no skill of type skiros:Nothing" in starter.preview([written("Nothing")]).refusal.message


# -- what travels -----------------------------------------------------------------------------------------------------


def test_parameters_that_json_cannot_hold_are_omitted():
    params = {"good": Param("good", "", 1, ParamTypes.Required), "bad": Param("bad", "", {1, 2}, ParamTypes.Required)}
    (sent,) = param_messages(params)
    assert json.loads(sent.param)["key"] == "good"


@pytest.mark.parametrize("text", ["plain", "ünïcode", "half \udcff of a letter"])
def test_any_text_is_encoded(text):
    msgs.SkillProgress(progress_message=wire_text(text)).serialize(io.BytesIO())


def test_codes_are_limited_to_their_message_type():
    assert [wire_code(code) for code in (-100_000, -404, 7, 100_000)] == [-32768, -404, 7, 32767]


# -- parameters as people write them -----------------------------------------------------------------------------------


def written(stype, *params):
    texts = [msgs.Param(p if isinstance(p, str) else json.dumps(p)) for p in params]
    return skill_request(msgs.ResourceDescription(stype, "", texts))


@pytest.fixture
def given(starter, scheduler):
    """The values of a parameter with which a skill runs that is asked for so."""

    def run(stype, key, values):
        task = starter.make("tests", [written(stype, {"key": key, "values": values})])
        scheduler.start(task.id)
        assert task.ended.wait(10)
        return task.root.children[0].params[key].values

    return run


@pytest.mark.parametrize("values", ["a", ["a"]])
def test_text_parameter_needs_no_type(given, values):
    assert given("Note", "Text", values) == ["a"]


def test_element_is_given_by_id_or_label(given, bench):
    bench.load(primitive(describe("Hold", [OBJECT]), "hold"))
    product = bench.other_product
    for values in (product.id, product.label, [product.id], {"id": product.id}, {"label": product.label}):
        (value,) = given("Hold", "Object", values)
        assert value.id == product.id


def test_int_is_accepted_for_a_float(given, bench):
    bench.load(primitive(describe("Turn", [("Angle", float, ParamTypes.Required)]), "turn"))
    assert given("Turn", "Angle", [2]) == [2.0]


def test_all_problems_of_a_request_are_reported_at_once(starter, bench, scheduler):
    bench.load(primitive(describe("Hold", [OBJECT, ("Times", int, ParamTypes.Required)]), "hold"))
    skills = [
        written(
            "Hold", {"key": "Object", "values": "prodct"}, {"key": "Tmes", "values": 1}, "no json", {"key": "Times"}
        ),
        written("Nte", {"key": "Text", "values": "a"}),
        written("Note", {"key": "Text", "values": 7}),
    ]
    with pytest.raises(TaskRefused) as refused:
        starter.make("tests", skills)
    for part in (
        "parameter 'Object': no element has the id or label 'prodct'; near: product",
        "has no parameter 'Tmes'",
        "params[2]: parameter is not JSON",
        "params[3]: parameter 'Times' has no \"values\"",
        "required parameter 'Times' (int) is not set",
        "no skill of type skiros:Nte; near: skiros:Note",
        "parameter Text: expected a value of type str, got int 7",
    ):
        assert part in str(refused.value)
    assert scheduler.tasks() == []
