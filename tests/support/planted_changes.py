"""A catalogue of single changes of skills, engine, goals for drivers, world model and planner, each planted in this
process and found by a re-run of one recorded run.
"""

from __future__ import annotations

import inspect
import textwrap
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import pytest
from replay_skills import engine as engine_skills
from replay_skills import skills as gripper_skills

from skiros2_common.core.abstract_skill import State
from skiros2_common.core.explanation import HOLD, POST
from skiros2_common.core.params import ParamTypes
from skiros2_common.core.world_element import Element
from skiros2_demo_skills import timed_motions, transport_skills
from skiros2_skill.core.engine import executor, parameters, selection
from skiros2_skill.core.engine.blackboard import Blackboard
from skiros2_skill.core.engine.hooks import Hooks
from skiros2_skill.core.processors import ParallelFf, ParallelFs, Selector, _Repeat
from skiros2_std_reasoners.core import spatial_data
from skiros2_std_reasoners.ros import codes
from skiros2_std_skills import utility_primitives
from skiros2_std_skills.action_client_primitive import PrimitiveActionClient
from skiros2_task.core import compiler, planning
from skiros2_task.core.formula import TRUE
from skiros2_task.core.task import PlanningTask
from skiros2_world_model.core.world_model_client import WorldModelClient

Patch = pytest.MonkeyPatch

#: Recorded runs.
TIMED, DRIVE, GRIPPER, ENGINE = "timed_pick_place.bag", "timed_drive.bag", "gripper.bag", "engine.bag"


@dataclass(frozen=True)
class PlantedChange:
    """One change.

    :param bag: the recorded run whose re-run finds it.
    :param plant: makes the change.
    :param played: labels of primitives whose progress is played in the re-run.
    :param not_compared: a part of the line by which the re-run lists that it does not compare this; "": it is found.
    """

    group: str
    name: str
    bag: str
    plant: Callable[[Patch], object]
    played: frozenset[str] = frozenset()
    not_compared: str = ""

    def __str__(self) -> str:
        return f"{self.group}: {self.name}"


def edited(owner: Any, name: str, old: str, new: str) -> Callable[[Patch], None]:
    """Replaces a part of the source of a function, which must occur once."""

    def plant(patch: Patch) -> None:
        function = getattr(owner, name)
        source = textwrap.dedent(inspect.getsource(function))
        assert source.count(old) == 1, f"{name} has {source.count(old)} times {old!r}"
        found: dict[str, Any] = {}
        code = "from __future__ import annotations\n" + source.replace(old, new)
        exec(compile(code, inspect.getfile(function), "exec"), function.__globals__, found)
        patch.setattr(owner, name, found[name])

    return plant


def replaced(owner: Any, name: str, new: Callable[[Any], Any]) -> Callable[[Patch], None]:
    """Replaces an attribute by what `new` makes of it."""
    return lambda patch: patch.setattr(owner, name, new(getattr(owner, name)))


def after(owner: Any, name: str, change: Callable[[Any], object]) -> Callable[[Patch], None]:
    """Changes an object after one of its methods."""

    def wrapped(genuine: Any) -> Any:
        def method(self: Any, *arguments: Any) -> Any:
            answer = genuine(self, *arguments)
            change(self if not arguments else arguments[0])
            return answer

        return method

    return replaced(owner, name, wrapped)


def described(cls: Any, change: Callable[[Any], object]) -> Callable[[Patch], None]:
    """Changes what a skill declares."""
    return after(cls, "createDescription", lambda skill: change(skill))


# -- 1. what skills declare -------------------------------------------------------------------------------------------


def _without(kind: str, label: str) -> Callable[[Any], None]:
    def change(description: Any) -> None:
        conditions = getattr(description, kind)
        assert any(c.label == label for c in conditions)
        conditions[:] = [c for c in conditions if c.label != label]

    return change


def _duration(seconds: float, **limits: Any) -> Callable[[Any], None]:
    return lambda motion: motion.addParam("Duration", seconds, ParamTypes.Optional, "Duration of the motion", **limits)


def _declared(name: str, cls: Any, change: Callable[[Any], object], bag: str = TIMED) -> PlantedChange:
    return PlantedChange("declared", name, bag, described(cls, change))


Pick, Drive = transport_skills.Pick, transport_skills.Drive
DECLARED = [
    _declared("no pre-condition that holds", Pick, _without("_pre_conditions", "GripperEmpty")),
    _declared("no hold-condition that holds", Pick, _without("_hold_conditions", "RobotAtWorkstation")),
    _declared("no post-condition that holds", Pick, _without("_post_conditions", "GripperNotEmpty")),
    _declared("a further pre-condition that holds", Drive, lambda d: d.addPreCondition(
        d.getRelationCond("Elsewhere", "skiros:contain", "Robot", "TargetLocation", False))),
    _declared("a condition of another relation", Drive, lambda d: (_without("_post_conditions", "RobotHasLeft")(d),
        d.addPostCondition(d.getRelationCond("RobotHasLeft", "skiros:contain", "Robot", "StartLocation", False)))),
    _declared("a condition of another label", Drive, lambda d: (_without("_post_conditions", "RobotHasLeft")(d),
        d.addPostCondition(d.getRelationCond("RobotLeft", "skiros:at", "Robot", "StartLocation", False)))),
    _declared("a limit that is not reached", timed_motions.move_arm_timed, _duration(1.0, unit="s", minimum=-1)),
    _declared("no limit", timed_motions.move_arm_timed, _duration(1.0, unit="s")),
    _declared("another unit", timed_motions.move_arm_timed, _duration(1.0, unit="ms", minimum=0)),
    _declared("another default within a tick", timed_motions.tuck_arm_timed, _duration(1.0001, unit="s", minimum=0)),
    _declared("a further parameter", timed_motions.tuck_arm_timed,
        lambda d: d.addParam("Unused", 8.0, ParamTypes.Optional)),
    _declared("a parameter of another kind", Pick,
        lambda d: d.addParam("Container", Element("skiros:Container"), ParamTypes.Required)),
    _declared("a parameter of another class", Pick,
        lambda d: d.addParam("Object", Element("sumo:Object"), ParamTypes.Required)),
]  # fmt: skip


# -- 2. what is asked of drivers --------------------------------------------------------------------------------------


def _goal(change: Callable[[Any], object]) -> Callable[[Patch], None]:
    def wrapped(genuine: Any) -> Any:
        def build(self: Any) -> Any:
            goal = genuine(self)
            change(goal.command)
            return goal

        return build

    return replaced(gripper_skills.grasp, "buildGoal", wrapped)


def _set(name: str, more: float) -> Callable[[Any], None]:
    return lambda command: setattr(command, name, getattr(command, name) + more)


def _cancelling(genuine: Any) -> Any:
    def on_feedback(self: Any, message: Any) -> State:
        self.client.cancel_goal()
        return genuine(self, message)  # type: ignore[no-any-return]

    return on_feedback


def _once_more(genuine: Any) -> Any:
    def on_done(self: Any, status: int, message: Any) -> State:
        self.client.send_goal(self.buildGoal())
        return genuine(self, status, message)  # type: ignore[no-any-return]

    return on_done


def _driver(name: str, plant: Callable[[Patch], object], bag: str = GRIPPER, **more: Any) -> PlantedChange:
    return PlantedChange("drivers", name, bag, plant, **more)


_WAIT = 'specify={"Duration": 0.3}'
DRIVERS = [
    _driver("a position 0.1 mm wider", _goal(_set("position", 1e-4))),
    _driver("a position 1 nm wider", _goal(_set("position", 1e-9 + 1e-10))),
    _driver("another effort", _goal(_set("max_effort", 1.0))),
    _driver("another action", lambda patch: patch.setattr(gripper_skills, "GRIPPER", "/other_gripper")),
    _driver("no cancel request on preemption", edited(PrimitiveActionClient, "onPreempt",
        "self.client.cancel_all_goals()", "pass"), ENGINE),
    _driver("a cancel request of one goal for all", edited(PrimitiveActionClient, "onPreempt",
        "self.client.cancel_all_goals()", "self.client.cancel_goal()"), ENGINE),
    _driver("a further cancel request", replaced(gripper_skills.grasp, "onFeedback", _cancelling)),
    _driver("a further goal", replaced(gripper_skills.grasp, "onDone", _once_more)),
    _driver("no goal", edited(PrimitiveActionClient, "_send",
        "send_goal(self.client, goal, done_cb=self._doneCb, feedback_cb=self._feedbackCb)", "pass")),
    _driver("feedback is not read", edited(gripper_skills.grasp, "onFeedback",
        'self.step(f"{msg.position:.3f} m open")', "self.step()")),
    _driver("the result is read differently", edited(gripper_skills.grasp, "onDone", "if msg.stalled", "if True")),
    _driver("another value for a skill that is played", edited(gripper_skills.grasp_and_wait, "expand", _WAIT,
        'specify={"Duration": 0.8}'), played=frozenset({"wait"})),
    _driver("a little other value for a skill that is played", edited(gripper_skills.grasp_and_wait, "expand", _WAIT,
        'specify={"Duration": 0.3001}'), played=frozenset({"wait"})),
    _driver("no value for a skill that is played", edited(gripper_skills.grasp_and_wait, "expand", _WAIT, ""),
        played=frozenset({"wait"})),
    _driver("a write of a skill that is played", edited(engine_skills.note_end, "execute", 'self.success("")',
        'self.success("", self.wmi.remove_element(self.params["Robot"].value))'), ENGINE,
        played=frozenset({"note_end"}), not_compared="what note_end does"),
]  # fmt: skip


# -- 3. the engine ----------------------------------------------------------------------------------------------------


def _not_evaluated(stage: str) -> Callable[[Patch], None]:
    def wrapped(genuine: Any) -> Any:
        return lambda self, at, *arguments: None if at == stage else genuine(self, at, *arguments)

    return replaced(parameters.Parameters, "check", wrapped)


def _engine(name: str, plant: Callable[[Patch], object], bag: str = ENGINE) -> PlantedChange:
    return PlantedChange("engine", name, bag, plant)


def _late_holds(patch: Patch) -> None:
    genuine = parameters.Parameters.refresh
    seen: set[int] = set()

    def refresh(self: Any, run: Any) -> Any:
        if run.hold_conditions and id(run) not in seen:
            seen.add(id(run))
            return None
        return genuine(self, run)

    patch.setattr(parameters.Parameters, "refresh", refresh)


ENGINE_CHANGES = [
    _engine("post-conditions are not evaluated", _not_evaluated(POST)),
    _engine("post-conditions that hold are not evaluated", _not_evaluated(POST), TIMED),
    _engine("hold-conditions are not evaluated", _not_evaluated(HOLD)),
    _engine("hold-conditions that hold are not evaluated", _not_evaluated(HOLD), TIMED),
    _engine("hold-conditions are evaluated a tick late", _late_holds),
    _engine("hold-conditions that hold are evaluated a tick late", _late_holds, TIMED),
    _engine("pre-conditions are not evaluated", edited(selection, "_find_params",
        "failure = check_conditions(PRE, conditions, params, wmi, run.evaluated, note)", "failure = None"), TIMED),
    _engine("onEnd is not called", replaced(Hooks, "on_end", lambda _: lambda self, run, state, preempted: state)),
    _engine("onEnd without effect is not called",
        replaced(Hooks, "on_end", lambda _: lambda self, run, state, preempted: state), DRIVE),
    _engine("onStart is called twice", edited(Hooks, "on_start", "refused = self.call(",
        'self.call(run, "onStart", run.instance.onStart, START_RAISED)\n        refused = self.call('), DRIVE),
    _engine("onPreempt is not called", replaced(Hooks, "on_preempt", lambda _: lambda self, run: State.Failure)),
    _engine("a value that is unset stays", edited(Blackboard, "push", "if removes and entry is not None and is_own",
        "if False")),
    _engine("values are not pulled", replaced(Blackboard, "pull", lambda _: lambda *arguments: False), TIMED),
    _engine("assigned elements are not written", edited(executor.Executor, "_finish_tick",
        "failure = self.parameters.write_back(run, state, version)", "failure = None")),
    _engine("|ff| ends with the first success", edited(ParallelFf, "processChildren", "succeeded.add(index)",
        "return self.stopAll(children, visitor) or _SUCCESS")),
    _engine("|fs| waits for all", edited(ParallelFs, "processChildren", "if state is not _RUNNING:",
        "if state is _FAILURE:")),
    _engine("|fs| leaves the others running", edited(ParallelFs, "processChildren",
        "self.stopAll(children, visitor)", "pass")),
    _engine("retry gives up one attempt earlier", edited(_Repeat, "processChildren",
        "(0 <= self._times <= self._done)", "(0 <= self._times <= self._done + 1)")),
    _engine("a fallback stops at a failure", lambda patch: patch.setattr(Selector, "_continue_on", State.Success)),
    _engine("a retry does not reset its processor", edited(_Repeat, "processChildren", "self._processor.reset()",
        "pass")),
]  # fmt: skip


# -- 4. the world model -----------------------------------------------------------------------------------------------


def _rounded(digits: int) -> Callable[[Patch], None]:
    """What is written has this many digits after the point."""

    def wrapped(genuine: Any) -> Any:
        def write(self: Any, element: Element, *more: Any) -> Any:
            for key in element.available_properties:
                prop = element.getProperty(key)
                if prop.values and isinstance(prop.value, float):
                    element.setProperty(key, round(prop.value, digits))
            return genuine(self, element, *more)

        return write

    return replaced(WorldModelClient, "update_element_properties", wrapped)


def _twice(name: str) -> Callable[[Patch], None]:
    def wrapped(genuine: Any) -> Any:
        def write(self: Any, *arguments: Any) -> Any:
            genuine(self, *arguments)
            return genuine(self, *arguments)

        return write

    return replaced(WorldModelClient, name, wrapped)


def _world(name: str, plant: Callable[[Patch], object], bag: str = TIMED) -> PlantedChange:
    return PlantedChange("world model", name, bag, plant)


def _inverted(genuine: Any) -> Any:
    def composed(first: Any, second: Any) -> Any:
        return genuine(second, first)

    return composed


WORLD = [
    _world("written numbers have four digits", _rounded(4), ENGINE),
    _world("written numbers have three digits", _rounded(3), ENGINE),
    _world("written numbers have two digits", _rounded(2), ENGINE),
    _world("written poses have four digits", edited(spatial_data, "set_numbers", "given = list(values)",
        "given = [round(value, 4) for value in values]"), ENGINE),
    _world("a pose differs by 0.5 mm", edited(transport_skills, "at_height", "height}", "height + 0.0005}")),
    _world("a pose differs by 1 nm", edited(transport_skills, "at_height", "height}", "height + 1e-9}")),
    _world("a text has another number", edited(engine_skills.note_end, "onEnd", "weighs 0.08 t", "weighs 0.09 t"),
        ENGINE),
    _world("a property is written twice", _twice("update_element_properties")),
    _world("an element is written twice", _twice("update_element")),
    _world("the same value is not written again", edited(engine_skills.set_weight, "execute",
        'robot.setProperty(WEIGHT',
        'if robot.value_of(WEIGHT) == self.params["Weight"].value: return self.success("written")\n    '
        "robot.setProperty(WEIGHT"), ENGINE),
    _world("a rotation is inverted", replaced(engine_skills, "composed", _inverted), ENGINE),
    _world("the reasoner inverts a rotation", replaced(codes, "from_euler",
        lambda genuine: lambda roll, pitch, yaw: genuine(-roll, -pitch, -yaw)), ENGINE),
    _world("the reasoner exchanges axes", replaced(codes, "from_euler",
        lambda genuine: lambda roll, pitch, yaw: genuine(pitch, roll, yaw)), ENGINE),
    _world("a relation is not removed", edited(transport_skills.drive, "expand",
        ', "OldDstToRemove": "StartLocation"', ""), DRIVE),
    _world("another relation is set", edited(transport_skills.drive, "expand", '"Relation": "skiros:at"',
        '"Relation": "skiros:contain"'), DRIVE),
    _world("a property is not written", edited(engine_skills.note_end, "onEnd",
        "self.wmi.update_element_properties(robot)", "pass"), ENGINE),
    _world("another property is written", edited(engine_skills.set_weight, "execute", "WEIGHT", '"skiros:Height"'),
        ENGINE),
    _world("a further property is written", edited(engine_skills.set_weight, "execute",
        "self.wmi.update_element_properties(robot)",
        'robot.setProperty("skiros:Height", 1.0); self.wmi.update_element_properties(robot)'), ENGINE),
    _world("two elements are exchanged", edited(utility_primitives, "_move",
        '(start, "Empty"), (target, "Full")', '(target, "Empty"), (start, "Full")')),
    _world("the object is not moved", edited(utility_primitives, "_move", "wmi.update_element(moved)", "pass")),
]  # fmt: skip

# -- 5. the planner ---------------------------------------------------------------------------------------------------


def _step(change: Callable[[Any], Any]) -> Callable[[Patch], None]:
    """Changes the steps of each plan."""

    def wrapped(genuine: Any) -> Any:
        def make(*arguments: Any) -> Any:
            plan = genuine(*arguments)
            return replace(plan, steps=tuple(change(list(plan.steps))))

        return make

    return replaced(planning, "make_plan", wrapped)


def _with_call(**values: Any) -> Callable[[Any], Any]:
    return lambda steps: [*steps[:-1], replace(steps[-1], call=replace(steps[-1].call, **values))]


def _without_preconditions(genuine: Any) -> Any:
    def make(robots: Any) -> Any:
        actions, notes = genuine(robots)
        return [replace(action, precondition=TRUE) for action in actions], notes

    return make


def _without_effects(genuine: Any) -> Any:
    def make(robots: Any) -> Any:
        actions, notes = genuine(robots)
        return [replace(action, effects=action.effects[:1]) for action in actions], notes

    return make


def _planner(name: str, plant: Callable[[Patch], object], bag: str = TIMED) -> PlantedChange:
    return PlantedChange("planner", name, bag, plant)


PLANNER = [
    _planner("steps in another order", _step(lambda steps: [steps[1], steps[0], *steps[2:]])),
    _planner("a step is missing", _step(lambda steps: steps[:-1])),
    _planner("a step too many", _step(lambda steps: [*steps, steps[-1]])),
    _planner("a step waits for nothing", _step(
        lambda steps: [*steps[:-1], replace(steps[-1], after=frozenset())])),
    _planner("another robot", _step(_with_call(manager="/other_robot"))),
    _planner("another implementation", _step(_with_call(label="place_slowly"))),
    _planner("another element", _step(lambda steps: _with_call(arguments=steps[0].call.arguments)(steps))),
    _planner("a longer schedule",
        replaced(planning.Plan, "makespan", lambda genuine: property(lambda plan: genuine.fget(plan) + 0.5))),
    _planner("no plan is found", edited(planning, "_why_impossible", "if task.actions:", "if not task.actions:")),
    _planner("the goal counts as reached", replaced(PlanningTask, "satisfied", lambda _: True), DRIVE),
    _planner("found plans are rejected", edited(planning.TaskPlanner, "_result",
        "if answer.outcome is not Outcome.SOLVED", "if answer.outcome is Outcome.SOLVED"), DRIVE),
    _planner("pre-conditions are ignored", replaced(compiler, "make_actions", _without_preconditions)),
    _planner("effects are ignored", replaced(compiler, "make_actions", _without_effects)),
]  # fmt: skip

CHANGES = [*DECLARED, *DRIVERS, *ENGINE_CHANGES, *WORLD, *PLANNER]
