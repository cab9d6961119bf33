"""One execution of a task: skills, tree engine, drivers and physics in this process, faster than real time.

The same scenario, configuration, seed and index give the same record, bit for bit: everything is made from scratch,
time is the simulated one, and threads of skills end before the world is stepped.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import replace
from typing import Any

import numpy as np

from skiros2_common.core.abstract_skill import State
from skiros2_common.core.errors import ConfigurationError, SkirosError, UnknownName, WrongValue
from skiros2_common.core.params import Param, ParamTypes
from skiros2_common.core.world_element import Element
from skiros2_learning.core.elements import find_element
from skiros2_learning.core.episode_record import EpisodeRecord
from skiros2_learning.core.randomisation import NO_RANDOMISATION, Draw, Quantity, draw, quantities
from skiros2_learning.core.rewards import names_used, unknown_names
from skiros2_learning.core.scenario import NO_SCENE, Scenario, ScenarioError, Step
from skiros2_learning.core.sections import Mistake, UnknownNames, near
from skiros2_learning.core.variables import Value, Variable
from skiros2_learning.core.variations import Feature
from skiros2_learning.local.knowledge import fresh_world_model
from skiros2_learning.local.no_drivers import NoDrivers
from skiros2_learning.local.recorder import Recorder
from skiros2_motion.core.geometry import Pose, composed, inverted
from skiros2_sim.core.scene_reader import SceneTree, read_scene
from skiros2_sim.core.world import World
from skiros2_skill.testing import BenchTask, FakeClock, SkillBench
from skiros2_std_reasoners.core import spatial_data as space
from skiros2_std_skills.core.devices import posture

try:
    from skiros2_learning.local.drivers import LocalDrivers
except ModuleNotFoundError:  # without ROS, no skill that is there has a client of an action
    LocalDrivers = NoDrivers

#: Time that a preempted task has to end (s of simulated time).
_GRACE = 2.0
#: Time that a thread of a skill has to end (s of wall time).
_THREAD_TIMEOUT = 10.0
#: Why there may be no skill of a type.
_NO_ROS = "ROS is not installed: skills that use its actions or services are not there"
#: Smallest motion that is written to the world model (m).
_STILL = 1e-5


def run_episode(scenario: Scenario, configuration: Mapping[str, Value], seed: int, index: int) -> EpisodeRecord:
    """Runs the task of a scenario once.

    :param seed: of the evaluation.
    :param index: of the repetition.
    :raises SkirosError: the scenario does not fit the scene or the skills.
    """
    with FakeClock() as clock, Episode(scenario, seed, index, clock) as episode:
        return episode.run(configuration)


class Episode:
    """A scene with physics and a robot's skills, ready to run the task once. A context manager.

    :param clock: in use.
    """

    def __init__(self, scenario: Scenario, seed: int, index: int, clock: FakeClock) -> None:
        self._scenario = scenario
        self._period = 1.0 / scenario.simulation.tick_rate
        random = np.random.default_rng([seed, index])
        with ExitStack() as stack:
            wmi = stack.enter_context(fresh_world_model(scenario.scene))
            self.bench = stack.enter_context(SkillBench(wmi=wmi, clock=clock, period=self._period))
            self.bench.library.on_load = lambda library, classes: None  # `learn check` has checked the skills
            self.bench.import_libraries(*scenario.libraries)
            if scenario.variation:
                self._vary()
            #: As in the file, before the draw.
            self.scene = read_scene(wmi.get_scene_elements(), wmi.is_subclass, (scenario.scene.parent,))
            self.draw: Draw = draw(self.scene, scenario.randomisation, random)
            self.world = stack.enter_context(
                World(
                    self.draw.scene,
                    seed=int(random.integers(2**31)),
                    rate=scenario.simulation.step_rate,
                    sensor=scenario.randomisation.sensor,
                    visuals=False,
                )
            )
            self._prepare()
            self._exit = stack.pop_all()

    def __enter__(self) -> Episode:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """Ends the world."""
        self._exit.close()

    def run(self, configuration: Mapping[str, Value]) -> EpisodeRecord:
        """Runs the task until it ends or its time is over.

        :raises SkirosError: a skill, parameter or element of the task does not exist, or a value is not allowed.
        """
        bench, limit = self.bench, self._scenario.simulation.time_limit
        steps = max(1, round(self._period * self.world.rate))
        with self.drivers.installed():
            task = bench.commands(*(self._command(step, configuration) for step in self._scenario.task))
            deadline, reason = limit, ""
            while self._tick(task) is State.Running:
                if self.world.time >= deadline:
                    if reason:
                        break
                    reason, deadline = f"not finished after {limit:g} s", limit + _GRACE
                    task.preempt()
                self.drivers.step(steps)
                self._follow_frames()
                self.recorder.sample()
        succeeded = task.state is State.Success and not reason
        return self.recorder.record(succeeded, "" if succeeded else reason or why(task), bench.wmi)

    def element_of(self, feature: Feature) -> Element:
        """Returns the element of a feature of the task.

        :raises SkirosError: the scene does not have it, or it has no such number.
        """
        element = find_element(self.bench.wmi, feature.element)
        keys = [each.key for each in element.properties if isinstance(each.value, float)]
        if feature.property not in keys:
            text = f"variation {feature.name}: {feature.element} has no number {feature.property!r}"
            raise UnknownName(f"{text}; {near(feature.property, keys)}")
        return element

    def take_posture(self, name: str) -> None:
        """Puts all arms into a posture.

        :raises SkirosError: an arm does not have it.
        """
        for eid, arm in self.world.arms.items():
            positions = posture(self.bench.wmi.get_element(eid), name)
            joints = {joint.name.rpartition("/")[2]: joint for joint in arm.joints}
            wanted = {joint.rpartition("/")[2]: position for joint, position in positions.items()}
            if wanted.keys() != joints.keys():
                raise WrongValue(f"posture {name!r} of {eid}: joints {sorted(wanted)}, expected {sorted(joints)}")
            for key, joint in joints.items():
                self.world.physics.set_joint(arm.body, joint.index, wanted[key])
            arm.drive([wanted[key] for key in joints])

    # -- internal --------------------------------------------------------------------------------------------------

    def _vary(self) -> None:
        """Changes the scene, also in the world model: the skills know the variation."""
        for feature in self._scenario.variations:
            element = self.element_of(feature)
            element.setProperty(feature.property, float(self._scenario.variation[feature.name]))
            self.bench.wmi.update_element_properties(element)

    def _prepare(self) -> None:
        for eid, value in self.draw.friction.items():
            self.world.physics.set_surface(self.world.bodies[eid].body, -1, value)
        if self.draw.start:
            self.take_posture(self.draw.start)
        self.drivers = LocalDrivers(self.world)
        elements = self.bench.wmi.get_scene_elements()
        ids = {element.label: element.id for element in elements if element.label}
        tree = SceneTree(elements)
        fixed = {
            element.label: pose
            for element in elements
            if element.label and element.id not in self.world and (pose := tree.pose_in_map(element)) is not None
        }
        self.recorder = Recorder(self.world, ids, fixed, *names_used(self._scenario.all_rewards))
        self.world.motions.add(self.recorder)
        self._last: dict[str, Pose] = {}
        self._follow_frames()
        self.recorder.sample()

    def _command(self, step: Step, configuration: Mapping[str, Value]) -> tuple[str, str, dict[str, Any]]:
        learned = {
            name.rpartition(".")[2]: value
            for name, value in configuration.items()
            if name.rpartition(".")[0] == step.name
        }
        given = {**step.parameters, **learned}
        declared = declared_parameters(self.bench, step)
        unknown = [key for key in given if key not in declared]
        if unknown:
            texts = (f"{step.skill} has no parameter {key!r}; {near(key, declared)}" for key in unknown)
            raise UnknownName("; ".join(texts))
        return step.skill, step.label, {key: self._value(declared[key], value) for key, value in given.items()}

    def _value(self, param: Param, value: Any) -> Any:
        return find_element(self.bench.wmi, value) if param.is_element and isinstance(value, str) else value

    def _tick(self, task: BenchTask) -> State:
        """Ticks the task, then waits for the threads of its skills: the next tick does not depend on their speed."""
        before = set(threading.enumerate())
        state = task.tick()
        for thread in threading.enumerate():
            if thread not in before:
                thread.join(_THREAD_TIMEOUT)
                if thread.is_alive():
                    raise WrongValue(f"a thread of a skill ({thread.name}) has not ended in {_THREAD_TIMEOUT:g} s")
        return state

    def _follow_frames(self) -> None:
        """Writes the poses of robots and grippers to the world model, as its reasoner does from tf."""
        for robot in self.world.robots.values():
            self._write(robot.spec.id, robot.pose())
            for arm in robot.arms.values():
                if arm.gripper is not None:
                    mount = composed(robot.pose(), arm.spec.pose)
                    self._write(arm.gripper.id, composed(inverted(mount), arm.tool_pose()))

    def _write(self, eid: str, pose: Pose) -> None:
        last = self._last.get(eid)
        if last is not None and math.dist(last.position, pose.position) < _STILL:
            return
        self._last[eid] = pose
        element: Element = self.bench.wmi.get_element(eid)
        space.set_pose(element, pose)
        self.bench.wmi.update_element_properties(element)


def check_scenario(scenario: Scenario) -> None:
    """Checks a scenario against its scene and skills: labels, parameters, ranges; nothing is simulated.

    :raises ScenarioError: the text names all problems, with their lines.
    """
    mistakes: list[Mistake] = []
    with FakeClock() as clock, ExitStack() as stack:
        episode: Episode | None = None
        if scenario.scene != NO_SCENE:
            try:
                episode = stack.enter_context(_comparable(scenario, clock, mistakes))
            except SkirosError as error:
                mistakes.append((("scene",), str(error)))
        bench = stack.enter_context(SkillBench(clock=clock)) if episode is None else episode.bench
        bench.library.on_load = lambda library, classes: None  # what does not fit is reported here
        if not scenario.libraries:
            mistakes.append((("libraries",), "libraries: missing; name the Python packages with the skills"))
        for index, package in enumerate(scenario.libraries):
            try:
                bench.import_libraries(package)
            except ConfigurationError as error:
                mistakes.append((("libraries", index), str(error)))
        mistakes += step_mistakes(scenario, bench, has_scene=episode is not None)
        if episode is not None:
            mistakes += _scene_mistakes(scenario, episode)
    if mistakes:
        raise ScenarioError(f"scenario {scenario.name}", mistakes, scenario.original)


def _comparable(scenario: Scenario, clock: FakeClock, mistakes: list[Mistake]) -> Episode:
    """Returns an episode to compare with, without skills: if its scene has not all that randomisation and rewards name,
    without these.

    :param mistakes: what they name wrongly is added.
    """
    paths: dict[str, tuple[str | int, ...]] = {
        name: ("randomisation", "bodies", name) for name in scenario.randomisation.bodies
    }
    for path, reward in scenario.reward_paths:
        things, _, series = names_used([reward])
        paths |= dict.fromkeys(things | series, path)
    always: dict[str, Any] = {"libraries": (), "variation": {}}
    no_rewards: dict[str, Any] = {"objectives": (), "success": (), "constraints": ()}
    for randomisation in (replace(scenario.randomisation, starts=()), NO_RANDOMISATION):
        try:
            return Episode(replace(scenario, **always, randomisation=randomisation), scenario.seed, 0, clock)
        except UnknownNames as error:
            found = [(paths[name], text) for name, text in error.problems.items()]
            mistakes += [each for each in found if each not in mistakes]
    plain = replace(scenario, **always, **no_rewards, randomisation=NO_RANDOMISATION)
    return Episode(plain, scenario.seed, 0, clock)


def _scene_mistakes(scenario: Scenario, episode: Episode) -> list[Mistake]:
    """Describes what start postures, variations, and conditions in rewards name that the scene does not have."""
    found: list[Mistake] = []
    for path, reward in scenario.reward_paths:
        found += [((*path, key), text) for key, text in unknown_names(reward, episode.bench.wmi)]
    for name in scenario.randomisation.starts:
        try:
            episode.take_posture(name)
        except SkirosError as error:
            found.append((("randomisation", "starts"), str(error)))
    for feature in scenario.variations:
        try:
            episode.element_of(feature)
        except SkirosError as error:
            found.append((("variations", feature.name), str(error)))
    return found


def randomised_quantities(scenario: Scenario) -> list[Quantity]:
    """Returns the randomised quantities of a scenario, with the values of its scene.

    :raises SkirosError: the scenario does not fit the scene.
    """
    with FakeClock() as clock, Episode(scenario, scenario.seed, 0, clock) as episode:
        return quantities(episode.scene, scenario.randomisation)


def default_configuration(scenario: Scenario) -> dict[str, Value]:
    """Returns the values that the skills have by default for the variables of a scenario; {} if one has none.

    :raises SkirosError: the scenario does not fit the scene or the skills.
    """
    found: dict[str, Value] = {}
    with FakeClock() as clock, Episode(scenario, scenario.seed, 0, clock) as episode:
        declared = {step.name: declared_parameters(episode.bench, step) for step in scenario.task}
    for variable in scenario.variables:
        if not variable.exists(found):
            continue
        name, _, key = variable.name.rpartition(".")
        value = declared[name][key].value
        if value is None:
            return {}
        found[variable.name] = value
    return found


def step_mistakes(scenario: Scenario, bench: SkillBench, has_scene: bool = True) -> list[Mistake]:
    """Describes what does not fit between the steps with their variables and the skills and elements of a bench.

    :param has_scene: whether to look for the elements.
    """
    found: list[Mistake] = []
    for index, step in enumerate(scenario.task):
        key = "skill"
        try:
            bench.library.require_type(step.skill, step.label)
            key = "label"
            declared = declared_parameters(bench, step)
        except SkirosError as error:
            why = f"; {_NO_ROS}" if LocalDrivers is NoDrivers else ""
            found.append((("task", index, key), f"{error}{why}"))
            continue
        variables = {v.name.rpartition(".")[2]: v for v in scenario.variables if v.name.rpartition(".")[0] == step.name}
        places: dict[str, tuple[str | int, ...]] = {key: ("variables", each.name) for key, each in variables.items()}
        places |= {key: ("task", index, "parameters", key) for key in step.parameters}
        for key, place in places.items():
            if key not in declared:
                found.append((place, f"{step.skill} has no parameter {key!r}; {near(key, declared)}"))
        text = "missing; the skill requires a value: fix it in the task, or make it a variable"
        found += [
            (("variables", f"{step.name}.{key}"), f"{step.name}.{key}: {text}")
            for key, param in declared.items()
            if key not in places and is_missing(param)
        ]
        for key, variable in variables.items():
            if key in declared and (mistake := _variable_mistake(variable, declared[key])):
                found.append(mistake)
        for key, value in step.parameters.items():
            if has_scene and key in declared and declared[key].is_element and isinstance(value, str):
                try:
                    find_element(bench.wmi, value)
                except SkirosError:
                    labels = [e.label for e in bench.wmi.get_scene_elements() if e.label]
                    text = f"{step.name}.{key}: no element is labelled {value!r}; {near(value, labels)}"
                    found.append((places[key], text))
    return found


def _variable_mistake(variable: Variable, param: Param) -> Mistake | None:
    path = ("variables", variable.name)
    if param.is_element:
        return path, f"{variable.name}: an element cannot be learned; only numbers, texts and truth values can"
    if variable.only_if and is_missing(param):
        text = "exists not always, but the skill requires a value: give it a default"
        return (*path, "only_if"), f"{variable.name}: {text}"
    if problem := param.limits.problem(variable.values or (variable.low, variable.high)):
        key = "values" if variable.values else "range"
        return (*path, key), f"{variable.name}: the skill allows other values: {problem}"
    return None


def declared_parameters(bench: SkillBench, step: Step) -> dict[str, Param]:
    """Returns the parameters of a step's skill, by key.

    :raises UnknownName: there is no such skill.
    """
    candidates = bench.library.candidates(step.skill, step.label)
    return dict(candidates[0].declared.params.items())


def is_missing(param: Param) -> bool:
    """Whether a start of the skill needs a value that is neither an element nor declared."""
    return param.paramTypeIs(ParamTypes.Required) and not param.is_element and not param.is_bound()


def why(task: BenchTask) -> str:
    """Returns the messages of the nodes that have failed, the deepest last."""
    texts = [node.progress_msg for node in task.nodes() if node.state is State.Failure and node.progress_msg]
    return texts[-1] if texts else str(task.root.progress_msg)
