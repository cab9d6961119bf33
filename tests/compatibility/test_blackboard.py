"""Parameters of running trees, in the idioms of libraries for SkiROS2. Compatibility, section 2."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Any

import pytest

from compatibility.rules import rule
from skiros2_common.core.abstract_skill import SkillDescription, State
from skiros2_common.core.params import ParamTypes
from skiros2_common.core.primitive import PrimitiveBase
from skiros2_common.core.world_element import Element
from skiros2_skill.core.skill import ParallelFf, RetryOnFail, SkillBase

LIBRARIES = Path(__file__).parents[1] / "libraries"
REQUIRED, OPTIONAL, INFERRED = ParamTypes.Required, ParamTypes.Optional, ParamTypes.Inferred
PRODUCT, BOX = Element("skiros:Product"), Element("skiros:LargeBox")


def describe(name, *params, pre=(), hold=(), post=()):
    """A description with parameters (key, value, type) and conditions, functions of the description."""

    def create(self):
        for param in params:
            self.addParam(*param)
        for add, made in ((self.addPreCondition, pre), (self.addHoldCondition, hold), (self.addPostCondition, post)):
            for make in made:
                add(make(self))

    return type(name, (SkillDescription,), {"createDescription": create})


def primitive(name, *params, pre=(), hold=(), post=(), **hooks):
    """A primitive labelled as its type."""
    description = describe(name, *params, pre=pre, hold=hold, post=post)
    hooks.setdefault("execute", lambda self: self.success())
    hooks["createDescription"] = lambda self: self.setDescription(description(), name)
    return type(name, (PrimitiveBase,), hooks)


def compound(name, expand, *params, pre=(), post=(), **hooks):
    description = describe(name, *params, pre=pre, post=post)
    hooks["createDescription"] = lambda self: self.setDescription(description(), name)
    return type(name, (SkillBase,), {"expand": expand, **hooks})


def tells(key):
    """An `execute` that reports the values of a parameter."""
    return lambda self: self.success(str([getattr(v, "id", v) for v in self.params[key].values]))


def does(function):
    """An `execute` that does something and succeeds."""

    def execute(self):
        function(self)
        return self.success()

    return execute


def message(task, name):
    return task.node(name).progress_msg


@pytest.fixture
def bench(skill_bench):
    skill_bench.tray = skill_bench.add("skiros:LargeBox", "tray")
    skill_bench.other_tray = skill_bench.add("skiros:LargeBox", "other tray")
    skill_bench.product = skill_bench.add("skiros:Product", "product", skill_bench.tray)
    skill_bench.other_product = skill_bench.add("skiros:Product", "other product", skill_bench.other_tray)
    return skill_bench


def run(bench, *skills, **blackboard):
    bench.load(*skills)
    return bench.run(*(bench.node(s.__name__) for s in skills), **blackboard)


CONTAINS = lambda d: d.getRelationCond("Contains", "skiros:contain", "Container", "Object", True)  # noqa: E731


# -- start of a node ---------------------------------------------------------------------------------------------------


@rule("blackboard", "A key is the key after all remaps; a node's remaps apply to everything below it")
def test_remaps_apply_to_all_below(bench):
    bench.load(
        primitive("Tell", ("Text", str, OPTIONAL), execute=tells("Text")),
        compound("Inner", lambda self, skill: skill(self.skill("Tell"))),
        compound("Outer", lambda self, skill: skill(self.skill("Inner", remap={"Text": "Words"}))),
    )
    assert message(bench.run(bench.node("Outer", remap={"Words": "Title"}), Title="hello"), "Tell") == "['hello']"


@rule("blackboard", "A parameter declared by a type takes what is on the blackboard; one with a default keeps it")
def test_default_takes_precedence_over_the_blackboard(bench):
    task = run(
        bench,
        primitive("Free", ("Text", str, OPTIONAL), execute=tells("Text")),
        primitive("Fixed", ("Text", "mine", REQUIRED), execute=tells("Text")),
        Text="yours",
    )
    assert (message(task, "Free"), message(task, "Fixed")) == ("['yours']", "['mine']")


@rule("blackboard", "A parameter with an abstract element takes what is on the blackboard, whatever its class")
def test_an_abstract_element_takes_any_element(bench):
    task = run(bench, primitive("Hold", ("Object", PRODUCT, REQUIRED), execute=tells("Object")), Object=bench.tray)
    assert message(task, "Hold") == f"['{bench.tray.id}']"


@rule("blackboard", "Elements as default are refreshed by the same elements on the blackboard")
def test_a_default_with_the_same_ids_is_refreshed(bench):
    seen = []
    tray = bench.wmi.get_element(bench.tray.id)
    bench.load(
        primitive("Hold", ("Object", BOX, REQUIRED), execute=does(lambda s: seen.append(s.params["Object"].value)))
    )
    bench.run(bench.node("Hold", Object=bench.wmi.get_element(bench.tray.id)), Object=tray)
    assert seen == [tray]


@rule("blackboard", "A value of another Python type is refused with a logged error; the own value stays")
def test_value_of_another_type_is_rejected(bench, caplog):
    with caplog.at_level(logging.ERROR):
        task = run(bench, primitive("Tell", ("Text", str, OPTIONAL), execute=tells("Text")), Text=5)
    assert (task.state, message(task, "Tell")) == (State.Success, "[]")
    assert "Text: expected a value of type str" in caplog.text


@rule("blackboard", "Elements with an id are read again at the start and before each `execute`")
def test_elements_are_read_again(bench):
    seen = []

    def look(self):
        seen.append(self.params["Object"].value.value_of("skiros:Weight"))
        return self.step() if len(seen) < 2 else self.success()

    bench.load(primitive("Look", ("Object", PRODUCT, REQUIRED), execute=look))
    stale = bench.wmi.get_element(bench.product.id)
    task = bench.task(bench.node("Look", Object=stale))
    for weight in (1.0, 2.0):
        fresh = bench.wmi.get_element(bench.product.id)
        fresh.setProperty("skiros:Weight", weight)
        bench.wmi.update_element(fresh)
        task.tick()
    assert seen == [1.0, 2.0]


@rule("blackboard", "An element that is gone is dropped when a skill starts")
def test_missing_element_is_dropped_at_the_start(bench):
    eat = does(lambda s: s.wmi.remove_element(s.params["Object"].value))
    task = run(
        bench,
        primitive("Eat", ("Object", PRODUCT, REQUIRED), execute=eat),
        primitive("Tell", ("Object", Element, OPTIONAL), execute=tells("Object")),
        Object=bench.product,
    )  # fmt: skip
    assert message(task, "Tell") == "[]"


@rule("blackboard", "An element that is removed while a skill runs is dropped from its parameter",
      differs="the skill fails and names the element, who removed it and when, "
              "before its code sees None")  # fmt: skip
def test_a_skill_fails_when_its_element_is_removed(bench, tmp_path):
    from skiros2_world_model.core.local_world_model import LocalWorldModel

    bench.load(primitive("Hold", ("Object", PRODUCT, REQUIRED), execute=lambda s: s.step(s.params["Object"].value.id)))
    node = bench.node("Hold", Object=bench.product)
    task = bench.task(node)
    task.tick()
    LocalWorldModel("somebody", bench.wmi.model).remove_element(bench.product.id)
    assert task.tick() is State.Failure
    assert bench.product.id in node.progress_msg and "\n" not in node.progress_msg


@rule("blackboard", "A skill may remove its own element and run on")
def test_a_skill_may_remove_its_own_element(bench):
    def eat(self):
        if self.progress_code:
            return self.success(str(self.params["Object"].values))
        self.wmi.remove_element(self.params["Object"].value)
        return self.step()

    task = run(bench, primitive("Eat", ("Object", PRODUCT, REQUIRED), execute=eat), Object=bench.product)
    assert (task.state, message(task, "Eat")) == (State.Success, "[]")


@rule("blackboard", "Abstract elements that are not Optional are searched so that all conditions hold; none: no start")
def test_inference_at_the_start(bench):
    take = primitive("Take", ("Container", BOX, INFERRED), ("Object", PRODUCT, REQUIRED), pre=[CONTAINS],
                     execute=tells("Container"))  # fmt: skip
    task = run(bench, take, Object=bench.other_product)
    assert message(task, "Take") == f"['{bench.other_tray.id}']"
    lost = bench.add("skiros:Product", "lost")
    assert bench.run(bench.node("Take"), Object=lost).state is State.Failure


# -- what goes to the blackboard ---------------------------------------------------------------------------------------


@rule("blackboard", "After its start all parameters of a skill that have a value are on the blackboard")
def test_given_default_and_inferred_values_go_up(bench):
    params = (("Given", str, REQUIRED), ("Default", 3, REQUIRED), ("Object", BOX, INFERRED), ("Unset", str, OPTIONAL))
    bench.load(primitive("Work", *params, execute=lambda s: s.step()))
    task = bench.task(bench.node("Work", Given="words"))
    task.tick()
    board = task.blackboard
    assert (board["Given"], board["Default"], board["Object"].id) == ("words", 3, bench.tray.id)
    assert "Unset" not in board


@rule("blackboard", "Abstract elements of a description never go to the blackboard")
def test_placeholders_stay_below(bench):
    task = run(bench, primitive("Work", ("Object", PRODUCT, OPTIONAL)))
    assert "Object" not in task.blackboard


@rule("blackboard", "`unset()` takes the key off the blackboard; siblings that start later find nothing")
@pytest.mark.parametrize("empty", [lambda p: p.unset(), lambda p: p.values.clear(), lambda p: setattr(p, "values", [])])
def test_unset_takes_the_key_off(bench, empty):
    task = run(
        bench,
        primitive("Drop", ("Text", str, OPTIONAL), execute=does(lambda s: empty(s.params["Text"]))),
        primitive("Tell", ("Text", str, OPTIONAL), execute=tells("Text")),
        Text="words",
    )
    assert message(task, "Tell") == "[]"
    assert "Text" not in task.blackboard


@rule("blackboard", "`unset()` in a child leaves a running ancestor its value: its post-conditions have it, "
                    "and at its end it is on the blackboard again")  # fmt: skip
def test_unset_leaves_ancestors_alone(bench):
    full = lambda d: d.getPropCond("Heavy", "skiros:Weight", "Object", "=", 2.0, True)  # noqa: E731
    bench.product.setProperty("skiros:Weight", 2.0)
    bench.wmi.update_element(bench.product)
    drop = does(lambda s: s.params["Start"].unset())
    bench.load(
        primitive("Drop", ("Start", Element("sumo:Object"), REQUIRED), execute=drop),
        primitive("See", ("Object", Element, OPTIONAL), execute=tells("Object")),
        compound("Carry", lambda self, skill: skill(self.skill("Drop", remap={"Start": "Object"}), self.skill("See")),
                 ("Object", PRODUCT, REQUIRED), post=[full]),
    )  # fmt: skip
    task = bench.run(bench.node("Carry", Object=bench.product))
    assert task.state is State.Success, task.why
    assert message(task, "See") == "[]"
    assert task.blackboard["Object"].id == bench.product.id


@rule("blackboard", "The pick-and-place idiom: the moving child unsets its start, which is remapped to the gripper")
def test_pick_and_place(skill_bench, monkeypatch):
    monkeypatch.syspath_prepend(LIBRARIES)
    furnish(skill_bench)
    task = skill_bench.command("Fetch", Object=skill_bench.element("bolt"), To=skill_bench.element("table")).run()
    assert task.state is State.Success, task.why
    assert skill_bench.holder("bolt") == "table"
    assert skill_bench.element("gripper").value_of("skiros:ContainerState") == "Empty"


def furnish(bench):
    """A shelf with a bolt, a table, and a robot with an arm and a gripper at a dock."""
    shelf, _, dock = (bench.add("skiros:Location", label) for label in ("shelf", "table", "dock"))
    bench.add("skiros:Product", "bolt", shelf)
    arm = bench.add("rparts:ArmDevice", "arm", bench.robot, "skiros:hasA")
    bench.add("rparts:GripperEffector", "gripper", arm, "skiros:hasA", ContainerState="Empty")
    bench.wmi.set_relation(bench.robot.id, "skiros:at", dock.id, True)
    bench.import_libraries("pick_place_skills", "skiros2_std_skills")


# -- sharing -----------------------------------------------------------------------------------------------------------


@rule("blackboard", "The list of values is shared, not copied: `values.append()` and `pop()` are seen by all holders")
def test_lists_are_shared(bench):
    log = []

    def produce(self):
        self.params["Items"].values.append(len(log))
        return self.step() if len(log) < 3 else self.success()

    def consume(self):
        if self.params["Items"].values:
            log.append(self.params["Items"].values.pop(0))
        return self.step() if len(log) < 3 else self.success()

    items = ("Items", int, OPTIONAL)

    def expand(self, skill):
        skill.setProcessor(ParallelFf())
        skill(self.skill("Produce"), self.skill("Consume"))

    bench.load(primitive("Produce", items, execute=produce), primitive("Consume", items, execute=consume),
               compound("Both", expand, items))  # fmt: skip
    assert bench.run(bench.node("Both")).state is State.Success
    assert log == [0, 1, 2]


@rule("blackboard", "`values.append(x)` in a child reaches its parent and later siblings without an assignment")
def test_append_reaches_the_parent(bench):
    seen = []
    items = ("Items", str, OPTIONAL)
    bench.load(
        primitive("Find", items, execute=does(lambda s: s.params["Items"].values.append("found"))),
        primitive("Tell", items, execute=tells("Items")),
        compound("Search", lambda self, skill: skill(self.skill("Find"), self.skill("Tell")), items,
                 execute=lambda self: seen.append(list(self.params["Items"].values))),
    )  # fmt: skip
    task = bench.run(bench.node("Search"))
    assert message(task, "Tell") == "['found']"
    assert seen == [["found"]]


@rule("blackboard", "`value = x` where there is a value changes the shared list; assigning all values makes a new one")
def test_assignments(bench):
    seen = {}

    def change(self):
        seen["list"] = self.params["A"].values, self.params["B"].values
        self.params["A"].value = 2
        self.params["B"].values = [2]
        return self.success()

    both = (("A", int, OPTIONAL), ("B", int, OPTIONAL))
    bench.load(
        primitive("Change", *both, execute=change),
        primitive("Tell", *both, execute=lambda s: s.success(f"{s.params['A'].value} {s.params['B'].value}")),
    )
    task = bench.run(bench.node("Change"), bench.node("Tell"), A=1, B=1)
    assert message(task, "Tell") == "2 2"
    assert seen["list"] == ([2], [1])


@rule("blackboard", "Elements that are changed in place are seen by siblings and parents without an assignment")
def test_elements_changed_in_place_are_seen(bench):
    thing = ("Object", PRODUCT, REQUIRED)
    heavy = lambda d: d.getPropCond("Heavy", "skiros:Weight", "Object", "=", 5.0, True)  # noqa: E731
    bench.load(
        primitive("Load", thing, execute=does(lambda s: s.params["Object"].value.setProperty("skiros:Weight", 5.0))),
        primitive("Look", thing, execute=lambda s: s.success(str(s.params["Object"].value.value_of("skiros:Weight")))),
        compound("Both", lambda self, skill: skill(self.skill("Load"), self.skill("Look")), thing, post=[heavy]),
    )
    task = bench.run(bench.node("Both", Object=bench.product))
    assert message(task, "Look") == "5.0"
    assert task.state is State.Success, task.why


@rule("blackboard", "Elements that are changed in place are seen by siblings",
      better="also when somebody else changes the element meanwhile")  # fmt: skip
def test_changes_in_place_survive_external_changes(bench):
    thing = ("Object", PRODUCT, REQUIRED)

    def touch(self):
        fresh = self.wmi.get_element(self.params["Object"].value.id)
        fresh.setProperty("skiros:CadModel", "theirs")
        self.wmi.update_element(fresh)
        return self.success()

    def look(self):
        element = self.params["Object"].value
        return self.success(f"{element.value_of('skiros:Weight')} {element.value_of('skiros:CadModel')}")

    task = run(
        bench,
        primitive("Load", thing, execute=does(lambda s: s.params["Object"].value.setProperty("skiros:Weight", 5.0))),
        primitive("Touch", thing, execute=touch),
        primitive("Look", thing, execute=look),
        Object=bench.product,
    )
    assert message(task, "Look") == "5.0 theirs"


@rule("blackboard", "The id that `wmi.add_element(e)` gives to a parameter's element is seen by siblings")
def test_the_id_of_an_added_element_is_seen(bench):
    def see(self):
        element = self.params["Seen"].value
        element.label = "seen"
        self.wmi.add_element(element)
        return self.success(element.id)

    seen = ("Seen", PRODUCT, OPTIONAL)
    task = run(bench, primitive("See", seen, execute=see), primitive("Tell", seen, execute=tells("Seen")))
    assert message(task, "Tell") == f"['{message(task, 'See')}']"


# -- the world model ---------------------------------------------------------------------------------------------------


def weigh(assigns):
    def execute(self):
        element = self.params["Object"].value
        element.setProperty("skiros:Weight", 4.0)
        assigns(self, element)
        return self.success()

    return execute


@rule("blackboard", "An element parameter that is assigned in `execute` is written to the world model")
@pytest.mark.parametrize(
    "assigns",
    [
        lambda s, e: setattr(s.params["Object"], "value", e),
        lambda s, e: setattr(s.params["Object"], "values", [e]),
        lambda s, e: s.params["Object"].setValue(e),
        lambda s, e: s.params.specify("Object", e),
    ],
)
def test_assigned_elements_are_written(bench, assigns):
    run(bench, primitive("Weigh", ("Object", PRODUCT, REQUIRED), execute=weigh(assigns)), Object=bench.product)
    assert bench.wmi.get_element(bench.product.id).value_of("skiros:Weight") == 4.0


@rule("blackboard", "Elements that are merely changed in place are not written to the world model",
      better="a line at debug level tells the author when the skill succeeded")  # fmt: skip
def test_elements_changed_in_place_are_not_written(bench, caplog):
    with caplog.at_level(logging.DEBUG):
        run(
            bench,
            primitive("Weigh", ("Object", PRODUCT, REQUIRED), execute=weigh(lambda s, e: None)),
            Object=bench.product,
        )
    assert bench.wmi.get_element(bench.product.id).value_of("skiros:Weight") is None
    assert "changed in place and not written" in caplog.text and bench.product.id in caplog.text


@rule("blackboard", "An abstract element that is assigned is not added to the world model")
def test_assigned_abstract_elements_are_not_added(bench):
    make = does(lambda s: setattr(s.params["Object"], "value", Element("skiros:Starter", "new")))
    run(bench, primitive("Make", ("Object", PRODUCT, OPTIONAL), execute=make))
    assert not bench.wmi.resolve_elements(Element("skiros:Starter"))


@rule("blackboard", "All elements that one `execute` has assigned are written", better="in one change: all or none")
def test_one_execute_is_one_change(bench):
    def swap(self):
        for key, weight in (("A", 1.0), ("B", 2.0)):
            element = self.params[key].value
            element.setProperty("skiros:Weight", weight)
            self.params[key].value = element
        return self.success()

    changes: list[Any] = []
    bench.wmi.add_listener(changes.append)
    run(bench, primitive("Swap", ("A", PRODUCT, REQUIRED), ("B", PRODUCT, REQUIRED), execute=swap),
        A=bench.product, B=bench.other_product)  # fmt: skip
    (change,) = changes
    assert {e.id for e in change.elements} == {bench.product.id, bench.other_product.id}


@rule("blackboard", "At its preemption a skill has the present values in `onPreempt`, and passes its own on")
def test_preemption(bench):
    seen = []

    def stop(self):
        seen.append(self.params["Speed"].value)
        self.params["Stopped"].value = True
        return State.Failure

    params = (("Speed", int, OPTIONAL), ("Stopped", bool, OPTIONAL))

    def expand(self, skill):
        skill.setProcessor(ParallelFf())
        skill(self.skill("Move"), self.skill("Fail"))

    def fail(self):
        self.params["Speed"].value = 0
        return self.fail("no", 1)

    bench.load(primitive("Move", *params, execute=lambda s: s.step(), onPreempt=stop),
               primitive("Fail", params[0], execute=fail), compound("Both", expand))  # fmt: skip
    task = bench.run(bench.node("Both"), Speed=5)
    assert seen == [0]
    assert task.blackboard["Stopped"] is True


@rule("blackboard", "Skills of one start request share the blackboard; what each was given it keeps")
def test_skills_of_one_request_share_the_blackboard(bench):
    params = (("Text", str, OPTIONAL), ("Note", str, OPTIONAL))
    note = primitive(
        "Note", *params, execute=does(lambda s: setattr(s.params["Note"], "value", s.params["Text"].value))
    )
    bench.load(
        note,
        primitive("Tell", *params, execute=lambda s: s.success(f"{s.params['Text'].value} {s.params['Note'].value}")),
    )
    task = bench.commands(("Note", "", {"Text": "first"}), ("Tell", "", {"Text": "second"})).run()
    assert message(task, "Tell") == "second first"


@rule("blackboard", "A compound's own `execute` comes after its children have ended, with what they have left")
def test_a_compound_executes_after_its_children(bench):
    seen = []
    text = ("Text", str, OPTIONAL)

    def put(self):
        self.params["Text"].value = "made"
        return self.step() if self.progress_code < 2 else self.success()

    bench.load(
        primitive("Put", text, execute=put),
        compound("Both", lambda self, skill: skill(self.skill("Put")), text,
                 execute=lambda self: seen.append(self.params["Text"].value)),
    )  # fmt: skip
    assert bench.run(bench.node("Both")).state is State.Success
    assert seen == ["made"]


# -- inferred values ---------------------------------------------------------------------------------------------------

TAKE = (("Container", BOX, INFERRED), ("Object", PRODUCT, REQUIRED))


@rule("blackboard", "An inferred value is there for an Optional parameter of a later skill")
def test_an_optional_parameter_takes_an_inferred_value(bench):
    task = run(
        bench,
        primitive("Take", *TAKE, pre=[CONTAINS]),
        primitive("Tell", ("Container", BOX, OPTIONAL), execute=tells("Container")),
        Object=bench.other_product,
    )
    assert message(task, "Tell") == f"['{bench.other_tray.id}']"


@rule("blackboard", "An inferred value is there for a Required or Inferred parameter of a later skill",
      better="it is the first candidate; where the conditions do not hold with it another is found, "
             "so that no stale value stays")  # fmt: skip
def test_an_inferred_value_is_the_first_candidate(bench):
    third = bench.add("skiros:LargeBox", "third tray")
    bench.add("skiros:Product", "spare", third)
    bench.load(
        primitive("Take", *TAKE, pre=[CONTAINS], execute=tells("Container")),
        primitive("Again", ("Container", BOX, REQUIRED), execute=tells("Container")),
    )
    first = bench.node("Take", Object=bench.element("spare"))
    second = bench.node("Take", Object=bench.other_product)
    again = bench.node("Again")
    assert bench.run(first, bench.node("Again"), second, again).state is State.Success
    assert first.parent.children[1].progress_msg == f"['{third.id}']"
    assert second.progress_msg == again.progress_msg == f"['{bench.other_tray.id}']"


@rule(
    "blackboard", "An ancestor's parameter without a value takes what a child has inferred, before its post-conditions"
)
def test_ancestor_pulls_an_inferred_value_of_a_child(bench):
    bench.load(
        primitive("Take", *TAKE, pre=[CONTAINS]),
        compound("Both", lambda self, skill: skill(self.skill("Take")), ("Container", BOX, OPTIONAL),
                 post=[lambda d: d.getIsSpecifiedCond("Known", "Container", True)]),
    )  # fmt: skip
    task = bench.run(bench.node("Both"), Object=bench.other_product)
    assert task.state is State.Success, task.why
    assert task.node("Both").params["Container"].value.id == bench.other_tray.id


@rule("blackboard", "A planned value of an Inferred parameter is fixed",
      differs="it is the first candidate, and replaced where the pre-conditions do not hold with it")  # fmt: skip
def test_a_planned_value_is_a_first_candidate(bench):
    from skiros2_common.core.params import ParamHandler

    bench.load(primitive("Take", *TAKE, pre=[CONTAINS], execute=tells("Container")))
    planned = ParamHandler()
    planned.addParam("Container", bench.tray, INFERRED)
    planned.addParam("Object", bench.product, REQUIRED)
    node, other = bench.node("Take"), bench.node("Take")
    node.specifyParamsDefault(planned)
    planned.specify("Object", bench.other_product)
    other.specifyParamsDefault(planned)
    assert bench.run(node, other).state is State.Success
    assert (node.progress_msg, other.progress_msg) == (f"['{bench.tray.id}']", f"['{bench.other_tray.id}']")


@rule("blackboard", "A key that a skill has unset is inferred again by the next",
      better="the standard skill `Forget` does that in the middle of a tree")  # fmt: skip
def test_unset_infers_again(bench):
    bench.import_libraries("skiros2_std_skills")
    bench.load(primitive("Take", *TAKE, pre=[CONTAINS], execute=tells("Container")))
    forget = bench.node("Forget", remap={"Value": "Container"})
    task = bench.run(forget, bench.node("Take"), Container=bench.tray, Object=bench.other_product)
    assert message(task, "Take") == f"['{bench.other_tray.id}']"


# -- remaps to nowhere -------------------------------------------------------------------------------------------------


@rule("blackboard", "A Required parameter that is remapped to a key which nothing provides is inferred",
      differs="the start fails and names the key and the nearest one")  # fmt: skip
def test_a_remap_to_nowhere_is_not_inferred(bench):
    go = ("To", BOX, REQUIRED)
    bench.load(
        primitive("Go", go),
        compound(
            "Bring", lambda self, skill: skill(self.skill("Go", remap={"To": "Taget"})), ("Target", BOX, OPTIONAL)
        ),
    )
    task = bench.run(bench.node("Bring"))
    assert task.state is State.Failure
    assert "parameter 'To' is remapped to 'Taget'" in task.why and "near: Target" in task.why


@rule("blackboard", "A Required parameter that is remapped to a sibling's key is inferred")
def test_a_remap_to_a_sibling_s_key_is_inferred(bench):
    go = ("To", BOX, REQUIRED)
    bench.load(
        primitive("Go", go),
        compound("Bring", lambda self, skill: skill(*(self.skill("Go", remap={"To": "Dock"}) for _ in range(2)))),
    )
    assert bench.run(bench.node("Bring")).state is State.Success


@rule("blackboard", "`self.params` of a node hold what was assigned, after its end too")
def test_values_remain_after_the_end(bench):
    task = run(
        bench,
        primitive("Put", ("Text", str, OPTIONAL), execute=does(lambda s: setattr(s.params["Text"], "value", "made"))),
    )
    assert task.node("Put").params["Text"].value == "made"


@rule("blackboard", "Each start of a node begins with its defaults again")
def test_each_start_begins_with_the_defaults(bench):
    seen = []

    def count(self):
        seen.append(self.params["Number"].value)
        self.params["Number"].value += 1
        return self.fail("again", 1) if len(seen) < 3 else self.success()

    def expand(self, skill):
        skill.setProcessor(RetryOnFail(-1))
        skill(self.skill("Count"))

    bench.load(primitive("Count", ("Number", 0, REQUIRED), execute=count), compound("Try", expand))
    bench.run(bench.node("Try"))
    assert seen == [0, 0, 0]


@rule("blackboard", "A library in which producers append, consumers pop, and detected elements are handed on")
def test_a_library_hands_values_on(skill_bench, monkeypatch):
    monkeypatch.syspath_prepend(LIBRARIES)
    furnish(skill_bench)
    task = skill_bench.command("TakeStock", Container=skill_bench.element("table")).run()
    assert task.state is State.Success, task.why
    assert task.blackboard["Sorted"] == {"bolt": 0, "nut": 1, "washer": 2}
    assert skill_bench.element("detected").value_of("skiros:Weight") == 0.5
    assert skill_bench.holder("detected") == "table"
