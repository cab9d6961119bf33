"""The skills that planning for a goal cannot use, with what they would bring about."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from skiros2_task.core.actions import declared_effects, make_actions, why_unusable
from skiros2_task.core.effects import FactFamilies, Literal
from skiros2_task.core.formula import Kind, Predicate
from skiros2_task.core.skill_model import Skill
from skiros2_task.core.task import PlanningTask
from skiros2_task.core.world_view import WorldView


@dataclass(frozen=True)
class LeftOut:
    """A skill that no plan can have.

    :param managers: the node names of those that offer it.
    :param reason: in words.
    :param makes: those of the task's literals that it would bring about.
    """

    name: str
    managers: tuple[str, ...]
    reason: str
    makes: frozenset[Literal]

    def __str__(self) -> str:
        return f"{self.name} of {', '.join(self.managers)}: {self.reason}"


def skills_left_out(world: WorldView, task: PlanningTask) -> list[LeftOut]:
    """The robots' skills that cannot run, or that planning cannot read, and would help with a task if they could.

    :param world: as the task was made from it.
    """
    predicates = {p for p in task.predicates if p.kind is not Kind.CAN}
    families = FactFamilies((), world.is_subproperty)
    owners: dict[Skill, list[str]] = {}
    for robot in world.robots:
        for skill in robot.skills:
            owners.setdefault(skill, []).append(robot.manager)
    usable = {action.skill: action for action in make_actions(world.robots)[0]}
    in_task = {action.skill for action in task.actions}
    found = []
    for skill, managers in owners.items():
        if skill in in_task:
            continue
        makes = frozenset(_made(declared_effects(skill), predicates, families, world))
        if skill in usable:
            empty = [v for v in usable[skill].variables if not _candidates(v.classes, world)]
            wanted = ", ".join(f"{v.key or 'Robot'} ({' and '.join(v.classes)})" for v in empty)
            reason = f"the scene has nothing for {wanted}" if empty else ""
        else:
            reason = why_unusable(skill)
        if makes and reason:
            found.append(LeftOut(skill.name, tuple(managers), reason, makes))
    return found


def _candidates(classes: Iterable[str], world: WorldView) -> set[str]:
    return set.intersection(*(set(world.members(cls)) for cls in classes))


def _made(
    effects: Iterable[Literal], predicates: set[Predicate], families: FactFamilies, world: WorldView
) -> Iterator[Literal]:
    for effect, state in effects:
        yield from families.consequences(effect, state, predicates)
        if effect.kind is Kind.RELATION and state:
            yield from ((p, True) for p in predicates if _is_under(effect, p, world))


def _is_under(effect: Predicate, predicate: Predicate, world: WorldView) -> bool:
    return predicate.kind is Kind.RELATION and world.is_subproperty(effect.name, predicate.name)
