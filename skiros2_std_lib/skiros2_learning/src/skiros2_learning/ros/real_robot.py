"""Executions on running nodes: a real robot, or the simulator's nodes. One at a time, each confirmed by the operator.

Before each execution the reset skills run, then the manager checks the values against the limits of its skills. The
record is made of the world model's poses and of signals, both as they arrive over ROS.
"""

from __future__ import annotations

import json
import threading
from collections.abc import Callable, Mapping

import numpy as np
import rospy

from skiros2_common.command_line.command import user
from skiros2_common.core.errors import ConfigurationError, Refused, RobotStopped, SkirosError
from skiros2_common.core.explanation import worst_kind
from skiros2_common.core.failure_kind import FailureKind
from skiros2_common.core.names import local_name
from skiros2_common.core.signals import SIGNAL, Signal
from skiros2_common.ros.signals import RosSignals
from skiros2_learning.core.elements import find_element
from skiros2_learning.core.episode_record import EpisodeRecord
from skiros2_learning.core.evaluation import Unavailable
from skiros2_learning.core.rewards import names_used, unknown_names
from skiros2_learning.core.scenario import Scenario, ScenarioError, Step
from skiros2_learning.core.sections import Mistake, near
from skiros2_learning.core.variables import Value
from skiros2_motion.core.geometry import Pose
from skiros2_msgs.msg import SkillProgress
from skiros2_sim.core.scene_reader import SceneTree
from skiros2_skill.client.description import Parameter
from skiros2_skill.client.description import Step as SkillStep
from skiros2_skill.client.skill_goal import SkillGoal
from skiros2_skill.command_line.connection import become_node, connect
from skiros2_world_model.ros.world_model_interface import WorldModelInterface

#: How long the first value of a signal is waited for (s), and how long a cancelled task may take to end (s).
_SIGNAL_TIMEOUT, _GRACE = 5.0, 20.0

#: Asked before each execution, with a text for people. Returns whether it may run.
Confirm = Callable[[str], bool]


def run_episode(scenario: Scenario, configuration: Mapping[str, Value], seed: int, index: int) -> EpisodeRecord:
    """Refuses: an execution needs a connection and the operator.

    :raises Refused: always.
    """
    raise Refused("executions on a real robot are started by `learn run` and `learn resume`")


def check_scenario(scenario: Scenario) -> None:
    """Checks what a scenario asks of a real robot.

    :raises ScenarioError: the text names all problems, with their lines.
    """
    known = scenario.real.signals
    mistakes: list[Mistake] = []
    for path, reward in scenario.reward_paths:
        _, pairs, series = names_used([reward])
        unknown = sorted(series - set(known))
        mistakes += [
            (path, f"real.signals: no signal for the series {name!r}; {near(name, known)}") for name in unknown
        ]
        text = "distances are not measured on a real robot"
        mistakes += [(path, f"{text}: {one!r} to {other!r}") for one, other in sorted(pairs)]
    if mistakes:
        raise ScenarioError(f"scenario {scenario.name}", mistakes, scenario.original)


class RealRobot:
    """The connection to a robot's nodes. A context manager; makes this process a node.

    :param confirm: asked before each execution.
    :raises SkirosError: a node does not run, or an element, signal or skill does not exist; the text names all.
    """

    def __init__(self, scenario: Scenario, confirm: Confirm) -> None:
        check_scenario(scenario)
        self._scenario = scenario
        self._confirm = confirm
        self._manager = connect(scenario.real.manager, user())
        become_node("learn")
        self._wmi = WorldModelInterface(rospy.get_name())
        self._signals = RosSignals()
        self._lock = threading.Lock()
        self._values: dict[str, list[float]] = {}
        things, _, series = names_used(scenario.all_rewards)
        self._things, self._series = sorted(things), sorted(series)
        try:
            self._check()
        except SkirosError:
            self.close()
            raise

    def __enter__(self) -> RealRobot:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """Closes all connections."""
        self._signals.close()
        self._manager.close()

    def execute(self, scenario: Scenario, configuration: Mapping[str, Value], seed: int, index: int) -> EpisodeRecord:
        """Resets, checks, asks the operator, and runs the task once; see `evaluation.Execution`.

        :raises Unavailable: the reset has failed, or the robot is stopped or gone: no configuration is to blame.
        :raises Refused: the manager does not accept the values, or the operator does not confirm.
        """
        try:
            self._reset()
            skills = [self._skill(step, configuration) for step in scenario.task]
            refusal = self._manager.preview(skills).refusal
            if refusal is not None and refusal.code == RobotStopped.CODE:
                raise Unavailable(refusal.message)
        except Unavailable:
            raise
        except SkirosError as error:
            raise Unavailable(str(error)) from error
        if refusal is not None:
            raise Refused(refusal.message)
        values = ", ".join(f"{name}={value:.4g}" if isinstance(value, float) else f"{name}={value}"
                           for name, value in configuration.items())  # fmt: skip
        if not self._confirm(f"execution {index + 1} of {scenario.repetitions} with {values}"):
            raise Refused("the operator has not confirmed")
        try:
            return self._record(skills)
        except SkirosError as error:
            raise Unavailable(str(error)) from error

    # -- internal ----------------------------------------------------------------------------------------------------

    def _check(self) -> None:
        problems = []
        steps = (*self._scenario.task, *self._scenario.real.reset)
        for step in steps:  # a manager loads skills when they are first asked for
            refusal = self._manager.preview([SkillStep(step.skill, step.label)], partial=True).refusal
            if refusal is not None and refusal.code != RobotStopped.CODE:
                problems.append(refusal.message)
        self._skills = self._manager.read_skills()
        for step in steps:
            known = self._parameters(step)
            for key, value in step.parameters.items():
                if known and key not in known:
                    problems.append(f"{step.skill} has no parameter {key!r}; {near(key, known)}")
                elif key in known and known[key].is_element:
                    problems += self._problem_of(str(value))
        for label in self._things:
            problems += self._problem_of(label)
        for name in self._series:
            problems += self._problem_of(self._scenario.real.signals[name])
        for reward in self._scenario.all_rewards:
            problems += [text for _, text in unknown_names(reward, self._wmi)]
        if problems:
            raise ConfigurationError(f"scenario {self._scenario.name}: {'; '.join(dict.fromkeys(problems))}")

    def _problem_of(self, name: str) -> list[str]:
        try:
            find_element(self._wmi, name)
        except SkirosError as error:
            return [str(error)]
        return []

    def _parameters(self, step: Step) -> dict[str, Parameter]:
        """Returns the parameters of a step's skill as the manager describes them; {} if it has no such skill."""
        fitting = (each for each in self._skills if local_name(each.type) == local_name(step.skill))
        return next((each.parameters for each in fitting if step.label in ("", each.label)), {})

    def _skill(self, step: Step, configuration: Mapping[str, Value]) -> SkillStep:
        given = dict(step.parameters)
        for name, value in configuration.items():
            if name.rpartition(".")[0] == step.name:
                given[name.rpartition(".")[2]] = value
        known, params = self._parameters(step), []
        for key, value in given.items():
            if key in known and known[key].is_element:
                value = find_element(self._wmi, str(value)).id
            params.append(json.dumps({"key": key, "values": [value]}))
        return SkillStep(step.skill, step.label, params)

    def _reset(self) -> None:
        """Runs the reset skills.

        :raises Unavailable: they have failed.
        """
        steps = self._scenario.real.reset
        if not steps:
            return
        run = self._manager.run([self._skill(step, {}) for step in steps])
        try:
            ended = run.wait(self._scenario.real.reset_timeout)
        finally:
            _stop(run)
        if not ended:
            raise Unavailable(f"the reset has not ended within {self._scenario.real.reset_timeout:g} s")
        if not run.succeeded():
            raise Unavailable(f"the reset has failed: {_why(run)}")

    def _record(self, skills: list[SkillStep]) -> EpisodeRecord:
        """Runs the task, and takes samples until it ends or its time is over."""
        period, limit = 1.0 / self._scenario.real.sample_rate, self._scenario.simulation.time_limit
        stops = [self._subscribe(name) for name in self._series]
        try:
            samples = _Samples(self._things, self._series)
            begin, reason = self._signals.now(), ""
            samples.take(0.0, self._poses(), self._taken())
            run = self._manager.run(skills)
            try:
                while not run.wait(period):
                    spent = self._signals.now() - begin
                    samples.take(spent, self._poses(), self._taken())
                    if spent > limit:
                        reason = f"not finished after {limit:g} s"
                        run.cancel()
                        if not run.wait(_GRACE):
                            raise Unavailable(f"the task does not end: {self._manager.name}")
            finally:
                _stop(run)
            self._wmi.catch_up()
            samples.take(self._signals.now() - begin, self._poses(), self._taken())
        finally:
            for stop in stops:
                stop()
        succeeded = not reason and run.succeeded()
        kind = FailureKind.RETRYABLE if succeeded else worst_kind(run.explanations())
        if kind.is_final and kind is not FailureKind.LIMIT:  # a limit is a result; a lost part no reset finds
            raise Unavailable(f"{_why(run)} ({kind.words}): a person has to look before the next execution")
        return samples.record(succeeded, "" if succeeded else reason or _why(run), self._wmi)

    def _subscribe(self, name: str) -> Callable[[], None]:
        """Collects the values of a signal from now on; waits for the first one.

        :raises Unavailable: there is none.
        """
        element = find_element(self._wmi, self._scenario.real.signals[name])
        arrived = threading.Event()
        with self._lock:
            self._values[name] = []

        def receive(value: float, time: float, problem: str) -> None:
            if problem:
                return
            with self._lock:
                self._values[name].append(value)
            arrived.set()

        stop = self._signals.subscribe(Signal.of(element), receive)
        if not arrived.wait(_SIGNAL_TIMEOUT):
            stop()
            raise Unavailable(f"no value of the {SIGNAL} {element.label!r} within {_SIGNAL_TIMEOUT:g} s")
        return stop

    def _taken(self) -> dict[str, float]:
        """Returns the maximum of each signal since the last call, or the last one known; of powers the mean."""
        taken = {}
        with self._lock:
            for name, values in self._values.items():
                taken[name] = float(np.mean(values)) if name.endswith(".power") else max(values)
                self._values[name] = values[-1:]
        return taken

    def _poses(self) -> dict[str, Pose]:
        if not self._things:
            return {}
        tree, poses = SceneTree(self._wmi.get_scene_elements()), {}
        for label in self._things:
            pose = tree.pose_in_map(find_element(self._wmi, label))
            if pose is None:
                raise Unavailable(f"the world model has no pose of {label!r}")
            poses[label] = pose
        return poses


class _Samples:
    """The samples of one execution."""

    def __init__(self, things: list[str], series: list[str]) -> None:
        self._times: list[float] = []
        self._poses: dict[str, list[Pose]] = {label: [] for label in things}
        self._values: dict[str, list[float]] = {name: [] for name in series}

    def take(self, time: float, poses: Mapping[str, Pose], values: Mapping[str, float]) -> None:
        self._times.append(time)
        for label, taken in self._poses.items():
            taken.append(poses[label])
        for name, numbers in self._values.items():
            numbers.append(values[name])

    def record(self, succeeded: bool, reason: str, wmi: WorldModelInterface) -> EpisodeRecord:
        return EpisodeRecord.of(succeeded, reason, self._times, self._poses, self._values, {}, wmi)


def _stop(run: SkillGoal) -> None:
    """Preempts a task that has not ended: after Ctrl-C, an error or a timeout."""
    if not run.done:
        run.cancel()


def _why(run: SkillGoal) -> str:
    explanations = run.explanations()
    if explanations:
        return explanations[-1].message
    return "it was preempted" if run.result().state != SkillProgress.SUCCESS else ""
