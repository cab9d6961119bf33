"""The skill my_skill in one process, without nodes."""

from skiros2_common.core.abstract_skill import State


def test_skill_takes_its_ticks(skill_bench):
    skill_bench.import_libraries("my_skills")
    task = skill_bench.command("MySkill", Times=2)
    assert task.tick() is State.Running
    assert task.tick() is State.Success


def test_skill_can_be_stopped(skill_bench):
    skill_bench.import_libraries("my_skills")
    task = skill_bench.command("MySkill", Times=100)
    task.tick()
    task.preempt()
    assert task.run().state is State.Failure
