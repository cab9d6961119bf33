"""Entities of RDF/XML files: ontologies use them; those that grow without end are refused, in URDFs too."""

from __future__ import annotations

from pathlib import Path

import pytest

from skiros2_common.core.errors import ConfigurationError, WrongValue
from skiros2_live.core.markers import read_robot
from skiros2_motion.core.urdf_chain import read_chain
from skiros2_sim.core.urdf import read_urdf
from skiros2_world_model.core.rdf import parse_triples


def _file(entities: str, text: str) -> bytes:
    return f"""<?xml version="1.0"?>
<!DOCTYPE rdf:RDF [ {entities} ]>
<rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#" xmlns:x="http://x#">
<rdf:Description rdf:about="http://x#a"><x:p>{text}</x:p></rdf:Description>
</rdf:RDF>""".encode()


def _growing(depth: int, factor: int) -> str:
    first = '<!ENTITY e0 "xxxxxxxxxx">'
    return first + "".join(f'<!ENTITY e{i} "{f"&e{i - 1};" * factor}">' for i in range(1, depth))


def test_entities_of_ontologies_are_read() -> None:
    entities = '<!ENTITY base "http://x/"><!ENTITY wine "&base;wine#"> <!ENTITY other "&wine;y">'
    (triple,) = parse_triples(_file(entities, "&other;z&amp;&#65;" * 100), "wine.owl")
    assert triple.object.value == "http://x/wine#yz&A" * 100


@pytest.mark.parametrize(
    ("entities", "text"),
    [
        (_growing(9, 10), "&e8;"),
        (_growing(3, 10), "&e2;" * 10_000),
        (f'<!ENTITY a "{"x" * 100_000}">', "&a;" * 1000),
        ('<!ENTITY a "&b;"><!ENTITY b "&a;">', "&a;"),
        ("".join(f'<!ENTITY e{i} "&e{i + 1};">' for i in range(5000)), "&e0;"),
        (f'<!ENTITY a "">{_growing(9, 10).replace("e8", "a")}', "&a;"),
    ],
)
def test_entities_that_stand_for_too_much_are_refused(entities: str, text: str) -> None:
    with pytest.raises(WrongValue, match=r"bomb\.owl: .*(entities)"):
        parse_triples(_file(entities, text), "bomb.owl")


def test_urdfs_with_entities_that_grow_are_refused(tmp_path: Path) -> None:
    text = f'<!DOCTYPE robot [ {_growing(9, 10)} ]><robot name="arm"><link name="&e8;"/></robot>'
    with pytest.raises(WrongValue, match="amplification"):
        read_robot(text)
    with pytest.raises(ConfigurationError, match="amplification"):
        read_chain(text, "base", "tip")
    for encoding in ("utf-8", "utf-16"):
        file = tmp_path / "arm.urdf"
        file.write_bytes(text.encode(encoding))
        with pytest.raises(ConfigurationError, match="amplification"):
            read_urdf(file)
