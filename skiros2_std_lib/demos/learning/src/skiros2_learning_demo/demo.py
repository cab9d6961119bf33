"""The demos of learning: parameters are learned without and with priors, the best configurations are tried again with
new draws, and the chosen one is proven."""

from __future__ import annotations

import argparse
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
from skiros2_contact_skills.contact_primitive import MAX_FORCE
from skiros2_learning.command_line.program import Progress
from skiros2_learning.core.evaluation import Evaluation, find_execution, seed_of
from skiros2_learning.core.report import describe, write_report
from skiros2_learning.core.scenario import Scenario, load_scenario
from skiros2_learning.core.study import LearningStudy
from skiros2_learning.core.variables import Value
from skiros2_learning.core.workers import Runner
from skiros2_learning.local.insertion import ARM_FORCE, DEPTH, default_configuration
from skiros2_learning_demo.production import produce

#: Executions of the chosen configuration, with draws that nothing has used before.
_TRIES = 10
#: Success rate of these for a proof.
_PROVEN = 0.8
#: Added to the scenario's seed.
_CONFIRMATION_SEED, _TRIAL_SEED = 1000, 2000

Configuration = dict[str, Value]


@dataclass(frozen=True)
class Demo:
    """A demo.

    :param scenario: name of the file.
    :param cold, guided: evaluations of the short form, without and with priors.
    :param repetitions: executions of each.
    :param candidates: best configurations that are run again; the best of many results is optimistic: it had luck.
    :param confirmations: executions of each of these.
    """

    name: str
    about: str
    scenario: str
    cold: int
    guided: int
    repetitions: int
    candidates: int
    confirmations: int


PUSH = Demo(
    "push", "a push across a table", "push.yaml", cold=100, guided=30, repetitions=3, candidates=4, confirmations=8
)
INSERTION = Demo(
    "insertion-learning", "the search of a bore", "insertion.yaml",
    cold=24, guided=10, repetitions=2, candidates=3, confirmations=5,
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
        best = [guided.result(number).configuration for number in guided.ranked()[: self._demo.candidates]]
        confirmed = self._repeat("confirmed", best, self._demo.confirmations, _CONFIRMATION_SEED)
        number = confirmed.ranked()[0]
        chosen = confirmed.result(number)
        findings, pictures = (self._insertion if self._demo is INSERTION else self._push)(confirmed, number, chosen)
        report = write_report(guided, {"without priors": cold}, pictures)
        lines = [
            "",
            f"without priors: {_summary(cold)}",
            f"with priors:    {_summary(guided)}",
            f"chosen of the best {len(best)}, each run {self._demo.confirmations} times again: {describe(chosen)}",
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

    def _repeat(self, name: str, chosen: Sequence[Configuration], repetitions: int, seed: int) -> LearningStudy:
        """Runs configurations with new draws, the same ones for each, and all repetitions."""
        _say(f"running {len(chosen)} configurations {repetitions} times with new draws")
        scenario = self._scenario.derived(
            evaluations=len(chosen),
            initial=0,
            repetitions=repetitions,
            max_failures=repetitions,
            seed=self._scenario.seed + seed,
        )
        study = LearningStudy.create(scenario, self._folder / name)
        for each in chosen:
            study.enqueue(each, seed_of(scenario, 0))
        return self._run(study)

    def _run(self, study: LearningStudy) -> LearningStudy:
        with study.running():
            Runner(study, self._options.workers, Progress(study)).run()
        return study

    # -- proofs ------------------------------------------------------------------------------------------------------

    def _push(self, study: LearningStudy, number: int, chosen: Evaluation) -> tuple[list[Finding], dict[str, Figure]]:
        tried = self._repeat("tried", [chosen.configuration], _TRIES, _TRIAL_SEED).result(0)
        findings = [_success(tried)]
        if self._options.nodes:
            _say("running the chosen configuration on real nodes")
            findings += produce(study.scenario, number, chosen, study.folder.resolve(), self._folder.resolve())
        return findings, {}

    def _insertion(
        self, study: LearningStudy, number: int, chosen: Evaluation
    ) -> tuple[list[Finding], dict[str, Figure]]:
        defaults = default_configuration(self._scenario)
        configurations = {"learned": chosen.configuration, "defaults of the skill": defaults}
        results = self._repeat("tried", list(configurations.values()), _TRIES, _TRIAL_SEED)
        tried, usual = results.result(0), results.result(1)
        most = max(each.rewards["force.measured_force"] for each in tried.repetitions)
        findings = [
            _success(tried),
            Finding(True, f"with the defaults of the skill and the same draws: {usual.success_rate:.0%}"),
            Finding(most <= MAX_FORCE, f"the maximum force was {most:.1f} N; {MAX_FORCE:g} N are allowed"),
        ]
        return findings, {"One insertion": _profiles(results.scenario, configurations, tried.seed)}


def _profiles(scenario: Scenario, configurations: dict[str, Configuration], seed: int) -> Figure:
    """Draws depth and force of one insertion for each configuration, with the same draw."""
    execution = find_execution(scenario.execution)
    figure = Figure(figsize=(7, 4.5), layout="constrained")
    depth, force = figure.subplots(2, 1, sharex=True)
    for title, configuration in configurations.items():
        record = execution(scenario, configuration, seed, 0)
        depth.plot(record.times, 1000.0 * record.values_of(DEPTH), label=title)
        force.plot(record.times, record.values_of(ARM_FORCE), lw=0.8)
    depth.set(ylabel="depth (mm)")
    depth.legend()
    force.set(ylabel="force at the wrist (N)", xlabel="time (s)")
    return figure


def _success(tried: Evaluation) -> Finding:
    good = sum(each.is_success for each in tried.repetitions)
    text = f"with new draws, {good} of {len(tried.repetitions)} executions succeeded; {_PROVEN:.0%} are expected"
    return Finding(tried.success_rate >= _PROVEN, text)


def _summary(study: LearningStudy) -> str:
    results = study.results()
    rates = [results[number].success_rate for number in sorted(results)]
    first = next((index for index, rate in enumerate(rates, 1) if rate == 1.0), None)
    found = f"the first configuration that always works after {first} evaluations" if first else "none always works"
    return f"best success {max(rates, default=0.0):.0%}; {found}; mean {sum(rates) / max(1, len(rates)):.0%}"


def _say(text: str) -> None:
    sys.stdout.write(f"\n{text}\n")
    sys.stdout.flush()
