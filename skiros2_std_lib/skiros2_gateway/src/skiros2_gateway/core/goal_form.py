"""The form that builds a goal: its lines, and the choices of each, as JSON data for the page.

A form is {goal, sentence, problem, lines, choices}. `goal` is the text, `sentence` that for people, `problem` why it
cannot be planned ("": it can). `lines` is null for a text that does not parse, else a list of lines:

- `subject`, `object`: {name, quantifier}; `predicate`, `operator`, `value`, `negated`; `text`: of a condition that
  lines cannot express. See `skiros2_task.core.goal_lines`.
- `subjects`, `predicates`, `objects`: the keys of their lists in `choices`; `operators`.
- `field`: of a property's value: {kind, options, known, limits}: `choice` of options, `number` or `text`.

`choices` has lists by key: {name, quantifier, text, tip, faint}.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

from pydantic import BaseModel, ConfigDict, Field, FiniteFloat

from skiros2_common.core.world_model_port import WorldModelPort
from skiros2_task.core.goal_checker import GoalChecker, check_syntax
from skiros2_task.core.goal_choices import Choice, GoalChoices
from skiros2_task.core.goal_lines import HOLDS, Line, Term, read_lines, write_lines
from skiros2_task.core.goal_sentence import lines_sentence
from skiros2_task.core.goal_text import MAX_GOAL
from skiros2_world_model.core.vocabulary import Vocabulary

#: The most lines of a form.
_MAX_LINES = 100


class _Part(BaseModel):
    model_config = ConfigDict(extra="ignore")  # the page sends the lines of an earlier form


class TermData(_Part):
    """See `Term`."""

    name: str = ""
    quantifier: str = Field(default="", pattern="^(every|some|)$")


class LineData(_Part):
    """See `Line`."""

    subject: TermData = TermData()
    predicate: str = ""
    operator: str = Field(default="", pattern=f"^(=|>|<|>=|<=|{HOLDS}|)$")
    object: TermData = TermData()
    value: FiniteFloat | str = ""
    negated: bool = False
    text: str = ""


class GoalEdit(BaseModel):
    """A goal as text, or as lines.

    :param goal: used if there are no lines.
    :param chosen: the index of the line whose predicate was chosen last: what does not fit it is dropped.
    """

    model_config = ConfigDict(extra="forbid")
    goal: str = Field(default="", max_length=MAX_GOAL)
    lines: list[LineData] | None = Field(default=None, max_length=_MAX_LINES)
    chosen: int | None = None


class GoalForms:
    """Makes forms. Any thread; one form at a time.

    :param world: returns the world model.
    """

    def __init__(self, world: Callable[[], WorldModelPort]) -> None:
        self._world = world
        self._lock = threading.Lock()
        self._checker: GoalChecker | None = None
        self._read: object = None
        self._ontology: tuple[object, Vocabulary | None] = (None, None)

    def form(self, edit: GoalEdit) -> dict[str, Any]:
        """Returns the form of an edited goal. Blocks while the scene is read.

        :raises WmException: the world model does not answer.
        """
        with self._lock:
            return form_data(self._current(), edit)

    def _current(self) -> GoalChecker:
        wm = self._world()
        version, revisions = wm.version, wm.revisions()
        if self._checker is None or version == -1 or self._read != version:
            declared = revisions.ontology if revisions is not None else None
            known = self._ontology[1] if declared is not None and self._ontology[0] is declared else None
            self._checker, self._read = GoalChecker(wm, known), version
            self._ontology = declared, self._checker.ontology
        return self._checker


def form_data(checker: GoalChecker, edit: GoalEdit) -> dict[str, Any]:
    """Returns the form of an edited goal."""
    choices, lines, text = checker.choices, None, edit.goal
    if edit.lines is not None:
        lines = [_line(data) for data in edit.lines]
        if edit.chosen is not None and 0 <= edit.chosen < len(lines):
            line = lines[edit.chosen]
            lines[edit.chosen] = choices.with_predicate(line, line.predicate)
        text = write_lines(lines)
    problem = check_syntax(text) if text.strip() else None
    if problem is None:
        lines = lines if lines is not None else list(read_lines(text)) if text.strip() else []
        problem = checker.check(text) if text.strip() else None
    lists: dict[str, list[dict[str, Any]]] = {}
    return {
        "goal": text,
        "sentence": lines_sentence(lines, choices.name_of) if lines is not None else "",
        "problem": problem.reason if problem is not None else "",
        "lines": None if lines is None else [_line_data(choices, line, lists) for line in lines],
        "choices": lists,
    }


def _line(data: LineData) -> Line:
    subject, other = (Term(term.name, term.quantifier) for term in (data.subject, data.object))
    return Line(subject, data.predicate, data.operator, other, data.value, data.negated, data.text)


def _line_data(choices: GoalChoices, line: Line, lists: dict[str, list[dict[str, Any]]]) -> dict[str, Any]:
    line = choices.normal(line)
    predicate = choices.predicate(line.predicate)
    name = predicate.text if predicate is not None else line.predicate

    def listed(kind: str, of: str, make: Callable[[], Sequence[Choice]]) -> str:
        key = f"{kind} {of}"
        if key not in lists:
            lists[key] = [_choice(choice) for choice in make()]
        return key

    def term(one: Term) -> dict[str, str]:
        eid = "" if one.quantifier else choices.id_of(one.name)
        return _term(replace(one, name=eid or one.name))

    data: dict[str, Any] = {
        "subject": term(line.subject),
        "predicate": name,
        "operator": line.operator,
        "object": term(line.object),
        "value": line.value,
        "negated": line.is_negated,
        "text": line.text,
    }
    if line.text:
        return data
    of = f"{line.subject.quantifier} {line.subject.name}"
    data["subjects"] = listed("subjects", name, lambda: choices.subjects(name))
    data["predicates"] = listed("predicates", of, lambda: choices.predicates(line.subject))
    if not line.operator:
        data["objects"] = listed("objects", name, lambda: choices.objects(name))
        return data
    field = choices.field(line)
    data["operators"] = [*field.operators, *([line.operator] if line.operator not in field.operators else [])]
    kind = "choice" if field.options else "number" if field.is_number else "text"
    limits = {**field.limits.to_json(), "text": field.limits.text}
    data["field"] = {"kind": kind, "options": list(field.options), "known": list(field.known), "limits": limits}
    return data


def _term(term: Term) -> dict[str, str]:
    return {"name": term.name, "quantifier": term.quantifier}


def _choice(choice: Choice) -> dict[str, Any]:
    return {**_term(choice.term), "text": choice.text, "tip": choice.tip, "faint": choice.is_faint}
