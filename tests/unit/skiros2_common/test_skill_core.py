"""Descriptions and primitives used without a task. Contract, 2 to 5."""

import threading

import pytest

from skiros2_common.core.abstract_skill import ParamOptions, SkillDescription, State
from skiros2_common.core.errors import Refused
from skiros2_common.core.params import ParamHandler, ParamTypes
from skiros2_common.core.primitive import PrimitiveBase
from skiros2_common.core.world_element import Element

REQUIRED, OPTIONAL = ParamTypes.Required, ParamTypes.Optional


class Say(SkillDescription):
    def createDescription(self):
        self.addParam("Text", "words", REQUIRED)
        self.addParam("Volume", 3, OPTIONAL)
        self.addParam("Listener", Element("sumo:Agent"), OPTIONAL, [ParamOptions.Unspecify])
        self.addPreCondition(self.getIsSpecifiedCond("Heard", "Listener", False))
        self.addHoldCondition(self.getIsSpecifiedCond("Unheard", "Listener", False))


class say(PrimitiveBase):
    """Remembers which hooks were called; says its text at the third tick."""

    def createDescription(self):
        self.setDescription(Say(), "say")
        self.calls = []
        self.willing = True

    def onReset(self):
        self.calls.append("onReset")

    def onStart(self):
        self.calls.append("onStart")
        return self.willing

    def execute(self):
        self.calls.append("execute")
        return self.step("breathes") if self.progress_code < 2 else self.success(self.params["Text"].value)


@pytest.fixture
def skill():
    made = say()
    assert made.init(None)
    return made


# -- descriptions ------------------------------------------------------------------------------------------------------


def test_description_is_complete_after_construction():
    description = Say()
    description.generateDefParams()
    description.generateDefConditions()  # once is enough
    assert list(description.params.keys()) == ["Text", "Volume", "Listener", "Robot"]
    assert [c.label for c in description._post_conditions] == ["UnsetListener"]
    assert description.getModifiedParams() == {"Listener"}


def test_print_info_shows_parameters_and_conditions(skill):
    assert skill.printInfo() == "skiros:Say-say [Text:['words'] Volume:[3] Listener: sumo:Agent- Robot: sumo:Agent-]"
    assert skill.printInfo(verbose=True).splitlines()[1:] == skill.printConditions().splitlines()
    assert [line.split(":")[0] for line in skill.printConditions().splitlines()] == ["Pre", "Hold", "Post"]


def test_set_description_copies_get_description(skill):
    copy = SkillDescription()
    copy.setDescription(*skill.getDescription())
    copy.params.specify("Text", "changed")
    copy.pre_conditions.clear()
    assert skill.params["Text"].value == "words"
    assert skill.hasPreCond()
    assert [c.label for c in copy.getDescription()[4]] == ["UnsetListener", "HasListener"]


def test_check_conditions_methods_return_unsatisfied_keys(skill):
    assert skill.hasPreCond() and skill.hasPostCond()
    assert skill.checkPreCond() == skill.checkHoldCond() == skill.checkPostCond() == []
    skill.specifyParam("Listener", Element("sumo:Agent", "Ann", "sumo:Agent-1"))
    for check, code in ((skill.checkPreCond, -1), (skill.checkHoldCond, -2), (skill.checkPostCond, -2)):
        assert check(verbose=True) == ["Listener"]
        assert skill.progress_code == code
        assert "sumo:Agent-1-Ann" in skill.progress_msg


# -- parameters of a skill ---------------------------------------------------------------------------------------------


def test_specify_params_sets_one_or_several_parameters(skill):
    others = ParamHandler()
    others.addParam("Text", "other words", REQUIRED)
    others.addParam("Volume", int, REQUIRED)
    skill.specifyParams(others)
    assert skill.params["Text"].value == "words"  # a default is kept
    skill.specifyParams(others, keep_default=False)
    assert [skill.params[key].value for key in ("Text", "Volume")] == ["other words", None]
    skill.params.setDefault()
    assert skill.params["Text"].value == "words"
    skill.specifyParamsDefault(others)
    skill.specifyParamDefault("Volume", 5)
    skill.params.setDefault()
    assert [skill.params[key].value for key in ("Text", "Volume")] == ["other words", 5]
    skill.specifyParam("Volume", "loud")
    assert skill.params["Volume"].value == 5


def test_make_default_sets_the_default_values(skill):
    volume = skill.params["Volume"]
    volume.makeDefault([1, 2])
    assert (volume.getDefaultValue(), volume.getDefaultValue(1)) == (1, 2)
    assert volume.getDefaultValues() == volume.defaults == [1, 2]
    assert volume.hasDefaultValues()
    assert volume.paramTypeIs(OPTIONAL) and not volume.paramTypeIs(REQUIRED)


# -- running by hand ---------------------------------------------------------------------------------------------------


def test_a_primitive_is_started_ticked_and_reset(skill):
    assert skill.getState() is State.Idle
    assert skill.start() is State.Running
    assert [skill.tick() for _ in range(4)] == [State.Running, State.Running, State.Success, State.Success]
    assert skill.printState() == "skiros:Say-say(State.Success)"
    assert skill.printProgress() == "3: words"
    assert skill.reset() is State.Idle
    assert skill.hasState(State.Idle)
    assert skill.printProgress() == "0: "
    assert skill.calls == ["onStart", "execute", "execute", "execute", "onReset"]


def test_start_sets_the_parameters(skill):
    params = ParamHandler()
    params.addParam("Text", "given", REQUIRED)
    assert skill.start(params) is State.Running
    assert "Text:['given']" in skill.printState(verbose=True)


def test_start_fails_if_on_start_returns_false(skill):
    skill.willing = False
    assert skill.start() is State.Failure
    assert skill.hasState(State.Failure)


def test_running_primitive_cannot_be_started(skill):
    skill.start()
    with pytest.raises(Refused, match="skiros:Say-say is already running"):
        skill.start()


def test_running_primitive_is_preempted(skill):
    assert skill.preempt() is State.Idle
    skill.start()
    assert skill.preempt() is State.Failure
    assert skill.printProgress() == "-1: Preempted"


def test_wait_state_waits_for_a_state_or_its_end(skill):
    seen = []

    def watch():
        skill.waitState(State.Running)
        seen.append("running")
        skill.waitState(State.Running, isset=False)
        seen.append(skill.state)

    thread = threading.Thread(target=watch)
    thread.start()
    skill.start()
    while "running" not in seen:
        thread.join(0.001)
    skill.preempt()
    thread.join(5)
    assert seen == ["running", State.Failure]


def test_progress_has_a_code_a_message_and_times(skill):
    skill.start()
    skill._setProgress("first")
    skill._setProgress("second", 7)
    assert (skill.progress_code, skill.progress_msg) == (7, "second")
    assert 0.0 <= skill.progress_period <= skill.progress_time


# -- effects of conditions on the parameters themselves ----------------------------------------------------------------

PRODUCT = Element("skiros:Product", "bolt", "skiros:Product-1")
TRAY = Element("skiros:Container", "tray", "skiros:Container-2")
make = SkillDescription()


@pytest.fixture
def params():
    handler = ParamHandler()
    handler.addParam("Object", PRODUCT.copy(), OPTIONAL)
    handler.addParam("Tray", TRAY.copy(), OPTIONAL)
    return handler


@pytest.mark.parametrize(
    ("condition", "done", "looks_so"),
    [
        (make.getPropCond("C", "skiros:Weight", "Object", "=", 2.0, True), True,
         lambda p: p["Object"].value.getProperty("skiros:Weight").value == 2.0),
        (make.getPropCond("C", "skiros:Weight", "Object", ">", 2.0, True), False,
         lambda p: not p["Object"].value.hasProperty("skiros:Weight")),
        (make.getHasPropCond("C", "skiros:Weight", "Object", False), True,
         lambda p: not p["Object"].value.hasProperty("skiros:Weight")),
        (make.getRelationCond("C", "skiros:contain", "Tray", "Object", True), True,
         lambda p: p["Tray"].value.hasRelation("-1", "skiros:contain", PRODUCT.id)),
        (make.getRelationCond("C", "skiros:contain", "Tray", "Object", False), True,
         lambda p: not p["Tray"].value.hasRelation("-1", "skiros:contain", PRODUCT.id)),
        (make.getAbstractRelationCond("C", "skiros:contain", "Tray", "Object", True), False, lambda p: True),
        (make.getIsSpecifiedCond("C", "Object", False), True, lambda p: not p.isSpecified("Object")),
        (make.getIsSpecifiedCond("C", "Object", True), True, lambda p: p.isSpecified("Object")),
        (make.getGenerateCond("C", "Object", False), True, lambda p: not p.isSpecified("Object")),
        (make.getOnTypeCond("C", "Object", "skiros:Part"), False, lambda p: p["Object"].value.type == "skiros:Product"),
    ],
)  # fmt: skip
def test_set_desired_state_applies_possible_effects(params, condition, done, looks_so):
    assert condition.setDesiredState(params) is done
    assert looks_so(params)


def test_set_true_of_or_applies_one_part(params):
    either = make.getOrCond(True)
    either.addCondition(make.getPropCond("C", "skiros:Weight", "Object", ">", 2.0, True))
    either.addCondition(make.getPropCond("C", "skiros:Weight", "Object", "=", 2.0, True))
    assert either.setDesiredState(params)
    assert params["Object"].value.getProperty("skiros:Weight").value == 2.0
