"""Skills that could help with a goal but are not part of its planning task."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from skiros2_task.core.actions import declared_effects, make_actions, why_unusable
from skiros2_task.core.effects import FactFamilies, Literal
from skiros2_task.core.formula import Kind, Predicate
from skiros2_task.core.skills import Skill
from skiros2_task.core.task import PlanningTask
from skiros2_task.core.world import WorldView


@dataclass(frozen=True)
class UnusableSkill:
    """A skill that no plan can contain.

    :param managers: the node names of its managers.
    :param reason: why it is unusable.
    :param effects: the task's literals that it would make true.
    """

    name: str
    managers: tuple[str, ...]
    reason: str
    effects: frozenset[Literal]

    def __str__(self) -> str:
        return f"{self.name} of {', '.join(self.managers)}: {self.reason}"


def unusable_skills(world: WorldView, task: PlanningTask) -> list[UnusableSkill]:
    """Returns the robots' skills that are not in a task, but have effects that it needs.

    :param world: the snapshot that the task was compiled from.
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
        effects = frozenset(_consequences(declared_effects(skill), predicates, families, world))
        if skill in usable:
            empty = [v for v in usable[skill].variables if not _candidates(v.classes, world)]
            wanted = ", ".join(f"{v.key or 'Robot'} ({' and '.join(v.classes)})" for v in empty)
            reason = f"the scene has no element for {wanted}" if empty else ""
        else:
            reason = why_unusable(skill)
        if effects and reason:
            found.append(UnusableSkill(skill.name, tuple(managers), reason, effects))
    return found


def _candidates(classes: Iterable[str], world: WorldView) -> set[str]:
    return set.intersection(*(set(world.members(cls)) for cls in classes))


def _consequences(
    effects: Iterable[Literal], predicates: set[Predicate], families: FactFamilies, world: WorldView
) -> Iterator[Literal]:
    for effect, state in effects:
        yield from families.consequences(effect, state, predicates)
        if effect.kind is Kind.RELATION and state:
            yield from ((p, True) for p in predicates if _is_subproperty(effect, p, world))


def _is_subproperty(effect: Predicate, predicate: Predicate, world: WorldView) -> bool:
    return predicate.kind is Kind.RELATION and world.is_subproperty(effect.name, predicate.name)
