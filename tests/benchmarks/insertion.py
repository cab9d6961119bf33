"""Insertions of the piston in physics, in this process and without ROS: success, force, time and speed by error.

A program of its own: `make bench-insertion`, or `.venv/bin/python3 tests/benchmarks/insertion.py --runs 20`.
"""

from __future__ import annotations

import argparse
import json
import math
import statistics
import sys
import time
from collections.abc import Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]

import tomllib  # noqa: E402

folders = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["pytest"]["ini_options"]["pythonpath"]
sys.path[:0] = [str(ROOT / folder) for folder in folders]

from skiros2_learning.local.insertion_study import InsertionRun, InsertionStudy  # noqa: E402 - after the path

#: Errors of the estimated pose (mm, degrees).
POSITIONS, ANGLES = (0.0, 1.0, 2.0, 3.0), (0.0, 1.0, 2.0)
#: Of the blind insertion (mm).
BLIND = (0.0, 0.5, 1.0, 2.0, 3.0)


def main(arguments: Sequence[str]) -> int:
    """Runs the program. Returns 0."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=20, help="per cell (%(default)s)")
    parser.add_argument("--json", type=Path, default=ROOT / "build/insertion.json", help="where the figures go")
    options = parser.parse_args(arguments)
    cells = []
    print("skill             mm   deg  success      depth   force max  time mean  x real time")
    with InsertionStudy() as study:
        wanted = [("insert_into_bore", far, turn) for turn in ANGLES for far in POSITIONS]
        for skill, far, turn in [*wanted, *(("insert_blindly", far, 0.0) for far in BLIND)]:
            began = time.perf_counter()
            runs = [study.run(seed, far / 1000.0, math.radians(turn), skill) for seed in range(1, options.runs + 1)]
            cell = summary(skill, far, turn, runs, time.perf_counter() - began)
            cells.append(cell)
            print(
                f"{skill:<16} {far:>3g}  {turn:>4g}  {cell['success']:>3}/{len(runs):<3}  {cell['depth']:>6.1f} mm"
                f"  {cell['max_force']:>6.1f} N  {cell['time']:>6.1f} s  {cell['real_time_factor']:>8.2f}",
                flush=True,
            )
    options.json.parent.mkdir(parents=True, exist_ok=True)
    options.json.write_text(json.dumps(cells, indent=1))
    return 0


def summary(skill: str, far: float, turn: float, runs: Sequence[InsertionRun], seconds: float) -> dict[str, object]:
    """Returns the figures of a cell."""
    return {
        "skill": skill,
        "position_error_mm": far,
        "angle_error_deg": turn,
        "runs": len(runs),
        "success": sum(run.success for run in runs),
        "depth": 1000.0 * statistics.median(run.depth for run in runs),
        "max_force": max(run.max_force for run in runs),
        "time": statistics.fmean(run.time for run in runs),
        "real_time_factor": sum(run.time for run in runs) / seconds,
        "failures": [f"seed {seed}: {run.why.splitlines()[:2]}" for seed, run in enumerate(runs, 1) if not run.success],
    }


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
