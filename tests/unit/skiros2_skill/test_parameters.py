"""Parameters of running skills: from the blackboard, back to it, and found from the conditions. Contract, 2 and 5."""

import pytest

from skiros2_common.core.abstract_skill import ParamOptions, State
from skiros2_common.core.world_element import Element
from skiros2_skill.core.skill import ParallelFf, SkillBase
from unit.skiros2_skill.skills import (
    CONTAINER,
    INFERRED,
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


def tell(key):
    """An `execute` that reports a parameter's value."""
    return lambda self: self.success(str(self.params[key].value))


def put(key, value):
    """An `execute` that sets a parameter."""

    def execute(self):
        self.params[key].value = value
        return self.success()

    return execute


Produce = describe("Produce", [("Text", str, OPTIONAL, [ParamOptions.Output])])


def compound(name, expand, params=()):
    """A compound class with this `expand`."""
    description = describe(name, params)
    return type(
        name.lower(),
        (SkillBase,),
        {
            "createDescription": lambda self: self.setDescription(description(), name.lower()),
            "expand": lambda self, skill: expand(self, skill),
        },
    )


def messages(task):
    return [node.progress_msg for node in task.nodes()]


# -- the blackboard ----------------------------------------------------------------------------------------------------


def test_parameter_declared_by_a_type_pulls_the_blackboard_value(bench):
    bench.load(primitive(Note, "note", execute=tell("Text")))
    assert "from above" in messages(bench.run(bench.node("note"), Text="from above"))


def test_parameter_with_a_default_keeps_it(bench):
    bench.load(primitive(Speak, "speak", execute=tell("Text")))
    assert "hello" in messages(bench.run(bench.node("speak"), Text="from above"))


def test_parameter_with_an_abstract_element_pulls_the_blackboard_value(bench):
    hold = describe("Hold", [("Object", Element("skiros:Product"), REQUIRED)])
    bench.load(primitive(hold, "hold", execute=lambda s: s.success(s.params["Object"].value.id)))
    assert bench.other_product.id in messages(bench.run(bench.node("hold"), Object=bench.other_product))


def test_removed_element_on_the_blackboard_is_unset_at_start(bench):
    hold = describe("Hold", [("Object", Element("skiros:Product"), OPTIONAL)])
    bench.load(
        primitive(hold, "hold", execute=lambda s: s.success(str(s.params.isSpecified("Object")))),
        primitive(describe("Eat"), "eat", execute=lambda s: s.wmi.remove_element(bench.product.id) and s.success()),
    )
    task = bench.run(bench.node("eat"), bench.node("hold"), Object=bench.product)
    assert task.state is State.Success
    assert "False" in messages(task)


def test_specified_parameter_keeps_its_value(bench):
    bench.load(primitive(Note, "note", execute=tell("Text")))
    assert "fixed" in messages(bench.run(bench.node("note", Text="fixed"), Text="from above"))


def test_output_of_a_child_reaches_its_siblings(bench):
    bench.load(
        primitive(Produce, "produce", execute=put("Text", "made")), primitive(Note, "note", execute=tell("Text"))
    )
    assert "made" in messages(bench.run(bench.node("produce"), bench.node("note")))


def test_output_of_a_child_reaches_its_parent_and_the_parents_siblings(bench):
    bench.load(
        primitive(Produce, "produce", execute=put("Text", "made")),
        primitive(Note, "note", execute=tell("Text")),
        compound("Make", lambda self, skill: skill(self.skill("Produce")), [("Text", str, OPTIONAL)]),
    )
    task = bench.run(bench.node("make"), bench.node("note"))
    assert task.root.children[0].params.getParamValue("Text") == "made"
    assert "made" in messages(task)


def test_specified_value_of_a_succeeded_skill_reaches_its_siblings(bench):
    bench.load(primitive(Note, "first"), primitive(Note, "note", execute=tell("Text")))
    assert "fixed" in messages(bench.run(bench.node("first", Text="fixed"), bench.node("note")))


def test_running_skill_pulls_the_value_of_a_parallel_sibling(bench):
    def wait_for_text(self):
        text = self.params["Text"].value
        return self.step("waiting") if text is None else self.success(text)

    bench.load(
        primitive(Note, "note", execute=wait_for_text),
        primitive(Produce, "produce", execute=lambda s: put("Text", "late")(s) if s.progress_code > 1 else s.step()),
        compound(
            "Both",
            lambda self, skill: (
                skill.setProcessor(ParallelFf()),
                skill(self.skill("Note"), self.skill("Produce")),
            ),
        ),
    )
    task = bench.run(bench.node("both"))
    assert task.state is State.Success
    assert "late" in messages(task)


def test_unset_value_is_removed_from_the_blackboard(bench):
    def unset(self):
        self.params["Text"].unset()
        return self.success()

    bench.load(primitive(Produce, "forget", execute=unset), primitive(Note, "note", execute=tell("Text")))
    assert "None" in messages(bench.run(bench.node("forget"), bench.node("note"), Text="secret"))


# -- remaps ------------------------------------------------------------------------------------------------------------


def test_remap_targets_the_parents_key(bench):
    bench.load(
        primitive(Note, "note", execute=tell("Text")),
        compound("Say", lambda self, skill: skill(self.skill("Note", "note", remap={"Text": "Words"})),
                 [("Words", str, REQUIRED)]),
    )  # fmt: skip
    assert "hi" in messages(bench.run(bench.node("say", Words="hi")))


def test_remaps_apply_through_several_levels(bench):
    bench.load(
        primitive(Produce, "produce", execute=put("Text", "deep")),
        primitive(Note, "note", execute=tell("Text")),
        compound(
            "Inner", lambda self, skill: skill(self.skill("Produce", remap={"Text": "A"})), [("A", str, OPTIONAL)]
        ),
        compound("Middle", lambda self, skill: skill(self.skill("Inner", remap={"A": "B"})), [("B", str, OPTIONAL)]),
    )
    task = bench.run(bench.node("middle", remap={"B": "C"}), bench.node("note", remap={"Text": "C"}))
    assert "deep" in messages(task)


def test_remap_swaps_two_keys(bench):
    two = [("A", str, REQUIRED), ("B", str, REQUIRED)]
    bench.load(
        primitive(describe("Two", two), "two", execute=lambda s: s.success(s.params["A"].value + s.params["B"].value)),
        compound("Swap", lambda self, skill: skill(self.skill("Two", remap={"A": "B", "B": "A"})), two),
    )
    assert "ba" in messages(bench.run(bench.node("swap", A="a", B="b")))


def test_remap_applies_to_a_descendants_key(bench):
    bench.load(
        primitive(Note, "note", execute=tell("Text")),
        compound("Inner", lambda self, skill: skill(self.skill("Note"))),
        compound("Outer", lambda self, skill: skill(self.skill("Inner", remap={"Text": "Words"})),
                 [("Words", str, REQUIRED)]),
    )  # fmt: skip
    assert "through" in messages(bench.run(bench.node("outer", Words="through")))


def test_specify_uses_remapped_keys(bench):
    bench.load(
        primitive(Note, "note", execute=tell("Text")),
        compound(
            "Say", lambda self, skill: skill(self.skill("Note", "", remap={"Text": "Words"}, specify={"Words": "x"}))
        ),
    )
    assert "x" in messages(bench.run(bench.node("say")))


def test_empty_string_is_no_remap(bench):
    bench.load(
        primitive(Speak, "speak", execute=tell("Text")),
        compound("Say", lambda self, skill: skill(self.skill("Speak", "", "", {"Text": "y"}))),
    )
    assert "y" in messages(bench.run(bench.node("say")))


# -- wrong parameters --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("given", "named"),
    [({"Txt": "x"}, "no parameter 'Txt'; near: Text"), ({"Text": 5}, "Text: expected a value of type str")],
)
def test_unknown_key_or_wrong_type_in_specify_is_logged(bench, caplog, given, named):
    bench.load(primitive(Speak, "speak", execute=tell("Text")))
    with caplog.at_level("ERROR"):
        task = bench.run(bench.node("speak", **given))
    assert named in caplog.text
    assert "hello" in messages(task)


def test_element_of_a_different_class_is_accepted(bench):
    bench.load(primitive(describe("Hold", [OBJECT]), "hold"))
    node = bench.node("hold", Object=bench.tray)
    assert bench.run(node).state is State.Success
    bench.load(primitive(describe("Hold", [("Object", Element("skiros:LargeBox"), REQUIRED)]), "hold_box"))
    assert [bench.run(bench.node("Hold", Object=e)).root.children[0].label for e in (bench.tray, bench.product)] == [
        "hold_box",
        "hold",
    ]


@pytest.mark.parametrize("any_type", [Element(), Element(""), Element])
def test_parameter_of_any_class_accepts_any_element(bench, any_type):
    hold = describe("Hold", [("Object", any_type, REQUIRED)])
    bench.load(primitive(hold, "hold", execute=lambda s: s.success(s.params["Object"].value.id)))
    assert bench.tray.id in messages(bench.run(bench.node("hold", Object=bench.tray)))


# -- inference ---------------------------------------------------------------------------------------------------------


def test_inferred_parameter_satisfies_the_pre_conditions(bench):
    bench.load(primitive(Take, "take", execute=lambda s: s.success(s.params["Container"].value.id)))
    assert bench.other_tray.id in messages(bench.run(bench.node("take", Object=bench.other_product)))


def test_unset_parameters_are_inferred_together(bench):
    heavy = bench.add("skiros:Product", "heavy", bench.other_tray, Weight=9.0)
    take_heavy = describe(
        "TakeHeavy",
        [CONTAINER, OBJECT],
        pre=[contains(), lambda d: d.getPropCond("Heavy", "skiros:Weight", "Object", ">", 5.0, True)],
    )
    bench.load(
        primitive(
            take_heavy,
            "take",
            execute=lambda s: s.success(f"{s.params['Container'].value.id} {s.params['Object'].value.id}"),
        )
    )
    assert f"{bench.other_tray.id} {heavy.id}" in messages(bench.run(bench.node("take")))


def test_inference_prefers_elements_on_the_blackboard(bench):
    bench.load(primitive(describe("Hold", [OBJECT]), "hold", execute=lambda s: s.success(s.params["Object"].value.id)))
    task = bench.run(bench.node("hold"), Something=bench.other_product)
    assert bench.other_product.id in messages(task)


def test_candidates_are_tried_in_order_of_ids(bench):
    products = [bench.add("skiros:Product", "p", bench.tray) for _ in range(12)]
    for element in (bench.product, bench.other_product):
        bench.wmi.remove_element(element)
    bench.load(primitive(Take, "take", execute=lambda s: s.success(s.params["Object"].value.id)))
    assert min(products, key=lambda p: p.getIdNumber()).id in messages(bench.run(bench.node("take")))


def test_inference_failure_names_the_rejecting_condition(bench):
    empty = bench.add("skiros:LargeBox", "empty")
    bench.load(primitive(Take, "take"))
    node = bench.node("take", Container=empty)
    assert bench.run(node).state is State.Failure
    assert (
        f"parameter 'Object': 2 skiros:Product in the scene, none with {empty!r} skiros:contain it [Contains] "
        f"({bench.product!r}: {bench.tray!r} skiros:contain it; "
        f"{bench.other_product!r}: {bench.other_tray!r} skiros:contain it)"
    ) in node.progress_msg


def test_inference_failure_names_a_class_without_elements(bench):
    bench.load(primitive(describe("Watch", [("Camera", Element("skiros:DepthCamera"), REQUIRED)]), "watch"))
    node = bench.node("watch")
    bench.run(node)
    assert "no skiros:DepthCamera in the scene for parameter 'Camera'" in node.progress_msg


def test_restarted_skill_infers_again(bench):
    bench.load(primitive(Take, "take", execute=lambda s: s.success(s.params["Container"].value.id)))
    first = bench.run(bench.node("take", Object=bench.product))
    bench.wmi.set_relation(bench.tray.id, "skiros:contain", bench.product.id, False)
    bench.wmi.set_relation(bench.other_tray.id, "skiros:contain", bench.product.id, True)
    second = bench.run(bench.node("take", Object=bench.product))
    assert bench.tray.id in messages(first)
    assert bench.other_tray.id in messages(second)


def test_children_pull_values_inferred_by_their_compound(bench):
    class Fetch(SkillBase):
        def createDescription(self):
            self.setDescription(Take(), "fetch")

        def expand(self, skill):
            skill(self.skill("Look", "look"))

    look = describe("Look", [("Container", Element("skiros:Container"), OPTIONAL)])
    bench.load(primitive(look, "look", execute=lambda s: s.success(s.params["Container"].value.id)), Fetch)
    assert bench.other_tray.id in messages(bench.run(bench.node("fetch", Object=bench.other_product)))


def test_robot_is_that_of_the_manager(bench):
    first = bench.robot
    bench.robot = bench.add("cora:Robot", "skiros:other_robot")
    bench.load(primitive(Work, "work", execute=lambda s: s.success(s.params["Robot"].value.id)))
    task = bench.run(bench.node("work"))
    assert bench.robot.id in messages(task)
    assert first.id not in messages(task)


def test_given_robot_replaces_that_of_the_manager(bench):
    other = bench.add("cora:Robot", "skiros:other_robot")
    bench.load(primitive(Work, "work", execute=lambda s: s.success(s.params["Robot"].value.id)))
    assert other.id in messages(bench.run(bench.node("work", Robot=other)))


def test_robot_updated_by_a_sibling_is_refreshed(bench):
    other = bench.add("cora:Robot", "skiros:other_robot")

    def change(self):
        if self.progress_code == 1:
            self.params["Robot"].value = self.wmi.get_element(other.id)
        return self.step() if self.progress_code < 3 else self.success()

    def see(self):
        return self.step() if self.progress_code < 3 else self.success(self.params["Robot"].value.id)

    def expand(self, skill):
        skill.setProcessor(ParallelFf())
        skill(self.skill("Change"), self.skill("See"))

    bench.load(
        primitive(describe("Change"), "change", execute=change),
        primitive(describe("See"), "see", execute=see),
        compound("Both", expand),
    )
    assert other.id in messages(bench.run(bench.node("both")))


# -- expansion ---------------------------------------------------------------------------------------------------------


def test_expand_reads_the_given_values(bench):
    def expand(self, skill):
        for _ in range(self.params["Times"].value):
            skill(self.skill("Work", "work"))

    bench.load(primitive(Work, "work"), compound("Repeat", expand, [("Times", int, REQUIRED)]))
    assert len(bench.run(bench.node("repeat", Times=3)).root.children[0].children) == 3


def test_expand_sets_its_own_processor(bench):
    def expand(self, skill):
        self.setProcessor(ParallelFf())
        skill(self.skill("Work", "work"), self.skill("Work", "work"))

    bench.load(primitive(Work, "work", execute=running_for(2)), compound("Both", expand))
    task = bench.task(bench.node("both"))
    task.tick()
    assert [c.state for c in task.root.children[0].children] == [State.Running, State.Running]


@pytest.mark.parametrize(("anew", "expansions"), [(False, 1), (True, 2)])
def test_expand_on_start_expands_at_each_start(bench, anew, expansions):
    count = []

    class Twice(SkillBase):
        def createDescription(self):
            self.setDescription(describe("Twice")(), "twice")
            self._expand_on_start = anew

        def expand(self, skill):
            count.append(1)
            skill(self.skill("Fail", "fail"))

    from skiros2_skill.core.skill import RetryOnFail, Skill

    bench.load(primitive(describe("Fail"), "fail", execute=lambda s: s.fail("no", 1)), Twice)
    bench.run(Skill("", RetryOnFail(1))(bench.node("twice")))
    assert len(count) == expansions


def test_execute_of_a_compound_runs_after_its_children(bench):
    seen = []

    class Watching(SkillBase):
        def createDescription(self):
            self.setDescription(describe("Watching")(), "watching")

        def expand(self, skill):
            skill(self.skill("Work", "work"))

        def execute(self):
            seen.append(self.progress_code)

    bench.load(primitive(Work, "work", execute=running_for(2)), Watching)
    assert bench.run(bench.node("watching")).state is State.Success
    assert len(seen) == 1


def test_implementation_narrows_its_description(bench):
    class take_starter(primitive(Take, "base")):
        def createDescription(self):
            self.setDescription(Take(), "take_starter")
            self.addParam("Object", Element("skiros:Starter"), REQUIRED)

    starter = bench.add("skiros:Starter", "starter", bench.tray)
    bench.load(take_starter)
    assert bench.library.by_label("take_starter").declared.params["Object"].element_type == "skiros:Starter"
    node = bench.node("take_starter")
    bench.run(node)
    assert node.params.getParamValue("Object").id == starter.id


def test_modify_description_adds_parameters_and_conditions(bench):
    class work(primitive(Work, "base")):
        def createDescription(self):
            self.setDescription(Work(), "work")

        def modifyDescription(self, skill):
            skill.addParam("Container", Element("skiros:LargeBox"), INFERRED)
            skill.addPreCondition(self.getPropCond("Empty", "skiros:ContainerState", "Container", "=", "Empty", True))

    bench.load(work)
    node = bench.node("work")
    bench.run(node)
    assert "2 skiros:LargeBox in the scene, none with skiros:ContainerState = 'Empty'" in node.progress_msg
