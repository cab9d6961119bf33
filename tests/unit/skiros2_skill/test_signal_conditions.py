"""Hold-conditions on signals: a violation wakes the task, which fails with the reason."""

import math
import threading

import pytest

from skiros2_common.core.abstract_skill import SkillDescription, State
from skiros2_common.core.errors import WrongValue
from skiros2_common.core.params import ParamTypes
from skiros2_common.core.world_element import Element
from skiros2_skill.core.lint.linter import Linter
from skiros2_skill.core.runtime.diagnosis import inspect
from skiros2_skill.core.runtime.scheduler import Scheduler
from skiros2_task.core.skills import read_skill
from unit.skiros2_skill.skills import describe, primitive

make = SkillDescription()
ARM = ("Arm", Element("rparts:ArmDevice"), ParamTypes.Required)
MAX_FORCE = ("MaxForce", 30.0, ParamTypes.Required)


def limited(**limits):
    return make.getSignalCond("ForceBelowLimit", "skiros:WristForce", "Arm", **limits)


def pressing(*conditions, params=(ARM, MAX_FORCE), pre=(), ticked=None):
    """A skill that runs until something ends it.

    :param ticked: an event that its ticks set.
    """
    stages = {stage: [lambda _, c=c: c.copy() for c in some] for stage, some in (("pre", pre), ("hold", conditions))}
    ticked = ticked or threading.Event()
    return primitive(describe("Press", list(params), **stages), execute=lambda s: ticked.set() or s.step(""))


class Cell:
    """An arm with a force sensor, and a scheduler that ticks only when a task is woken."""

    def __init__(self, bench, rate=0.001):
        self.bench, self.signals = bench, bench.signals
        self.arm = bench.add("rparts:ArmDevice", "arm", bench.robot, "skiros:hasA")
        self.sensor = bench.add("skiros:WristForce", "wrist", self.arm, "skiros:hasSignal")
        self.write(self.sensor, SignalTopic="/wrist", Unit="N")
        self.scheduler = Scheduler(rate=rate, keep_alive=1e6, signals=self.signals)

    def write(self, element, **properties):
        for key, value in properties.items():
            element.setProperty(f"skiros:{key}", value)
        self.bench.wmi.update_element_properties(element)

    def task(self, *conditions, **options):
        """A task with a skill that presses, not ticked yet."""
        self.bench.load(pressing(*conditions, **options))
        return self.bench.command("Press", Arm=self.arm)

    def started(self, *conditions):
        """A task that a scheduler ticks; its first tick is over."""
        ticked = threading.Event()
        self.bench.load(pressing(*conditions, ticked=ticked))
        task = self.scheduler.new_task(self.bench.wmi, "test")
        task.root(self.bench.node("Press", Arm=self.arm))
        self.scheduler.start(task.id)
        assert ticked.wait(10)
        return task


@pytest.fixture
def cell(bench):
    made = Cell(bench)
    yield made
    made.scheduler.stop()


def failed(task):
    """The reason of a task that has failed."""
    assert task.state is State.Failure
    return task.cause().message


# -- violations --------------------------------------------------------------------------------------------------------


def test_violation_fails_the_skill_at_the_next_tick(cell):
    task = cell.task(limited(maximum=30.0))
    cell.signals.publish("/wrist", 12.0)
    assert task.tick(2) is State.Running
    cell.signals.publish("/wrist", 41.5)
    assert task.tick() is State.Failure
    assert failed(task).startswith(
        f"Hold-condition failed: [ForceBelowLimit] skiros:WristForce of {cell.arm!r} is at most 30 N, "
        f"but {cell.sensor!r} was 41.5 N at "
    )
    assert failed(task).endswith(", above 30 N")


def test_violation_wakes_the_task(cell):
    task = cell.started(limited(maximum=30.0))
    cell.signals.publish("/wrist", 12.0)
    assert not task.ended.is_set()
    cell.signals.publish("/wrist", 41.5)
    assert task.ended.wait(10)
    assert "was 41.5 N" in failed(task)


def test_short_violation_is_not_missed(cell):
    task = cell.task(limited(maximum=30.0))
    task.tick()
    for force in (12.0, 41.5, 12.0):
        cell.signals.publish("/wrist", force)
    task.tick()
    assert "was 41.5 N" in failed(task)


def test_duration_ignores_a_short_peak(cell, fake_clock):
    task = cell.task(limited(maximum=30.0, duration=0.01))
    task.tick()
    for force in (41.5, 12.0, 41.5):
        cell.signals.publish("/wrist", force)
        fake_clock.advance(0.006)
    assert task.tick() is State.Running
    fake_clock.advance(0.006)
    cell.signals.publish("/wrist", 42.5)
    task.tick()
    assert "was 42.5 N" in failed(task)
    assert failed(task).endswith("above 30 N for 0.012 s")


def test_silent_signal_violates(cell, fake_clock):
    task = cell.task(limited(maximum=30.0, timeout=0.2))
    task.tick()
    fake_clock.advance(0.1)
    cell.signals.publish("/wrist", 12.0)
    fake_clock.advance(0.19)
    assert task.tick() is State.Running
    fake_clock.advance(0.02)
    task.tick()
    assert "has sent no message on /wrist for 0.21 s at " in failed(task)
    assert failed(task).endswith("(last value 12 N)")


def test_signal_without_publisher_violates(cell, fake_clock):
    task = cell.task(limited(maximum=30.0))
    assert task.tick() is State.Running
    fake_clock.advance(0.51)
    task.tick()
    assert failed(task).endswith("(none since the start)")


def test_not_a_number_violates(cell):
    task = cell.task(limited(maximum=30.0))
    task.tick()
    cell.signals.publish("/wrist", math.nan)
    task.tick()
    assert f"but {cell.sensor!r} was not a number (NaN) at " in failed(task)


def test_message_without_the_field_violates(cell):
    cell.write(cell.sensor, MessageField="wrench.force")
    task = cell.task(limited(maximum=30.0))
    task.tick()
    cell.signals.publish("/wrist", 1.0)
    task.tick()
    assert "on /wrist: a message of type float has no number at 'wrench.force', at " in failed(task)


def test_missing_signal_fails_the_skill_before_it_moves(cell):
    cell.bench.wmi.remove_element(cell.sensor)
    task = cell.task(limited(maximum=30.0))
    task.tick()
    assert f"{cell.arm!r} has no signal skiros:WristForce; it has: none" in failed(task)


def test_limit_may_be_a_parameter(cell):
    task = cell.task(limited(maximum="MaxForce"))
    task.tick()
    cell.signals.publish("/wrist", 29.0)
    assert task.tick() is State.Running
    cell.signals.publish("/wrist", 31.0)
    task.tick()
    assert "is at most 30 N, but" in failed(task)


def test_unset_limit_fails_the_skill(cell):
    task = cell.task(limited(maximum="MaxForce"), params=(ARM, ("MaxForce", float, ParamTypes.Optional)))
    task.tick()
    assert "the maximum is parameter 'MaxForce', which is unset" in failed(task)


def test_signal_of_a_part_is_found_by_its_label(cell):
    finger = cell.bench.add("rparts:GripperEffector", "gripper", cell.arm, "skiros:hasA")
    gap = cell.bench.add("skiros:Distance", "gap", finger, "skiros:hasA")
    cell.write(gap, SignalTopic="/gap", Unit="m")
    task = cell.task(make.getSignalCond("Gap", "gap", "Arm", minimum=0.01))
    task.tick()
    cell.signals.publish("/gap", 0.001)
    task.tick()
    assert f"{gap!r} was 0.001 m at " in failed(task)


def test_part_of_an_or_condition_is_monitored(cell):
    either = make.getOrCond(True)
    either.addCondition(limited(maximum=30.0))
    either.addCondition(make.getSignalCond("Pulls", "skiros:WristForce", "Arm", minimum=50.0))
    task = cell.task(either)
    task.tick()
    cell.signals.publish("/wrist", 12.0)
    assert task.tick() is State.Running
    cell.signals.publish("/wrist", 40.0)
    task.tick()
    assert f"{cell.sensor!r} was 40 N at " in failed(task)
    assert "below 50 N" in failed(task)
    assert cell.signals.topics() == []


# -- the lease ---------------------------------------------------------------------------------------------------------


def test_topic_is_subscribed_while_the_skill_runs(cell):
    task = cell.task(limited(maximum=30.0))
    assert cell.signals.topics() == []
    task.tick()
    assert cell.signals.topics() == ["/wrist"]
    task.preempt()
    task.tick()
    assert cell.signals.topics() == []


def test_next_start_depends_on_the_last_value(cell):
    cell.task(limited(maximum=30.0))
    for force, state in ((41.5, State.Failure), (12.0, State.Running)):
        cell.signals.publish("/wrist", force)
        assert cell.bench.command("Press", Arm=cell.arm).tick() is state


# -- what people see ---------------------------------------------------------------------------------------------------


def test_explanation_has_the_condition_and_what_was_found(cell):
    task = cell.task(limited(maximum=30.0))
    task.tick()
    cell.signals.publish("/wrist", 41.5)
    task.tick()
    (finding,) = task.cause().findings
    assert (finding.kind, finding.label) == ("ConditionSignal", "ForceBelowLimit")
    assert finding.expected == f"skiros:WristForce of {cell.arm!r} is at most 30 N"
    assert "was 41.5 N" in finding.found


def test_inspection_lists_the_condition(cell):
    task = cell.task(limited(maximum=30.0))
    task.tick()
    task.progress()
    node = task.root.children[0]
    (condition,) = inspect(task, node.id, cell.bench.wmi).conditions
    assert (condition.verdict, condition.text) == ("holds", f"skiros:WristForce of {cell.arm!r} is at most 30 N")


@pytest.mark.parametrize(
    ("limits", "text"),
    [
        ({"maximum": 30.0}, "is at most 30"),
        ({"minimum": -5.0, "maximum": "MaxForce"}, "is at least -5 and at most MaxForce"),
        ({"maximum": 30.0, "duration": 0.01}, "is at most 30, except for less than 0.01 s"),
    ],
)
def test_description_has_the_limits(limits, text):
    assert limited(**limits).describe() == f"skiros:WristForce of Arm {text}"


def test_registered_skill_has_the_condition_and_planning_ignores_it(cell):
    cell.bench.load(pressing(limited(maximum="MaxForce")))
    (implementation,) = cell.bench.library.implementations()
    element = cell.bench.wmi.add_element(implementation.declared.toElement())
    scene = {e.id: e for e in cell.bench.wmi.get_branch(element.id)}
    (condition,) = read_skill(element, scene).hold
    assert (condition.kind, condition.subject, condition.name) == ("ConditionSignal", "Arm", "skiros:WristForce")
    assert condition.value == "at most MaxForce"
    assert condition.planned_as == "ignored"


def test_unusable_limits_are_refused_at_once():
    with pytest.raises(WrongValue, match=r"'ForceBelowLimit': it has neither .*; the duration is -1"):
        limited(duration=-1)


def test_conditions_with_other_limits_differ():
    assert limited(maximum=30.0) == limited(maximum=30.0)
    assert limited(maximum=30.0) != limited(maximum=31.0)


def test_remap_renames_the_keys_of_limits():
    condition = limited(maximum="MaxForce")
    condition.remap("MaxForce", "Limit")
    condition.remap("Arm", "LeftArm")
    assert condition.getKeys() == ["LeftArm", "Limit"]


def test_lint_reports_unknown_signals_and_other_stages(cell):
    made = pressing(make.getSignalCond("Odd", "skiros:Wristforce", "Arm", maximum=1.0), pre=[limited(maximum=1.0)])
    faults = {fault.code: fault.text for fault in Linter([made], cell.bench.wmi).lint(made)}
    assert set(faults) == {"unknown-class", "wrong-stage"}
    assert "hold-condition [Odd] refers to skiros:Wristforce" in faults["unknown-class"]
    assert "pre-condition [ForceBelowLimit] is on a signal, which is only checked while" in faults["wrong-stage"]


def test_pre_condition_on_a_signal_fails_the_start(cell):
    task = cell.task(pre=[limited(maximum=30.0)])
    task.tick()
    assert "which is only checked while the skill runs" in failed(task)
