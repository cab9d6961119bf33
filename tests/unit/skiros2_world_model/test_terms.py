"""Literals and Python values, terms and texts."""

import math

import pyoxigraph as ox
import pytest
from hypothesis import given
from hypothesis import strategies as st

from skiros2_common.core.errors import WrongType, WrongValue
from skiros2_world_model.core.datatypes import as_datatype
from skiros2_world_model.core.prefixes import XSD, Prefixes
from skiros2_world_model.core.rdf import literal, parse_term, python_value, term_text


def typed(text, datatype):
    return ox.Literal(text, datatype=ox.NamedNode(XSD + datatype))


@pytest.mark.parametrize(
    ("read", "value"),
    [
        (typed("1.5", "float"), 1.5),
        (typed("1e3", "double"), 1000.0),
        (typed("2.50", "decimal"), 2.5),
        (typed(" 7 ", "int"), 7),
        (typed("7.0", "integer"), 7),
        (typed("true", "boolean"), True),
        (typed("0", "boolean"), False),
        (typed("False", "boolean"), False),
        (ox.Literal("Idle"), "Idle"),
        (ox.Literal("Idle", language="en"), "Idle"),
        (typed("2024-01-01", "date"), "2024-01-01"),
    ],
)
def test_a_literal_gives_a_value_of_its_datatype(read, value):
    found = python_value(read)
    assert found == value
    assert type(found) is type(value)


@pytest.mark.parametrize("read", [typed("abc", "float"), typed("1.5", "int"), typed("maybe", "boolean")])
def test_a_literal_that_is_none_of_its_datatype_is_refused(read):
    with pytest.raises(WrongValue):
        python_value(read)


@given(st.one_of(st.floats(allow_nan=False), st.integers(), st.booleans(), st.text()))
def test_a_value_and_its_literal_lead_to_each_other(value):
    found = python_value(literal(value))
    assert found == value
    assert type(found) is type(value)


def test_numbers_that_are_not_finite_are_written_as_xsd_wants():
    assert [literal(v).value for v in (math.inf, -math.inf, math.nan)] == ["INF", "-INF", "NaN"]
    assert python_value(typed("INF", "double")) == math.inf


def test_lists_and_dicts_are_literals_too():
    assert python_value(literal({"a": [1, 2]})) == {"a": [1, 2]}


def test_a_literal_has_the_datatype_that_is_asked_for_when_the_value_fits():
    assert literal(1.5, "xsd:float").datatype.value == XSD + "float"
    assert literal("Idle", "xsd:float").datatype.value == XSD + "string"
    assert literal(1.5).datatype.value == XSD + "double"


@pytest.mark.parametrize(
    ("value", "datatype", "expected"),
    [
        ("1.5", "xsd:float", 1.5),
        (2, "xsd:float", 2.0),
        ("True", "xsd:boolean", True),
        (3.0, "xsd:int", 3),
        ("Idle", "xsd:string", "Idle"),
        (5, "xsd:unknown", 5),
    ],
)
def test_a_value_becomes_one_of_a_datatype_where_nothing_is_lost(value, datatype, expected):
    found = as_datatype(value, datatype)
    assert found == expected
    assert type(found) is type(expected)


@pytest.mark.parametrize(
    ("value", "datatype"), [("abc", "xsd:float"), (1.5, "xsd:int"), (1, "xsd:boolean"), (5, "xsd:string")]
)
def test_another_kind_of_value_is_refused_with_the_datatype_and_the_value(value, datatype):
    with pytest.raises(WrongType, match=f"expected {datatype}, got .*{value}"):
        as_datatype(value, datatype)


@pytest.mark.parametrize(
    ("text", "term"),
    [
        ("owl:Class", ox.NamedNode("http://www.w3.org/2002/07/owl#Class")),
        ("<http://x.org/a>", ox.NamedNode("http://x.org/a")),
        ("http://x.org/a", ox.NamedNode("http://x.org/a")),
        ("_:b1", ox.BlankNode("b1")),
        ('"Idle"', ox.Literal("Idle")),
        ('"1.5"^^xsd:float', typed("1.5", "float")),
        ('"Idle"@en', ox.Literal("Idle", language="en")),
        ("true", ox.Literal(True)),
        ("5", ox.Literal(5)),
    ],
)
def test_a_text_is_read_as_the_term_it_writes(text, term):
    assert parse_term(text, Prefixes()) == term


@pytest.mark.parametrize("text", ["", "Idle", "a b", "x:", '"open', '"a" , "b"', "<a b>", "x:a b", '"1"^^none:int'])
def test_a_text_that_writes_no_term_is_refused_and_named(text):
    with pytest.raises(WrongValue, match="RDF term"):
        parse_term(text, Prefixes())


def test_terms_as_text_have_names_and_plain_values_or_n3():
    prefixes = Prefixes()
    term = ox.NamedNode("http://www.w3.org/2002/07/owl#Class")
    assert term_text(term, prefixes, True) == "owl:Class"
    assert term_text(term, prefixes, False) == "<http://www.w3.org/2002/07/owl#Class>"
    assert term_text(typed("1.5", "float"), prefixes, True) == "1.5"
    assert term_text(typed("1.5", "float"), prefixes, False) == f'"1.5"^^<{XSD}float>'
    assert term_text(None, prefixes, True) == ""
