"""The text of goals, read into a tree that keeps the place of each name.

    goals      = goal {[","] goal}
    goal       = "(" predicate {term} ")"
               | "(" "not" goal ")" | "(" ("and" | "or") {goal} ")"
               | "(" ("forall" | "exists") "(" {variable {variable} "-" type} ")" goal ")"
               | "(" ("=" | ">" | "<" | ">=" | "<=") "(" property term ")" number ")"

Names end at spaces, parentheses, commas and semicolons; in double quotes they may hold any of these. A semicolon
starts a comment that ends with the line. Key words are read in any case.
"""

from __future__ import annotations

from dataclasses import dataclass

from skiros2_common.core.errors import WrongValue

#: The operators between a property and a number.
COMPARATORS = ("=", ">", "<", ">=", "<=")

_CONNECTIVES = ("and", "or", "not", "forall", "exists")
_PUNCTUATION = "(),"
_MAX_DEPTH = 100


class GoalError(WrongValue):
    """A goal that cannot be read. The text names the line, the column, what was found and what was expected."""


@dataclass(frozen=True)
class Name:
    """A word of the goal and its place (both from 1)."""

    text: str
    line: int
    column: int


@dataclass(frozen=True)
class ParsedAtom:
    predicate: Name
    terms: tuple[Name, ...]


@dataclass(frozen=True)
class ParsedComparison:
    operator: str
    property: Name
    subject: Name
    value: float


@dataclass(frozen=True)
class ParsedNot:
    part: ParsedGoal


@dataclass(frozen=True)
class ParsedJunction:
    every: bool  # and, or
    parts: tuple[ParsedGoal, ...]


@dataclass(frozen=True)
class ParsedQuantifier:
    every: bool  # forall, exists
    variables: tuple[tuple[Name, Name | None], ...]  # (variable, class or None when not given)
    body: ParsedGoal


ParsedGoal = ParsedAtom | ParsedComparison | ParsedNot | ParsedJunction | ParsedQuantifier


def goal_error(text: str, at: Name, message: str) -> GoalError:
    """An error that points at a place of the goal's text."""
    lines = text.splitlines() or [""]
    shown = lines[at.line - 1] if at.line <= len(lines) else ""
    return GoalError(f"goal, line {at.line}, column {at.column}: {message}\n  {shown}\n  {' ' * (at.column - 1)}^")


def parse_goals(text: str) -> tuple[ParsedGoal, ...]:
    """The goals in a text.

    :raises GoalError: the text is no list of goals.
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
            if self._peek().text == ",":
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
        word = head.text.lower()
        if word in COMPARATORS:
            return self._comparison(word)
        if head.text in _PUNCTUATION:
            raise self._unexpected(head, "a predicate")
        if word not in _CONNECTIVES:
            return self._atom(head)
        goal: ParsedGoal
        if word == "not":
            goal = ParsedNot(self._goal())
        elif word in ("and", "or"):
            parts = []
            while self._peek().text == "(":
                parts.append(self._goal())
            goal = ParsedJunction(word == "and", tuple(parts))
        else:
            goal = ParsedQuantifier(word == "forall", self._variables(word), self._goal())
        self._expect(")", f") at the end of ({word} ...")
        return goal

    def _atom(self, head: Name) -> ParsedAtom:
        terms = []
        while self._peek().text not in ("", *_PUNCTUATION):
            terms.append(self._take())
        self._expect(")", f"a name, or ) at the end of ({head.text} ...")
        return ParsedAtom(head, tuple(terms))

    def _comparison(self, operator: str) -> ParsedComparison:
        self._expect("(", f"(property element) after {operator}")
        prop, subject = self._name("a property"), self._name("an element")
        self._expect(")", ") after the element")
        number = self._name("a number")
        try:
            value = float(number.text)
        except ValueError:
            raise self._unexpected(number, "a number") from None
        self._expect(")", f") at the end of ({operator} ...")
        return ParsedComparison(operator, prop, subject, value)

    def _variables(self, word: str) -> tuple[tuple[Name, Name | None], ...]:
        self._expect("(", f"the variables of {word}, such as (?x - skiros:Product)")
        typed: list[tuple[Name, Name | None]] = []
        waiting: list[Name] = []
        while self._peek().text != ")":
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
        if token.text in ("", *_PUNCTUATION):
            raise self._unexpected(token, expected)
        return token

    def _expect(self, wanted: str, expected: str) -> None:
        token = self._take()
        if token.text != wanted:
            raise self._unexpected(token, expected)

    def _peek(self) -> Name:
        return self._tokens[self._next]

    def _take(self) -> Name:
        token = self._tokens[self._next]
        self._next = min(self._next + 1, len(self._tokens) - 1)
        return token

    def _unexpected(self, found: Name, expected: str) -> GoalError:
        what = repr(found.text) if found.text else "the end"
        return self._error(found, f"expected {expected}, found {what}")

    def _error(self, at: Name, message: str) -> GoalError:
        return goal_error(self._text, at, message)


def _tokens(text: str) -> list[Name]:
    """The words and punctuation; the last one is empty and stands for the end."""
    found: list[Name] = []
    line, start, i = 1, 0, 0  # start: where the line begins
    while i < len(text):
        char = text[i]
        if char == "\n":
            line, start, i = line + 1, i + 1, i + 1
        elif char.isspace():
            i += 1
        elif char == ";":
            while i < len(text) and text[i] != "\n":
                i += 1
        elif char in _PUNCTUATION:
            found.append(Name(char, line, i - start + 1))
            i += 1
        elif char == '"':
            end = text.find('"', i + 1)
            if end < 0 or "\n" in text[i:end]:
                raise goal_error(text, Name('"', line, i - start + 1), "this quote is not closed on its line")
            if end == i + 1:
                raise goal_error(text, Name('""', line, i - start + 1), "expected a name between the quotes")
            found.append(Name(text[i + 1 : end], line, i - start + 1))
            i = end + 1
        else:
            end = i
            while end < len(text) and not text[end].isspace() and text[end] not in '(),;"':
                end += 1
            found.append(Name(text[i:end], line, i - start + 1))
            i = end
    last = text.splitlines()[-1] if text.strip() else ""
    found.append(Name("", max(1, len(text.splitlines())), len(last) + 1))
    return found
