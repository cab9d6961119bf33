"""Learning scenarios: one readable YAML file with everything that defines a study."""

from __future__ import annotations

import importlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import yaml

from skiros2_common.core.errors import ConfigurationError, WrongValue
from skiros2_common.core.yaml_text import read_yaml
from skiros2_common.tools.libraries import find_libraries
from skiros2_learning.core.platforms import (
    PLATFORMS,
    REAL_SKILLS,
    SIMULATED_SKILLS,
    RealPlatform,
    Simulation,
    Step,
    read_real,
    read_simulation,
    read_step,
)
from skiros2_learning.core.randomisation import NO_RANDOMISATION, Randomisation, read_randomisation
from skiros2_learning.core.rewards import Reward, read_reward
from skiros2_learning.core.sections import Section
from skiros2_learning.core.variables import Variable, read_variable
from skiros2_learning.core.variations import Feature, read_feature, variation_problems

#: The samplers that a scenario may name; see `study.make_sampler`.
OPTIMISERS = ("prior", "tpe", "nsga2", "random", "qmc", "cmaes", "gp")
#: The layout of the file.
VERSION = 1

Sense = Literal["maximise", "minimise"]


class ScenarioError(ConfigurationError):
    """A scenario with mistakes.

    :param problems: all of them, one line each.
    """

    def __init__(self, source: str, problems: Sequence[str]) -> None:
        super().__init__(f"{source}: {'; '.join(problems)}")
        self.problems = tuple(problems)


@dataclass(frozen=True)
class WeightedReward:
    """A reward as a part of an objective.

    :param name: as in the scenario, for reports.
    """

    name: str
    weight: float
    reward: Reward


@dataclass(frozen=True)
class Objective:
    """A weighted sum of rewards, kept apart from other objectives."""

    name: str
    sense: Sense
    rewards: tuple[WeightedReward, ...]


@dataclass(frozen=True)
class Criterion:
    """A reward with limits: a constraint, or a part of the definition of success.

    :param name: as in the scenario, for reports.
    """

    name: str
    reward: Reward
    at_least: float = -math.inf
    at_most: float = math.inf

    def violation(self, value: float) -> float:
        """How far a value is outside the limits; 0 or less inside."""
        return max(self.at_least - value, value - self.at_most)


@dataclass(frozen=True)
class Scenario:
    """A learning scenario.

    :param scene: file of the scene, absolute.
    :param libraries: Python packages or modules with the skills of the task.
    :param plugins: Python modules that add rewards.
    :param execution: `module:function` that runs one execution; see `evaluation.Execution`.
    :param success: what counts as success, besides the success of the task.
    :param evaluations: budget of the study; `initial` of them are drawn from the prior.
    :param repetitions: executions per configuration, each with another draw of the randomisation.
    :param max_failures: an evaluation ends after this number of executions without success: it is hopeless.
    :param timeout: of one evaluation (s of wall time). Generous, as results should not depend on the load of a machine.
    :param variations: features of the task, of which good parameters are functions; see `policy`.
    :param variation: their values in this study, by name; {} for those of the scene.
    :param prior_from: folders of earlier studies, whose good configurations are the priors; see `earlier_studies`.
    :param goal: the goal that the task is the plan for; "" if it has none.
    :param source: the text of the file.
    """

    name: str
    task: tuple[Step, ...]
    variables: tuple[Variable, ...]
    objectives: tuple[Objective, ...]
    scene: Path
    libraries: tuple[str, ...] = ()
    plugins: tuple[str, ...] = ()
    execution: str = SIMULATED_SKILLS
    settings: Mapping[str, Any] = field(default_factory=dict)
    success: tuple[Criterion, ...] = ()
    constraints: tuple[Criterion, ...] = ()
    randomisation: Randomisation = NO_RANDOMISATION
    simulation: Simulation = field(default_factory=Simulation)
    evaluations: int = 100
    initial: int = 20
    repetitions: int = 5
    max_failures: int = 5
    seed: int = 0
    optimiser: str = "prior"
    timeout: float = 600.0
    prior_from: tuple[Path, ...] = ()
    variations: tuple[Feature, ...] = ()
    variation: Mapping[str, float] = field(default_factory=dict)
    goal: str = ""
    real: RealPlatform = field(default_factory=RealPlatform)
    source: str = ""

    @property
    def is_real(self) -> bool:
        """Whether the task runs on a real robot."""
        return self.execution == REAL_SKILLS

    @property
    def all_rewards(self) -> list[Reward]:
        """The rewards of objectives, constraints and success."""
        weighted = [part.reward for objective in self.objectives for part in objective.rewards]
        return weighted + [criterion.reward for criterion in (*self.constraints, *self.success)]

    def check_variation(self, variation: Mapping[str, float]) -> None:
        """Checks the values of the features.

        :raises WrongValue: the text names all problems.
        """
        if problems := variation_problems(self.variations, variation):
            raise WrongValue(f"scenario {self.name}: {'; '.join(problems)}")

    def derived(
        self,
        *,
        priors: bool = True,
        changed_priors: Mapping[str, Mapping[str, Any]] | None = None,
        variation: Mapping[str, float] | None = None,
        evaluations: int | None = None,
        initial: int | None = None,
        repetitions: int | None = None,
        max_failures: int | None = None,
        optimiser: str | None = None,
        seed: int | None = None,
    ) -> Scenario:
        """Returns the scenario with changes, also in its text, and with the absolute name of the scene: to be stored
        anywhere.

        :param priors: False removes all priors.
        :param changed_priors: by name of the variable, as in the file: they replace `prior_from`.
        :raises ScenarioError: the changes do not fit.
        """
        data = read_yaml(self.source)
        if "scene" in data:
            data["scene"] = str(self.scene)
        budget = data.setdefault("budget", {})
        budget["evaluations"] = self.evaluations if evaluations is None else evaluations
        wanted = self.initial if initial is None else initial
        budget["initial"] = min(wanted, budget["evaluations"]) if initial is None else wanted
        changes = {
            "repetitions": repetitions, "max_failures": max_failures, "optimiser": optimiser, "seed": seed,
            "variation": None if variation is None else dict(variation),
        }  # fmt: skip
        for key, value in changes.items():
            if value is not None:
                data[key] = value
        if self.prior_from:
            data["prior_from"] = [str(folder) for folder in self.prior_from]
        if not priors or changed_priors is not None:
            data.pop("prior_from", None)
        for name, variable in data["variables"].items():
            if not priors:
                variable.pop("prior", None)
            if changed_priors is not None and name in changed_priors:
                variable["prior"] = dict(changed_priors[name])
        text = yaml.safe_dump(data, sort_keys=False, allow_unicode=True, width=110)
        return parse_scenario(text, Path("/"), self.name)


def load_scenario(file: str | Path) -> Scenario:
    """Reads a scenario file.

    :raises ScenarioError: it has mistakes; the text names all of them.
    :raises ConfigurationError: it cannot be read.
    """
    path = Path(file)
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigurationError(f"scenario {path}: {getattr(error, 'strerror', None) or error}") from None
    return parse_scenario(text, path.resolve().parent, str(path))


def parse_scenario(text: str, folder: Path, source: str = "scenario") -> Scenario:
    """Reads a scenario.

    :param folder: for relative names of files.
    :param source: for error texts.
    :raises ScenarioError: it has mistakes; the text names all of them.
    """
    try:
        data = read_yaml(text)
    except WrongValue as error:
        raise ScenarioError(source, [str(error)]) from None
    problems: list[str] = []
    root = Section(data, "", problems)
    scenario = _read(root, folder, text)
    root.end()
    if problems:
        raise ScenarioError(source, problems)
    return scenario


def _read(root: Section, folder: Path, text: str) -> Scenario:
    name = root.text("scenario")
    version = root.whole("version", VERSION, low=1)
    if version != VERSION:
        root.problem("version", f"expected {VERSION}, got {version}")
    plugins, libraries = tuple(root.texts("plugins", ())), tuple(root.texts("libraries", ()))
    platform = root.choice("platform", tuple(PLATFORMS), "simulation")
    execution = root.text("execution", PLATFORMS[platform])
    scene = _file(root, "scene", folder, needed=execution == SIMULATED_SKILLS)
    find_libraries([*plugins, *libraries], folder, scene.parent)
    for plugin in plugins:
        try:
            importlib.import_module(plugin)
        except ImportError as error:
            root.problem("plugins", f"{plugin}: {error}")
    budget = root.section("budget")
    evaluations = budget.whole("evaluations", 100, low=1)
    initial = budget.whole("initial", min(20, evaluations), low=0, high=evaluations)
    budget.end()
    task = tuple(read_step(part) for part in root.listed("task", ()))
    variables = tuple(read_variable(key, part) for key, part in root.section("variables").sections())
    if not variables:
        root.problem("variables", "none; a scenario needs at least one")
    objectives = tuple(_objective(key, part) for key, part in root.section("objectives").sections())
    if not objectives:
        root.problem("objectives", "none; a scenario needs at least one")
    if execution in PLATFORMS.values():
        if not task:
            root.problem("task", "no steps; name at least one skill")
        _check_names(root, task, variables)
    repetitions = root.whole("repetitions", 5, low=1)
    features = tuple(read_feature(key, part) for key, part in root.section("variations").sections())
    variation = root.take("variation", {})
    for problem in variation_problems(features, variation) if variation else ():
        root.problem("variation", problem)
    return Scenario(
        name=name,
        task=task,
        variables=variables,
        objectives=objectives,
        scene=scene,
        libraries=libraries,
        plugins=plugins,
        execution=execution,
        settings=root.take("settings", {}),
        success=tuple(_criterion(part) for part in root.listed("success", ())),
        constraints=tuple(_criterion(part) for part in root.listed("constraints", ())),
        randomisation=read_randomisation(root.section("randomisation")),
        simulation=read_simulation(root.section("simulation")),
        evaluations=evaluations,
        initial=initial,
        repetitions=repetitions,
        max_failures=root.whole("max_failures", repetitions, low=1),
        seed=root.whole("seed", 0),
        optimiser=root.choice("optimiser", OPTIMISERS, OPTIMISERS[0]),
        timeout=root.number("timeout", 600.0, above=0.0),
        variations=features,
        variation=variation,
        prior_from=tuple((folder / name).resolve() for name in root.texts("prior_from", ())),
        goal=root.text("goal", ""),
        real=read_real(root.section("real")),
        source=text,
    )


def _file(root: Section, key: str, folder: Path, needed: bool) -> Path:
    """Returns a file: absolute, or relative to the folder of the scenario."""
    named = root.text(key) if needed else root.text(key, "")
    if not named:
        return Path()
    path = folder / named
    if needed and not path.is_file():
        root.problem(key, f"no such file: {path}")
    return path.resolve()


def _objective(name: str, section: Section) -> Objective:
    sense: Sense = section.choice("sense", ("maximise", "minimise"), "maximise")  # type: ignore[assignment]
    rewards = []
    for part in section.listed("rewards"):
        weight = part.number("weight", 1.0)
        title = part.text("name", part.take("reward", ""))
        made = read_reward(part)
        part.end()
        if made is not None:
            rewards.append(WeightedReward(title, weight, made))
    if not rewards and "rewards" in section and not section.items("rewards"):
        section.problem("rewards", "none; an objective needs at least one")
    section.end()
    return Objective(name, sense, tuple(rewards))


def _criterion(section: Section) -> Criterion:
    limits = {key: section.number(key) for key in ("at_least", "at_most") if key in section}
    title = section.text("name", section.take("reward", ""))
    made = read_reward(section)
    if not limits:
        section.problem("", "expected at_least or at_most")
    section.end()
    if made is None:
        return Criterion(title, lambda record: 0.0)
    return Criterion(title, made, **limits)


def _check_names(root: Section, task: Sequence[Step], variables: Sequence[Variable]) -> None:
    names = [step.name for step in task]
    for twice in {name for name in names if names.count(name) > 1}:
        root.problem("task", f"several steps are called {twice!r}; give each a name")
    for variable in variables:
        step, dot, _ = variable.name.rpartition(".")
        if not dot or step not in names:
            root.problem(
                f"variables.{variable.name}",
                f"expected STEP.PARAMETER with a step of the task: {', '.join(names) or 'none'}",
            )
