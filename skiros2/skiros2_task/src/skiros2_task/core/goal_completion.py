"""Completion of goals."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from heapq import nsmallest

from skiros2_common.core.names import local_name
from skiros2_common.core.world_element import Element
from skiros2_task.core.actions import ROBOT_KEY
from skiros2_task.core.goal_lines import quoted
from skiros2_task.core.goal_text import COMPARATORS, keywords
from skiros2_task.core.skills import SkillCondition
from skiros2_task.core.world import WorldView

RELATION, PROPERTY, VALUE, CLASS, ELEMENT, KEYWORD = "relation", "property", "value", "class", "element", "keyword"

#: The most completions.
MAX_COMPLETIONS = 60

_QUANTIFIERS = ("forall", "exists")
_TOKEN = re.compile(r'"[^"\n]*"?|[(),]|[^\s(),";]+')
_COMMENT = re.compile(r";[^\n]*")
_CHILD = "()"


@dataclass(frozen=True)
class Completion:
    """:param text: as written in the goal.
    :param label: as displayed; for an element its label.
    :param kind: one of the constants above.
    :param rank: lower ranks come first.
    """

    text: str
    label: str
    kind: str
    rank: int = 0

    @cached_property
    def names(self) -> str:
        """The lower-case texts it is found by, each after a newline."""
        return f"\n{self.label}\n{self.text}\n{local_name(self.text)}".lower().replace('"', "")

    def match(self, typed: str) -> int | None:
        """Returns how well it matches typed text, 0 best; None if it does not.

        :param typed: lower case, without quotes.
        """
        if f"\n{typed}" in self.names:
            return 0
        return 1 if typed in self.names else None


@dataclass(frozen=True)
class GoalVocabulary:
    """The names that goals may use."""

    predicates: tuple[Completion, ...] = ()
    properties: tuple[Completion, ...] = ()
    values: tuple[Completion, ...] = ()
    classes: tuple[Completion, ...] = ()  # those with elements first
    elements: tuple[Completion, ...] = ()  # those that an effect of a skill may concern first


@dataclass(frozen=True)
class Completions:
    """The completions at a cursor.

    :param start: the start of the typed word, which is replaced up to the cursor.
    """

    start: int
    items: tuple[Completion, ...] = ()


def read_goal_vocabulary(world: WorldView) -> GoalVocabulary:
    """Reads the names of a world. Predicates are ranked: effects of skills, conditions of skills, relations in the
    scene, all others. Elements are ranked: those that an effect of a skill may concern, all others.
    """
    effects, conditions = _in_skills(world)
    written = set(world.stated_relations())
    ranks = {**dict.fromkeys(written, 2), **dict.fromkeys(conditions, 1), **dict.fromkeys(effects, 0)}

    def rank(name: str) -> int:
        return ranks.get(name, 3)

    reachable = _in_effects(world)
    types = {element.type for element in world.objects.values()}

    def is_used(cls: str) -> bool:
        return any(world.is_subclass(etype, cls) for etype in types)

    relations = [Completion(name, local_name(name), RELATION, rank(name)) for name in world.relations()]
    known = world.properties() | _properties_in_skills(world)
    properties = [Completion(name, local_name(name), PROPERTY, rank(name)) for name in known]
    texts = sorted({value for _, value in world.texts()})
    return GoalVocabulary(
        _sorted([*relations, *properties]),
        _sorted(properties),
        tuple(Completion(quoted(text), text, VALUE) for text in texts),
        _sorted(Completion(name, local_name(name), CLASS, 0 if is_used(name) else 1) for name in world.classes()),
        _sorted(_element(e, 0 if name in reachable else 1) for name, e in world.objects.items()),
    )


def _in_effects(world: WorldView) -> set[str]:
    """Returns the objects that the effects of skills may concern, by the classes of their parameters."""
    found: set[str] = set()
    for robot in world.robots:
        for skill in robot.skills:
            keys = {key for effect in _parts(skill.post) for key in (effect.subject, effect.object)}
            classes = {p.element_class for key in keys if (p := skill.parameter(key)) and p.element_class}
            found.update(*map(world.members, classes), {robot.id} if ROBOT_KEY in keys else ())
    return found


def _properties_in_skills(world: WorldView) -> set[str]:
    return {
        c.name
        for robot in world.robots
        for skill in robot.skills
        for c in _parts((*skill.post, *skill.pre, *skill.hold))
        if c.kind in ("ConditionProperty", "ConditionHasProperty")
    }


def _in_skills(world: WorldView) -> tuple[set[str], set[str]]:
    """Returns the predicates in effects, and in conditions, of skills."""
    skills = [skill for robot in world.robots for skill in robot.skills]
    effects = {c.name for skill in skills for c in _parts(skill.post)}
    conditions = {c.name for skill in skills for c in _parts((*skill.pre, *skill.hold))}
    return effects - {""}, conditions - {""}


def _parts(conditions: Iterable[SkillCondition]) -> Iterable[SkillCondition]:
    for condition in conditions:
        yield condition
        yield from _parts(condition.parts)


def _sorted(completions: Iterable[Completion]) -> tuple[Completion, ...]:
    return tuple(sorted(completions, key=lambda w: (w.rank, not w.label, w.label.lower(), len(w.text), w.text)))


def _element(element: Element, rank: int) -> Completion:
    return Completion(quoted(element.id or element.label), element.label or element.id, ELEMENT, rank)


# -- completion ----------------------------------------------------------------------------------------------------


def complete(text: str, cursor: int, vocabulary: GoalVocabulary) -> Completions:
    """Returns the completions at a cursor.

    :param cursor: the number of characters before it.
    """
    before = _COMMENT.sub(lambda found: " " * len(found[0]), text[:cursor])
    tokens = [(m[0], m.start()) for m in _TOKEN.finditer(before)]
    typed, start = "", len(before)
    if tokens and tokens[-1][0] not in "()," and not before[-1:].isspace():
        typed, start = tokens.pop()
    stack, variables = _open_lists([token for token, _ in tokens])
    completions = _expected(stack, variables, vocabulary)
    typed = typed.lower().replace('"', "")
    if not typed:
        return Completions(start, tuple(sorted(completions, key=lambda completion: completion.rank)[:MAX_COMPLETIONS]))
    matches = ((c.match(typed), c.rank, i) for i, c in enumerate(completions))
    ranked = [(match, rank, i) for match, rank, i in matches if match is not None]
    return Completions(start, tuple(completions[i] for _, _, i in nsmallest(MAX_COMPLETIONS, ranked)))


def _open_lists(tokens: Iterable[str]) -> tuple[list[list[str]], list[str]]:
    """Returns the unclosed lists, outermost first, and the declared variables."""
    stack: list[list[str]] = []
    variables: list[str] = []
    for token in tokens:
        if token == "(":
            stack.append([])
        elif token == ")":
            if stack:
                stack.pop()
            if stack:
                stack[-1].append(_CHILD)
        elif stack:
            stack[-1].append(token)
            if token.startswith("?") and token not in variables and _declares(stack):
                variables.append(token)
    return stack, variables


def _declares(stack: list[list[str]]) -> bool:
    """Returns whether the innermost list declares the variables of a quantifier."""
    return len(stack) > 1 and len(stack[-2]) == 1 and stack[-2][0].lower() in _QUANTIFIERS


def _expected(stack: list[list[str]], variables: list[str], vocabulary: GoalVocabulary) -> list[Completion]:
    if not stack:
        return [Completion("(", "( a goal", KEYWORD)]
    inside = stack[-1]
    above = stack[-2] if len(stack) > 1 else []
    if _declares(stack):
        if inside and inside[-1] == "-":
            return list(vocabulary.classes)
        is_named = bool(inside) and inside[-1].startswith("?")
        return [Completion("-", "-  and a class", KEYWORD) if is_named else Completion("?x", "?x", KEYWORD)]
    if not inside:
        if above and above[0] in COMPARATORS:
            return list(vocabulary.properties)
        connectives = [Completion(word, word, KEYWORD, 3) for word in (*keywords(), *COMPARATORS)]
        return [*vocabulary.predicates, *connectives]
    head = inside[0].lower()
    if head in (*keywords(), *COMPARATORS):
        if head == "=" and inside[-1] == _CHILD:
            return list(vocabulary.values)
        return [Completion("(", "(", KEYWORD)]
    return [*(Completion(v, v, KEYWORD) for v in variables), *vocabulary.elements]
