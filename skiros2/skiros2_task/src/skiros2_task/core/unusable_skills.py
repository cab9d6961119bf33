"""Skills of robots that a task needs and planning cannot use."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from skiros2_task.core.actions import declared_effects, make_actions, why_unusable
from skiros2_task.core.conditions import FactFamilies
from skiros2_task.core.conditions import Literal as PredicateLiteral
from skiros2_task.core.formula import Kind, Predicate
from skiros2_task.core.no_plan_sentence import needs
from skiros2_task.core.skills import Skill
from skiros2_task.core.task import PlanningTask
from skiros2_task.core.world import WorldView


@dataclass(frozen=True)
class UnusableSkill:
    """A skill with effects that no plan can use.

    :param managers: the node names of its managers.
    :param reason: why it is unusable.
    :param effects: the task's literals that it would make true.
    :param obstacle: the reason as a phrase that follows the skill's name; "" if there is none.
    """

    name: str
    managers: tuple[str, ...]
    reason: str
    effects: frozenset[PredicateLiteral]
    obstacle: str = ""

    def __str__(self) -> str:
        return f"{self.name} of {', '.join(self.managers)}: {self.reason}"


#: Why a plan cannot use the effect of a hold-condition. It would need concurrency (Cushing, Kambhampati, Mausam, Weld:
#: When is temporal planning really temporal?, IJCAI 2007), but planners produce sequences.
_TEMPORARY = "this lasts only while it runs, and plans start no step during another one; a skill that runs both can"


def unusable_skills(world: WorldView, task: PlanningTask) -> list[UnusableSkill]:
    """Returns the robots' skills with effects that a task needs and cannot use.

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
        reasons: dict[str, list[PredicateLiteral]] = {}
        obstacles: dict[str, str] = {}
        if skill not in usable:
            reasons[why_unusable(skill)] = declared_effects(skill)
        else:
            reasons[_TEMPORARY] = [(e.atom.predicate, e.state) for e in usable[skill].during]
            empty = [v for v in usable[skill].variables if not world.members_of_all(v.classes)]
            if empty and skill not in in_task:
                wanted = ", ".join(f"{v.key or 'Robot'} ({' and '.join(v.classes)})" for v in empty)
                missing = f"the scene has no element for {wanted}"
                reasons[missing] = declared_effects(skill)
                obstacles[missing] = f"{' and '.join(map(needs, empty))}, but the scene has none"
        for reason, declared in reasons.items():
            effects = frozenset(_consequences(declared, predicates, families, world))
            if effects:
                found.append(UnusableSkill(skill.name, tuple(managers), reason, effects, obstacles.get(reason, "")))
    return found


def _consequences(
    effects: Iterable[PredicateLiteral], predicates: set[Predicate], families: FactFamilies, world: WorldView
) -> Iterator[PredicateLiteral]:
    for effect, state in effects:
        yield from families.consequences(effect, state, predicates)
        if effect.kind is Kind.RELATION and state:
            yield from ((p, True) for p in predicates if _is_subproperty(effect, p, world))


def _is_subproperty(effect: Predicate, predicate: Predicate, world: WorldView) -> bool:
    return predicate.kind is Kind.RELATION and world.is_subproperty(effect.name, predicate.name)
