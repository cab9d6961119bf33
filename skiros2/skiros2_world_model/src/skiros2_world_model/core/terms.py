"""Converts RDF terms to and from Python values and texts."""

from __future__ import annotations

import re
from typing import Any

import pyoxigraph as ox

from skiros2_common.core.errors import WrongValue
from skiros2_common.core.json_data import read_json
from skiros2_common.core.property import from_text
from skiros2_world_model.core.datatypes import PYTHON_TYPES, literal_parts
from skiros2_world_model.core.prefixes import RDF, XSD, Prefixes, is_iri

RDF_TYPE = ox.NamedNode(RDF + "type")
RDF_JSON = ox.NamedNode(RDF + "JSON")

_TYPE_BY_IRI: dict[str, type] = {XSD + name.partition(":")[2]: kind for name, kind in PYTHON_TYPES.items()}
_NAME = re.compile(r"[A-Za-z][\w.-]*|")


def python_value(literal: ox.Literal) -> Any:
    """The value of a literal: a float, int, bool, list, dict or text.

    :raises WrongValue: the text is not valid for its datatype.
    """
    text, datatype = literal.value, literal.datatype.value
    kind = _TYPE_BY_IRI.get(datatype, str)
    if kind is str:
        if datatype == RDF_JSON.value:
            try:
                return read_json(text)
            except ValueError:
                raise WrongValue(f"{text!r} is no JSON") from None
        return text
    try:
        return from_text(text.strip(), kind)
    except WrongValue:
        if kind is int and re.fullmatch(r"[+-]?\d+\.0*", text.strip()):
            return int(float(text))
        raise


def literal(value: Any, datatype: str = "") -> ox.Literal:
    """The literal of a value.

    :param datatype: the desired datatype, such as `xsd:float`; ignored when the value does not fit it.
    """
    text, iri = literal_parts(value, datatype)
    return ox.Literal(text, datatype=ox.NamedNode(iri))


def term_text(term: Any, prefixes: Prefixes, cut_prefix: bool) -> str:
    """Formats a term: as a name or plain value when the prefix is cut, else as N3; "" for None."""
    if term is None:
        return ""
    if not cut_prefix:
        return str(term)
    if isinstance(term, ox.NamedNode):
        return prefixes.name(term.value)
    if isinstance(term, ox.Literal):
        return term.value
    return str(term)


def parse_term(text: str, prefixes: Prefixes) -> ox.NamedNode | ox.BlankNode | ox.Literal:
    """Parses a term: a name, an IRI (bare or in `<>`), a blank node `_:x`, or a literal in N3.

    :raises WrongValue: the text is not a term.
    """
    text = text.strip()
    try:
        if text.startswith("_:"):
            return ox.BlankNode(text[2:])
        if text.startswith("<") and text.endswith(">"):
            return ox.NamedNode(text[1:-1])
        if text[:1] in ('"', "'") or re.fullmatch(r"[+-]?[\d.]+([eE][+-]?\d+)?|true|false", text):
            return _parse_literal(text, prefixes)
        if is_iri(text):
            return ox.NamedNode(text)
        prefix, colon, local = text.partition(":")
        if local and colon and _NAME.fullmatch(prefix) and not re.search(r"[\s<>\"{}|\\^`]", local):
            return ox.NamedNode(prefixes.iri(text))
    except (ValueError, SyntaxError) as error:
        raise WrongValue(f"{text!r} is no RDF term: {error}") from None
    raise WrongValue(f'{text!r} is no RDF term: expected prefix:Name, <IRI>, _:blank or "literal"')


def _parse_literal(text: str, prefixes: Prefixes) -> ox.Literal:
    declared = "".join(f"@prefix {prefix}: <{ns}> .\n" for prefix, ns in prefixes.namespaces().items())
    triples = list(ox.parse(f"{declared}<x:s> <x:p> {text} .", ox.RdfFormat.TURTLE))
    if len(triples) != 1 or not isinstance(triples[0].object, ox.Literal):
        raise WrongValue(f"{text!r} is not one literal")
    return triples[0].object
