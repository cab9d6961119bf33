"""Progress messages of tasks. Compatibility, section 14."""

from __future__ import annotations

from compatibility.rules import rule
from skiros2_common.core.abstract_skill import SkillDescription, State
from skiros2_common.core.primitive import PrimitiveBase
from skiros2_skill.core.skill import ParallelFf, SkillBase


class Step(SkillDescription):
    pass


class step(PrimitiveBase):
    def createDescription(self):
        self.setDescription(Step(), "step")

    def execute(self):
        return self.success("done")


class Job(SkillDescription):
    pass


class job(SkillBase):
    def createDescription(self):
        self.setDescription(Job(), "job")

    def expand(self, skill):
        skill(self.skill(ParallelFf())(self.skill("Step", ""), self.skill("Step", "step")))


def run(bench):
    """The reported nodes of a task that has run `job`: root, compound, group, and two steps."""
    bench.load(step, job)
    task = bench.command("Job").run()
    assert task.state is State.Success
    return task.progress()


@rule("description", "The root of a task has the type `:Root` and the label `task_<id>`; at success code 1 and `End`")
def test_root_is_labelled_by_its_task_and_ends_with_End(skill_bench):
    root = run(skill_bench)[0]
    assert (root.type, root.label, root.progress_code, root.progress_message) == (":Root", f"task_{root.id}", 1, "End")


@rule("description", "A compound that succeeds has the progress code 1 and the message `End`")
def test_compound_reports_End(skill_bench):
    compound = run(skill_bench)[1]
    assert (compound.label, compound.progress_code, compound.progress_message) == ("job", 1, "End")


@rule("description", "A node that only groups others has the type `:Skill` and its processor's symbol as label")
def test_group_is_labelled_by_its_processor(skill_bench):
    group = run(skill_bench)[2]
    assert (group.type, group.label, group.processor) == (":Skill", "|ff|", "|ff|")
