"""Runs a known good push on real nodes, with a master of its own: python3 -m support.produce_push FOLDER."""

from __future__ import annotations

import sys
from pathlib import Path

import rospkg

from skiros2_learning.core.evaluation import Evaluation
from skiros2_learning.core.scenario import load_scenario
from skiros2_learning_demo.production import produce

GOOD = {"Push.StartX": -0.005, "Push.StartY": -0.07, "Push.GoalX": 0.01, "Push.GoalY": -0.045}

if __name__ == "__main__":
    push = load_scenario(Path(rospkg.RosPack().get_path("skiros2_learning_demo")) / "scenarios/push.yaml")
    result = Evaluation(dict(GOOD), 1, {"goal": 1.0, "force": 20.0}, {}, 1.0)
    findings = produce(push, 3, result, Path("/studies/push"), Path(sys.argv[1]))
    for finding in findings:
        print("yes" if finding.holds else "NO", finding.text)
    sys.exit(0 if all(finding.holds for finding in findings) else 1)
