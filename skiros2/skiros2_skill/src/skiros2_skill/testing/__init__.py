"""Runs skills in one process, tick by tick, with a scene, a fake clock, stand-ins for children and injected failures.

For tests of skills. With pytest, name the package in the top `conftest.py` to get its fixtures:

    pytest_plugins = ["skiros2_skill.testing"]

    def test_it_opens_the_gripper(skill_bench):
        gripper = skill_bench.add("rparts:GripperEffector", "gripper")
        skill_bench.load(open_gripper)
        task = skill_bench.command("Open").run()
        assert task.state is State.Success, task.why
        assert skill_bench.element("gripper").hasProperty("skiros:Open", True)

`SkillBench` works without pytest. Without a given world model it creates one, which needs rdflib.
"""

from skiros2_skill.testing.bench import SkillBench
from skiros2_skill.testing.bench_task import BenchTask, Trace
from skiros2_skill.testing.fake_clock import FakeClock
from skiros2_skill.testing.faults import inject, refusing
from skiros2_skill.testing.stand_in import Script, describe, stand_in

__all__ = [
    "BenchTask",
    "FakeClock",
    "Script",
    "SkillBench",
    "Trace",
    "describe",
    "inject",
    "refusing",
    "stand_in",
]

#: Only pytest loads the fixtures.
pytest_plugins = ["skiros2_skill.testing.fixtures"]
