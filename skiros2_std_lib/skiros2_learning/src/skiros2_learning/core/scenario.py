"""Learning scenarios: one readable YAML file with everything that defines a study."""

from __future__ import annotations

import importlib
import logging
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

import yaml
from pydantic import AfterValidator, Field, PlainValidator, SkipValidation, ValidationError, ValidationInfo

from skiros2_common.core.errors import ConfigurationError, WrongValue
from skiros2_common.core.names import nearest
from skiros2_common.core.yaml_text import YamlText, read_yaml
from skiros2_common.tools.libraries import find_libraries
from skiros2_learning.core.objectives import Criteria, Objective
from skiros2_learning.core.platforms import (
    PLATFORMS,
    REAL_SKILLS,
    SIMULATED_SKILLS,
    Platform,
    RealPlatform,
    Simulation,
    Step,
)
from skiros2_learning.core.randomisation import NO_RANDOMISATION, Randomisation
from skiros2_learning.core.rewards import Reward
from skiros2_learning.core.sections import (
    Count,
    Mistake,
    Named,
    Natural,
    Positive,
    Section,
    Some,
    Text,
    mistaken,
    mistakes_of,
    near,
    numbers,
    path_text,
    read,
)
from skiros2_learning.core.variables import Restriction, Value, Variable, check_conditions, existing
from skiros2_learning.core.variations import Feature, variation_problems

log = logging.getLogger(__name__)

Optimiser = Literal["prior", "tpe", "nsga2", "random", "qmc", "cmaes", "optuna-gp", "gp", "botorch", "smac"]
#: The samplers that a scenario may name; see `samplers.make_sampler`; `gp` is the older name of `optuna-gp`.
OPTIMISERS: tuple[Optimiser, ...] = get_args(Optimiser)
#: The layout of the file.
VERSION = 1

#: The scene of a scenario that has none.
NO_SCENE = Path()

#: What a validator knows: `context` is the folder of the file, `data` the values of the fields before its own.
_Info = ValidationInfo[Any]


class ScenarioError(ConfigurationError):
    """A scenario with mistakes: `problems` has a text for each, in the order of the file.

    :param source: the name of the file or scenario.
    :param mistakes: the path of each, () if it is not known, and a line of text.
    :param text: of the file, for line numbers; "" if these are not known.
    """

    def __init__(self, source: str, mistakes: Sequence[Mistake], text: str = "") -> None:
        lines = [YamlText(text).line(path) if text else 0 for path, _ in mistakes]
        found = sorted(zip(lines, (each for _, each in mistakes), strict=True), key=lambda each: each[0])
        self.problems = tuple(f"line {line}: {each}" if line else each for line, each in found)
        super().__init__(f"{source}: {'; '.join(self.problems)}")
        #: One for each problem, if they are printed one after the other.
        self.texts = [f"{source}: {each}" for each in self.problems]
        self.mistakes, self.text = tuple(mistakes), text


@dataclass(frozen=True)
class Budget(Section):
    """The number of evaluations; `initial` of them are drawn from the prior."""

    evaluations: Count = 100
    initial: Natural = 20

    @classmethod
    def completed(cls, data: dict[str, Any]) -> dict[str, Any]:
        return {"initial": round(min([cls.initial, *numbers(data.get("evaluations"))])), **data}

    @classmethod
    def mistakes(cls, data: Mapping[str, Any]) -> Iterator[Mistake]:
        most = numbers(data.get("evaluations", cls.evaluations))
        if numbers(data["initial"]) > most:
            yield ("initial",), f"expected at most {data.get('evaluations')}, the evaluations, got {data['initial']}"


@dataclass(frozen=True)
class ValidationPlan(Section):
    """The validation of a study.

    :param candidates: best configurations of the search that take part.
    :param choice: executions of each of these, by which one is chosen.
    :param repetitions: executions of the chosen one and of the skill's defaults, for the comparison and the report.
    """

    candidates: Count = 4
    choice: Count = 10
    repetitions: Annotated[Count, Field(ge=2)] = 30


def _scene_file(named: Any, info: _Info) -> Path:
    """Returns the file: absolute, or relative to the folder of the scenario."""
    path: Path = info.context / str(named)
    if info.data.get("execution") == SIMULATED_SKILLS and not path.is_file():
        raise ValueError(f"no such file: {path}{_near_files(path)}" if named else "missing")
    return path.resolve() if named else NO_SCENE


def _near_files(path: Path) -> str:
    close = nearest(path.name, (each.name for each in path.parent.glob("*")))
    return f"; near: {', '.join(close)}" if close else ""


def _found(packages: tuple[str, ...], info: _Info) -> tuple[str, ...]:
    find_libraries(packages, info.context, info.data.get("scene", NO_SCENE).parent)
    return packages


def _imported(plugins: tuple[str, ...]) -> tuple[str, ...]:
    """Imports modules, before the rewards that they add are looked up."""
    failed = []
    for plugin in plugins:
        try:
            importlib.import_module(plugin)
        except ImportError as error:
            failed.append(f"{plugin}: {error}")
    if failed:
        raise ValueError("; ".join(failed))
    return plugins


def _named_once(task: tuple[Step, ...], info: _Info) -> tuple[Step, ...]:
    if info.data.get("execution") in PLATFORMS.values():
        if not task:
            raise ValueError("no steps; name at least one skill")
        names = [step.name for step in task]
        if twice := sorted({name for name in names if names.count(name) > 1}):
            raise mistaken(((), f"several steps are called {name!r}; give each a name") for name in twice)
    return task


def unassigned_variables(data: Mapping[str, Any]) -> list[str]:
    """Returns the names of the variables that belong to no step of the task; [] if not all steps have names.

    :param data: of the file, with values of any type.
    """
    names, variables = _step_names(data.get("task")), data.get("variables")
    if not names or None in names or not isinstance(variables, Mapping):
        return []
    return [name for name in map(str, variables) if name.rpartition(".")[0] not in names]


def _step_names(task: Any) -> list[str | None]:
    steps = [step if isinstance(step, Mapping) else {} for step in task] if isinstance(task, list) else [{}]
    named = (step.get("name") or step.get("skill") for step in steps)
    return [name if isinstance(name, str) else None for name in named]


def _fixed_variables(data: Mapping[str, Any]) -> list[str]:
    task, variables = data.get("task"), data.get("variables")
    steps = task if isinstance(task, list) else []
    fixed = {
        f"{name}.{key}"
        for name, step in zip(_step_names(task), steps, strict=False)
        if isinstance(step, Mapping) and isinstance(step.get("parameters"), Mapping)
        for key in step["parameters"]
    }
    return [name for name in map(str, variables) if name in fixed] if isinstance(variables, Mapping) else []


def _between_numbers(restrictions: tuple[Restriction, ...], info: _Info) -> tuple[Restriction, ...]:
    known = [v.name for v in info.data.get("variables", ()) if v.kind != "categorical" and not v.only_if]
    wrong = [(i, name) for i, each in enumerate(restrictions) for name in each.weights if name not in known]
    if wrong and "variables" in info.data:
        text = "expected a variable that is a number, and always there"
        raise mistaken(((i, "sum", name), f"{text}; {near(name, known)}") for i, name in wrong)
    ends = {v.name: v.values or v.range for v in info.data.get("variables", ())}
    never = [i for i, each in enumerate(restrictions) if not wrong and not each.can_hold(ends)]
    if never:
        raise mistaken(((i,), "no values of the variables satisfy it") for i in never)
    return restrictions


def _of_the_features(variation: Any, info: _Info) -> Any:
    problems = variation_problems(info.data["variations"], variation) if variation and "variations" in info.data else []
    if problems:
        raise mistaken(((), problem) for problem in problems)
    return variation


def _in_folder(name: str, info: _Info) -> Path:
    folder: Path = info.context
    return (folder / name).resolve()


@dataclass(frozen=True, kw_only=True)
class Scenario(Section):
    """A learning scenario.

    :param scene: file of the scene, absolute.
    :param libraries: Python packages or modules with the skills of the task.
    :param plugins: Python modules that add rewards.
    :param execution: `module:function` that runs one execution; see `evaluation.Execution`.
    :param restrictions: constraints between variables, which every configuration satisfies.
    :param success: what counts as success, besides the success of the task.
    :param repetitions: executions per configuration, each with another draw of the randomisation.
    :param max_failures: an evaluation ends after this number of executions without success: it is hopeless.
    :param timeout: of one evaluation (s of wall time). Generous, as results should not depend on the load of a machine.
    :param variations: features of the task, of which good parameters are functions; see `policy`.
    :param variation: their values in this study, by name; {} for those of the scene.
    :param prior_from: folders of earlier studies, whose good configurations are the priors; see `earlier_studies`.
    :param goal: the goal that the task is the plan for; "" if it has none.
    :param source: the text of the file, with the changes of `derived`.
    :param original: the text of the file, for the lines of mistakes.
    """

    # in this order: some validators need the values of fields before their own
    name: Annotated[Text, Field(alias="scenario")]
    version: Annotated[Count, Field(le=VERSION)] = VERSION
    platform: Platform = "simulation"
    execution: Text = SIMULATED_SKILLS
    settings: Annotated[Any, SkipValidation] = field(default_factory=dict)
    scene: Annotated[Path, PlainValidator(_scene_file)]
    libraries: Annotated[tuple[Text, ...], AfterValidator(_found)] = ()
    plugins: Annotated[tuple[Text, ...], AfterValidator(_found), AfterValidator(_imported)] = ()
    task: Annotated[tuple[Step, ...], AfterValidator(_named_once)]
    variables: Annotated[Named[Variable], Some, AfterValidator(check_conditions)]
    restrictions: Annotated[tuple[Restriction, ...], AfterValidator(_between_numbers)] = ()
    objectives: Annotated[Named[Objective], Some]
    success: Criteria = ()
    constraints: Criteria = ()
    randomisation: Randomisation = NO_RANDOMISATION
    simulation: Simulation = field(default_factory=Simulation)
    budget: Budget = field(default_factory=Budget)
    validation: ValidationPlan = field(default_factory=ValidationPlan)
    repetitions: Count = 5
    max_failures: Count = 5
    seed: Natural = 0
    optimiser: Optimiser = "prior"
    timeout: Positive = 600.0
    variations: Named[Feature] = ()
    variation: Annotated[Mapping[str, float], SkipValidation, AfterValidator(_of_the_features)] = field(
        default_factory=dict
    )
    prior_from: tuple[Annotated[Path, PlainValidator(_in_folder)], ...] = ()
    goal: Text = ""
    real: RealPlatform = field(default_factory=RealPlatform)
    source: str = ""
    original: str = ""

    @classmethod
    def completed(cls, data: dict[str, Any]) -> dict[str, Any]:
        execution = PLATFORMS.get(str(data.get("platform")), SIMULATED_SKILLS)
        absent: dict[str, Any] = {"execution": execution, "scene": "", "task": [], "variables": {}, "objectives": {}}
        if "repetitions" in data and isinstance(data["repetitions"], int):
            absent["max_failures"] = max(1, data["repetitions"])
        return absent | data

    @classmethod
    def mistakes(cls, data: Mapping[str, Any]) -> Iterator[Mistake]:
        for key in data.keys() & {"source", "original"}:
            yield (key,), "unknown key"
        if data.get("execution") in PLATFORMS.values():
            steps = ", ".join(name for name in _step_names(data["task"]) if name) or "none"
            for name in unassigned_variables(data):
                yield ("variables", name), f"expected STEP.PARAMETER with a step of the task: {steps}"
            for name in _fixed_variables(data):
                yield ("variables", name), "a variable, and fixed in the task: expected one of them"
        most, failures = data.get("repetitions", cls.repetitions), data.get("max_failures")
        if isinstance(most, int) and isinstance(failures, int) and failures > max(1, most):
            yield ("max_failures",), f"expected at most {most}, the repetitions, got {failures}"

    @property
    def is_real(self) -> bool:
        """Whether the task runs on a real robot."""
        return self.execution == REAL_SKILLS

    @property
    def all_rewards(self) -> list[Reward]:
        """The rewards of objectives, constraints and success."""
        return [reward for _, reward in self.reward_paths]

    @property
    def reward_paths(self) -> list[tuple[tuple[str | int, ...], Reward]]:
        """The rewards of objectives, constraints and success, with their paths in the file."""
        parts = [(each.name, i, part.reward) for each in self.objectives for i, part in enumerate(each.rewards)]
        found: list[tuple[tuple[str | int, ...], Reward]] = [
            (("objectives", name, "rewards", i), reward) for name, i, reward in parts
        ]
        for key, criteria in (("constraints", self.constraints), ("success", self.success)):
            found += [((key, i), each.reward) for i, each in enumerate(criteria)]
        return found

    @property
    def typical(self) -> dict[str, Value]:
        """A configuration."""
        return existing(self.variables, {each.name: each.typical for each in self.variables})

    def allows(self, configuration: Mapping[str, Value]) -> bool:
        """Whether a configuration satisfies all restrictions."""
        return all(each.holds(configuration) for each in self.restrictions)

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
        budget["evaluations"] = self.budget.evaluations if evaluations is None else evaluations
        wanted = self.budget.initial if initial is None else initial
        budget["initial"] = min(wanted, budget["evaluations"]) if initial is None else wanted
        changes = {
            "repetitions": repetitions, "max_failures": max_failures, "optimiser": optimiser, "seed": seed,
            "variation": None if variation is None else dict(variation),
        }  # fmt: skip
        for key, value in changes.items():
            if value is not None:
                data[key] = value
        if "max_failures" in data and max_failures is None:
            data["max_failures"] = min(data["max_failures"], data.get("repetitions", self.repetitions))
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
        return _parsed(text, Path("/"), self.name, original=self.original)


def load_scenario(file: str | Path, is_stored: bool = False) -> Scenario:
    """Reads a scenario file.

    :param is_stored: whether it is that of a study: see `parse_scenario`.
    :raises ScenarioError: it has mistakes; the text names all of them.
    :raises ConfigurationError: it cannot be read.
    """
    path = Path(file)
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigurationError(f"scenario {path}: {getattr(error, 'strerror', None) or error}") from None
    return parse_scenario(text, path.resolve().parent, str(path), is_stored)


def parse_scenario(text: str, folder: Path, source: str = "scenario", is_stored: bool = False) -> Scenario:
    """Reads a scenario.

    :param folder: for relative names of files.
    :param source: for error texts.
    :param is_stored: whether it is that of a study: `max_failures` above `repetitions`, which earlier versions
        accepted, counts as `repetitions`, with a warning.
    :raises ScenarioError: it has mistakes; the text names all of them, with their lines.
    """
    return _parsed(text, folder, source, is_stored, text)


def _parsed(text: str, folder: Path, source: str, is_stored: bool = False, original: str = "") -> Scenario:
    """Same as `parse_scenario`.

    :param original: the text of the file that the text is made of.
    """
    try:
        found = YamlText(text)
    except WrongValue as error:
        raise ScenarioError(source, [((), str(error))]) from None
    data = found.data
    if is_stored and isinstance(data, dict) and any(path == ("max_failures",) for path, _ in Scenario.mistakes(data)):
        most = data.get("repetitions", Scenario.repetitions)
        log.warning("%s: max_failures is %s, taken as %s, the repetitions", source, data["max_failures"], most)
        data["max_failures"] = most
    mistakes: list[Mistake] = [(path, f"{path_text(path)}: the key occurs twice") for path in found.repeated]
    try:
        scenario = replace(read(Scenario, data, folder), source=text, original=original)
    except ValidationError as error:
        mistakes += mistakes_of(error)
    if mistakes:
        raise ScenarioError(source, mistakes, text if original is text else "")
    return scenario
