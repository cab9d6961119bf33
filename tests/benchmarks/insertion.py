"""Insertions in physics, in this process and without ROS: a grid of errors of the estimated pose, clearances, bores and
arms. Each run is judged by the simulator's truth.

A program of its own: `make bench-insertion`, or `.venv/bin/python3 tests/benchmarks/insertion.py --runs 60`. The grid
is run in a random order, seed by seed: a part of it is a fair sample.
"""

from __future__ import annotations

import argparse
import itertools
import json
import math
import statistics
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from random import Random

ROOT = Path(__file__).resolve().parents[2]

sys.path.insert(0, str(ROOT / "tests"))
from support.packages import source_folders  # noqa: E402 - after the path

sys.path[:0] = [str(folder) for folder in source_folders()]

from skiros2_learning.local.insertion_study import BORES, InsertionStudy  # noqa: E402 - after the path
from support.insertion_cells import ARMS, write_cell  # noqa: E402

#: Limit of the force of the skills (N), and the factor up to which it may be exceeded.
LIMIT, OVERSHOOT = 40.0, 1.2


@dataclass(frozen=True)
class Case:
    """A run of the grid.

    :param error: of the estimated position of the bore (mm).
    :param angle: of its axis (degrees).
    :param clearance: difference of the diameters (mm).
    """

    error: float
    angle: float
    clearance: float
    bore: str
    arm: str
    seed: int


@dataclass(frozen=True)
class Result:
    """What a run has measured.

    :param success: the task reports success, and the part is as deep as wanted.
    :param reported: the task reports success.
    :param depth: true depth of the part (mm).
    :param max_force: at the wrist (N).
    :param time: simulated (s).
    :param wall: time of the computer (s).
    """

    case: Case
    success: bool
    reported: bool
    depth: float
    max_force: float
    time: float
    wall: float
    why: str


def main(arguments: Sequence[str]) -> int:
    """Runs the program. Returns 0."""
    options = _parser().parse_args(arguments)
    cases = grid(options)[: options.runs]
    print(f"{len(cases)} of {len(grid(options))} runs")
    results: list[Result] = []
    began = time.monotonic()
    for case in cases:
        if options.minutes and time.monotonic() - began > 60.0 * options.minutes:
            break
        results.append(run(case, options.skill))
        if not results[-1].success or results[-1].max_force > LIMIT * OVERSHOOT:
            print(f"  {results[-1].max_force:.1f} N  {case}: {results[-1].why}", flush=True)
    for line in tables(results):
        print(line)
    options.json.parent.mkdir(parents=True, exist_ok=True)
    options.json.write_text(json.dumps([asdict(result) for result in results], indent=1))
    return 0


def grid(options: argparse.Namespace) -> list[Case]:
    """Returns all runs, in their order."""
    axes = options.errors, options.angles, options.clearances, options.bores, options.arms
    found: list[Case] = []
    for seed in options.seeds:
        cases = [Case(*values, seed) for values in itertools.product(*axes)]
        Random(seed).shuffle(cases)
        found += cases
    return found


def run(case: Case, skill: str = "insert_into_bore") -> Result:
    """Runs one insertion."""
    began = time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        scene = write_cell(Path(folder) / "cell", case.arm, case.clearance / 1000.0)
        with InsertionStudy(scene, bore=case.bore) as study:
            got = study.run(case.seed, case.error / 1000.0, math.radians(case.angle), skill)
    why = " / ".join(got.why.splitlines()[:2]) or ("" if got.success else f"{1000.0 * got.depth:.1f} mm deep")
    wall = time.monotonic() - began
    return Result(case, got.success, got.reported, 1000.0 * got.depth, got.max_force, got.time, wall, why)


def tables(results: Sequence[Result]) -> list[str]:
    """Returns the figures by error, clearance, bore and arm, and of all runs."""
    groups: list[tuple[str, Callable[[Case], object]]] = [
        ("error", lambda case: f"{case.error:g} mm, {case.angle:g} deg"),
        ("clearance", lambda case: f"{case.clearance:g} mm"),
        ("bore", lambda case: case.bore),
        ("arm", lambda case: case.arm),
        ("all", lambda case: ""),
    ]
    lines = [f"{'':<26}success  false  max force  above {LIMIT * OVERSHOOT:g} N  mean time  x real time"]
    for name, key in groups:
        for value in sorted({str(key(result.case)) for result in results}):
            rows = [result for result in results if str(key(result.case)) == value]
            false = sum(row.reported and not row.success for row in rows)
            above = sum(row.max_force > LIMIT * OVERSHOOT for row in rows)
            lines.append(
                f"{name:<10}{value:<16}{sum(row.success for row in rows):>3}/{len(rows):<3}  {false:>5}"
                f"  {max(row.max_force for row in rows):>7.1f} N  {above:>12}"
                f"  {statistics.fmean(row.time for row in rows):>7.1f} s"
                f"  {sum(row.time for row in rows) / sum(row.wall for row in rows):>11.2f}"
            )
    return lines


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--errors", type=float, nargs="+", default=[1.0, 2.0, 3.0], help="mm (%(default)s)")
    parser.add_argument("--angles", type=float, nargs="+", default=[0.0, 1.0, 2.0], help="degrees (%(default)s)")
    parser.add_argument("--clearances", type=float, nargs="+", default=[0.05, 0.1, 0.2], help="mm (%(default)s)")
    parser.add_argument("--bores", nargs="+", default=list(BORES[:3]), help="ids (%(default)s)")
    parser.add_argument("--arms", nargs="+", choices=ARMS, default=list(ARMS), help="(%(default)s)")
    parser.add_argument("--seeds", type=int, nargs="+", default=list(range(1, 11)), help="(%(default)s)")
    parser.add_argument("--runs", type=int, help="the first ones only")
    parser.add_argument("--minutes", type=float, help="starts no run after them")
    parser.add_argument("--skill", default="insert_into_bore", help="or insert_blindly, to compare")
    parser.add_argument("--json", type=Path, default=ROOT / "build/insertion.json", help="where the runs go")
    return parser


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
