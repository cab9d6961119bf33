"""The offered skills as a tree: robot, skill, implementations."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from skiros2_common.core.names import local_name
from skiros2_skill.client.description import Parameter, Skill


@dataclass(frozen=True)
class Offer:
    """A skill of a robot.

    :param manager: the node name of the robot's skill manager.
    :param type: the skill's class.
    :param label: of the implementation; "" lets the robot select one.
    :param implementations: the candidates, with their declared parameters.
    """

    manager: str
    type: str
    label: str
    implementations: tuple[Skill, ...]

    @property
    def key(self) -> tuple[str, str, str]:
        """Identifies the offer across updates."""
        return (self.manager, self.type, self.label)

    @property
    def name(self) -> str:
        """The displayed name."""
        return self.label or local_name(self.type)

    @property
    def parameters(self) -> dict[str, Parameter]:
        """The parameters of all implementations; the first declaration of a key counts."""
        found: dict[str, Parameter] = {}
        for implementation in self.implementations:
            for key, parameter in implementation.parameters.items():
                found.setdefault(key, parameter)
        return found


@dataclass(frozen=True)
class SkillRow:
    """A skill with its implementations.

    :param offer: the skill, or its only implementation.
    :param children: the implementations, if there are several.
    """

    offer: Offer
    children: tuple[Offer, ...] = ()


@dataclass(frozen=True)
class RobotRow:
    """A robot with its skills, in display order."""

    manager: str
    skills: tuple[SkillRow, ...]


def rows_of(offered: Mapping[str, Sequence[Skill]], search: str = "") -> tuple[RobotRow, ...]:
    """Returns the tree, skills sorted by name.

    :param offered: by the node names of the managers.
    :param search: words that must all occur in the names of a skill or of its parameters.
    """
    words = search.lower().split()
    rows = []
    for manager in sorted(offered):
        found = (_filtered(row, words) for row in _skill_rows(manager, offered[manager]))
        skills = [row for row in found if row is not None]
        skills.sort(key=lambda row: (row.offer.name.lower(), row.offer.key))
        if skills or not words:
            rows.append(RobotRow(manager, tuple(skills)))
    return tuple(rows)


def offers_of(rows: Iterable[RobotRow]) -> Iterator[Offer]:
    """Yields all offers of a tree."""
    for robot in rows:
        for row in robot.skills:
            yield row.offer
            yield from row.children


def _skill_rows(manager: str, skills: Sequence[Skill]) -> list[SkillRow]:
    by_type: dict[str, list[Skill]] = {}
    for skill in skills:
        by_type.setdefault(skill.type, []).append(skill)
    rows = []
    for stype, found in by_type.items():
        offers = tuple(Offer(manager, stype, skill.label, (skill,)) for skill in found)
        if len(offers) == 1:
            rows.append(SkillRow(offers[0]))
        else:
            rows.append(SkillRow(Offer(manager, stype, "", tuple(found)), offers))
    return rows


def _filtered(row: SkillRow, words: Sequence[str]) -> SkillRow | None:
    """Returns a row with the matching children; None if neither it nor a child matches."""
    if not words or _has(row.offer, words):
        return row
    children = tuple(offer for offer in row.children if _has(offer, words))
    return SkillRow(row.offer, children) if children else None


def _has(offer: Offer, words: Sequence[str]) -> bool:
    text = " ".join((offer.manager, offer.type, offer.label, *offer.parameters)).lower()
    return all(word in text for word in words)
