"""Runs and validates studies for the program `learn`, with their progress on the terminal."""

from __future__ import annotations

import sys
import time
from contextlib import ExitStack
from pathlib import Path

from skiros2_common.command_line.command import CommandResult
from skiros2_common.core.errors import Refused
from skiros2_learning.core.evaluation import Evaluation, Execution, Unavailable, repeat_once, seed_of
from skiros2_learning.core.policy import variation_studies
from skiros2_learning.core.policy_table import ValidatedPolicy, validate_policy
from skiros2_learning.core.pools import Workers
from skiros2_learning.core.report import describe, status_lines, write_report
from skiros2_learning.core.scenario import Scenario
from skiros2_learning.core.study import LearningStudy
from skiros2_learning.core.validation import Repeat, repeat_here, stored_validation, validate, validation_lines
from skiros2_learning.core.workers import OneByOne, Runner, repeat_in_processes

#: Evaluations of which the rate is the mean.
_RECENT = 20
#: The number that the seed of a measured execution is made of.
_COST_NUMBER = 2_000_000


class Progress:
    """Prints a line after each evaluation: number, rate, time left, success, and the best so far.

    :param every: prints one of this number of evaluations, the last one, and each that raises the best success rate.
    """

    def __init__(self, study: LearningStudy, every: int = 1) -> None:
        self._study = study
        self._every = every
        self._best = 0.0
        self._times = [time.monotonic()]

    def __call__(self, number: int, result: Evaluation) -> None:
        self._times = [*self._times, time.monotonic()][-_RECENT:]
        rate = (len(self._times) - 1) / max(1e-3, self._times[-1] - self._times[0])
        done, budget = self._study.counted, self._study.scenario.budget.evaluations
        best = max((each.success_rate for each in self._study.results().values()), default=0.0)
        if done % self._every and done < budget and best <= self._best:
            return
        self._best = best
        left = (budget - done) / rate
        sys.stdout.write(
            f"[{done}/{budget}] {rate:.2f}/s, {left:.0f} s left, best success {best:.0%} | {number}: "
            f"{describe(result)}\n"
        )
        sys.stdout.flush()


def run_study(
    study: LearningStudy, workers: Workers, requeue: bool = True, confirmed: bool = False, validated: bool = True
) -> CommandResult:
    """Runs a study until its budget is used up, validates it, and writes the report. Ctrl-C keeps all finished
    evaluations.

    :param workers: see `Workers`; a real robot is used by this one only.
    :param requeue: whether to repeat interrupted evaluations at once.
    :param confirmed: whether executions on a real robot start without asking the operator.
    :param validated: whether to validate the study.
    """
    begin = time.monotonic()
    progress = Progress(study)
    with ExitStack() as stack:
        runner: Runner | OneByOne
        repeat, execution = _executor(study, stack, workers, confirmed)
        runner = Runner(study, workers, progress) if execution is None else OneByOne(study, execution, progress)
        stack.enter_context(study.running())
        saved = study.save_unsaved()
        if saved:
            sys.stdout.write(f"{saved} results of an earlier run are stored now\n")
        if requeue:
            study.requeue_interrupted()
        try:
            runner.run()
        except KeyboardInterrupt:
            sys.stdout.write(f"\ninterrupted; resume with: learn resume {study.folder}\n")
            raise
        if validated:
            _validate_ended(study, repeat)
    report = write_report(study)
    spent = time.monotonic() - begin
    sampling = f"the sampler took {runner.sampling_time:.1f} s of {spent:.1f} s"
    return CommandResult([*status_lines(study), sampling, f"report: {report}"])


def validate_study(study: LearningStudy, workers: Workers, confirmed: bool = False) -> CommandResult:
    """Validates a study, and writes the report. Arguments as of `run_study`."""
    with ExitStack() as stack:
        repeat, _ = _executor(study, stack, workers, confirmed)
        stack.enter_context(study.running())
        _say_cost(study)
        found = validate(study, repeat)
    report = write_report(study)
    return CommandResult([*validation_lines(study.scenario, found), f"report: {report}"], found.to_json())


def validate_variations(folder: Path, workers: Workers) -> CommandResult:
    """Validates the policy of learned variations, and stores it in their folder.

    :raises Refused: there are too few results, or they are of a real robot, which does not change the task.
    """
    studies = variation_studies(folder)
    scenario = studies[0].scenario
    if scenario.is_real:
        raise Refused("policies are validated in simulation only: a real robot does not change the task")
    plan = scenario.validation
    sys.stdout.write(
        f"validating: {plan.choice} executions of each policy, then {plan.repetitions} of the chosen one and of the "
        "defaults, each with another variation\n"
    )
    sys.stdout.flush()
    with repeat_in_processes(scenario, workers) as repeat:
        found = validate_policy(studies, repeat)
    found.save(folder)
    return CommandResult(
        [*policy_lines(scenario, found), f"apply it with: learn apply {folder}"], found.validation.to_json()
    )


def policy_lines(scenario: Scenario, found: ValidatedPolicy) -> list[str]:
    """Describes a validated policy for people."""
    ranges = (f"{each.name} {each.range_text()}" for each in scenario.variations)
    return [
        f"policy for {', '.join(ranges)}, chosen from: "
        + "; ".join(f"{each.name} ({each.good} of {each.count})" for each in found.validation.candidates),
        *validation_lines(scenario, found.validation),
    ]


def cost_of(scenario: Scenario, workers: int) -> CommandResult:
    """Describes how long a study takes at most, by the time of one execution; status 1 if that breaks.

    A real robot does not move for it.
    """
    plan, budget = scenario.validation, scenario.budget.evaluations
    search, validation = budget * scenario.repetitions, plan.candidates * plan.choice + 2 * plan.repetitions
    text = f"at most {search} executions in the search and {validation} in the validation"
    if scenario.is_real:
        return CommandResult([f"{text}, of up to {scenario.simulation.time_limit:g} s each, and the resets"])
    configuration = scenario.typical
    for _ in range(2):  # the first one reads the ontologies
        begin = time.perf_counter()
        outcome = repeat_once(scenario, configuration, seed_of(scenario, _COST_NUMBER), 0)
        spent = time.perf_counter() - begin
    if isinstance(outcome, str):
        return CommandResult([text, f"an execution of a typical configuration breaks: {outcome}"], None, 1)
    total = (search + validation) * spent / workers
    time_text = f"{total:.0f} s" if total < 60.0 else f"{total / 60.0:.2g} min"
    return CommandResult([f"{text}, {spent:.2g} s each: about {time_text} with {workers} processes"])


def _executor(
    study: LearningStudy, stack: ExitStack, workers: Workers, confirmed: bool
) -> tuple[Repeat, Execution | None]:
    """Returns what makes executions, and the execution of a real robot; None in simulation."""
    if not study.scenario.is_real:
        return stack.enter_context(repeat_in_processes(study.scenario, workers)), None
    from skiros2_learning.ros.real_robot import RealRobot  # needs ROS

    robot = stack.enter_context(RealRobot(study.scenario, _yes if confirmed else _ask_operator))
    return repeat_here(robot.execute), robot.execute


def _validate_ended(study: LearningStudy, repeat: Repeat) -> None:
    """Validates a study after its search, unless it is. Of several machines, that with the last evaluation does."""
    if study.running_count:
        sys.stdout.write(f"other processes run this study; when they end: learn validate {study.folder}\n")
        return
    if not study.ranked():
        sys.stdout.write("not validated: no evaluation has a result\n")
        return
    found = stored_validation(study)
    if found is not None and found.counted == study.counted:
        return
    _say_cost(study)
    try:
        validate(study, repeat)
    except KeyboardInterrupt:
        sys.stdout.write(f"\ninterrupted; validate with: learn validate {study.folder}\n")
        raise


def _say_cost(study: LearningStudy) -> None:
    plan = study.scenario.validation
    sys.stdout.write(
        f"validating: up to {plan.choice} executions of each of the best {plan.candidates} configurations, then "
        f"{plan.repetitions} of the chosen one and of the defaults, with new draws\n"
    )
    sys.stdout.flush()


def _yes(text: str) -> bool:
    sys.stdout.write(f"{text}\n")
    sys.stdout.flush()
    return True


def _ask_operator(text: str) -> bool:
    """Asks whether an execution may start. Ctrl-C and `q` end the run.

    :raises Unavailable: there is no terminal to ask at.
    """
    while True:
        try:
            answer = input(f"{text}: start? [y/n/q] ").strip().lower()
        except EOFError:
            raise Unavailable("each execution needs the operator's confirmation at a terminal, or --yes") from None
        if answer == "q":
            raise KeyboardInterrupt
        if answer in ("y", "n"):
            return answer == "y"
