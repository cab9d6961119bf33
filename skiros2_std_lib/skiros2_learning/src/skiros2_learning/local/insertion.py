"""An execution of the insertion of a piston: skills, compliant arm and physics of `skiros2_contact_skills`, in this
process.

A step of the task names an implementation of the insertion in `label`; its parameters and variables replace the
defaults of that skill. The scenario's `settings` are those of `Settings`.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from pydantic import Field, ValidationError

from skiros2_common.core.errors import SkirosError
from skiros2_contact_skills.fit import Fit
from skiros2_learning.core.episode_record import EpisodeRecord
from skiros2_learning.core.randomisation import Quantity, sensor_quantities
from skiros2_learning.core.rewards import PropertyValue, Relation, Sparql, names_used
from skiros2_learning.core.scenario import Scenario, ScenarioError
from skiros2_learning.core.sections import Mistake, NotNegative, Section, mistakes_of, near, numbers, read
from skiros2_learning.core.variables import Value
from skiros2_learning.local.episode import declared_parameters, step_mistakes
from skiros2_learning.local.insertion_study import SCENE, InsertionStudy, insertion_skills
from skiros2_sim.core.wrist_sensor import SensorModel
from skiros2_skill.testing import SkillBench

#: The series of the record: depth of the piston below the rim (m), its tilt (rad), force at the wrist (N).
DEPTH, TILT, ARM_FORCE = "depth", "tilt", "Right arm.measured_force"


#: Of parameters that come from the world model, which is silent about them in the scene of the study.
_USUAL: dict[str, Value] = {"Radius": Fit().search_radius, "DropDepth": Fit().drop_depth}

Error = Annotated[NotNegative, Field(le=90.0)]


@dataclass(frozen=True)
class Settings(Section):
    """Errors of the estimated pose of the bore. Each execution draws its errors between the bounds, in any direction.

    :param least_position_error, position_error: across the axis of the bore (m).
    :param least_angle_error, angle_error: of its axis (degrees).
    """

    least_position_error: Error = 0.0
    position_error: Error = 0.0
    least_angle_error: Error = 0.0
    angle_error: Error = 0.0

    @classmethod
    def mistakes(cls, data: Mapping[str, Any]) -> Iterator[Mistake]:
        for key in ("position_error", "angle_error"):
            if numbers(data.get(f"least_{key}", 0.0)) > numbers(data.get(key, 0.0)):
                yield (key,), f"expected at least that of least_{key}"


def run_insertion(scenario: Scenario, configuration: dict[str, Value], seed: int, index: int) -> EpisodeRecord:
    """Inserts the piston once. The record has the series `depth` (m, by the simulator's truth), `tilt` (rad) and
    `Right arm.measured_force` (N), one sample for each tick of the skills.

    :param seed: of the evaluation.
    :param index: of the repetition.
    :raises SkirosError: the scenario does not fit the insertion.
    """
    settings = _settings(scenario)
    random = np.random.default_rng([seed, index])
    run = _study(scenario.randomisation.sensor).run(
        int(random.integers(2**31)),
        random.uniform(settings.least_position_error, settings.position_error),
        math.radians(random.uniform(settings.least_angle_error, settings.angle_error)),
        parameters=_parameters(scenario, configuration),
        time_limit=scenario.simulation.time_limit,
    )
    times, depths, forces = np.array(run.profile).T
    series = {DEPTH: depths, TILT: np.full(len(times), run.tilt), ARM_FORCE: forces}
    return EpisodeRecord(run.success, run.why, run.time, times, {}, {}, series)


def randomised_quantities(scenario: Scenario) -> list[Quantity]:
    """Returns what differs between insertions: the estimated pose of the bore, and the noise of the sensor."""
    given = _settings(scenario)
    return [
        Quantity(
            "position of the bore", "the true one", _bounds(given.least_position_error, given.position_error, "m")
        ),
        Quantity("axis of the bore", "the true one", _bounds(given.least_angle_error, given.angle_error, "degrees")),
        *sensor_quantities(scenario.randomisation.sensor),
    ]


def _bounds(least: float, most: float, unit: str) -> str:
    return f"off by {least:.4g} to {most:.4g} {unit}, in any direction"


def default_configuration(scenario: Scenario) -> dict[str, Value]:
    """Returns the values that the skills have by default for the variables of a scenario.

    :raises SkirosError: the scenario does not fit the insertion.
    """
    found: dict[str, Value] = {}
    with SkillBench(SCENE) as bench:
        bench.load(*insertion_skills())
        for variable in scenario.variables:
            if not variable.exists(found):
                continue
            name, _, key = variable.name.rpartition(".")
            (step,) = (each for each in scenario.task if each.name == name)
            declared = declared_parameters(bench, step)[key].value
            found[variable.name] = _USUAL[key] if declared is None else declared
    return found


def check_scenario(scenario: Scenario) -> None:
    """Checks a scenario against the skills of the insertion; nothing is simulated.

    :raises ScenarioError: the text names all problems, with their lines.
    """
    mistakes: list[Mistake] = []
    try:
        _settings(scenario)
    except ScenarioError as error:
        mistakes += error.mistakes
    for part in ("bodies", "starts"):
        if getattr(scenario.randomisation, part):
            text = "randomisation: the insertion has only `sensor`; errors of poses are in `settings`"
            mistakes.append((("randomisation", part), text))
    with SkillBench(SCENE) as bench:
        try:
            bench.load(*insertion_skills(parameters=_parameters(scenario, {})))
        except SkirosError as error:
            mistakes.append((("task",), str(error)))
        else:
            mistakes += step_mistakes(scenario, bench)
    names = {step.name for step in scenario.task}
    for variable in scenario.variables:
        step = variable.name.rpartition(".")[0]
        if step not in names:
            text = f"{variable.name}: no step is called {step!r}; {near(step, names)}"
            mistakes.append((("variables", variable.name), text))
    known = {DEPTH, TILT, ARM_FORCE}
    for path, reward in scenario.reward_paths:
        if isinstance(reward, Relation | PropertyValue | Sparql):
            mistakes.append((path, "rewards: the insertion has no world model"))
        things, _, series = names_used([reward])
        mistakes += [(path, f"no series {each!r} is recorded; {near(each, known)}") for each in sorted(series - known)]
        mistakes += [(path, f"rewards: the insertion does not record the pose of {each!r}") for each in sorted(things)]
    if mistakes:
        raise ScenarioError(f"scenario {scenario.name}", mistakes, scenario.original)


@functools.cache
def _study(sensor: SensorModel) -> InsertionStudy:
    """Returns the world of this process: it takes a second to make, and each run resets it."""
    return InsertionStudy(sensor=sensor)


def _settings(scenario: Scenario) -> Settings:
    """Reads the settings.

    :raises ScenarioError: they have mistakes; the text names all of them.
    """
    try:
        return read(Settings, scenario.settings)
    except ValidationError as error:
        raise ScenarioError(f"scenario {scenario.name}", mistakes_of(error, "settings"), scenario.original) from None


def _parameters(scenario: Scenario, configuration: dict[str, Value]) -> dict[str, dict[str, Value]]:
    """Returns the values by implementation and key."""
    found: dict[str, dict[str, Value]] = {}
    for step in scenario.task:
        learned = {
            name.rpartition(".")[2]: value
            for name, value in configuration.items()
            if name.rpartition(".")[0] == step.name
        }
        found.setdefault(step.label, {}).update({**step.parameters, **learned})
    return found
