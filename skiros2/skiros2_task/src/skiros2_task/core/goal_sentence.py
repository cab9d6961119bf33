"""Goals as sentences for people."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from skiros2_common.core.wording import verb, words
from skiros2_task.core.goal_lines import EVERY, HOLDS, Line, Term, number_text, read_lines
from skiros2_task.core.goal_text import GoalError

#: Returns the displayed name of an element, by its id.
NameOf = Callable[[str], str]


def goal_sentence(text: str, name_of: NameOf) -> str:
    """Returns a goal as a sentence, such as "Tray B contains Product A"; a goal that does not parse as it is."""
    try:
        return lines_sentence(read_lines(text), name_of)
    except GoalError:
        return text


def lines_sentence(lines: Sequence[Line], name_of: NameOf) -> str:
    """Returns the complete lines of a goal as a sentence."""
    return ", and ".join(line_sentence(line, name_of) for line in lines if line.is_complete)


def line_sentence(line: Line, name_of: NameOf) -> str:
    """Returns a condition of a goal as a sentence."""
    if line.text:
        return line.text
    subject = _term(line.subject, name_of, line.is_negated)
    if not line.operator:
        return f"{subject} {verb(line.predicate, not line.is_negated)} {_term(line.object, name_of, line.is_negated)}"
    if line.operator == HOLDS:
        return f"{words(line.predicate)} of {subject} {'is not' if line.is_negated else 'is'} set"
    value = number_text(line.value) if isinstance(line.value, float) else line.value
    relation = ("is not" if line.is_negated else "is") if line.operator == "=" else line.operator
    negation = "not: " if line.is_negated and line.operator != "=" else ""
    return f"{negation}{words(line.predicate)} of {subject} {relation} {value}"


def _term(term: Term, name_of: NameOf, is_negated: bool) -> str:
    if not term.quantifier:
        return name_of(term.name)
    quantifier = "any" if term.quantifier == EVERY and is_negated else term.quantifier
    return f"{quantifier} {words(term.name)}"
