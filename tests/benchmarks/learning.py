"""Learning beside its peers: optimisers on known functions, on the push and on the insertion; speed.

A program of its own: `make bench-learning`, or `.venv/bin/python3 tests/benchmarks/learning.py --short`.
"""

from __future__ import annotations

import argparse
import json
import statistics
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]

import tomllib  # noqa: E402

folders = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["pytest"]["ini_options"]["pythonpath"]
sys.path[:0] = [str(ROOT / folder) for folder in folders]

import optuna  # noqa: E402 - after the path

from benchmarks.optimisers import optimisers  # noqa: E402
from skiros2_learning.core.evaluation import evaluate, seed_of  # noqa: E402
from skiros2_learning.core.policy import Policy, learn_variations  # noqa: E402
from skiros2_learning.core.prior_sampler import PriorSampler  # noqa: E402
from skiros2_learning.core.scenario import Scenario, load_scenario  # noqa: E402
from skiros2_learning.core.study import LearningStudy  # noqa: E402
from skiros2_learning.core.variables import Gaussian, Value  # noqa: E402
from skiros2_learning.core.workers import Runner  # noqa: E402
from skiros2_learning.local.insertion import default_configuration  # noqa: E402
from skiros2_sim.core import bullet  # noqa: E402
from skiros2_sim.core.scene_reader import load_scene  # noqa: E402
from skiros2_sim.core.world import World  # noqa: E402
from support import known_functions as known  # noqa: E402

Row = dict[str, Any]
SCENARIOS = ROOT / "skiros2_std_lib/demos/learning/scenarios"
#: Commands of PyBullet to motors.
_MOTORS = ("setJointMotorControlArray", "setJointMotorControl2")


def main(arguments: Sequence[str]) -> int:
    """Runs the program. Returns 0."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--short", action="store_true", help="few seeds and evaluations: a few minutes")
    parser.add_argument("--parts", default="optimisers,push,insertion,variations,speed", help="default: %(default)s")
    parser.add_argument("--only", default="", help="optimisers of the part `optimisers`, separated by |")
    parser.add_argument("--seeds", type=int, help="of that part; default: 10, --short 2; a third for slow ones")
    parser.add_argument("--json", type=Path, default=ROOT / "build/learning.json", help="where the figures go")
    options = parser.parse_args(arguments)
    optuna.logging.set_verbosity(optuna.logging.ERROR)
    parts: dict[str, Callable[[bool], list[Row]]] = {
        "optimisers": lambda short: optimisers(
            options.json.with_suffix(".jsonl"), options.seeds or (2 if short else 10), shown, options.only
        ),
        "push": lambda short: scenario_rows("push.yaml", 12 if short else 60, 1 if short else 5),
        "insertion": lambda short: scenario_rows("insertion.yaml", 8 if short else 30, 1 if short else 5),
        "variations": variations,
        "speed": speed,
    }
    found: dict[str, list[Row]] = {}
    for part in options.parts.split(","):
        print(f"\n{part}", flush=True)
        found[part] = parts[part](options.short)
        options.json.parent.mkdir(parents=True, exist_ok=True)
        options.json.write_text(json.dumps(found, indent=1))
    return 0


def shown(row: Row) -> Row:
    """Prints a row, and returns it."""
    print("  " + ", ".join(f"{k} {v:.4g}" if isinstance(v, float) else f"{k} {v}" for k, v in row.items()), flush=True)
    return row


# -- scenarios ---------------------------------------------------------------------------------------------------------


def scenario_rows(file: str, evaluations: int, seeds: int) -> list[Row]:
    """Success rate and hypervolume of optimisers on a scenario with two objectives: medians over seeds."""
    scenario = load_scenario(SCENARIOS / file)
    studies: dict[str, list[LearningStudy]] = {}
    with tempfile.TemporaryDirectory() as folder:
        for optimiser, name, priors in (
            ("random", "random", False),
            ("TPE", "tpe", False),
            ("NSGA-II", "nsga2", False),
            ("prior sampler, no prior", "prior", False),
            ("prior sampler, good prior", "prior", True),
        ):
            for seed in range(1, seeds + 1):
                changed = scenario.derived(
                    priors=priors, optimiser=name, seed=seed, evaluations=evaluations, initial=max(2, evaluations // 5)
                )
                study = LearningStudy.create(changed, Path(folder) / f"{name}_{priors}_{seed}")
                Runner(study, 2).run()
                studies.setdefault(optimiser, []).append(study)
        corner = _worst(scenario, [study for each in studies.values() for study in each])
        rows = [shown(_scenario_row(name, each, corner)) for name, each in studies.items()]
    if scenario.name == "insertion":
        usual = evaluate(scenario, default_configuration(scenario), seed_of(scenario, 0))
        rows.append(shown({"optimiser": "defaults of the skill", "success": usual.success_rate}))
    return rows


def _costs(study: LearningStudy) -> list[tuple[float, ...]]:
    """The objectives of all evaluations, to be minimised."""
    sense = [1.0 if objective.sense == "minimise" else -1.0 for objective in study.scenario.objectives]
    results = [result for result in study.results().values() if not result.error]
    return [tuple(s * v for s, v in zip(sense, r.objectives.values(), strict=True)) for r in results]


def _worst(scenario: Scenario, studies: Sequence[LearningStudy]) -> tuple[float, float]:
    costs = [cost for study in studies for cost in _costs(study)]
    return max(cost[0] for cost in costs), max(cost[1] for cost in costs)


def _scenario_row(optimiser: str, studies: Sequence[LearningStudy], corner: tuple[float, float]) -> Row:
    means, needed, areas = [], [], []
    for study in studies:
        rates = [result.success_rate for _, result in sorted(study.results().items())]
        means.append(statistics.fmean(rates))
        needed.append(next((number for number, rate in enumerate(rates, 1) if rate >= 0.95), len(rates) + 1))
        areas.append(known.dominated_area(_costs(study), corner))
    few = statistics.median(needed)
    return {
        "optimiser": optimiser,
        "evaluations": len(studies[0].results()),
        "mean success": statistics.median(means),
        "until 95 %": few if few <= len(studies[0].results()) else "-",
        "hypervolume": statistics.median(areas),
    }


# -- variations --------------------------------------------------------------------------------------------------------


def variations(short: bool) -> list[Row]:
    """Success of the push at goals that were not learned: with predicted parameters, and with the best ones of the
    nearest goal that was learned."""
    scenario = load_scenario(SCENARIOS / "push.yaml").derived(evaluations=10 if short else 30, initial=6)
    (feature,) = scenario.variations
    rates: dict[str, list[float]] = {"predicted": [], "of the nearest goal": []}
    with tempfile.TemporaryDirectory() as folder:
        studies = learn_variations(scenario, Path(folder), 2 if short else 4, lambda study: Runner(study, 2).run())
        policy = Policy(studies)
        for goal in (0.52, 0.56, 0.6, 0.64):
            unseen = {feature.name: goal}
            near = min(studies, key=lambda each: abs(each.scenario.variation[feature.name] - goal))
            count = 3 if short else 10
            plan = scenario.derived(variation=unseen, repetitions=count, max_failures=count)
            for name, chosen in (
                ("predicted", policy.predict(unseen).configuration),
                ("of the nearest goal", near.result(near.ranked()[0]).configuration),
            ):
                rates[name].append(evaluate(plan, chosen, seed_of(plan, 0)).success_rate)
    row = {"learned goals": len(studies), "evaluations of each": scenario.budget.evaluations, "unseen goals": 4}
    return [
        shown({**row, "parameters": name, "success": statistics.fmean(found), "worst": min(found)})
        for name, found in rates.items()
    ]


# -- speed -------------------------------------------------------------------------------------------------------------


def speed(short: bool) -> list[Row]:
    """Executions per second and core, beside the same motions in bare PyBullet; speed-up of two processes; the
    optimiser's own time."""
    scenario = load_scenario(SCENARIOS / "push.yaml").derived(repetitions=2 if short else 8)
    middle = {each.name: each.prior.mean for each in scenario.variables if isinstance(each.prior, Gaussian)}
    evaluate(scenario, middle, 1)  # reads the ontologies, which is done once per process
    begin = time.thread_time()
    result = evaluate(scenario, middle, 1)
    ours = time.thread_time() - begin
    count = len(result.repetitions)
    bare = min(_bare(scenario, middle) for _ in range(3)) * count
    rows = [shown({"executions per second and core": count / ours, "CPU time relative to bare PyBullet": ours / bare})]
    times = {}
    with tempfile.TemporaryDirectory() as folder:
        for workers in (1, 2):
            changed = scenario.derived(
                optimiser="random", evaluations=6 if short else 60, initial=2, repetitions=3, max_failures=3
            )
            study = LearningStudy.create(changed, Path(folder) / str(workers))
            begin = time.perf_counter()
            Runner(study, workers).run()
            times[workers] = time.perf_counter() - begin
    rows.append(shown({"speed-up of two processes": times[1] / times[2]}))
    study = optuna.create_study(sampler=PriorSampler(seed=1))
    asked: list[float] = []
    for _ in range(60 if short else 500):
        begin = time.thread_time()
        trial = study.ask()
        value = known.hartmann(trial)
        asked.append(time.thread_time() - begin)
        study.tell(trial, value)
    last = statistics.fmean(asked[-20:])
    part = last / (ours / count * 3)
    rows.append(shown({"evaluations before": len(asked), "sampler (s)": last, "part of an evaluation of 3": part}))
    return rows


def _bare(scenario: Scenario, configuration: dict[str, Value]) -> float:
    """CPU time (s) of one execution in bare PyBullet: the robot is loaded, and its motors get the same commands."""
    calls: list[tuple[Callable[..., Any], tuple[Any, ...], dict[str, Any]]] = []
    commands = {name: getattr(bullet.pybullet, name) for name in ("stepSimulation", *_MOTORS)}

    def recording(command: Callable[..., Any]) -> Callable[..., Any]:
        def record(*arguments: Any, **named: Any) -> Any:
            calls.append((command, arguments, {k: v for k, v in named.items() if k != "physicsClientId"}))
            return command(*arguments, **named)

        return record

    try:
        for name, command in commands.items():
            setattr(bullet.pybullet, name, recording(command))
        evaluate(scenario.derived(repetitions=1), configuration, 1)
    finally:
        for name, command in commands.items():
            setattr(bullet.pybullet, name, command)
    scene = load_scene(scenario.scene, scenario.scene.parent)
    begin = time.thread_time()
    with World(scene, rate=scenario.simulation.step_rate, visuals=False) as world:
        for command, arguments, named in calls:
            command(*arguments, **named, physicsClientId=world.physics.id)
    return time.thread_time() - begin


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
