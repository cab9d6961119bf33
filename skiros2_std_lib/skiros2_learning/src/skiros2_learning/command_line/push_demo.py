"""The demo of learning: a push is learned without and with priors, and the best configuration is tried again."""

from __future__ import annotations

import argparse
import dataclasses
import os
import shutil
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import rospkg

from skiros2_common.command_line.command import CommandResult, Parser, command_arguments, run_command
from skiros2_learning.command_line.program import Progress
from skiros2_learning.core.evaluation import Evaluation, evaluate
from skiros2_learning.core.report import describe, write_report
from skiros2_learning.core.scenario import Scenario, load_scenario
from skiros2_learning.core.study import LearningStudy
from skiros2_learning.core.workers import Runner
from skiros2_learning.ros.production import produce

#: Evaluations of the short form, without and with priors, and executions of each.
_COLD, _GUIDED, _REPETITIONS = 60, 30, 3
#: Executions of the chosen configuration, with seeds that no study has used.
_TRIES = 10
_NEW_SEED = 900_000_007


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the demo. Returns the exit status: 0 if the chosen configuration works."""
    parser = Parser(prog="push_demo", description="Learns a push, without and with priors. See docs/learning.md.")
    parser.add_argument("--folder", type=Path, default=Path("build/demo/push"), help="default: %(default)s")
    parser.add_argument("--cold", type=int, default=_COLD, metavar="N", help="evaluations without priors")
    parser.add_argument("--guided", type=int, default=_GUIDED, metavar="N", help="evaluations with priors")
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1, metavar="N", help="processes")
    parser.add_argument("--no-nodes", dest="nodes", action="store_false", help="do not run the result on real nodes")
    options = parser.parse_args(command_arguments(arguments))
    return run_command("push_demo", lambda: _demo(options), as_json=False)


def _demo(options: argparse.Namespace) -> CommandResult:
    begin = time.monotonic()
    push = load_scenario(Path(rospkg.RosPack().get_path("skiros2_learning")) / "scenarios" / "push.yaml")
    shutil.rmtree(options.folder, ignore_errors=True)
    cold = _learn(push, options.folder / "without_priors", False, options.cold, options.workers)
    guided = _learn(push, options.folder / "with_priors", True, options.guided, options.workers)
    report = write_report(guided, {"without priors": cold})
    number = _best(guided)
    chosen = guided.result(number)
    tried = _try(push, chosen)
    lines = [
        "",
        f"without priors: {_summary(cold)}",
        f"with priors:    {_summary(guided)}",
        f"chosen: evaluation {number}: {describe(chosen)}",
        f"tried {_TRIES} times with new draws: success {tried.success_rate:.0%}",
        f"report: {report}",
    ]
    proven = True
    if options.nodes:
        sys.stdout.write("\nrunning the chosen configuration on real nodes\n")
        findings = produce(guided.scenario, number, chosen, guided.folder.resolve(), options.folder.resolve())
        proven = all(finding.holds for finding in findings)
        lines += ["on real nodes:", *(f"  {'✓' if each.holds else '✗'} {each.text}" for each in findings)]
    lines.append(f"{time.monotonic() - begin:.0f} s")
    return CommandResult(lines, status=0 if tried.success_rate >= 0.5 and proven else 1)


def _learn(push: Scenario, folder: Path, priors: bool, evaluations: int, workers: int) -> LearningStudy:
    sys.stdout.write(f"\nlearning {'with' if priors else 'without'} priors, {evaluations} evaluations\n")
    initial = max(2, evaluations // (6 if priors else 4))
    scenario = push.derived(priors=priors, evaluations=evaluations, initial=initial, repetitions=_REPETITIONS)
    study = LearningStudy.create(scenario, folder)
    with study.running():
        Runner(study, workers, Progress(study)).run()
    return study


def _best(study: LearningStudy) -> int:
    """Returns the evaluation to apply: highest success rate, then highest first objective."""
    goal = study.scenario.objectives[0].name
    results = {number: result for number, result in study.results().items() if not result.error}
    return max(results, key=lambda number: (results[number].success_rate, results[number].objectives[goal]))


def _try(push: Scenario, chosen: Evaluation) -> Evaluation:
    return evaluate(dataclasses.replace(push, repetitions=_TRIES), chosen.configuration, _NEW_SEED)


def _summary(study: LearningStudy) -> str:
    results = study.results()
    rates = [results[number].success_rate for number in sorted(results)]
    first = next((index for index, rate in enumerate(rates, 1) if rate == 1.0), None)
    found = f"the first configuration that always works after {first} evaluations" if first else "none always works"
    return f"best success {max(rates, default=0.0):.0%}; {found}; mean {sum(rates) / max(1, len(rates)):.0%}"
