"""The facts of plans as sentences for people."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from skiros2_common.core.names import local_name
from skiros2_common.core.wording import label_text
from skiros2_task.core.explain_plan import Link, WhyPlan
from skiros2_task.core.goal_sentence import NameOf, goal_sentence
from skiros2_task.core.preview import Preview, change_sentences

#: The names of steps, by number.
StepNames = Mapping[int, str]


def change_lines(preview: Preview, steps: StepNames, name_of: NameOf) -> Iterator[str]:
    """Yields the effects of each step of a simulated plan."""

    def name(eid: str) -> str:
        """Prefers the scene, which knows whether the label is unique; created elements are in the preview only."""
        label = preview.labels.get(eid, "")
        shown = name_of(eid)
        return label_text(label) if label and shown == local_name(eid) else shown

    for step in preview.steps:
        yield f"{step.number}. {steps.get(step.number, step.skill)}"
        yield from (f"     ✕ does not hold: {text}" for text in step.unsatisfied)
        yield from (f"     {text}" for text in change_sentences(step.changes, name))
        yield from (f"     assumed: {text}" for text in step.assumed)
    yield "The goal holds at the end." if preview.reached else "✕ The goal does not hold at the end."


def why_lines(why: WhyPlan, steps: StepNames, name_of: NameOf) -> Iterator[str]:
    """Yields the purpose of each step of a plan."""

    def source(link: Link) -> str:
        return f"by step {link.step}" if link.step else "from the start"

    for step in why.steps:
        yield f"{step.number}. {steps.get(step.number, step.call)}"
        for fact in dict.fromkeys(link.fact for link in step.serves):
            users = [f"step {link.step}" if link.step else "the goal" for link in step.serves if link.fact == fact]
            yield f"     so that {goal_sentence(fact, name_of)}, for {', '.join(users)}"
        if not step.serves:
            yield "     no step needs its effects"
        served = {link.fact for link in step.serves if not link.step}
        if reached := [goal_sentence(goal, name_of) for goal in step.goals if goal not in served]:
            yield f"     in the end for: {', '.join(reached)}"
        for link in step.needs:
            yield f"     needs: {goal_sentence(link.fact, name_of)}, {source(link)}"
    for goal in why.held:
        yield f"{goal_sentence(goal, name_of)}: holds already"
