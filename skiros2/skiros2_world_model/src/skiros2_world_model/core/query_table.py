"""Converts the answer to a SPARQL query to a table of names and Python values."""

from __future__ import annotations

import re
from typing import Any, Protocol

from skiros2_common.core.errors import WrongValue
from skiros2_common.core.property import from_text
from skiros2_world_model.core.datatypes import PYTHON_TYPES
from skiros2_world_model.core.prefixes import Prefixes

#: A term in N3, or nothing.
_TERM = re.compile(r'<[^>]*>|"(?:[^"\\]|\\.)*"(?:\^\^<[^>]*>|@[\w-]+)?|[^\s<"]\S*|')
_LITERAL = re.compile(r'"((?:[^"\\]|\\.)*)"(?:\^\^<([^>]*)>|@[\w-]+)?', re.DOTALL)
_ESCAPES = {"n": "\n", "r": "\r", "t": "\t", "b": "\b", "f": "\f"}


class Asked(Protocol):
    """A client that answers queries."""

    def query_ontology(self, query: str, cut_prefix: bool = True, context: str = "") -> list[str]: ...


def query_table(wm: Asked, sparql: str, context: str = "") -> tuple[list[str], list[list[Any]]]:
    """Runs a query. Returns the names of the columns and the rows.

    A cell is a name, a Python value, or None where nothing is bound. The names are [] if the query does not list them.

    :param context: the context to query; "": all.
    :raises WmException: the query cannot be answered, or the context does not exist.
    """
    prefixes = Prefixes()
    rows = [[_value(term, prefixes) for term in _terms(row)] for row in wm.query_ontology(sparql, False, context)]
    names = _variables(sparql)
    return (names if not rows or len(names) == len(rows[0]) else []), rows


def _variables(sparql: str) -> list[str]:
    """The names of a query's columns; [] when it does not list them."""
    text = re.sub(r"#[^\n]*(?=\n)|<[^>\s]*>", " ", sparql)
    match = re.search(r"\bSELECT\b\s*(?:DISTINCT\b|REDUCED\b)?(.*?)(?:\bFROM\b|\bWHERE\b|\{)", text, re.S | re.I)
    if match is None:
        return []
    columns = re.sub(r"\((?:[^()]|\([^()]*\))*\bAS\s+[?$](\w+)\s*\)", r" ?\1 ", match[1], flags=re.I)
    return re.findall(r"[?$](\w+)", columns)


def _terms(row: str) -> list[str]:
    """The terms of a row; "" where nothing is bound."""
    terms = []
    at = 0
    while True:
        match = _TERM.match(row, at)
        assert match is not None
        terms.append(match[0])
        at = match.end() + 1  # skip the space after each value
        if at >= len(row):
            return terms


def _value(term: str, prefixes: Prefixes) -> Any:
    """Converts a term in N3 to a name or a Python value; None for ""."""
    if not term:
        return None
    if term.startswith("<"):
        return prefixes.name(term[1:-1])
    literal = _LITERAL.fullmatch(term)
    if literal is None:
        return term
    text = re.sub(r"\\u([0-9A-Fa-f]{4})|\\U([0-9A-Fa-f]{8})|\\(.)", _unescaped, literal[1], flags=re.S)
    kind = PYTHON_TYPES.get(prefixes.name(literal[2] or ""), str)
    try:
        return from_text(text, kind)
    except WrongValue:
        return text


def _unescaped(match: re.Match[str]) -> str:
    digits = match[1] or match[2]
    return chr(int(digits, 16)) if digits else _ESCAPES.get(match[3], match[3])
