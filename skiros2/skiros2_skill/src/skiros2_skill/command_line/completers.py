"""Completes the words of the commands of `rosrun skiros2_skill` with what a manager and its world model have."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from skiros2_common.command_line.completion import Typed
from skiros2_common.core.errors import UnknownName
from skiros2_skill.client.description import Parameter, Skill, find_skill
from skiros2_skill.command_line.queries import World

if TYPE_CHECKING:
    from skiros2_skill.client.manager import ManagerClient


def skill_names(manager: ManagerClient) -> Iterator[str]:
    """The labels of the skills; then their types without the default prefix."""
    skills = manager.read_skills()
    yield from (skill.label for skill in skills)
    yield from (skill.type.removeprefix("skiros:") for skill in skills)


def task_numbers(manager: ManagerClient) -> Iterator[str]:
    """The numbers of the tasks that have not ended."""
    yield from (str(nodes[0].id) for nodes in manager.read_tasks())


def step_words(manager: ManagerClient, typed: Typed, current: str) -> Iterator[str]:
    """The words of `run` and `preview`: skills, the keys of the last skill, and values for a key."""
    skills = manager.read_skills()
    key, sign, value = current.partition("=")
    last, given = _last_skill(typed.words, skills)
    if not sign:
        keys = dict.fromkeys(key for skill in last for key in skill.parameters if key not in ("Robot", *given))
        yield from (f"{key}=" for key in keys)
        yield from (skill.label for skill in skills)
        return
    declared = next((skill.parameters[key] for skill in last if key in skill.parameters), None)
    if declared is not None:
        yield from (f"{key}={text}" for text in _values(manager, declared, value))


def _last_skill(words: Sequence[str], skills: Sequence[Skill]) -> tuple[Sequence[Skill], set[str]]:
    """The implementations that the last name of a skill stands for, and the keys behind it."""
    last: Sequence[Skill] = ()
    given: set[str] = set()
    for word in words:
        key, sign, _ = word.partition("=")
        if sign:
            given.add(key)
            continue
        try:
            last, given = find_skill(word, skills).skills, set()
        except UnknownName:
            last = ()
    return last, given


def _values(manager: ManagerClient, declared: Parameter, begun: str) -> list[str]:
    """The values that a parameter may have: choices, or elements by label, or by id where no label begins so."""
    if declared.is_element:
        elements = World.of(manager).elements_for(declared)
        labels = [element.label for element in elements if element.label]
        unique = [label for label in labels if labels.count(label) == 1]
        found = [label for label in unique if label.startswith(begun)]
        return found or [element.id for element in elements]
    if declared.limits.choices:
        return [str(choice) for choice in declared.limits.choices]
    return ["true", "false"] if declared.type == "bool" else []
