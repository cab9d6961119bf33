"""The choices for the lines of a goal: the elements, predicates and values that the ontologies allow, for people.

The window and the gateway's page show these choices; neither has rules of its own.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace
from functools import cached_property

from skiros2_common.core.limits import NO_LIMITS, Limits
from skiros2_common.core.names import local_name
from skiros2_common.core.wording import label_text, verb, words
from skiros2_task.core.goal_completion import PROPERTY, Completion, GoalVocabulary
from skiros2_task.core.goal_lines import EVERY, HOLDS, OPERATORS, SOME, Line, Term
from skiros2_task.core.goal_values import TRUTHS, value_problem
from skiros2_task.core.world import WorldView
from skiros2_world_model.core.vocabulary import Vocabulary

_QUANTIFIER_TIPS = {EVERY: "each element", SOME: "at least one element"}


@dataclass(frozen=True)
class Choice:
    """An entry of a list.

    :param term: an element or a quantified class; for a predicate, its name.
    :param text: as displayed.
    :param tip: the full name.
    :param is_faint: whether no skill can change it.
    """

    term: Term
    text: str
    tip: str
    is_faint: bool = False


@dataclass(frozen=True)
class ValueField:
    """How a value is entered.

    :param type: `bool`, `int`, `float` or `str`.
    :param options: the texts of the allowed values; (): any.
    :param known: texts in the scene, if any text is allowed.
    """

    type: type
    limits: Limits = NO_LIMITS
    options: tuple[str, ...] = ()
    known: tuple[str, ...] = ()

    @property
    def is_number(self) -> bool:
        """Whether it is a number without enumerated values."""
        return self.type in (int, float) and not self.options

    @property
    def operators(self) -> tuple[str, ...]:
        """The operators that make sense; the first is the default."""
        if self.type is bool:
            return ("=",)
        return OPERATORS if self.type in (int, float) else ("=", HOLDS)


class GoalChoices:
    """The choices in a snapshot of the world. Immutable; any thread. By default there are none.

    :param names: of the world.
    :param ontology: the vocabulary of the ontologies.
    """

    def __init__(self, world: WorldView, names: GoalVocabulary, ontology: Vocabulary) -> None:
        self._names = names
        self._ontology = ontology
        self._types = {name: element.type for name, element in world.objects.items()}
        self._booleans = frozenset(world.boolean_properties())
        self._texts: dict[str, list[str]] = {}
        for key, text in sorted(world.texts()):
            self._texts.setdefault(key, []).append(text)
        self._number_types = {
            prop.key: prop.dataType()
            for element in world.objects.values()
            for prop in element.properties
            if prop.dataType() in (int, float)
        }

    # -- names -------------------------------------------------------------------------------------------------

    @cached_property
    def _predicates(self) -> dict[str, Completion]:
        """The predicates by full and by local name, in lower case."""
        predicates = self._names.predicates
        short = {predicate.label.lower(): predicate for predicate in reversed(predicates)}
        return {**short, **{predicate.text.lower(): predicate for predicate in predicates}}

    @cached_property
    def _ids(self) -> dict[str, list[str]]:
        """The elements by id and by label, in lower case."""
        found: dict[str, list[str]] = {}
        for element in self._names.elements:
            found.setdefault(element.label.lower(), []).append(_id(element))
        return {**found, **{_id(element).lower(): [_id(element)] for element in self._names.elements}}

    def predicate(self, name: str) -> Completion | None:
        """Returns a predicate, by its name with or without prefix; None if the world has none of that name."""
        return self._predicates.get(name.lower())

    def id_of(self, name: str) -> str:
        """Returns the id of an element by its id or label; "" if none, or several, have it."""
        found = self._ids.get(name.lower(), [])
        return found[0] if len(found) == 1 else ""

    def name_of(self, name: str) -> str:
        """Returns an element for people, by its id or label."""
        known = self._shown.get(self.id_of(name))
        return known or label_text(local_name(name))

    @cached_property
    def _shown(self) -> dict[str, str]:
        return {choice.term.name: choice.text for choice in self._terms if not choice.term.quantifier}

    def _full_name(self, name: str) -> str:
        known = self.predicate(name)
        return known.text if known is not None else name

    # -- choices -----------------------------------------------------------------------------------------------

    def predicates(self, subject: Term) -> tuple[Choice, ...]:
        """Returns the relations and properties; those that a subject may have come first."""
        found = self._all_predicates
        fitting = [choice for choice in found if self._fits(subject, choice.term.name, "subject")]
        if len(fitting) == len(found):
            return found
        kept = set(fitting)
        return (*fitting, *(replace(choice, is_faint=True) for choice in found if choice not in kept))

    @cached_property
    def _all_predicates(self) -> tuple[Choice, ...]:
        labels = Counter(predicate.label for predicate in self._names.predicates)
        found = []
        for predicate in self._names.predicates:
            text = predicate_text(predicate)
            text = text if labels[predicate.label] == 1 else f"{text}  ({predicate.text})"
            tip = f"{predicate.kind} {predicate.text}\n{self._ontology.description(predicate.text)}".rstrip()
            found.append(Choice(Term(predicate.text), text, tip, predicate.rank > 0))
        return tuple(found)

    def subjects(self, predicate: str) -> tuple[Choice, ...]:
        """Returns the elements and classes in the domain of a predicate; "": all."""
        return tuple(choice for choice in self._terms if self._fits(choice.term, predicate, "subject"))

    def objects(self, relation: str) -> tuple[Choice, ...]:
        """Returns the elements and classes in the range of a relation; "": all."""
        return tuple(choice for choice in self._terms if self._fits(choice.term, relation, "object"))

    @cached_property
    def _terms(self) -> tuple[Choice, ...]:
        """Elements that skills can change, quantified classes, other elements."""
        labels = Counter(element.label for element in self._names.elements)
        elements = [_element(element, labels) for element in self._names.elements]
        used = [cls for cls in self._names.classes if cls.rank == 0]
        quantified = [
            Choice(Term(cls.text, quantifier), f"{quantifier} {words(cls.label)}", f"{tip} of {cls.text}")
            for quantifier, tip in _QUANTIFIER_TIPS.items()
            for cls in used
        ]
        changing = [choice for choice in elements if not choice.is_faint]
        return (*changing, *quantified, *elements[len(changing) :])

    def field(self, line: Line) -> ValueField:
        """Returns how the value of a line is entered."""
        key, etype = self._full_name(line.predicate), self._type_of(line.subject)
        limits, texts = self._ontology.limits(key), self._texts.get(key, [])
        current = bool if key in self._booleans else self._number_types.get(key, str if texts else None)
        found = self._ontology.value_type(etype, key, current)
        if found is bool:
            return ValueField(bool, limits, TRUTHS)
        if limits.choices:
            return ValueField(found, limits, tuple(map(str, limits.choices)))
        return ValueField(found if found in (int, float) else str, limits, known=tuple(texts))

    # -- editing -----------------------------------------------------------------------------------------------

    def normal(self, line: Line) -> Line:
        """Returns a line as editors show it: `(Open box)` as "open of box = true"."""
        if line.operator == HOLDS and self.field(line).type is bool:
            return replace(line, operator="=", value=TRUTHS[0])
        if line.operator and isinstance(line.value, str) and self.field(line).type is bool:
            return replace(line, value=line.value.lower())
        return line

    def with_predicate(self, line: Line, name: str) -> Line:
        """Returns a line with another predicate, without what does not fit it: subject, object, operator, value."""
        predicate = self.predicate(name)
        is_property = predicate is not None and predicate.kind == PROPERTY
        line = replace(line, predicate=name, text="")
        subject = line.subject if self._fits(line.subject, name, "subject") else Term()
        if not is_property:
            kept = line.object if self._fits(line.object, name, "object") else Term()
            return replace(line, subject=subject, operator="", object=kept, value="")
        line = replace(line, subject=subject, object=Term())
        field = self.field(line)
        line = replace(line, operator=line.operator if line.operator in field.operators else field.operators[0])
        return line if line.value != "" and not self.value_problem(line) else replace(line, value="")

    def value_problem(self, line: Line) -> str:
        """Returns why a property cannot have the value of a line; "" if it can, or there is no value."""
        if line.operator in ("", HOLDS) or line.value == "":
            return ""
        field = self.field(line)
        return value_problem(field.type, line.operator, line.value, field.limits)

    # -- fitting -----------------------------------------------------------------------------------------------

    def _type_of(self, term: Term) -> str:
        """Returns the class of a term; "" if it is unknown."""
        return term.name if term.quantifier else self._types.get(self.id_of(term.name), "")

    def _fits(self, term: Term, predicate: str, side: str) -> bool:
        """Whether a term may be the subject or object of a predicate. Anything fits where a class is unknown."""
        etype = self._type_of(term)
        if not etype or not predicate:
            return True
        name = self._full_name(predicate)
        return not (self._ontology.mismatch(etype, name, "") if side == "subject" else
                    self._ontology.mismatch("", name, etype))  # fmt: skip


def predicate_text(predicate: Completion) -> str:
    """Returns a predicate as displayed."""
    return predicate.label if predicate.kind == PROPERTY else verb(predicate.text)


def _element(element: Completion, labels: Counter[str]) -> Choice:
    eid, label = _id(element), label_text(element.label)
    text = label if labels[element.label] == 1 else f"{label}  ({local_name(eid)})"
    return Choice(Term(eid), text, eid, element.rank > 0)


def _id(element: Completion) -> str:
    return element.text.strip('"')
