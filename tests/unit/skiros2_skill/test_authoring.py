"""What authors declare and build: descriptions, implementations, options of parameters, trees. Contract, 2 and 4."""

import itertools

import pytest

from skiros2_common.core.abstract_skill import ParamOptions, SkillDescription, State
from skiros2_common.core.conditions import ConditionOnType
from skiros2_common.core.errors import ConfigurationError, UnknownName
from skiros2_common.core.params import ParamTypes
from skiros2_common.core.primitive import PrimitiveBase
from skiros2_common.core.world_element import Element
from skiros2_skill.core.library.library import SkillLibrary
from skiros2_skill.core.skill import (
    NoFail,
    ParallelFf,
    ParallelFs,
    RetryOnFail,
    Selector,
    SelectorStar,
    Sequential,
    Serial,
    SerialStar,
    Skill,
    SkillBase,
    SkillWrapper,
)
from skiros2_world_model.core.local_world_model import LocalWorldModel
from unit.skiros2_skill.conftest import Workbench
from unit.skiros2_skill.skills import (
    CONTAINER,
    INFERRED,
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


def declared(bench, cls):
    """What an implementation declares once it is loaded."""
    bench.load(cls)
    return bench.library.implementations()[-1].declared


def tree(name, expand, params=(), **body):
    """A compound class labelled as its description in lower case."""
    description = describe(name, params)
    body["createDescription"] = lambda self: self.setDescription(description(), name.lower())
    body["expand"] = expand
    return type(name.lower(), (SkillBase,), body)


def messages(task):
    return [node.progress_msg for node in task.nodes()]


# -- parameters --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("value", "datatype", "values"),
    [
        (0.5, float, [0.5]),
        (float, float, []),
        ([1, 2, 3], int, [1, 2, 3]),
        (True, bool, [True]),
        ({"a": 1}, dict, [{"a": 1}]),
        (dict, dict, []),
        (list, list, []),
        ("text", str, ["text"]),
    ],
)
def test_parameter_is_declared_by_a_default_a_type_or_a_list(value, datatype, values):
    description = SkillDescription()
    description.addParam("Key", value, ParamTypes.Optional)
    param = description.params["Key"]
    assert (param.dataType(), param.values, param.defaults) == (datatype, values, values)


def test_list_of_mixed_types_is_not_a_default():
    with pytest.raises(ValueError, match="Key"):
        SkillDescription().addParam("Key", [1, "two"], ParamTypes.Optional)


def test_skill_has_robot_unless_it_declares_its_own(bench):
    own = describe("Own", [("Robot", Element("cora:Robot"), REQUIRED)])
    robot = declared(bench, primitive(Work, "work")).params["Robot"]
    assert (robot.default.type, robot.paramType) == ("sumo:Agent", INFERRED)
    robot = declared(bench, primitive(own, "own")).params["Robot"]
    assert (robot.default.type, robot.paramType) == ("cora:Robot", REQUIRED)


def test_text_in_place_of_the_options_is_the_description(bench):
    work = declared(bench, primitive(describe("Say", [("Text", str, OPTIONAL, "What to say")]), "say"))
    assert work.params["Text"].description == "What to say"
    assert work.options == {}


def test_keys_may_contain_spaces_and_slashes(bench):
    say = describe("Say", [("what/to say", "hi", REQUIRED)])
    bench.load(primitive(say, "say it/now", execute=lambda s: s.success(s.params["what/to say"].value)))
    node = SkillWrapper("Say", "say it/now", bench.library)
    node.specifyParamDefault("what/to say", "bye")
    bench.run(node)
    assert node.progress_msg == "bye"


def test_redeclared_key_is_redefined_with_its_options(bench):
    class work(PrimitiveBase):
        def createDescription(self):
            self.setDescription(describe("Hold", [(*CONTAINER, [ParamOptions.Consume])])(), "work")
            self.addParam("Container", Element("skiros:LargeBox"), OPTIONAL)

    hold = declared(bench, work)
    assert hold.params["Container"].element_type == "skiros:LargeBox"
    assert hold.options == {}
    # The conditions that an option added belong to the description: they stay as it was described.
    assert [c.getKeys() for c in hold.post_conditions] == [["Container"]]


def test_on_start_redefines_a_parameter(bench):
    def on_start(self):
        self.addParam("Text", 7, OPTIONAL)
        return True

    say = describe("Say", [("Text", "words", OPTIONAL)])
    bench.load(primitive(say, "say", onStart=on_start, execute=lambda s: s.success(str(s.params["Text"].value))))
    assert "7" in messages(bench.run(bench.node("say")))
    assert "7" in messages(bench.run(bench.node("say")))  # and each time anew
    assert bench.library.by_label("say").declared.params["Text"].value == "words"


# -- options of parameters ---------------------------------------------------------------------------------------------


def test_consume_requires_element_removed_at_end(bench):
    eat = describe("Eat", [(*OBJECT, [ParamOptions.Consume])])
    bench.load(
        primitive(eat, "eat", execute=lambda s: s.wmi.remove_element(s.params["Object"].value) and s.success()),
        primitive(eat, "fast"),
    )
    assert bench.run(bench.node("eat", Object=bench.product)).state is State.Success
    fast = bench.run(bench.node("fast", Object=bench.other_product))
    assert fast.state is State.Failure
    assert "Post-condition failed: [ConsumeObject]" in fast.root.progress_msg


def test_unspecify_requires_parameter_unset_at_end(bench):
    drop = describe("Drop", [(*OBJECT, [ParamOptions.Unspecify])])
    bench.load(
        primitive(drop, "drop", execute=lambda s: s.params["Object"].unset() or s.success()), primitive(drop, "keep")
    )
    assert bench.run(bench.node("drop", Object=bench.product)).state is State.Success
    assert "Post-condition failed" in bench.run(bench.node("keep", Object=bench.product)).root.progress_msg


def test_lock_requires_idle_device_before_and_after(bench):
    hold = declared(
        bench, primitive(describe("Hold", [("Arm", Element("rparts:ArmDevice"), REQUIRED, [ParamOptions.Lock])]))
    )
    told = [
        [(c._owl_label, c._operator, c._value, c._desired_state) for c in some]
        for some in (hold.pre_conditions, hold.hold_conditions, hold.post_conditions)
    ]
    idle = ("skiros:StateProperty", "=", "Idle")
    assert told == [[(*idle, True)], [(*idle, False)], [(*idle, True)]]


def test_respect_type_requires_class_of_default(bench):
    hold = declared(bench, primitive(describe("Hold", [(*OBJECT, [ParamOptions.RespectType])])))
    (condition,) = hold.pre_conditions
    assert isinstance(condition, ConditionOnType)
    assert condition.getDescription().endswith("is a skiros:Product")


def test_output_parameters_are_listed(bench):
    made = declared(bench, primitive(describe("Make", [("Made", str, OPTIONAL, [ParamOptions.Output]), CONTAINER])))
    assert list(made.getOutputParams()) == ["Made"]


def test_one_option_needs_no_list(bench):
    made = declared(bench, primitive(describe("Make", [("Made", str, OPTIONAL, ParamOptions.Output)])))
    assert list(made.getOutputParams()) == ["Made"]


# -- descriptions and implementations ----------------------------------------------------------------------------------


def test_description_without_create_description_is_empty(bench):
    class Rest(SkillDescription):
        pass

    rest = declared(bench, primitive(Rest, "rest"))
    assert (rest.type, list(rest.params.keys())) == ("skiros:Rest", ["Robot"])
    assert bench.run(bench.node("rest")).state is State.Success


def test_default_label_is_the_class_name(bench):
    class my_work(PrimitiveBase):
        def createDescription(self):
            self.setDescription(Work())

    assert declared(bench, my_work).label == "my_work"


def test_labels_differ_in_case(bench):
    bench.load(primitive(Work, "Work it"), primitive(Work, "work it"))
    assert {i.label for i in bench.library.implementations()} == {"Work it", "work it"}
    with pytest.raises(ConfigurationError, match="labels have to differ"):
        bench.load(primitive(Work, "work it"))


def test_implementation_may_extend_its_description(bench):
    class take(PrimitiveBase):
        def createDescription(self):
            self.setDescription(Take(), "take")
            self.addParam("Force", 5.0, OPTIONAL)
            self.addPreCondition(self.getPropCond("Light", "skiros:Weight", "Object", "<", 2.0, True))
            self.addHoldCondition(contains()(self))
            self.addPostCondition(self.getPropCond("Heavy", "skiros:Weight", "Object", ">", 9.0, True))

        def execute(self):
            return self.success()

    element = declared(bench, take).toElement()
    children = [(predicate, child.label) for _, predicate, child in element.local_relations]
    for relation, label in (
        ("skiros:hasParam", "Object"),
        ("skiros:hasPreCondition", "Light"),
        ("skiros:hasHoldCondition", "Contains"),
        ("skiros:hasPostCondition", "Heavy"),
    ):
        assert (relation, label) in children
    task = bench.run(bench.node("take", Object=bench.add("skiros:Product", "nail", bench.tray, Weight=1.0)))
    assert "Post-condition failed: [Heavy]" in task.root.progress_msg


def test_two_implementations_of_one_description_share_nothing(bench):
    class narrow(primitive(Take, "narrow")):
        def createDescription(self):
            self.setDescription(Take(), "narrow")
            self.addParam("Object", Element("skiros:Starter"), REQUIRED)
            self.pre_conditions.clear()

    bench.load(narrow, primitive(Take, "wide"))
    wide = bench.library.by_label("wide").declared
    assert wide.params["Object"].element_type == "skiros:Product"
    assert len(wide.pre_conditions) == 1


def test_world_model_is_available_while_a_skill_is_loaded(bench):
    seen = []

    class work(PrimitiveBase):
        def createDescription(self):
            self.setDescription(Work(), "work")

        def onInit(self):
            seen.extend((self.wmi, self._wmi))

    bench.load(work)
    assert seen[:2] == [bench.wmi, bench.wmi]


# -- choosing ----------------------------------------------------------------------------------------------------------


def either(bench, **hooks):
    """Loads two implementations of `Either`, `first` and `second`."""
    either = describe("Either")
    bench.load(primitive(either, "first", **hooks), primitive(either, "second", **hooks))


def any_either(bench):
    return SkillWrapper("Either", "", bench.library)


def test_free_implementation_is_selected_before_running_one(bench):
    either(bench, execute=running_for(2))
    nodes = [any_either(bench) for _ in range(3)]
    task = bench.run(Skill("", ParallelFf())(*nodes))
    assert task.state is State.Success
    assert [n.label for n in nodes][:2] == ["first", "second"]


def test_first_implementation_is_selected_again_after_its_end(bench):
    either(bench)
    nodes = [any_either(bench) for _ in range(3)]
    bench.run(*nodes)
    assert [n.label for n in nodes] == ["first"] * 3


def test_ended_compound_is_free(bench):
    description = describe("Either")
    bench.load(primitive(Work, "work"))
    for label in ("first", "second"):
        body = {
            "createDescription": lambda self, label=label: self.setDescription(description(), label),
            "expand": lambda self, skill: skill(self.skill("Work")),
        }
        bench.load(type(label, (SkillBase,), body))
    nodes = [any_either(bench) for _ in range(2)]
    bench.run(*nodes)
    assert [n.label for n in nodes] == ["first", "first"]


def test_requested_label_is_never_replaced(bench):
    never = describe("Never", [("Container", Element("skiros:LargeBox"), REQUIRED)])

    def create(self):
        self.setDescription(never(), "never")
        self.addPreCondition(self.getPropCond("No", "skiros:Weight", "Container", ">", 1e9, True))

    bench.load(type("never", (primitive(never),), {"createDescription": create}), primitive(never, "always"))
    assert bench.run(SkillWrapper("Never", "never", bench.library)).state is State.Failure
    node = SkillWrapper("Never", "", bench.library)
    assert bench.run(node).state is State.Success
    assert node.label == "always"


@pytest.mark.parametrize("written", ["Work", ":Work", "skiros:Work"])
def test_type_is_written_in_three_ways(bench, written):
    bench.load(primitive(Work, "work"), tree("Top", lambda self, skill: skill(self.skill(written, "work"))))
    assert bench.run(bench.node("top")).state is State.Success


def test_unlisted_skill_is_loaded_from_library():
    library = SkillLibrary(LocalWorldModel("test"))
    library.import_libraries(["skiros2_std_skills"])
    assert library.implementations() == []
    assert [i.label for i in library.candidates("Wait", "wait")] == ["wait"]
    assert {i.label for i in library.candidates("WmMoveObject", "")} == {
        "wm_move_object",
        "wm_move_and_transform_object",
    }
    with pytest.raises(UnknownName):
        library.candidates("Wait", "Wait")


# -- trees -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "processor",
    [Serial(), SerialStar(), Sequential(), Selector(), SelectorStar(), ParallelFf(), ParallelFs(),
     NoFail(Sequential()), RetryOnFail(), RetryOnFail(3), NoFail(RetryOnFail(1))],
    ids=lambda p: p.printType(),
)  # fmt: skip
def test_each_processor_groups_nodes_in_a_tree(bench, processor):
    def expand(self, skill):
        skill(self.skill(processor)(self.skill("Work", "work"), self.skill(ParallelFf())(self.skill("Work", "work"))))

    bench.load(primitive(Work, "work", execute=running_for(2)), tree("Top", expand))
    task = bench.run(bench.node("top"))
    assert task.state is State.Success
    assert task.root.children[0].children[0].processor.printType() == processor.printType()


def test_default_processor_is_sequential(bench):
    order = itertools.count()
    bench.load(
        primitive(Work, "work", execute=lambda self: self.success(str(next(order)))),
        tree("Top", lambda self, skill: skill(self.skill("Work"), self.skill("Work"), self.skill("Work"))),
    )
    top = bench.run(bench.node("top")).root.children[0]
    assert [c.progress_msg for c in top.children] == ["0", "1", "2"]
    assert top.processor.printType() == "->*"


def test_one_processor_object_serves_several_nodes(bench):
    shared = Sequential()

    def expand(self, skill):
        skill.setProcessor(shared)
        skill(self.skill(shared)(self.skill("Work")), self.skill(shared)(self.skill("Work")))

    bench.load(primitive(Work, "work", execute=running_for(2)), tree("Top", expand))
    assert bench.run(bench.node("top")).state is State.Success


def test_latched_node_gets_following_children(bench):
    def expand(self, skill):
        skill.addChild(self.getNode(Selector()), latch=True)
        skill.addChild(self.skill("Fail", "fail"))
        skill.addChild(self.getSkill(":Work", "work"))

    bench.load(
        primitive(Work, "work"),
        primitive(describe("Fail"), "fail", execute=lambda s: s.fail("no", 1)),
        tree("Top", expand),
    )
    task = bench.run(bench.node("top"))
    assert task.state is State.Success
    (group,) = task.root.children[0].children
    assert [c.label for c in group.children] == ["fail", "work"]


def test_added_child_may_be_changed(bench):
    def expand(self, skill):
        skill(self.skill("Say", "say"), self.skill("Work", "work"))
        skill.popChild()
        skill.last().specifyParamDefault("Text", "changed")
        skill.last().remap("Volume", "Loudness")

    say = describe("Say", [("Text", "words", REQUIRED), ("Volume", int, OPTIONAL)])
    bench.load(
        primitive(Work, "work"),
        primitive(say, "say", execute=lambda s: s.success(f"{s.params['Text'].value} {s.params['Volume'].value}")),
        tree("Top", expand, [("Loudness", 3, OPTIONAL)]),
    )
    task = bench.run(bench.node("top"))
    assert "changed 3" in messages(task)
    assert len(task.root.children[0].children) == 1


def test_remap_applies_to_keys_remapped_below(bench, caplog):
    say = describe("Say", [("Text", str, REQUIRED)])
    bench.load(
        primitive(say, "say", execute=lambda s: s.success(s.params["Text"].value)),
        tree("Low", lambda self, skill: skill(self.skill("Say", remap={"Text": "A"}))),
        tree("Mid", lambda self, skill: skill(self.skill("Low", remap={"A": "B"}))),
        tree("Top", lambda self, skill: skill(self.skill("Mid", remap={"B": "C"}, specify={"C": "deep"}))),
    )
    top = bench.node("top")
    # `Mid` does not declare the key: what is fixed has to be its parameter.
    with caplog.at_level("ERROR"):
        assert "None" in messages(bench.run(top))
    assert "no parameter 'B'" in caplog.text
    task = bench.run(bench.node("mid", remap={"B": "C"}), C="deep")
    assert "deep" in messages(task)


def test_specified_element_is_read_from_the_world_model(bench):
    bench.load(
        primitive(describe("Weigh", [OBJECT]), "weigh",
                  execute=lambda s: s.success(str(s.params["Object"].value.value_of("skiros:Weight")))),
        tree("Top", lambda self, skill: skill(self.skill("Weigh", specify={"Object": self.params["Thing"].value})),
             [("Thing", Element("skiros:Product"), REQUIRED)]),
    )  # fmt: skip
    heavy = bench.wmi.get_element(bench.product.id)
    heavy.setProperty("skiros:Weight", 8.0)
    bench.wmi.update_element(heavy)
    assert "8.0" in messages(bench.run(bench.node("top", Thing=bench.product)))


def test_conditions_of_a_node_do_not_apply_to_other_nodes(bench):
    def expand(self, skill):
        heavy = self.getPropCond("Heavy", "skiros:Weight", "Object", ">", 1e9, True)
        skill(self.skill(NoFail(Sequential()))(self.skill("Take", preconditions=[heavy])), self.skill("Take"))

    bench.load(primitive(Take, "take"), tree("Top", expand, [OBJECT]))
    assert bench.run(bench.node("top", Object=bench.product)).state is State.Success


# -- no shared state ---------------------------------------------------------------------------------------------------


def test_two_managers_in_one_process_share_no_state():
    """One library of classes, loaded for two worlds."""
    say = describe("Say", [("Texts", ["a"], OPTIONAL), ("Options", {}, OPTIONAL)])
    seen = []

    def execute(self):
        seen.append((list(self.params["Texts"].values), dict(self.params["Options"].value)))
        self.params["Texts"].addValue("b")
        self.params["Options"].value["used"] = True
        return self.success()

    cls = primitive(say, "say", execute=execute)
    for bench in (Workbench(LocalWorldModel("one")), Workbench(LocalWorldModel("other"))):
        bench.load(cls)
        for _ in range(2):
            bench.run(bench.node("say"))
    assert seen == [(["a"], {})] * 4


@pytest.mark.parametrize("hook", ["onStart", "expand"])
def test_runtime_additions_of_skill_are_removed_at_next_start(bench, hook):
    seen = []

    class grows(SkillBase):
        def createDescription(self):
            self.setDescription(describe("Grows", [CONTAINER])(), "grows")
            self._expand_on_start = True

        def grow(self):
            seen.append((len(self._pre_conditions), len(self._hold_conditions), len(self._post_conditions)))
            for add in (self.addPreCondition, self.addHoldCondition, self.addPostCondition):
                add(self.getIsSpecifiedCond("There", "Container", True))
            seen.append(sorted(self.params.keys()))
            self.addParam("More", 1, OPTIONAL, [ParamOptions.Output])
            return True

        def onStart(self):
            return hook != "onStart" or self.grow()

        def expand(self, skill):
            if hook == "expand":
                self.grow()

    bench.load(grows)
    for _ in range(2):
        bench.run(bench.node("grows"))
    bench.run(Skill("", RetryOnFail(1))(bench.node("grows"), bench.node("grows")))
    assert seen[::2] == [(0, 0, 0)] * 4
    assert seen[1::2] == [["Container", "Robot"]] * 4
    declared = bench.library.by_label("grows").declared
    assert declared.options == {} and not declared.hasPreCond()
