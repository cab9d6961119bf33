"""Parses goal texts to a syntax tree with the position of each name.

    goals      = goal {[","] goal}
    goal       = "(" predicate {term} ")"
               | "(" "not" goal ")" | "(" ("and" | "or") {goal} ")" | "(" "imply" goal goal ")"
               | "(" ("forall" | "exists") "(" {variable {variable} "-" type} ")" goal ")"
               | "(" operator {goal} ")", for operators of other packages
               | "(" ("=" | ">" | "<" | ">=" | "<=") "(" property term ")" value ")" | "(" "=" term term ")"

Names end at spaces, parentheses, commas and semicolons; names in double quotes may contain them. A semicolon starts a
comment up to the end of the line. Keywords are case-insensitive.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import dataclass, field

from skiros2_common.core.errors import WrongValue

#: The longest goal text that people and clients of the gateway may write (characters).
MAX_GOAL = 20_000
#: The operators that compare a property with a number.
COMPARATORS = ("=", ">", "<", ">=", "<=")

#: Builds the goal of an operator from its parts.
BuildGoal = Callable[[tuple["ParsedGoal", ...]], "ParsedGoal"]

_operators: dict[str, BuildGoal] = {}

_CONNECTIVES = ("and", "or", "not", "imply", "forall", "exists")
_PUNCTUATION = "(),"
_TOKEN = re.compile(
    r"""(?P<blank>\s+|;[^\n]*)|(?P<sign>[(),])|"(?P<quoted>[^"\n]*)"|(?P<unclosed>")|(?P<name>[^\s(),;"]+)"""
)
_MAX_DEPTH = 100


class GoalError(WrongValue):
    """A goal that cannot be read. The text has the line, the column, the found and the expected token.

    :param line, column: the position, counting from 1.
    :param reason: the text without the position.
    """

    def __init__(self, text: str, line: int = 1, column: int = 1, reason: str = "") -> None:
        super().__init__(text)
        self.line = line
        self.column = column
        self.reason = reason or text


@dataclass(frozen=True)
class Name:
    """A token with its position (counting from 1).

    :param quoted: it was in quotes, so it is neither punctuation nor a keyword.
    """

    text: str
    line: int
    column: int
    quoted: bool = field(default=False, compare=False)

    def is_sign(self, *signs: str) -> bool:
        """Whether the token is one of these signs, unquoted."""
        return not self.quoted and self.text in signs


@dataclass(frozen=True)
class ParsedAtom:
    """A predicate with terms: `(skiros:contain demo:Tray-12 ?x)`."""

    predicate: Name
    terms: tuple[Name, ...]


@dataclass(frozen=True)
class ParsedComparison:
    """:param value: a number; with `=` also a text."""

    operator: str
    property: Name
    subject: Name
    value: float | str


@dataclass(frozen=True)
class ParsedEquality:
    """`(= ONE OTHER)`: the same element."""

    one: Name
    other: Name


@dataclass(frozen=True)
class ParsedNot:
    """`(not PART)`."""

    part: ParsedGoal


@dataclass(frozen=True)
class ParsedJunction:
    """`(and PARTS)` or `(or PARTS)`.

    :param every: `and`.
    """

    every: bool
    parts: tuple[ParsedGoal, ...]


@dataclass(frozen=True)
class ParsedQuantifier:
    """`(forall (VARIABLES) BODY)` or `(exists (VARIABLES) BODY)`.

    :param every: `forall`.
    :param variables: each with its class, if one is given.
    """

    every: bool
    variables: tuple[tuple[Name, Name | None], ...]
    body: ParsedGoal


ParsedGoal = ParsedAtom | ParsedComparison | ParsedEquality | ParsedNot | ParsedJunction | ParsedQuantifier


def add_goal_operator(word: str, build: BuildGoal) -> None:
    """Adds an operator to the language of goals: `(word goal goal ...)`. Replaces one with this word.

    :param word: case is ignored.
    :param build: returns the goal that the operator stands for; raises `ValueError` for wrong parts.
    :raises WrongValue: the word is a part of the language.
    """
    if word.lower() in (*_CONNECTIVES, *COMPARATORS):
        raise WrongValue(f"the goal operator {word!r} exists")
    _operators[word.lower()] = build


def keywords() -> tuple[str, ...]:
    """Returns the words that begin a goal of goals: connectives, quantifiers, operators of other packages."""
    return (*_CONNECTIVES, *sorted(_operators))


def goal_error(text: str, at: Name, message: str) -> GoalError:
    """Returns an error that points at a position of the text."""
    line = text.split("\n")[at.line - 1].rstrip()
    # Tabs are kept, so that the marker is aligned.
    indent = "".join("\t" if char == "\t" else " " for char in line[: at.column - 1]).ljust(at.column - 1)
    full = f"goal, line {at.line}, column {at.column}: {message}\n  {line}\n  {indent}^"
    return GoalError(full, at.line, at.column, message)


def parse_goals(text: str) -> tuple[ParsedGoal, ...]:
    """Returns the goals in a text.

    :raises GoalError: the text does not parse.
    """
    return _Parser(text).goals()


class _Parser:
    def __init__(self, text: str) -> None:
        self._text = text
        self._tokens = _tokens(text)
        self._next = 0
        self._depth = 0

    def goals(self) -> tuple[ParsedGoal, ...]:
        if self._peek().text == "":
            raise self._error(self._peek(), "the goal is empty; expected something like (skiros:at robot place)")
        found = [self._goal()]
        while self._peek().text != "":
            if self._peek().is_sign(","):
                self._take()
            found.append(self._goal())
        return tuple(found)

    def _goal(self) -> ParsedGoal:
        opening = self._peek()
        self._expect("(", "a goal, which starts with (")
        self._depth += 1
        if self._depth > _MAX_DEPTH:
            raise self._error(opening, f"goals nested more than {_MAX_DEPTH} deep")
        goal = self._inside()
        self._depth -= 1
        return goal

    def _inside(self) -> ParsedGoal:
        head = self._take()
        word = "" if head.quoted else head.text.lower()
        if word == "=" and not self._peek().is_sign("("):
            return self._equality()
        if word in COMPARATORS:
            return self._comparison(word)
        if self._ends_names(head):
            raise self._unexpected(head, "a predicate")
        if word in _operators and self._peek().is_sign("(", ")"):
            return self._operator(head, word)
        if word not in _CONNECTIVES:
            return self._atom(head)
        goal: ParsedGoal
        if word == "not":
            goal = ParsedNot(self._goal())
        elif word == "imply":
            goal = ParsedJunction(False, (ParsedNot(self._goal()), self._goal()))
        elif word in ("and", "or"):
            goal = ParsedJunction(word == "and", self._parts())
        else:
            goal = ParsedQuantifier(word == "forall", self._variables(word), self._goal())
        self._expect(")", f") at the end of ({word} ...")
        return goal

    def _parts(self) -> tuple[ParsedGoal, ...]:
        parts = []
        while self._peek().is_sign("("):
            parts.append(self._goal())
        return tuple(parts)

    def _operator(self, head: Name, word: str) -> ParsedGoal:
        try:
            goal = _operators[word](self._parts())
        except ValueError as error:
            raise self._error(head, f"{head.text}: {error}") from None
        self._expect(")", f") at the end of ({word} ...")
        return goal

    def _atom(self, head: Name) -> ParsedAtom:
        terms = []
        while not self._ends_names(self._peek()):
            terms.append(self._take())
        self._expect(")", f"a name, or ) at the end of ({head.text} ...")
        return ParsedAtom(head, tuple(terms))

    def _comparison(self, operator: str) -> ParsedComparison:
        self._expect("(", f"(property element) after {operator}")
        prop, subject = self._name("a property"), self._name("an element")
        self._expect(")", ") after the element")
        wanted = self._name("a value" if operator == "=" else "a number")
        value = _value(wanted)
        if operator != "=" and isinstance(value, str):
            raise self._unexpected(wanted, "a number")
        self._expect(")", f") at the end of ({operator} ...")
        return ParsedComparison(operator, prop, subject, value)

    def _equality(self) -> ParsedEquality:
        one, other = self._name("(property element), or an element, after ="), self._name("an element")
        self._expect(")", ") at the end of (= ...")
        return ParsedEquality(one, other)

    def _variables(self, word: str) -> tuple[tuple[Name, Name | None], ...]:
        self._expect("(", f"the variables of {word}, such as (?x - skiros:Product)")
        typed: list[tuple[Name, Name | None]] = []
        waiting: list[Name] = []
        while not self._peek().is_sign(")"):
            token = self._name("a variable, such as ?x")
            if token.text.startswith("-"):
                if not waiting:
                    raise self._unexpected(token, "a variable before the -")
                if token.text == "-":
                    cls = self._name("a type after the -")
                else:  # (?x -type)
                    cls = Name(token.text[1:], token.line, token.column + 1)
                typed += [(variable, cls) for variable in waiting]
                waiting = []
            elif token.text.startswith("?") and len(token.text) > 1:
                if token.text in (v.text for v in (*waiting, *(v for v, _ in typed))):
                    raise self._error(token, f"{token.text!r} is declared twice")
                waiting.append(token)
            else:
                raise self._unexpected(token, "a variable, such as ?x")
        typed += [(variable, None) for variable in waiting]
        if not typed:
            raise self._unexpected(self._peek(), f"a variable, such as (?x - skiros:Product), after {word}")
        self._take()
        return tuple(typed)

    def _name(self, expected: str) -> Name:
        token = self._take()
        if self._ends_names(token):
            raise self._unexpected(token, expected)
        return token

    def _ends_names(self, token: Name) -> bool:
        return token.is_sign("", *_PUNCTUATION)

    def _expect(self, wanted: str, expected: str) -> None:
        token = self._take()
        if not token.is_sign(wanted):
            raise self._unexpected(token, expected)

    def _peek(self) -> Name:
        return self._tokens[self._next]

    def _take(self) -> Name:
        token = self._tokens[self._next]
        self._next = min(self._next + 1, len(self._tokens) - 1)
        return token

    def _unexpected(self, found: Name, expected: str) -> GoalError:
        token = repr(found.text) if found.text else "the end"
        return self._error(found, f"expected {expected}, found {token}")

    def _error(self, at: Name, message: str) -> GoalError:
        return goal_error(self._text, at, message)


def _tokens(text: str) -> list[Name]:
    """Returns the tokens; the last one is empty and marks the end."""
    found: list[Name] = []
    line, start = 1, 0  # start: of the line
    for match in _TOKEN.finditer(text):
        kind, column = match.lastgroup or "", match.start() - start + 1
        if kind == "blank":
            if "\n" in match[0]:
                line, start = line + match[0].count("\n"), match.start() + match[0].rindex("\n") + 1
        elif kind == "unclosed":
            raise goal_error(text, Name('"', line, column), "this quote is not closed on its line")
        elif not match[kind]:
            raise goal_error(text, Name('""', line, column), "expected a name between the quotes")
        else:
            found.append(Name(match[kind], line, column, quoted=kind == "quoted"))
    lines = text.rstrip("\n").split("\n")
    found.append(Name("", len(lines), len(lines[-1]) + 1))
    return found


def _value(name: Name) -> float | str:
    """Returns a finite unquoted number as float, anything else as text."""
    try:
        number = float(name.text)
    except ValueError:
        return name.text
    return number if math.isfinite(number) and not name.quoted else name.text
