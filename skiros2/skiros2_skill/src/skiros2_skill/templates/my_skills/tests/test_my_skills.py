"""The skills in one process, without nodes: python3 -m pytest tests"""

from pathlib import Path

import pytest

from skiros2_common.core.abstract_skill import State
from skiros2_skill.testing import SkillBench
from skiros2_task.testing import plan

SCENE = Path(__file__).parents[1] / "owl" / "scene.ttl"


@pytest.fixture
def bench(fake_clock):
    with SkillBench(SCENE, clock=fake_clock) as made:
        yield made.import_libraries("my_skills", "skiros2_std_skills")


def test_inspection_needs_the_robot_at_the_object(bench):
    task = bench.command("Inspect", Object=bench.element("Bolt 1")).run()
    assert task.state is State.Failure
    assert "RobotAtLocation" in task.why


def test_robot_drives_and_inspects(bench):
    bolt = bench.element("Bolt 1")
    task = bench.commands(
        ("Drive", "", {"TargetLocation": bench.element("Shelf A")}), ("Inspect", "", {"Object": bolt})
    ).run()
    assert task.state is State.Success, task.why
    assert bench.element("Bolt 1").value_of("my_skills:Inspected") is True
    assert bench.related("my_skills:my_robot", "skiros:at") == ["Shelf A"]


def test_goal_is_planned(bench):
    goal = ", ".join(f"(my_skills:Inspected {bench.element(name).id})" for name in ("Bolt 1", "Bolt 2"))
    steps = plan(bench, goal, ["drive", "inspect"])
    assert [step.label for step in steps] == ["drive", "inspect", "drive", "inspect"]
