"""The demos of learning: parameters are learned without and with priors, the study is validated, and the configuration
that it chooses, learned or of the skill's defaults, is proven."""

from __future__ import annotations

import argparse
import math
import os
import shutil
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import rospkg
from matplotlib.figure import Figure

from skiros2_bags.core.run import Finding
from skiros2_common.command_line.command import CommandResult, Parser, command_arguments, run_command
from skiros2_common.command_line.layout import next_commands
from skiros2_contact_skills.contact_primitive import MAX_FORCE, OVERSHOOT
from skiros2_learning.command_line.running import Progress
from skiros2_learning.core.evaluation import find_execution
from skiros2_learning.core.report import write_report
from skiros2_learning.core.scenario import Scenario, load_scenario
from skiros2_learning.core.study import LearningStudy
from skiros2_learning.core.validation import (
    Sample,
    Validation,
    applicable,
    share_text,
    validate,
    validation_lines,
)
from skiros2_learning.core.workers import Runner, repeat_in_processes
from skiros2_learning.local.insertion import ARM_FORCE, DEPTH
from skiros2_learning_demo.production import produce


@dataclass(frozen=True)
class Demo:
    """A demo.

    :param scenario: name of the file.
    :param cold, guided: evaluations of the short form, without and with priors.
    :param repetitions: executions of each.
    :param claimed: success rate that the interval of the chosen configuration has to exceed, for a proof.
    """

    name: str
    about: str
    scenario: str
    cold: int
    guided: int
    repetitions: int
    claimed: float


PUSH = Demo("push", "a push across a table", "push.yaml", cold=100, guided=30, repetitions=3, claimed=0.8)
INSERTION = Demo(
    "insertion-learning", "the search of a bore", "insertion.yaml",
    cold=24, guided=10, repetitions=2, claimed=0.6,
)  # fmt: skip


def following(demo: Demo, folder: Path) -> dict[str, str]:
    """What to type next, in the folder of the clone."""
    learn = ". install/setup.sh && rosrun skiros2_learning learn"
    other = INSERTION if demo is PUSH else PUSH
    return {
        f"{learn} status {folder / 'with_priors'}": "the evaluations of the study",
        f"make demo DEMO={other.name}": f"learn {other.about}",
        f"{learn} --help": "a study of your own: see docs/tutorials/15_learning.md",
    }


def main(demo: Demo, arguments: Sequence[str] | None = None) -> int:
    """Runs a demo. Returns the exit status: 0 if the chosen configuration is proven."""
    prog = f"{demo.name.replace('-', '_')}_demo"
    parser = Parser(prog=prog, description=f"Learns {demo.about}, without and with priors. See docs/learning.md.")
    parser.add_argument("--folder", type=Path, default=Path("build/demo") / demo.name, help="default: %(default)s")
    parser.add_argument("--cold", type=int, default=demo.cold, metavar="N", help="evaluations without priors")
    parser.add_argument("--guided", type=int, default=demo.guided, metavar="N", help="evaluations with priors")
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1, metavar="N", help="processes")
    if demo is PUSH:
        parser.add_argument("--no-nodes", dest="nodes", action="store_false", help="do not run it on real nodes")
    options = parser.parse_args(command_arguments(arguments))
    return run_command(prog, lambda: _Run(demo, options).run(), as_json=False)


class _Run:
    """One run of a demo."""

    def __init__(self, demo: Demo, options: argparse.Namespace) -> None:
        self._demo = demo
        self._options = options
        self._folder: Path = options.folder
        folder = Path(rospkg.RosPack().get_path("skiros2_learning_demo")) / "scenarios"
        self._scenario = load_scenario(folder / demo.scenario)

    def run(self) -> CommandResult:
        begin = time.monotonic()
        shutil.rmtree(self._folder, ignore_errors=True)
        cold = self._learn("without_priors", False, self._options.cold)
        guided = self._learn("with_priors", True, self._options.guided)
        plan = guided.scenario.validation
        _say(
            f"validating the best {plan.candidates}: up to {plan.choice} executions each, then {plan.repetitions} of "
            "the chosen one and of the defaults, with new draws"
        )
        with guided.running(), repeat_in_processes(guided.scenario, self._options.workers) as repeat:
            validation = validate(guided, repeat)
        findings, pictures = (self._insertion if self._demo is INSERTION else self._push)(guided, validation)
        findings.insert(0, _success(validation.decided, self._demo.claimed))
        report = write_report(guided, {"without priors": cold}, pictures)
        lines = [
            "",
            f"without priors: {_summary(cold)}",
            f"with priors:    {_summary(guided)}",
            *validation_lines(guided.scenario, validation),
            *(f"  {'✓' if each.holds else '✗'} {each.text}" for each in findings),
            f"report: {report}",
            f"{time.monotonic() - begin:.0f} s",
        ]
        proven = all(each.holds for each in findings)
        if proven:
            lines += next_commands(following(self._demo, self._folder)).rstrip().split("\n")
        return CommandResult(lines, status=0 if proven else 1)

    def _learn(self, name: str, priors: bool, evaluations: int) -> LearningStudy:
        _say(f"learning {name.replace('_', ' ')}, {evaluations} evaluations")
        scenario = self._scenario.derived(
            priors=priors,
            evaluations=evaluations,
            initial=max(2, evaluations // (6 if priors else 4)),
            repetitions=self._demo.repetitions,
        )
        return self._run(LearningStudy.create(scenario, self._folder / name))

    def _run(self, study: LearningStudy) -> LearningStudy:
        every = max(1, study.scenario.budget.evaluations // 10)
        with study.running():
            Runner(study, self._options.workers, Progress(study, every)).run()
        return study

    # -- proofs ------------------------------------------------------------------------------------------------------

    def _push(self, study: LearningStudy, validation: Validation) -> tuple[list[Finding], dict[str, Figure]]:
        if not self._options.nodes:
            return [], {}
        _say("running the chosen configuration on real nodes")
        number, result, sample = applicable(study)
        return produce(study.scenario, number, result, study.folder.resolve(), self._folder.resolve(), sample), {}

    def _insertion(self, study: LearningStudy, validation: Validation) -> tuple[list[Finding], dict[str, Figure]]:
        shown = [each for each in (validation.learned, validation.defaults) if each is not None]
        most = max((r.rewards["force.measured_force"] for r in validation.decided.repetitions), default=math.inf)
        text = f"the maximum force was {most:.1f} N; the limit is {MAX_FORCE:g} N, its overshoot {OVERSHOOT - 1:.0%}"
        findings = [Finding(most <= OVERSHOOT * MAX_FORCE, text)]
        return findings, {"One insertion": _profiles(study.scenario, shown)}


def _profiles(scenario: Scenario, samples: Sequence[Sample]) -> Figure:
    """Draws depth and force of one insertion for each configuration, with the same draw."""
    execution = find_execution(scenario.execution)
    figure = Figure(figsize=(7, 4.5), layout="constrained")
    depth, force = figure.subplots(2, 1, sharex=True)
    for sample in samples:
        record = execution(scenario, sample.configuration, sample.seed, 0)
        depth.plot(record.times, 1000.0 * record.values_of(DEPTH), label=sample.name)
        force.plot(record.times, record.values_of(ARM_FORCE), lw=0.8)
    depth.set(ylabel="depth (mm)")
    depth.legend()
    force.set(ylabel="force at the wrist (N)", xlabel="time (s)")
    return figure


def _success(chosen: Sample, claimed: float) -> Finding:
    text = f"{chosen.name}: {share_text(chosen)}; an interval above {claimed:.0%} is expected"
    return Finding(chosen.success.low > claimed, text)


def _summary(study: LearningStudy) -> str:
    results = study.results()
    rates = [results[number].success_rate for number in sorted(results)]
    times = study.scenario.repetitions
    first = next((index for index, rate in enumerate(rates, 1) if rate == 1.0), None)
    found = f"the first one that succeeded {times} of {times} times was number {first}" if first else "none always did"
    return f"{len(rates)} evaluations; best success {max(rates, default=0.0):.0%} (optimistic); {found}"


def _say(text: str) -> None:
    sys.stdout.write(f"\n{text}\n")
    sys.stdout.flush()
