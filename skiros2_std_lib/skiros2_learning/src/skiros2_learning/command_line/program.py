"""The program `learn`: arguments, commands and exit status."""

from __future__ import annotations

import argparse
import datetime
import os
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

from skiros2_common.command_line.command import CommandResult, Parser, command_arguments, end, run_command, user
from skiros2_common.core.errors import ConfigurationError, Refused, WrongValue
from skiros2_common.core.world_element import Element
from skiros2_common.core.world_model_port import WorldModelPort
from skiros2_common.tools.libraries import find_libraries
from skiros2_learning.command_line.running import (
    cost_of,
    policy_lines,
    run_study,
    validate_study,
    validate_variations,
)
from skiros2_learning.core.earlier_studies import with_earlier
from skiros2_learning.core.evaluation import check_execution, evaluate, seed_of
from skiros2_learning.core.hypermapper import import_hypermapper
from skiros2_learning.core.parameter_sets import apply_policy, apply_result, remove_set
from skiros2_learning.core.policy import Policy, has_variations, learn_variations, variation_studies
from skiros2_learning.core.policy_table import applicable_policy, stored_policy
from skiros2_learning.core.pools import DASK, Workers
from skiros2_learning.core.report import describe, format_value, status_lines, write_report
from skiros2_learning.core.samplers import better_sampler
from skiros2_learning.core.scenario import OPTIMISERS, Scenario
from skiros2_learning.core.scenario_check import load_checked, plugins_of
from skiros2_learning.core.storage import public_name
from skiros2_learning.core.study import LearningStudy
from skiros2_learning.core.validation import Sample, applicable, sample_text, share_text, stored_validation

if TYPE_CHECKING:
    from skiros2_world_model.command_line.program import Cell

#: Executions that check a prediction, and the success rate that they need; the number that their seed is made of.
_CHECKS, _LEAST_SUCCESS, _CHECK_NUMBER = 5, 0.5, 1_000_000


def _run(options: argparse.Namespace) -> CommandResult:
    scenario = _changed(load_checked(options.scenario), options)
    earlier = [LearningStudy.open(folder) for folder in (*scenario.prior_from, *options.prior_study)]
    scenario, first = with_earlier(scenario, earlier) if earlier else (scenario, [])
    folder = options.study or Path("build/learning") / scenario.name
    study = LearningStudy.create(scenario, folder, options.storage)
    for configuration in first:
        study.enqueue(configuration)
    return run_study(study, options.workers, not options.storage, options.yes, not options.no_validation)


def _resume(options: argparse.Namespace) -> CommandResult:
    study = LearningStudy.open(options.study, options.storage)
    study.scenario = _changed(study.scenario, options)
    requeue = options.alone or not options.storage
    return run_study(study, options.workers, requeue, options.yes, not options.no_validation)


def _validate(options: argparse.Namespace) -> CommandResult:
    if has_variations(options.study):
        return validate_variations(options.study, options.workers)
    study = LearningStudy.open(options.study, options.storage)
    return validate_study(study, options.workers, options.yes)


def _status(options: argparse.Namespace) -> CommandResult:
    if has_variations(options.study):
        studies, policy = variation_studies(options.study), stored_policy(options.study)
        lines = _variation_lines(studies)
        hint = f"the policy is not validated; run: learn validate {options.study}"
        lines += [hint] if policy is None else policy_lines(studies[0].scenario, policy)
        return CommandResult(lines, {"validation": None if policy is None else policy.validation.to_json()})
    study = LearningStudy.open(options.study, options.storage)
    results = {str(number): result.to_json() for number, result in study.results().items()}
    validation = stored_validation(study)
    data = {"validation": None if validation is None else validation.to_json(), "results": results}
    return CommandResult(status_lines(study), data)


def _report(options: argparse.Namespace) -> CommandResult:
    study = LearningStudy.open(options.study, options.storage)
    others = {str(folder): LearningStudy.open(folder) for folder in options.compare}
    return CommandResult([str(write_report(study, others))])


def _replay(options: argparse.Namespace) -> CommandResult:
    study = LearningStudy.open(options.study, options.storage)
    stored = study.result(options.number)
    if study.scenario.is_real:
        raise Refused("executions on a real robot are not replayed: they cannot be repeated exactly")
    again = evaluate(study.scenario, stored.configuration, stored.seed)
    is_same = (again.repetitions, again.error) == (stored.repetitions, stored.error)
    same = "the same" if is_same else "NOT the same"
    lines = [f"stored: {describe(stored)}", f"again:  {describe(again)}", f"the result is {same}"]
    for index, repetition in enumerate(again.repetitions):
        values = ", ".join(f"{name} {value:.3g}" for name, value in repetition.rewards.items())
        word = "success" if repetition.is_success else f"no success {repetition.reason}".rstrip()
        lines.append(f"  {index}: {word}; {repetition.duration:.1f} s; {values}")
    return CommandResult(lines, again.to_json(), 0 if is_same else 1)


def _variations(options: argparse.Namespace) -> CommandResult:
    scenario = _changed(load_checked(options.scenario), options)
    middle = {each.name: sum(each.range) / 2.0 for each in scenario.variations}
    check_execution(scenario.derived(variation=middle))
    folder = options.study or Path("build/learning") / f"{scenario.name}_variations"

    def run(study: LearningStudy) -> None:
        sys.stdout.write(f"variation {_values_text(study.scenario.variation)}\n")
        run_study(study, options.workers, validated=False)  # the policy is

    studies = learn_variations(scenario, folder, options.count, run)
    lines = _variation_lines(studies)
    lines.append(f"predict others with: learn predict {folder} FEATURE=VALUE ...")
    if not options.no_validation and not scenario.is_real:
        lines += validate_variations(folder, options.workers).lines
    return CommandResult(lines)


def _variation_lines(studies: Sequence[LearningStudy]) -> list[str]:
    best = [(each.scenario.variation, each.result(each.ranked()[0])) for each in studies if each.ranked()]
    return [f"{_values_text(variation)}: {describe(result)}" for variation, result in best]


def _predict(options: argparse.Namespace) -> CommandResult:
    policy = Policy(variation_studies(options.study))
    variation = dict(map(_feature_value, options.features))
    found = policy.predict(variation)
    values = " ".join(f"{name}={format_value(value)}" for name, value in found.configuration.items())
    lines = [f"{_values_text(variation)}: success {found.success:.0%} ± {found.deviation:.0%} expected; {values}"]
    data: dict[str, object] = {"configuration": found.configuration, "success": found.success}
    data["deviation"] = found.deviation
    if not options.check and not options.apply:
        return CommandResult(lines, data)
    scenario = policy.scenario.derived(
        variation=variation, repetitions=options.check or _CHECKS, max_failures=options.check or _CHECKS
    )
    seed = seed_of(scenario, _CHECK_NUMBER)
    result = evaluate(scenario, found.configuration, seed)
    checked = Sample(_CHECK_NUMBER, found.configuration, seed, tuple(result.repetitions))
    lines.append(f"in simulation: {share_text(checked)}; {describe(result)}")
    data["checked"] = result.to_json()
    if result.success_rate < _LEAST_SUCCESS:
        lines.append(f"not good enough: {_LEAST_SUCCESS:.0%} are needed; learn this variation too")
        return CommandResult(lines, data, 1)
    if options.apply:
        date = datetime.datetime.now().astimezone().isoformat(timespec="seconds")
        source = f"{options.study.resolve()} for {_values_text(variation)}"
        with _world(options) as wm:
            added = apply_result(wm, scenario, _CHECK_NUMBER, result, date, source, checked)
        lines += [f"{each.id}: revert it with: learn remove {each.id}" for each in added]
    return CommandResult(lines, data)


def _feature_value(text: str) -> tuple[str, float]:
    """Reads FEATURE=VALUE.

    :raises WrongValue: it is something else.
    """
    name, _, value = text.partition("=")
    try:
        return name, float(value)
    except ValueError:
        raise WrongValue(f"{text!r}: expected FEATURE=NUMBER, such as goal_x=0.6") from None


def _values_text(variation: Mapping[str, float]) -> str:
    return " ".join(f"{name}={value:.4g}" for name, value in variation.items())


@contextmanager
def _world(options: argparse.Namespace) -> Iterator[WorldModelPort]:
    """Yields the world model of the cell of these commands, or else the running one that `--wm` names."""
    if options.cell is not None:
        with options.cell.scene(options, user(), reads=False) as found:
            yield found
        return
    from skiros2_world_model.command_line.program import connect  # takes a second to import

    yield connect(options.wm, user())


def _apply(options: argparse.Namespace) -> CommandResult:
    if has_variations(options.study):
        return _apply_policy(options)
    study = LearningStudy.open(options.study, options.storage)
    number, result, validated = applicable(study, options.number, options.unvalidated)
    date = datetime.datetime.now().astimezone().isoformat(timespec="seconds")
    source = public_name(options.storage) if options.storage else str(options.study.resolve())
    with _world(options) as wm:
        added = apply_result(wm, study.scenario, number, result, date, source, validated)
    text = f"NOT validated: {describe(result)}"
    if validated is not None:
        text = f"evaluation {number}: {sample_text(study.scenario.objectives, validated)}"
    lines = [f"{each.id}: {text}" for each in added]
    return CommandResult([*lines, *_reverts(added)], [each.id for each in added])


def _reverts(added: Sequence[Element]) -> list[str]:
    return [f"revert it with: learn remove {each.id}" for each in added]


def _apply_policy(options: argparse.Namespace) -> CommandResult:
    policy = applicable_policy(options.study, options.unvalidated)
    scenario = variation_studies(options.study)[0].scenario
    date = datetime.datetime.now().astimezone().isoformat(timespec="seconds")
    with _world(options) as wm:
        added = apply_policy(wm, scenario, policy, date, str(options.study.resolve()))
    lines = [f"{each.id}: {sample_text(scenario.objectives, policy.validation.learned)}" for each in added]
    return CommandResult([*lines, *_reverts(added)], [each.id for each in added])


def _remove(options: argparse.Namespace) -> CommandResult:
    with _world(options) as wm:
        remove_set(wm, options.id)
    return CommandResult([f"{options.id} is removed"])


def _scenario(options: argparse.Namespace) -> CommandResult:
    scene, libraries = options.scene.resolve(), options.libraries.split(",")
    find_libraries(libraries, scene.parent)
    if bool(options.goal) == bool(options.skill):
        raise WrongValue("expected a skill or --goal")
    from skiros2_learning.local.identification import identify, identify_goal

    if options.goal:
        text = identify_goal(scene, libraries, options.goal)
    else:
        text = identify(scene, libraries, options.skill, options.parameters)
    if options.output:
        options.output.write_text(text, encoding="utf-8")
        return CommandResult([f"{options.output}: complete the objectives, then: learn check {options.output}"])
    return CommandResult(text.splitlines())


def _import(options: argparse.Namespace) -> CommandResult:
    return CommandResult(import_hypermapper(options.file).splitlines())


def _check(options: argparse.Namespace) -> CommandResult:
    if (plugins := plugins_of(options.scenario)) and not options.plugins:
        raise Refused(
            f"{options.scenario} names plug-ins, whose code would run: {', '.join(plugins)}; read them, then: "
            f"learn check --plugins {options.scenario}"
        )
    scenario = load_checked(options.scenario)
    variables = [
        f"{each.name}: {each.range_text}{f'; only if {each.condition_text}' if each.only_if else ''}"
        for each in scenario.variables
    ]
    cost = cost_of(scenario, os.cpu_count() or 1)
    hint = better_sampler(scenario)
    end = "" if cost.status else f"no mistakes; start the study with: learn run {options.scenario}"
    return CommandResult([*variables, *cost.lines, *filter(None, (hint, end))], None, cost.status)


def _changed(scenario: Scenario, options: argparse.Namespace) -> Scenario:
    """Returns the scenario with the changes of the command line."""
    return scenario.derived(
        priors=not getattr(options, "no_priors", False),
        evaluations=options.evaluations,
        optimiser=getattr(options, "optimiser", None),
    )


def _parser(cell: Cell | None) -> argparse.ArgumentParser:
    parser = Parser(prog="learn", description="Learns parameters of skills in simulation. See docs/learning.md.")
    parser.set_defaults(cell=cell)
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")

    def add(name: str, text: str) -> argparse.ArgumentParser:
        command: argparse.ArgumentParser = commands.add_parser(name, help=text, description=text)
        command.add_argument("--json", action="store_true", help="print JSON")
        return command

    def add_study(name: str, text: str) -> argparse.ArgumentParser:
        command = add(name, text)
        command.add_argument("study", type=Path, metavar="STUDY", help="folder of the study")
        command.add_argument("--storage", default="", metavar="URL", help="database of the study, if it has one")
        return command

    def add_world(command: argparse.ArgumentParser) -> None:
        text = "node of the world model (default: %(default)s)"
        command.add_argument("--wm", default="wm", metavar="NAME", help=text)
        if cell is not None:
            cell.add_arguments(command)

    def add_budget(command: argparse.ArgumentParser) -> None:
        command.add_argument(
            "--workers",
            type=_workers,
            default=os.cpu_count() or 1,
            metavar="N",
            help="processes (default: one per core), or dask://HOST:PORT of the scheduler of a Dask cluster",
        )
        command.add_argument("--yes", action="store_true", help="on a real robot: do not ask before each execution")

    def add_search(command: argparse.ArgumentParser) -> None:
        add_budget(command)
        command.add_argument("--evaluations", type=_count, metavar="N", help="another budget than the scenario's")

    def add_validation(command: argparse.ArgumentParser) -> None:
        command.add_argument("--no-validation", action="store_true", help="search only; see `learn validate`")

    command = add(
        "check",
        "Checks a scenario: names, ranges, scene, skills. Measures an execution: the time of the study.",
    )
    command.add_argument("scenario", type=Path, metavar="SCENARIO", help="scenario file")
    command.add_argument("--plugins", action="store_true", help="import the plug-ins of the scenario: their code runs")
    command = add("run", "Starts a study. Ctrl-C ends it; `learn resume` continues it.")
    command.add_argument("scenario", type=Path, metavar="SCENARIO", help="scenario file")
    command.add_argument("--study", type=Path, metavar="FOLDER", help="default: build/learning/NAME")
    command.add_argument("--storage", default="", metavar="URL", help="database, such as postgresql://user@host/name")
    command.add_argument("--optimiser", choices=OPTIMISERS, help="another optimiser than the scenario's")
    command.add_argument("--no-priors", action="store_true", help="remove all priors")
    command.add_argument(
        "--prior-study", type=Path, action="append", default=[], metavar="STUDY",
        help="take the good configurations of an earlier study as priors",
    )  # fmt: skip
    add_search(command)
    add_validation(command)
    command = add_study("resume", "Continues a study, also on another machine with --storage.")
    command.add_argument(
        "--alone", action="store_true", help="no other process runs it: repeat what was running at once"
    )
    add_search(command)
    add_validation(command)
    command = add_study("validate", "Repeats the best configurations and the skill's defaults on new draws.")
    add_budget(command)
    add_study("status", "Shows progress, the validation, and the Pareto-optimal configurations.")
    command = add_study("report", "Writes report.html with pictures into the folder of the study.")
    command.add_argument("--compare", type=Path, nargs="*", default=[], metavar="STUDY", help="draw these studies too")
    command = add("scenario", "Prints a scenario for a skill or a goal: missing parameters are the variables.")
    command.add_argument("skill", nargs="?", metavar="SKILL", help="type of the skill, such as Push")
    command.add_argument("parameters", nargs="*", metavar="KEY=LABEL", help="elements and fixed values")
    command.add_argument("--goal", default="", metavar="GOAL", help="instead of a skill: the skills of its plan")
    command.add_argument("--scene", type=Path, required=True, metavar="FILE", help="scene file")
    command.add_argument("--libraries", required=True, metavar="A,B", help="Python packages with the skills")
    command.add_argument("-o", "--output", type=Path, metavar="FILE", help="write it to a file")
    command = add("variations", "Learns sampled variations of a task, and validates a policy for all.")
    command.add_argument("scenario", type=Path, metavar="SCENARIO", help="scenario file with `variations`")
    command.add_argument("--study", type=Path, metavar="FOLDER", help="default: build/learning/NAME_variations")
    command.add_argument("--count", type=_count, default=8, metavar="N", help="variations (default: %(default)s)")
    add_search(command)
    add_validation(command)
    command = add("predict", "Predicts the parameters of a variation that was not learned.")
    command.add_argument("study", type=Path, metavar="FOLDER", help="folder of `learn variations`")
    command.add_argument("features", nargs="+", metavar="FEATURE=VALUE", help="the variation")
    command.add_argument("--check", type=_count, metavar="N", help="try the prediction N times in simulation")
    command.add_argument("--apply", action="store_true", help="check it, and store it in the world model")
    add_world(command)
    command = add("import", "Prints the variables and objectives of a HyperMapper scenario (JSON) in this layout.")
    command.add_argument("file", type=Path, metavar="JSON", help="scenario of HyperMapper")
    command = add_study("apply", "Stores a configuration in the world model: skills use it when they start.")
    command.add_argument(
        "number", type=int, nargs="?", metavar="NUMBER", help="evaluation (default: the validated one)"
    )
    text = "also if it is not validated, or not better than the defaults"
    command.add_argument("--unvalidated", action="store_true", help=text)
    add_world(command)
    command = add("remove", "Reverts an applied configuration.")
    command.add_argument("id", metavar="ID", help="id of the parameter set")
    add_world(command)
    command = add_study("replay", "Runs an evaluation again and compares it with the stored result.")
    command.add_argument("number", type=int, metavar="NUMBER", help="number of the evaluation")
    return parser


def _count(text: str) -> int:
    number = int(text)
    if number < 1:
        raise argparse.ArgumentTypeError(f"expected 1 or more, got {number}")
    return number


def _workers(text: str) -> Workers:
    return text if text.startswith(DASK) else _count(text)


_COMMANDS = {
    "scenario": _scenario,
    "import": _import,
    "check": _check,
    "run": _run,
    "variations": _variations,
    "predict": _predict,
    "resume": _resume,
    "validate": _validate,
    "status": _status,
    "report": _report,
    "replay": _replay,
    "apply": _apply,
    "remove": _remove,
}


def main(arguments: Sequence[str] | None = None, cell: Cell | None = None) -> int:
    """Runs the program. Returns the exit status.

    :param cell: where configurations are applied, without ROS.
    """
    options = _parser(cell).parse_args(command_arguments(arguments))
    return run_command("learn", lambda: _do(options), options.json)


def run(arguments: Sequence[str] | None = None, cell: Cell | None = None) -> NoReturn:
    """Runs the program and ends the process with its status."""
    end(main(arguments, cell))


def _do(options: argparse.Namespace) -> CommandResult:
    """Runs a command; a file that cannot be read or written is an error in one line."""
    try:
        return _COMMANDS[options.command](options)
    except BrokenPipeError:
        raise
    except OSError as error:
        name = f"{error.filename}: " if error.filename else ""
        raise ConfigurationError(f"{name}{error.strerror or error}") from error
