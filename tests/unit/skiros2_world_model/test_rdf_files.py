"""Reads Turtle and RDF/XML files, writes sorted Turtle."""

import random
from pathlib import Path

import pyoxigraph as ox
import pytest

from skiros2_common.core.errors import WrongValue
from skiros2_world_model.core.rdf import parse_triples, read_triples, turtle, write_file

LAB = "http://x.org/lab.owl#"

TURTLE = b"""@prefix lab: <http://x.org/lab.owl#> .
lab:Bench-1 a lab:Bench ; lab:height 1.5 ; lab:holds lab:Box-2, lab:Box-10 .
lab:Box-2 a lab:Box ; lab:note "a \\"red\\" one\\nof two" .
lab:Box-10 a lab:Box .
"""

XML = b"""<?xml version="1.0"?>
<!DOCTYPE rdf:RDF [ <!ENTITY lab "http://x.org/lab.owl#" > ]>
<rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#" xmlns:lab="http://x.org/lab.owl#">
  <lab:Bench rdf:about="&lab;Bench-1"><lab:holds rdf:resource="&lab;Box-2"/></lab:Bench>
</rdf:RDF>
"""


def test_content_decides_the_format():
    assert len(parse_triples(TURTLE, "scene.owl")) == 7
    assert len(parse_triples(XML, "scene.ttl")) == 2


def test_a_byte_order_mark_is_no_mistake():
    assert len(parse_triples(b"\xef\xbb\xbf" + TURTLE, "scene.ttl")) == 7


@pytest.mark.parametrize(
    ("content", "line"),
    [
        (b"@prefix lab: <http://x.org/lab.owl#> .\nlab:a lab:b lab:c .\nlab:a lab:b none:c .\n", 3),
        (b"@prefix lab: <http://x.org/lab.owl#> .\nlab:a lab:b\n", 3),
        (b"this is not RDF at all", 1),
        (b'<?xml version="1.0"?>\n<rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">\n<a></b>', 3),
        (b"\x00\x01\x02\xff", 1),
    ],
)
def test_a_text_that_does_not_parse_is_refused_with_file_and_line(content, line):
    with pytest.raises(WrongValue, match=rf"lab\.ttl, line {line}, column \d+: expected (Turtle|RDF/XML)"):
        parse_triples(content, "lab.ttl")


def test_a_file_that_is_not_there_is_named(tmp_path: Path):
    with pytest.raises(WrongValue, match=r"none\.ttl: cannot be read"):
        read_triples(tmp_path / "none.ttl")


def test_the_text_depends_on_the_triples_alone_not_on_their_order():
    triples = parse_triples(TURTLE, "scene.ttl")
    texts = set()
    for seed in range(5):
        random.Random(seed).shuffle(triples)
        texts.add(turtle(triples, {"lab": LAB, "unused": "http://x.org/u#"}))
    assert len(texts) == 1


def test_each_triple_is_one_line():
    triples = parse_triples(TURTLE, "scene.ttl")
    more = ox.Triple(ox.NamedNode(LAB + "Bench-1"), ox.NamedNode(LAB + "holds"), ox.NamedNode(LAB + "Box-3"))
    before = turtle(triples, {"lab": LAB}).splitlines()
    after = turtle([*triples, more], {"lab": LAB}).splitlines()
    assert [line for line in after if line not in before] == [b"    lab:holds lab:Box-3 ;"]


def test_written_triples_read_back_unchanged():
    triples = parse_triples(TURTLE, "scene.ttl")
    assert set(parse_triples(turtle(triples, {"lab": LAB}), "again.ttl")) == set(triples)
    assert set(parse_triples(turtle(triples, {}), "again.ttl")) == set(triples)


def test_names_without_valid_prefixed_form_are_written_as_iris():
    odd = ox.NamedNode(LAB + "a/b.c")
    text = turtle([ox.Triple(odd, odd, odd)], {"lab": LAB})
    assert text.count(b"<http://x.org/lab.owl#a/b.c>") == 3
    assert b"@prefix" not in text


def test_nothing_is_an_empty_text():
    assert turtle([], {"lab": LAB}) == b""


def test_file_is_replaced_atomically(tmp_path: Path):
    path = tmp_path / "scene.ttl"
    write_file(path, b"one")
    write_file(path, b"two")
    assert path.read_bytes() == b"two"
    assert list(tmp_path.iterdir()) == [path]
    with pytest.raises(WrongValue, match="cannot be written"):
        write_file(tmp_path / "none" / "scene.ttl", b"three")
