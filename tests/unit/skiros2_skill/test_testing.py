"""The kit for skill authors: what `skiros2_skill.testing` promises them."""

import threading
import time

import pytest

from skiros2_common.core.abstract_skill import State
from skiros2_common.core.errors import Refused, UnknownName, WrongValue
from skiros2_common.core.primitive import PrimitiveBase
from skiros2_common.core.primitive_thread import PrimitiveThreadBase
from skiros2_common.core.world_element import Element
from skiros2_skill.core.skill import ParallelFf, SerialStar, Skill, SkillBase
from skiros2_skill.testing import FakeClock, Script, SkillBench, Trace, describe, inject, refusing, stand_in
from unit.skiros2_skill.skills import INFERRED, OBJECT, OPTIONAL, REQUIRED

SCENE = """
@prefix skiros: <http://rvmi.aau.dk/ontologies/skiros.owl#> .
@prefix cora: <http://purl.org/ieee1872-owl/cora#> .
@prefix rdf: <http://www.w3.org/1999/02/22-rdf-syntax-ns#> .
@prefix rdfs: <http://www.w3.org/2000/01/rdf-schema#> .
@prefix xsd: <http://www.w3.org/2001/XMLSchema#> .
@prefix owl: <http://www.w3.org/2002/07/owl#> .
skiros:Scene-0 a skiros:Scene, owl:NamedIndividual ; rdfs:label "" ; skiros:contain skiros:LargeBox-4 .
skiros:LargeBox-4 a skiros:LargeBox, owl:NamedIndividual ; rdfs:label "box" ; skiros:contain skiros:Product-7 .
skiros:Product-7 a skiros:Product, owl:NamedIndividual ; rdfs:label "bolt" ; skiros:Weight "0.5"^^xsd:float .
"""


class sleeper(PrimitiveThreadBase):
    """Sleeps for a minute in its thread."""

    def createDescription(self):
        self.setDescription(describe("Sleep")(), "sleeper")

    def run(self):
        began = time.monotonic()
        time.sleep(60.0)
        slept = time.monotonic() - began
        return self.success("slept") if slept >= 60.0 else self.fail(f"slept for {slept} s only", -1)


class patient(PrimitiveBase):
    """Waits for two minutes by the machine's clock."""

    def createDescription(self):
        self.setDescription(describe("Patience")(), "patient")

    def onStart(self):
        self.since = time.monotonic()
        return True

    def execute(self):
        waited = time.monotonic() - self.since
        return self.success("enough") if waited >= 120.0 else self.step(f"{waited:g}")


class both(SkillBase):
    """One after the other."""

    def createDescription(self):
        self.setDescription(describe("Both", [OBJECT])(), "both")

    def expand(self, skill):
        skill(self.skill(ParallelFf())(self.skill("Left", ""), self.skill("Right", "")))


# -- the scene ---------------------------------------------------------------------------------------------------------


def test_blank_scene_has_a_robot(skill_bench):
    assert skill_bench.robot.type == "cora:Robot"
    assert skill_bench.holder(skill_bench.robot.label) == skill_bench.wmi.get_element("skiros:Scene-0").label


def test_scene_is_given_as_text():
    with SkillBench(SCENE) as bench:
        assert bench.holder("bolt") == "box"
        assert bench.element("bolt").id == "skiros:Product-7"
        assert bench.element("bolt").value_of("skiros:Weight") == 0.5


def test_scene_is_read_from_a_file(tmp_path):
    (tmp_path / "cell.ttl").write_text(SCENE)
    with SkillBench(tmp_path / "cell.ttl") as bench:
        assert bench.related("box", "skiros:spatiallyRelated") == ["bolt"]


def test_scene_is_built_by_calls(skill_bench):
    box = skill_bench.add("skiros:LargeBox", "box")
    skill_bench.add("skiros:Product", "bolt", box, Weight=0.5)
    skill_bench.add("skiros:Location", "shelf")
    skill_bench.wmi.set_relation(box.id, "skiros:at", skill_bench.element("shelf").id)
    assert skill_bench.holder("bolt") == "box"
    assert skill_bench.related("box", "skiros:at") == ["shelf"]
    assert skill_bench.element("bolt").value_of("skiros:Weight") == 0.5


def test_unknown_or_ambiguous_label_is_refused(skill_bench):
    with pytest.raises(UnknownName, match=r"no element is labelled 'box'; there are: .*robot"):
        skill_bench.element("box")
    skill_bench.add("skiros:LargeBox", "box")
    skill_bench.add("skiros:LargeBox", "box")
    with pytest.raises(WrongValue, match="several elements are labelled 'box'"):
        skill_bench.element("box")


# -- stand-ins ---------------------------------------------------------------------------------------------------------


def test_stand_in_follows_its_script(skill_bench):
    skill_bench.stand_in("Work", "RRS")
    task = skill_bench.command("Work")
    assert [task.tick() for _ in range(3)] == [State.Running, State.Running, State.Success]


@pytest.mark.parametrize(
    ("outcome", "state", "code"),
    [
        ("S", State.Success, 1),
        ("F", State.Failure, -1),
        ("X", State.Failure, -405),
        (ValueError("bad"), State.Failure, -405),
        (lambda skill: skill.fail("slipped", 9), State.Failure, -9),
        (State.Success, State.Success, 0),
        (None, State.Failure, -405),
    ],
)
def test_script_accepts_letters_exceptions_functions_and_states(skill_bench, outcome, state, code):
    skill_bench.stand_in("Work", [outcome])
    task = skill_bench.command("Work").run()
    assert (task.skill.state, task.skill.progress_code) == (state, code)


def test_script_may_differ_for_each_start(skill_bench):
    skill_bench.stand_in("Work", Script("F", "RS"))
    assert skill_bench.command("Work").run().state is State.Failure
    assert [len(skill_bench.command("Work").run().trace.ticks) for _ in range(2)] == [2, 2]


def test_empty_script_is_refused():
    with pytest.raises(WrongValue, match="outcomes are R, S, F, X, got Q"):
        stand_in("Work", "RQ")
    with pytest.raises(WrongValue, match="an outcome for each start"):
        Script("F", "")


def test_stand_in_records_its_hooks(skill_bench):
    work = skill_bench.stand_in("Work", "R", onPreempt=State.Success)
    task = skill_bench.command("Work")
    task.tick()
    task.preempt()
    task.tick()
    assert work.calls == ["onStart", "execute", "onPreempt", "onEnd"]
    assert task.skill.state is State.Success


def test_stand_in_has_parameters_and_conditions_of_its_description(skill_bench):
    weighed = describe(
        "Weigh",
        [OBJECT, ("Most", 1.0, REQUIRED)],
        pre=[lambda d: d.getHasPropCond("Weighed", "skiros:Weight", "Object", True)],
    )
    skill_bench.stand_in(weighed, label="scales")
    skill_bench.add("skiros:Product", "feather")
    assert "Weighed" in skill_bench.command("Weigh").run().why
    skill_bench.add("skiros:Product", "bolt", Weight=0.5)
    task = skill_bench.command("Weigh", "scales").run()
    assert task.skill.params["Object"].value.label == "bolt"


def test_stand_ins_replace_children_of_the_tested_skill(skill_bench):
    skill_bench.add("skiros:Product", "bolt")
    skill_bench.load(both)
    skill_bench.stand_in("Left", "RS")
    right = skill_bench.stand_in("Right", "F")
    task = skill_bench.command("Both").run()
    assert task.state is State.Failure
    assert right.calls.count("execute") == 1
    assert task.trace == Trace.parse("""
        root       F-1
          both     F-1
            |ff|   F
              left   F-1
              right  F-1
    """)


# -- tasks -------------------------------------------------------------------------------------------------------------


def test_bench_checks_requests_like_a_manager(skill_bench):
    skill_bench.stand_in(describe("Note", [("Text", str, REQUIRED)]))
    with pytest.raises(Refused, match="required parameter 'Text'"):
        skill_bench.command("Note")
    with pytest.raises(UnknownName, match="no parameter 'Txt'"):
        skill_bench.command("Note", Text="x", Txt="x")
    assert skill_bench.command("Note", Text="x").run().state is State.Success


def test_several_skills_run_in_sequence(skill_bench):
    skill_bench.stand_in("One")
    skill_bench.stand_in("Two", "RS")
    task = skill_bench.commands(("One", "", {}), (":Two", "two", {})).run()
    assert task.state is State.Success, task.why
    assert len(task.trace.ticks) == 2


def test_nodes_have_remaps_specified_and_blackboard_values(skill_bench):
    def note(skill):
        heard.append((skill.params["Text"].value, skill.params["Size"].value))
        skill.params["Text"].value = "done"
        return skill.success()

    heard = []
    skill_bench.stand_in(describe("Note", [("Text", str, OPTIONAL), ("Size", 1, OPTIONAL)]), [note])
    task = skill_bench.run(skill_bench.node("note", remap={"Text": "Title"}, Size=3), Title="a title")
    assert heard == [("a title", 3)]
    assert task.blackboard["Title"] == "done"


def test_node_is_found_by_label_type_or_processor(skill_bench):
    skill_bench.stand_in("Work", label="worker")
    skill_bench.stand_in("Rest")
    group = Skill("", SerialStar())(skill_bench.node("Work"), skill_bench.node("Rest"), skill_bench.node("Rest"))
    task = skill_bench.run(group)
    assert task.node("worker") is task.node("Work") is group.children[0]
    assert task.node("->*" if task.root.label else "") is group
    with pytest.raises(WrongValue, match="2 nodes are called 'rest'"):
        task.node("rest")
    with pytest.raises(UnknownName, match="no node is called 'play'; there are: root, ->\\*, worker, rest, rest"):
        task.node("play")


def test_why_has_the_failure_and_the_trace(skill_bench):
    skill_bench.stand_in("Work", ["R", lambda skill: skill.fail("no grip", 7)])
    why = skill_bench.command("Work").run().why
    assert "no grip" in why
    assert "work  R1 F-7" in why


def test_run_ends_after_the_maximum_of_ticks(skill_bench):
    skill_bench.stand_in("Work", "R")
    task = skill_bench.command("Work").run(ticks=7)
    assert task.state is State.Running
    assert len(task.trace.ticks) == 7


def test_thread_of_a_skill_runs_between_ticks(skill_bench):
    class quick(sleeper):
        def run(self):
            return self.success("quick") if go.wait(10) else self.fail("slow", 1)

    go = threading.Event()
    skill_bench.load(quick)
    task = skill_bench.command("Sleep")
    task.tick()
    go.set()
    assert task.run().state is State.Success, task.why


# -- the clock ---------------------------------------------------------------------------------------------------------


def test_fake_clock_advances_on_request(fake_clock, skill_bench):
    skill_bench.load(patient)
    task = skill_bench.command("Patience")
    assert task.tick() is State.Running
    fake_clock.advance(119.9)
    assert task.tick() is State.Running
    assert task.skill.progress_msg == "119.94"
    fake_clock.advance(0.1)
    assert task.tick() is State.Success


def test_tick_advances_the_clock_by_a_period(fake_clock, skill_bench):
    skill_bench.load(patient)
    assert len(skill_bench.command("Patience").run(ticks=10_000).trace.ticks) == pytest.approx(120 / 0.04, abs=2)


def test_sleeping_thread_wakes_at_its_deadline(fake_clock, skill_bench):
    skill_bench.load(sleeper)
    task = skill_bench.command("Sleep")
    task.tick(3)
    assert task.state is State.Running
    assert task.run(ticks=2000).state is State.Success
    assert len(task.trace.ticks) >= 60.0 / 0.04


def test_sleep_in_the_test_thread_advances_the_clock(fake_clock):
    before = time.time()
    time.sleep(3600.0)
    assert time.time() - before == 3600.0
    with pytest.raises(ValueError, match="time does not go back"):
        fake_clock.advance(-1.0)


def test_rospy_uses_the_fake_clock(fake_clock):
    rospy = pytest.importorskip("rospy")
    with FakeClock(50.0) as clock:
        assert rospy.get_time() == 50.0
        clock.advance(2.5)
        assert rospy.Time.now().to_sec() == 52.5


def test_real_time_is_restored_after_the_test():
    real = time.monotonic
    with FakeClock(5.0):
        assert time.monotonic() == pytest.approx(5.0)
    assert time.monotonic is real


def test_a_second_thread_cannot_replace_the_clock_too():
    real, refused = time.monotonic, []

    def enter():
        try:
            with FakeClock():
                pass
        except RuntimeError as error:
            refused.append(str(error))

    with FakeClock():
        thread = threading.Thread(target=enter)
        thread.start()
        thread.join()
    assert refused == ["the fake clock of thread MainThread is active"]
    assert time.monotonic is real


# -- injected failures -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("hook", "code"), [("onStart", -404), ("execute", -405), ("onEnd", -405)])
def test_injected_exception_is_raised_in_a_hook(skill_bench, hook, code):
    skill_bench.load(patient)
    skill_bench.inject(patient, hook, raises=RuntimeError("injected"))
    skill_bench.inject(patient, "execute", returns=State.Success) if hook == "onEnd" else None
    task = skill_bench.command("Patience").run(2)
    assert task.skill.progress_code == code
    assert "injected" in task.skill.progress_msg


def test_injected_refusal_is_returned_by_a_hook(skill_bench):
    skill_bench.load(patient)
    with inject(patient, "onStart", returns=False):
        assert skill_bench.command("Patience").run(2).state is State.Failure
    assert skill_bench.command("Patience").run(2).state is State.Running


def test_fault_is_injected_at_one_call(skill_bench):
    skill_bench.load(patient)
    skill_bench.inject(patient, "execute", raises=RuntimeError("third time"), at=3)
    assert len(skill_bench.command("Patience").run().trace.ticks) == 3


def test_injected_delay_slows_a_hook(fake_clock, skill_bench):
    skill_bench.load(patient)
    skill_bench.inject(patient, "execute", late=130.0)
    assert skill_bench.command("Patience").run().state is State.Success
    assert fake_clock.now > 1130.0


def test_fault_in_an_unknown_hook_is_refused():
    with pytest.raises(AttributeError), inject(patient, "onStrat", returns=False):
        pass


def test_injected_faults_are_removed():
    genuine = patient.execute
    with SkillBench() as bench:
        bench.inject(patient, "execute", returns=State.Success)
        bench.inject(patient, "onEnd", returns=False)
        assert patient.execute is not genuine
    assert patient.execute is genuine
    assert "onEnd" not in vars(patient)


def test_refused_change_fails_the_skill(skill_bench):
    def paint(skill):
        product = skill.params["Object"].value
        product.setProperty("skiros:Weight", 2.0)
        skill.params["Object"].value = product
        return skill.success()

    skill_bench.add("skiros:Product", "bolt", Weight=1.0)
    skill_bench.stand_in(describe("Paint", [OBJECT]), [paint])
    with refusing(skill_bench.wmi, "the disk is full"):
        task = skill_bench.command("Paint").run()
    assert task.state is State.Failure
    assert "the disk is full" in task.skill.progress_msg
    assert skill_bench.element("bolt").value_of("skiros:Weight") == 1.0
    assert skill_bench.command("Paint").run().state is State.Success


def test_refused_read_fails_the_skill(skill_bench):
    skill_bench.add("skiros:Product", "bolt")
    skill_bench.stand_in(describe("Look", [("Object", Element("skiros:Product"), INFERRED)]))
    task = skill_bench.command("Look")
    skill_bench.refuse("gone for lunch", changes=False, reads=True)
    assert task.run().state is State.Failure
    assert "gone for lunch" in task.skill.progress_msg


# -- traces ------------------------------------------------------------------------------------------------------------

TABLE = """\
root          R  R   F-1
  ->*         R  R   F
    first     R1 S2  S2
    second    .  R1  F-405
      deeper  -  R1  F-1
  last        .  F-5 ."""


def test_trace_is_printed_as_a_table():
    assert str(Trace.parse(TABLE)) == TABLE
    assert Trace.parse(TABLE) == Trace.parse("\n" + TABLE.replace("\n", "\n     ").replace("root", "     root"))
    assert Trace.parse(TABLE) != Trace.parse(TABLE.replace("F-405", "F-8"))


def test_trace_has_tick_node_state_and_code():
    rows = Trace.parse(TABLE).rows()
    assert rows[0] == (1, "root", State.Running, 0)
    assert rows[-3:-1] == [(3, "second", State.Failure, -405), (3, "deeper", State.Failure, -1)]
    assert [row[1] for row in rows].count("deeper") == 2


@pytest.mark.parametrize(
    ("table", "named"), [("a  R Q1", "'Q1' is not a state"), ("a  Rx", "'Rx'"), ("a  R R\n  b  R", "rows of")]
)
def test_malformed_trace_table_is_refused(table, named):
    with pytest.raises(WrongValue, match=named):
        Trace.parse(table)
