"""The `on_preempt` of descriptions: skills that run when a task is preempted, such as putting down a held object."""

import threading

import pytest

from skiros2_common.core.abstract_skill import SkillDescription, State
from skiros2_common.core.errors import WrongType, WrongValue
from skiros2_common.core.world_element import Element
from skiros2_runs.core.states import TaskState
from skiros2_skill.core.breakpoint import Breakpoint
from skiros2_skill.core.runtime.scheduler import Scheduler
from skiros2_skill.core.skill import ParallelFf, ParallelFs, SerialStar, Skill, SkillBase
from unit.skiros2_skill.skills import INFERRED, OPTIONAL, REQUIRED, Work, describe, primitive

GRIPPER = ("Gripper", Element("rparts:GripperEffector"), INFERRED)
PutDown = describe("PutDown", [GRIPPER, ("Held", Element("skiros:Product"), REQUIRED), ("Speed", 0.1, OPTIONAL)])


class Hold(SkillDescription):
    """Something that is done with a product in the gripper."""

    seconds = 30.0
    label = ""

    def createDescription(self):
        self.addParam("Gripper", Element("rparts:GripperEffector"), INFERRED)
        self.addParam("Object", Element("skiros:Product"), REQUIRED)
        holds = self.getRelationCond("Holds", "skiros:contain", "Gripper", "Object", True)
        self.set_on_preempt("PutDown", self.label, {"Held": "Object"}, holds, self.seconds)


class Insert(Hold):
    """The same, as part of `Hold`."""


def release(self):
    """Moves the product from the gripper to the tray."""
    product = self.params["Held"].value
    product.setRelation(self.wmi.resolve_elements(Element("", "tray"))[0].id, "skiros:contain", "-1")
    self.wmi.update_element(product)


def put_down(ticks, log=None):
    """An `execute` that releases the product at a tick."""

    def execute(self):
        self.count = getattr(self, "count", 0) + 1
        if self.count < ticks:
            return self.step("lowering")
        release(self)
        if log is not None:
            log.append((self.params["Gripper"].value.label, self.params["Held"].value.label))
        self.count = 0
        return self.success("put down")

    return execute


def forever(self):
    return self.step("at it")


@pytest.fixture
def held(bench):
    """The bench with a product in the robot's gripper."""
    gripper = bench.add("rparts:GripperEffector", "gripper", bench.robot, "skiros:hasA")
    bench.move = lambda label, holder: bench.wmi.update_element(_moved(bench.element(label), bench.element(holder)))
    bench.move("product", "gripper")
    assert bench.holder("product") == gripper.label
    return bench


def _moved(element, holder):
    element.setRelation(holder.id, "skiros:contain", "-1")
    return element


def started(bench, *nodes):
    task = bench.task(*(nodes or (bench.node("hold", Object=bench.element("product")),)))
    task.tick(2)
    return task


def test_handler_runs_after_preemption_and_task_ends_as_preempted(held):
    log = []
    held.load(primitive(Hold, "hold", execute=forever, onEnd=lambda self: log.append("ended")))
    held.load(primitive(PutDown, "put_down", execute=put_down(3, log)))
    task = started(held)
    assert task.status is TaskState.RUNNING
    assert task.preempt()
    assert task.tick() is State.Running
    assert task.status is TaskState.ENDING
    assert task.root.progress_msg == "ending: on_preempt of skiros:Hold-hold (skiros:PutDown)"
    assert task.node("hold").state is State.Failure
    assert task.node("put_down").parent is task.root
    assert [node.label for node in task.progress()] == ["task_0", "hold", "put_down"]
    task.run()
    assert (task.state, task.status) == (State.Failure, TaskState.PREEMPTED), task.why
    assert task.root.progress_msg == "Preempted"
    assert log == ["ended", ("gripper", "product")]
    assert held.holder("product") == "tray"


def test_handler_runs_only_if_its_condition_holds_after_the_preemption(held):
    held.load(primitive(Hold, "hold", execute=forever), primitive(PutDown, "put_down", execute=put_down(3)))
    task = started(held)
    held.move("product", "tray")
    task.preempt()
    assert task.tick() is State.Failure
    assert (task.status, task.root.progress_msg) == (TaskState.PREEMPTED, "Preempted")
    assert len(task.root.children) == 1


def test_task_that_ends_otherwise_runs_no_handler(held):
    held.load(primitive(PutDown, "put_down", execute=put_down(1)))
    held.load(primitive(Hold, "hold", execute=forever), primitive(Insert, "insert", execute=lambda s: s.fail("no", -7)))
    nodes = [held.node(label, Object=held.element("product")) for label in ("hold", "insert")]
    task = held.run(_group(held, ParallelFf(), *nodes))
    assert task.status is TaskState.FAILED
    assert held.holder("product") == "gripper"


def _group(bench, processor, *nodes):
    return Skill("", processor, bench.wmi)(*nodes)


class hold_and_insert(SkillBase):
    def createDescription(self):
        self.setDescription(Hold(), "hold")

    def expand(self, skill):
        skill.setProcessor(SerialStar())
        skill(self.skill("Insert", ""))


def test_handler_gets_bound_values_and_keeps_its_defaults(held):
    seen = {}
    put = [GRIPPER, ("Held", Element("skiros:Product"), REQUIRED), ("Speed", 0.1, OPTIONAL), ("Force", 5.0, OPTIONAL)]

    class hold(primitive(Hold, "hold", execute=forever)):
        def createDescription(self):
            super().createDescription()
            self.addParam("Speed", 1.0, OPTIONAL)
            self.addParam("Limit", 8.0, OPTIONAL)
            self.set_on_preempt("PutDown", bind={"Held": "Object", "Force": "Limit"})

    def execute(self):
        seen.update({key: param.value for key, param in self.params.items()})
        return self.success("")

    held.load(hold, primitive(describe("PutDown", put), "put_down", execute=execute))
    task = started(held, held.node("hold", Object=held.element("product"), Gripper=held.element("gripper")))
    task.preempt()
    task.run()
    assert (seen["Speed"], seen["Force"]) == (0.1, 8.0)
    assert [seen[key].label for key in ("Held", "Gripper", "Robot")] == ["product", "gripper", "skiros:robot"]


def test_nested_handlers_run_innermost_first_and_each_once(held):
    order = []

    class InnerInsert(Insert):
        def createDescription(self):
            super().createDescription()
            self._type = "skiros:Insert"
            self.set_on_preempt("Note", "inner")

    class OuterHold(Hold):
        def createDescription(self):
            super().createDescription()
            self._type = "skiros:Hold"
            self.set_on_preempt("Note", "outer")

    class outer(hold_and_insert):
        def createDescription(self):
            self.setDescription(OuterHold(), "hold")

    note = describe("Note")
    for label in ("inner", "outer"):
        held.load(primitive(note, label, execute=lambda self: order.append(self.label) or self.success("")))
    held.load(primitive(InnerInsert, "insert", execute=forever), outer)
    task = started(held)
    task.preempt()
    task.run()
    assert order == ["inner", "outer"]
    assert task.status is TaskState.PREEMPTED


def test_outer_handler_is_not_needed_once_the_inner_one_has_put_the_object_down(held):
    log = []
    held.load(hold_and_insert, primitive(Insert, "insert", execute=forever))
    held.load(primitive(PutDown, "put_down", execute=put_down(2, log)))
    task = started(held)
    task.preempt()
    task.run()
    assert log == [("gripper", "product")]
    assert task.root.progress_msg == "Preempted"


@pytest.mark.parametrize(
    ("hooks", "reason"),
    [
        ({"execute": lambda s: s.fail("the tray is full", -7)}, "has failed: the tray is full"),
        ({"execute": lambda s: 1 / 0}, "has failed: ZeroDivisionError"),
        ({"onStart": lambda s: s.startError("no power", 3)}, "has failed: no power"),
    ],
)
def test_failed_handler_is_reported_and_the_task_ends_as_preempted(held, hooks, reason):
    held.load(primitive(Hold, "hold", execute=forever), primitive(PutDown, "put_down", **hooks))
    task = started(held)
    task.preempt()
    task.run()
    assert task.status is TaskState.PREEMPTED
    expected = f"Preempted; on_preempt of skiros:Hold-hold (skiros:PutDown) {reason}"
    assert task.root.progress_msg.startswith(expected), task.why
    assert task.root.progress_msg.endswith(task.cause().message)


@pytest.mark.parametrize("prepare", ["no skill", "no object"])
def test_handler_that_cannot_start_is_reported(held, prepare):
    held.load(primitive(Hold, "hold", execute=forever))
    if prepare == "no object":
        need = describe("PutDown", [("Arm", Element("rparts:ArmDevice"), REQUIRED)])
        held.load(primitive(need, "put_down"))
    task = started(held)
    task.preempt()
    task.run()
    assert task.status is TaskState.PREEMPTED
    wanted = "was not run: " if prepare == "no skill" else "has failed: "
    assert f"on_preempt of skiros:Hold-hold (skiros:PutDown) {wanted}" in task.root.progress_msg


def test_condition_that_raises_is_reported(held):
    held.load(primitive(Hold, "hold", execute=forever), primitive(PutDown, "put_down", execute=put_down(1)))
    task = started(held)
    held.refuse("the world model is gone", changes=False, reads=True)
    task.preempt()
    task.run()
    assert "on_preempt of skiros:Hold-hold (skiros:PutDown) was not run: " in task.root.progress_msg
    assert "the world model is gone" in task.root.progress_msg


def test_handler_that_passes_its_deadline_is_preempted_and_reported(held, fake_clock):
    held.clock = fake_clock

    class Brief(Hold):
        seconds = 0.2

        def createDescription(self):
            super().createDescription()
            self._type = "skiros:Hold"

    ended = []
    held.load(primitive(Brief, "hold", execute=forever))
    held.load(primitive(PutDown, "put_down", execute=forever, onEnd=lambda self: ended.append(self.label)))
    task = started(held)
    task.preempt()
    task.run(200)
    assert ended == ["put_down"]
    assert len(task.trace.ticks) == pytest.approx(2 + 0.2 / 0.04, abs=2)
    assert task.root.progress_msg == (
        "Preempted; on_preempt of skiros:Hold-hold (skiros:PutDown) has not ended within 0.2 s"
    )
    assert (task.status, task.node("put_down").state) == (TaskState.PREEMPTED, State.Failure)


def test_second_stop_abandons_the_running_handler_and_those_that_follow(held):
    held.load(hold_and_insert, primitive(Insert, "insert", execute=forever))
    held.load(primitive(PutDown, "put_down", execute=forever))
    task = started(held)
    task.preempt()
    task.preempt()  # before a handler runs, it has no effect
    task.tick(3)
    assert task.status is TaskState.ENDING
    assert task.preempt()
    assert task.tick() is State.Failure
    assert task.root.progress_msg == (
        "Preempted; on_preempt of skiros:Insert-insert (skiros:PutDown) was abandoned: the task was stopped again; "
        "on_preempt of skiros:Hold-hold (skiros:PutDown) was not run: the task was stopped again"
    )
    assert not task.preempt()


@pytest.mark.parametrize("is_ending", [False, True])
def test_shutdown_runs_no_handler(held, is_ending):
    held.load(primitive(Hold, "hold", execute=forever), primitive(PutDown, "put_down", execute=forever))
    task = started(held)
    if is_ending:
        task.preempt()
        task.tick(2)
    task.preempt(shuts_down=True)
    assert task.tick() is State.Failure
    assert task.root.progress_msg.endswith(
        f"(skiros:PutDown) was {'abandoned' if is_ending else 'not run'}: the manager shuts down"
    )


def test_handler_waits_for_nodes_that_are_still_ending(held):
    log = []
    stopping = {"onPreempt": lambda self: State.Running}

    def slow(self):
        self.ticks = getattr(self, "ticks", 0) + 1
        return self.success("stopped") if self.ticks > 4 else self.step("")

    held.load(primitive(Hold, "hold", execute=slow, **stopping))
    held.load(primitive(PutDown, "put_down", execute=put_down(1, log)))
    task = started(held)
    task.preempt()
    task.tick()
    assert (task.status, log) == (TaskState.ENDING, [])
    assert len(task.root.children) == 1
    task.run()
    assert log == [("gripper", "product")]


def test_each_branch_of_a_parallel_has_its_own_handler(held):
    log = []
    other = held.add("rparts:GripperEffector", "other gripper", held.robot, "skiros:hasA")
    held.move("other product", "other gripper")
    held.load(primitive(Hold, "hold", execute=forever), primitive(PutDown, "put_down", execute=put_down(2, log)))
    nodes = [
        held.node("hold", Object=held.element("product"), Gripper=held.element("gripper")),
        held.node("hold", Object=held.element("other product"), Gripper=other),
    ]
    task = started(held, _group(held, ParallelFs(), *nodes))
    task.preempt()
    task.run()
    assert sorted(log) == [("gripper", "product"), ("other gripper", "other product")]


def test_breakpoints_do_not_stop_a_handler(held):
    held.load(primitive(Hold, "hold", execute=forever), primitive(PutDown, "put_down", execute=put_down(2)))
    one = Scheduler(rate=200)
    try:
        one.breakpoints.add(Breakpoint("node", "PutDown"))
        task = one.new_task(held.wmi, "test")
        task.root(held.node("hold", Object=held.element("product")))
        one.start(task.id)
        _await_state(task, "hold")
        one.preempt(task.id)
        assert task.ended.wait(10)
        assert task.root.progress_msg == "Preempted"
        assert held.holder("product") == "tray"
    finally:
        one.stop()


def _await_state(task, label):
    done = threading.Event()
    for _ in range(1000):
        if any(n.label == label and n.state is State.Running for n in task.nodes()):
            return
        done.wait(0.005)
    raise AssertionError(f"{label} does not run")


def test_hook_of_a_handler_may_take_until_the_deadline_and_is_abandoned_after_it(held):
    class Brief(Hold):
        seconds = 0.5

        def createDescription(self):
            super().createDescription()
            self._type = "skiros:Hold"

    reached, released = threading.Event(), threading.Event()

    def stuck(self):
        reached.set()
        released.wait(30)
        return self.success("late")

    held.load(primitive(Brief, "hold", execute=forever), primitive(PutDown, "put_down", execute=stuck))
    one = Scheduler(rate=200, preempt_timeout=0.2)
    try:
        task = one.new_task(held.wmi, "test")
        task.root(held.node("hold", Object=held.element("product")))
        one.start(task.id)
        _await_state(task, "hold")
        one.preempt(task.id)
        assert reached.wait(5)
        assert not task.ended.wait(0.35), "abandoned before the deadline"
        assert task.ended.wait(10)
        assert "skiros:PutDown-put_down: execute has not returned" in task.root.progress_msg
        assert "has not ended within 0.5 s" in task.root.progress_msg
        assert task.status is TaskState.PREEMPTED
    finally:
        released.set()
        one.stop()


def test_hung_hook_of_the_preempted_skill_does_not_prevent_its_handler(held):
    log, reached, released = [], threading.Event(), threading.Event()

    def stuck(self):
        reached.set()
        released.wait(30)
        return self.step("")

    held.load(primitive(Hold, "hold", execute=stuck), primitive(PutDown, "put_down", execute=put_down(2, log)))
    one = Scheduler(rate=200, preempt_timeout=0.3)
    try:
        task = one.new_task(held.wmi, "test")
        task.root(held.node("hold", Object=held.element("product")))
        one.start(task.id)
        assert reached.wait(5)
        one.preempt(task.id)
        assert task.ended.wait(10)
        assert log == [("gripper", "product")]
        assert "skiros:Hold-hold: execute has not returned" in task.root.progress_msg
    finally:
        released.set()
        one.stop()


def test_implementation_may_add_or_replace_the_handler_of_its_description(held):
    class bare(primitive(Work, "bare", execute=forever)):
        def createDescription(self):
            super().createDescription()
            self.set_on_preempt("Note")

    calls = []
    held.load(primitive(describe("Note"), "note", execute=lambda self: calls.append(1) or self.success("")), bare)
    task = started(held, held.node("bare"))
    task.preempt()
    task.run()
    assert calls == [1]


@pytest.mark.parametrize(
    ("arguments", "error"),
    [
        ({"skill": ""}, WrongValue),
        ({"skill": "PutDown", "seconds": 0.0}, WrongValue),
        ({"skill": "PutDown", "seconds": float("nan")}, WrongValue),
        ({"skill": "PutDown", "seconds": True}, WrongValue),
        ({"skill": "PutDown", "condition": "Holds"}, WrongType),
    ],
)
def test_wrong_declaration_is_refused(arguments, error):
    with pytest.raises(error, match="on_preempt"):
        SkillDescription().set_on_preempt(**arguments)


def test_task_without_handler_ends_in_the_tick_of_its_preemption(held):
    held.load(primitive(Work, "work", execute=forever))
    assert held.library.candidates("skiros:Work", "work")[0].declared.on_preempt is None
    task = started(held, held.node("work"))
    task.preempt()
    assert task.tick() is State.Failure
    assert task.root.progress_msg == "Preempted"
