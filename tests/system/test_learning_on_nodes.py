"""A scenario with `platform: real` on running nodes, those of the simulator."""

from __future__ import annotations

import json
import math
import subprocess
from pathlib import Path
from typing import Any

import pytest
import yaml

from skiros2_common.core.world_element import Element
from skiros2_msgs.srv import ResourceGetDescriptions
from skiros2_sim_msgs.srv import GetPose
from skiros2_world_model.ros.world_model_interface import WorldModelInterface
from support.ros import ROOT, Ros

pytestmark = [pytest.mark.long, pytest.mark.timeout(240)]

GOAL = (0.58, 0.2)
LIBRARIES = ["skiros2_std_skills", "skiros2_sim_skills", "skiros2_learning.demo_skills", "support.reset_skills"]
#: Near values that bring the block to the goal.
VARIABLES = {
    "Push.StartX": {"range": [-0.006, -0.004], "unit": "m"},
    "Push.StartY": {"range": [-0.071, -0.069], "unit": "m"},
    "Push.GoalX": {"range": [0.009, 0.011], "unit": "m"},
    "Push.GoalY": {"range": [-0.046, -0.044], "unit": "m"},
}
SCENARIO: dict[str, Any] = {
    "scenario": "real_push",
    "platform": "real",
    "real": {
        "reset": [
            {"skill": "MoveArmJoints", "parameters": {"Arm": "Arm", "Posture": "home"}},
            {"skill": "PutBack", "parameters": {"Object": "Block"}},
        ],
        "signals": {"Arm.force": "Wrist force"},
    },
    "task": [{"skill": "Push", "parameters": {"Object": "Block", "Goal": "Goal"}}],
    "variables": VARIABLES,
    "objectives": {
        "force": {"sense": "minimise", "rewards": [{"reward": "applied_force", "arm": "Arm"}]},
        "arrival": {"rewards": [{"reward": "relation", "subject": "Block", "relation": "skiros:at", "object": "Goal"}]},
        "near": {"sense": "minimise", "rewards": [{"reward": "distance", "object": "Gripper", "goal": "Goal"}]},
    },
    "simulation": {"time_limit": 60},
    "budget": {"evaluations": 2, "initial": 2},
    "repetitions": 1,
    "validation": {"candidates": 1, "repetitions": 2},
}


class Cell:
    """The nodes of the push, and the program `learn`."""

    def __init__(self, ros: Ros, folder: Path) -> None:
        self.ros, self.folder = ros, folder
        env = {**ros.master.env, "PYTHONPATH": f"{ROOT / 'tests'}:{ros.master.env['PYTHONPATH']}"}
        ros.launch("skiros2_learning", "push.launch", env=env, gui=False, rate=2.0, libraries_list=LIBRARIES)
        ros.service("/pusher/get_skills", ResourceGetDescriptions, 60.0)()
        self.pose = ros.service("/sim/get_pose", GetPose)
        self.wmi = WorldModelInterface("tests")
        self.block, self.arm = (self.wmi.resolve_elements(Element("", name))[0] for name in ("Block", "Arm"))
        signal = Element("skiros:Signal", "Wrist force")
        for key, value in (("SignalTopic", "/pusher/arm/wrench"), ("MessageField", "wrench.force"), ("Unit", "N")):
            signal.setProperty(f"skiros:{key}", value)
        signal.addRelation(self.arm.id, "skiros:hasA", "-1")
        self.wmi.add_element(signal)

    @property
    def distance(self) -> float:
        """Of the block from the goal (m)."""
        position = self.pose(element=self.block.id).pose.pose.position
        return math.hypot(position.x - GOAL[0], position.y - GOAL[1])

    def learn(self, *arguments: str, answers: str = "") -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            ["rosrun", "skiros2_learning", "learn", *arguments], env=self.ros.master.env, input=answers,
            capture_output=True, text=True, timeout=180, check=False,
        )  # fmt: skip


def test_executions_are_confirmed_and_judged_by_signals_and_the_world_model(ros: Ros, tmp_path: Path) -> None:
    cell = Cell(ros, tmp_path)
    file, study = tmp_path / "real.yaml", str(tmp_path / "study")
    file.write_text(yaml.safe_dump(SCENARIO))

    refused = cell.learn("run", str(file), "--study", study)
    assert refused.returncode == 1
    assert refused.stderr == "learn: each execution needs the operator's confirmation at a terminal, or --yes\n"

    ended = cell.learn("resume", study, answers="what\nn\ny\ny\ny\n")
    assert ended.returncode == 0, ended.stderr
    assert "execution 1 of 1 with Push.GoalX=0." in ended.stdout
    assert "execution 2 of 2 with Push.GoalX=0." in ended.stdout
    assert "success 2 of 2, 95 % interval 34 to 100 %" in ended.stdout
    results = json.loads(cell.learn("status", study, "--json").stdout)["results"]
    declined, done = results.values()
    assert declined["error"] == "repetition 0: the operator has not confirmed"
    assert done["error"] == ""
    assert done["success_rate"] == 1.0, done["repetitions"]
    assert done["objectives"]["force"] > 1.0
    assert done["objectives"]["arrival"] == 1.0
    assert done["objectives"]["near"] < 0.25
    assert cell.distance < 0.03

    wrong = {"signals": {"Arm.force": "Wrist farce"}, "reset": [{"skill": "PutBack", "parameters": {"Object": "Blok"}}]}
    (tmp_path / "bad.yaml").write_text(yaml.safe_dump({**SCENARIO, "real": wrong}))
    bad = cell.learn("run", str(tmp_path / "bad.yaml"), "--study", str(tmp_path / "bad"), "--yes")
    assert bad.stderr.startswith("learn: scenario real_push: no element is labelled 'Blok'; near: Block; ")
    assert bad.stderr.endswith("; no element is labelled 'Wrist farce'; near: Wrist force\n")
