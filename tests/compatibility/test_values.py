"""The values of a skill that starts: which one wins, and elements as they are. Compatibility, section 2."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from compatibility.rules import rule
from compatibility.test_blackboard import compound, message, primitive, tells
from libraries.value_skills import use
from skiros2_common.core.abstract_skill import State
from skiros2_common.core.params import Param, ParamHandler, ParamTypes
from skiros2_common.core.world_element import Element
from skiros2_common.ros.utils import ParamsEncoder, decodeElement
from skiros2_skill.core.runtime.request import JsonValues, SkillRequest, make_nodes
from skiros2_skill.core.skill import RetryOnFail
from skiros2_skill.ros.utils import SkillHolder, deserialize_skill
from skiros2_world_model.core.local_world_model import LocalWorldModel
from support.value_table import CHANGES, WAYS, Outcome, check, furnish, seen_by

LIBRARIES = Path(__file__).parents[1] / "libraries"


@rule("blackboard", "An element is read when the skill starts, whichever way it came",
      better="a write changes only what the skill has changed since then")  # fmt: skip
@pytest.mark.parametrize("author", ["another author", "the robot"])
@pytest.mark.parametrize("change", CHANGES)
@pytest.mark.parametrize("way", WAYS)
def test_a_skill_starts_with_the_element_as_it_is(skill_bench, monkeypatch, way, change, author):
    monkeypatch.syspath_prepend(LIBRARIES)
    skill_bench.import_libraries("value_skills")
    editor = skill_bench.wmi if author == "the robot" else LocalWorldModel("editor", skill_bench.wmi.model)
    stage = furnish(editor)
    calls = [(skill, "", params) for skill, params in WAYS[way](editor.get_element(stage.part))]
    task = skill_bench.commands(*calls)
    task.tick(3)
    assert any(node.progress_msg == "waiting" for node in task.nodes()), task.why
    CHANGES[change](editor, stage)
    gate = editor.get_element(stage.gate)
    gate.setProperty("skiros:Weight", 1.0)
    editor.update_element(gate)
    state = task.run().state
    messages = [(node.label, node.progress_msg) for node in task.nodes()]
    outcome = Outcome(state is State.Success, seen_by(messages), task.why)
    check(way, change, stage, outcome, editor)


# -- which value wins --------------------------------------------------------------------------------------------------


def product(key="Object", kind=ParamTypes.Inferred):
    return (key, Element("skiros:Product"), kind)


def closed(description):
    return description.getPropCond("Closed", "skiros:CadModel", "Object", "=", "closed", True)


def closing(word):
    """An `execute` that assigns the element in place, with a new value of a property, as many libraries do."""

    def execute(skill):
        element = skill.params["Object"].value
        element.setProperty("skiros:CadModel", word)
        skill.params["Object"].value = element
        return skill.success()

    return execute


@pytest.fixture
def doors(skill_bench):
    """Two closed doors, and a compound that opens one: its child assigns the element."""
    for label in ("fridge", "pantry"):
        skill_bench.add("skiros:Product", label, CadModel="closed")
    skill_bench.load(
        primitive("Turn", product(kind=ParamTypes.Required), execute=closing("open")),
        compound("Open", lambda self, skill: skill(self.skill("Turn")), product(), pre=[closed]),
    )
    return skill_bench


def planned(bench, skill, element, kind=ParamTypes.Inferred, key="Object"):
    """A step of a plan, as it is read from the plan's text."""
    node = bench.node(skill)
    step = SkillHolder("", skill, skill, {key: Param(key, "", element, kind)})
    node.specifyParamsDefault(deserialize_skill(step.toJson()).ph)
    return node


def states(bench):
    return {label: bench.element(label).value_of("skiros:CadModel") for label in ("fridge", "pantry")}


@rule("blackboard", "Two steps of a plan that name two elements use these two, whatever a child has assigned")
def test_steps_of_a_plan_use_the_elements_that_it_names(doors):
    task = doors.run(*(planned(doors, "Open", doors.element(label)) for label in ("pantry", "fridge")))
    assert task.state is State.Success, task.why
    assert states(doors) == {"fridge": "open", "pantry": "open"}


@rule("blackboard", "An element that a plan names for an Inferred parameter takes precedence over the blackboard")
def test_a_suggested_element_takes_precedence_over_one_on_the_blackboard_that_fits_too(doors):
    doors.load(primitive("Look", product(), execute=tells("Object")))
    fridge, pantry = doors.element("fridge"), doors.element("pantry")
    task = doors.run(planned(doors, "Look", pantry), planned(doors, "Look", fridge))
    assert [node.progress_msg for node in task.root.children] == [f"['{pantry.id}']", f"['{fridge.id}']"]


@rule("blackboard", "A planned element with which the pre-conditions do not hold is used all the same",
      differs="another one is searched, and a log line names both")  # fmt: skip
def test_the_search_continues_when_the_suggested_element_does_not_fit(doors, caplog):
    pantry = doors.element("pantry")
    pantry.setProperty("skiros:CadModel", "broken")
    doors.wmi.update_element(pantry)
    with caplog.at_level("INFO"):
        task = doors.run(planned(doors, "Open", pantry))
    assert task.state is State.Success, task.why
    assert states(doors) == {"fridge": "open", "pantry": "broken"}
    assert "the pre-conditions do not hold with" in caplog.text and repr(pantry) in caplog.text


@rule("blackboard", "A planned element that is gone leaves an Inferred parameter without a value",
      better="another one is searched, with a warning")  # fmt: skip
def test_the_search_continues_when_the_suggested_element_is_gone(doors, caplog):
    node = planned(doors, "Open", doors.element("pantry"))
    doors.wmi.remove_element(doors.element("pantry").id)
    assert doors.run(node).state is State.Success
    assert doors.element("fridge").value_of("skiros:CadModel") == "open"
    assert "which is no longer in the scene" in caplog.text


@rule("blackboard", "A planned value follows a later remap")
def test_a_suggestion_follows_a_remap(doors):
    node = planned(doors, "Open", doors.element("pantry"))
    node.remap("Object", "Door")
    assert doors.run(node).state is State.Success
    assert states(doors) == {"fridge": "closed", "pantry": "open"}


@rule("blackboard", "A value that a task gives is kept, also for an Inferred parameter: no other element is searched")
def test_a_given_value_is_kept_although_the_preconditions_do_not_hold(doors):
    pantry = doors.element("pantry")
    pantry.setProperty("skiros:CadModel", "broken")
    doors.wmi.update_element(pantry)
    assert doors.command("Open", Object=pantry).run().state is State.Failure
    assert states(doors) == {"fridge": "closed", "pantry": "broken"}


@rule("blackboard", "A given element stays given when a child assigns it again")
def test_a_given_element_that_a_child_assigns_again_stays_given(doors):
    task = doors.run(doors.node("Turn", Object=doors.element("pantry")), doors.node("Open"))
    assert task.state is State.Failure, "the pantry is open already, and nobody asked for the fridge"
    assert states(doors) == {"fridge": "closed", "pantry": "open"}


@rule("blackboard", "An inferred element that a skill assigns again is a candidate of the next skill",
      better="so a sequence of the same skill treats one element after the other")  # fmt: skip
def test_an_inferred_element_that_a_child_assigns_again_is_a_candidate(doors):
    task = doors.run(doors.node("Open"), doors.node("Open"))
    assert task.state is State.Success, task.why
    assert states(doors) == {"fridge": "open", "pantry": "open"}


@rule("blackboard", "An element that a skill assigns is used by the next skill with that key",
      better="if its pre-conditions hold with it; otherwise another one is searched")  # fmt: skip
@pytest.mark.parametrize("assign", ["in place", "by name"])
def test_an_assigned_element_is_the_first_candidate_of_the_next_skill(doors, assign):
    def execute(skill):
        pantry = doors.element("pantry")
        if assign == "in place":
            skill.params["Object"].value = pantry
        else:
            skill.params.specify("Object", pantry)
        return skill.success()

    doors.load(primitive("Find", product(kind=ParamTypes.Optional), execute=execute))
    assert doors.run(doors.node("Find"), doors.node("Open")).state is State.Success
    assert states(doors) == {"fridge": "closed", "pantry": "open"}
    assert doors.run(doors.node("Find"), doors.node("Open")).state is State.Success
    assert states(doors) == {"fridge": "open", "pantry": "open"}


@rule("blackboard", "Several elements that a skill has assigned reach the next skill as one list")
def test_several_assigned_elements_are_passed_on_whole(doors):
    def execute(skill):
        skill.params["Object"].values = [doors.element("pantry"), doors.element("fridge")]
        return skill.success()

    doors.load(
        primitive("FindAll", product(kind=ParamTypes.Optional), execute=execute),
        primitive("Tell", product(kind=ParamTypes.Required), execute=tells("Object")),
    )
    task = doors.run(doors.node("FindAll"), doors.node("Tell"))
    assert message(task, "Tell") == str([doors.element(label).id for label in ("pantry", "fridge")])


@rule("blackboard", "Of several elements that a skill has assigned, the next skill has those that are left",
      better="if none is left, a Required parameter fails, and for an Inferred one another is searched")  # fmt: skip
@pytest.mark.parametrize("kind", [ParamTypes.Required, ParamTypes.Inferred])
@pytest.mark.parametrize("gone", [("pantry",), ("pantry", "fridge")])
def test_assigned_elements_that_are_gone_are_left_out(doors, kind, gone):
    oven = doors.add("skiros:Product", "oven")
    both = [doors.element(label) for label in ("pantry", "fridge")]

    def find(skill):
        skill.params["Object"].values = list(both)
        return skill.success()

    def lose(skill):
        for label in gone:
            doors.wmi.remove_element(doors.element(label).id)
        return skill.success()

    doors.load(
        primitive("FindBoth", product(kind=ParamTypes.Optional), execute=find),
        primitive("Lose", execute=lose),
        primitive("Tell", product(kind=kind), execute=tells("Object")),
    )
    task = doors.run(doors.node("FindBoth"), doors.node("Lose"), doors.node("Tell"))
    if len(gone) == 1:
        assert message(task, "Tell") == str([both[1].id])
    elif kind is ParamTypes.Required:
        assert task.state is State.Failure and both[0].id in task.why
    else:
        assert message(task, "Tell") == str([oven.id])


@rule("blackboard", "A compound whose inferred element is gone at its end leaves what a child has found since")
def test_a_compound_whose_element_is_gone_keeps_what_a_child_has_found(doors):
    fridge, pantry = doors.element("fridge"), doors.element("pantry")

    def expand(self, skill):
        look = self.skill("Look")
        suggested = Param("Object", "", pantry, ParamTypes.Inferred)
        look.specifyParamsDefault(ParamHandler({"Object": suggested}))
        skill(look, self.skill("Lose"))

    doors.load(
        primitive("Look", product(), execute=lambda skill: skill.success()),
        primitive("Lose", execute=lambda skill: skill.success(str(doors.wmi.remove_element(fridge.id)))),
        compound("Around", expand, product()),
        primitive("Tell", product(kind=ParamTypes.Optional), execute=tells("Object")),
    )
    around = doors.node("Around")
    around.specifyParamsDefault(ParamHandler({"Object": Param("Object", "", fridge, ParamTypes.Inferred)}))
    task = doors.run(around, doors.node("Tell"))
    assert message(task, "Tell") == str([pantry.id])


@rule("blackboard", "A skill that has started without an element that is gone does not get it later",
      better="a change of something else does not make it fail")  # fmt: skip
def test_an_element_that_was_gone_at_the_start_is_not_taken_up_later(skill_bench):
    bolt = skill_bench.add("skiros:Product", "bolt")

    def look(skill):
        return skill.success() if skill.progress_code else skill.step("looked")

    skill_bench.load(
        primitive("Find", product(), execute=lambda skill: skill.success()),
        primitive("Lose", execute=lambda skill: skill.success(str(skill_bench.wmi.remove_element(bolt.id)))),
        primitive("Look", product(), execute=look),
    )
    task = skill_bench.task(*map(skill_bench.node, ("Find", "Lose", "Look")))
    while not any(node.progress_msg == "looked" for node in task.nodes()):
        task.tick()
    skill_bench.add("skiros:Location", "shelf")
    assert task.run().state is State.Success, task.why


@rule("blackboard", "An element that `specify` or a default gives only names the one to use: it is read at the start",
      better="also when its holder has changed it and has not written that")  # fmt: skip
@pytest.mark.parametrize("way", ["specify", "default"])
def test_unwritten_changes_of_a_given_element_are_not_seen(doors, way):
    pantry = doors.element("pantry")
    pantry.setProperty("skiros:CadModel", "broken")
    default = pantry if way == "default" else Element("skiros:Product")
    told = []
    doors.load(
        primitive(
            "Look", ("Object", default, ParamTypes.Required),
            execute=lambda skill: skill.success(told.append(skill.params["Object"].value.value_of("skiros:CadModel"))),
        )
    )  # fmt: skip
    assert doors.run(doors.node("Look", **({"Object": pantry} if way == "specify" else {}))).state is State.Success
    assert told == ["closed"]


@rule("blackboard", "A parameter with elements as default shares the list on the blackboard that has their ids",
      better="also if these were inferred: changes in place are seen")  # fmt: skip
def test_a_given_element_that_was_inferred_before_is_shared(doors):
    fridge, told = doors.element("fridge"), []

    def dent(skill):
        skill.params["Object"].value.setProperty("skiros:Value", "dented")
        return skill.success()

    def tell(skill):
        told.append(skill.params["Object"].value.value_of("skiros:Value"))
        return skill.success()

    doors.load(
        primitive("Dent", product(), execute=dent), primitive("Tell", product(kind=ParamTypes.Required), execute=tell)
    )
    assert doors.run(doors.node("Dent"), doors.node("Tell", Object=fridge)).state is State.Success
    assert told == ["dented"]


@rule("blackboard", "A skill whose Optional parameter is given an element that is gone fails",
      better="also when the blackboard has the same element")  # fmt: skip
@pytest.mark.parametrize("is_on_blackboard", [False, True])
def test_a_given_element_that_is_gone_fails_an_optional_parameter_too(doors, is_on_blackboard):
    fridge = doors.element("fridge")
    doors.load(
        primitive("Find", product(), execute=tells("Object")),
        primitive("Lose", execute=lambda skill: skill.success(str(doors.wmi.remove_element(fridge.id)))),
        primitive("Look", product(kind=ParamTypes.Optional), execute=tells("Object")),
    )
    steps = [doors.node("Find")] if is_on_blackboard else []
    task = doors.run(*steps, doors.node("Lose"), doors.node("Look", Object=fridge))
    assert task.state is State.Failure
    assert fridge.id in task.why


@rule(
    "blackboard", "A skill that fails because what it writes is gone leaves no element that is gone on the blackboard"
)
def test_a_refused_write_drops_the_elements_that_are_gone(doors):
    def use_or_lose(skill):
        element = skill.params["Object"].value
        if element.label == "fridge":
            doors.wmi.remove_element(element.id)
        element.setProperty("skiros:Value", "used")
        skill.params["Object"].value = element
        return skill.success()

    doors.load(
        primitive("Use", product(kind=ParamTypes.Required), execute=use_or_lose),
        compound("Twice", lambda self, skill: (skill.setProcessor(RetryOnFail(1)), skill(self.skill("Use")))),
    )
    task = doors.run(doors.node("Twice"))
    assert task.state is State.Success, task.why
    assert doors.element("pantry").value_of("skiros:Value") == "used"


# -- writes ------------------------------------------------------------------------------------------------------------


@rule("element", "An element from a plan's text is written whole",
      better="only what was changed since it was read")  # fmt: skip
def test_a_write_of_a_decoded_element_changes_only_what_its_author_has_changed(doors):
    text = json.dumps(doors.element("pantry"), cls=ParamsEncoder)
    fresh = doors.element("pantry")
    fresh.setProperty("skiros:Weight", 7.0)
    fresh.setProperty("skiros:CadModel", "broken")
    doors.wmi.update_element(fresh)
    decoded = decodeElement(text)
    decoded.setProperty("skiros:Value", "mine")
    doors.wmi.update_element(decoded)
    pantry = doors.element("pantry")
    assert [pantry.value_of(f"skiros:{key}") for key in ("Weight", "CadModel", "Value")] == [7.0, "broken", "mine"]


@rule("blackboard", "An element that a skill builds itself, with the id of an existing one, is written whole",
      better="only what the skill has set")  # fmt: skip
def test_an_element_that_a_skill_has_built_itself_changes_only_what_it_has_set(doors):
    pantry = doors.element("pantry")

    def execute(skill):
        mine = Element("skiros:Product", "", pantry.id)
        mine.setProperty("skiros:Weight", 3.0)
        skill.params["Object"].value = mine
        return skill.success()

    doors.load(primitive("Weigh", product(kind=ParamTypes.Optional), execute=execute))
    assert doors.run(doors.node("Weigh")).state is State.Success
    after = doors.element("pantry")
    assert (after.value_of("skiros:Weight"), after.value_of("skiros:CadModel")) == (3.0, "closed")
    assert after.getRelations("", "skiros:contain", "-1") == pantry.getRelations("", "skiros:contain", "-1")


# -- ways that only the process itself has --------------------------------------------------------------------------


def by_default(bench, part):
    """A skill whose declaration has the element as a default."""
    bench.load(primitive("Defaulted", ("Object", part, ParamTypes.Required), execute=use))
    return bench.node("Defaulted")


def by_id(bench, part):
    """A request in JSON, which names the element by its id."""
    bench.load(primitive("Named", product(kind=ParamTypes.Required), execute=use))
    (node,) = make_nodes([SkillRequest("Named", "", {"Object": JsonValues([part.id])})], bench.library, bench.wmi)
    return node


@rule("blackboard", "An element that is a default, or that a request names by its id, is read when the skill starts")
@pytest.mark.parametrize("change", CHANGES)
@pytest.mark.parametrize("way", [by_default, by_id])
def test_a_default_and_an_id_name_the_element_as_it_is(skill_bench, monkeypatch, way, change):
    monkeypatch.syspath_prepend(LIBRARIES)
    skill_bench.import_libraries("value_skills")
    editor = LocalWorldModel("editor", skill_bench.wmi.model)
    stage = furnish(editor)
    node = way(skill_bench, editor.get_element(stage.part))
    CHANGES[change](editor, stage)
    task = skill_bench.run(node)
    seen = seen_by([(f"use_{node.label}", node.progress_msg)])
    check("a command", change, stage, Outcome(task.state is State.Success, seen, task.why), editor)


@pytest.fixture
def learned(skill_bench):
    """Runs a skill with a default of 0.1 and returns the value that it has."""
    speed = ("Speed", 0.1, ParamTypes.Required)
    skill_bench.load(primitive("Push", speed, execute=lambda s: s.success(str(s.params["Speed"].value))))
    return lambda **given: message(skill_bench.run(skill_bench.node("Push", **given)), "Push")


def learn(bench, value):
    """Adds a set with a value, as `learn apply` does. Returns both."""
    found = bench.add("skiros:ParameterSet", "learned", SkillType="skiros:Push")
    return found, bench.add("skiros:Parameter", "Speed", found, "skiros:hasParam", Value=value)


@rule("more", "A learned value replaces a default: each start takes the present one; a given value wins")
def test_learned_values_are_read_at_each_start(skill_bench, learned):
    said = [learned()]
    _, part = learn(skill_bench, 0.2)
    said.append(learned())
    part.setProperty("skiros:Value", 0.3)
    skill_bench.wmi.update_element(part)
    said.append(learned())
    said.append(learned(Speed=0.9))
    assert said == ["0.1", "0.2", "0.3", "0.9"]


@rule("more", "A learned value is that of the newest set that is in the scene at the start; without one, the default")
@pytest.mark.parametrize("change, expected", [
    ("its value is removed", "0.1"), ("its value is replaced", "0.4"), ("it is removed", "0.1"), ("it is moved", "0.2"),
    ("a newer one", "0.4"), ("a newer one that is removed", "0.2"),
])  # fmt: skip
def test_learned_values_follow_their_set(skill_bench, learned, change, expected):
    wmi = skill_bench.wmi
    found, part = learn(skill_bench, 0.2)
    assert learned() == "0.2"
    if change.startswith("its value"):
        wmi.remove_element(part.id)
        if change.endswith("replaced"):
            skill_bench.add("skiros:Parameter", "Speed", found, "skiros:hasParam", Value=0.4)
    elif change == "it is removed":
        wmi.remove_element(found.id)
    elif change == "it is moved":
        wmi.set_relation("skiros:Scene-0", "skiros:contain", found.id, False)
        wmi.set_relation(skill_bench.add("skiros:Location", "archive").id, "skiros:contain", found.id)
    else:
        newer, _ = learn(skill_bench, 0.4)
        if change.endswith("removed"):
            wmi.remove_element(newer.id)
    assert learned() == expected
