"""RDF files: Turtle and RDF/XML in, sorted Turtle out."""

from __future__ import annotations

import os
import re
import tempfile
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any
from xml.parsers import expat

import pyoxigraph as ox

from skiros2_common.core.errors import WrongValue

_XML_START = re.compile(rb"\s*<(\?xml|!DOCTYPE|!--|([A-Za-z][\w.-]*:)?RDF[\s>])")
_BYTE_ORDER_MARK = b"\xef\xbb\xbf"
_PLAIN_LOCAL = re.compile(r"\w[\w-]*", re.ASCII)
_XSD_STRING = "http://www.w3.org/2001/XMLSchema#string"
_RDF_TYPE = "http://www.w3.org/1999/02/22-rdf-syntax-ns#type"


def read_triples(path: Path) -> list[ox.Triple]:
    """The triples of a Turtle or RDF/XML file; what is inside decides which of them it is.

    :raises WrongValue: the file is not there, or does not parse; the text names the file, the line and the mistake.
    """
    try:
        content = path.read_bytes()
    except OSError as error:
        raise WrongValue(f"{path}: cannot be read: {error.strerror or error}") from None
    return parse_triples(content, str(path))


def parse_triples(content: bytes, origin: str) -> list[ox.Triple]:
    """The triples of a Turtle or RDF/XML text. Blank nodes get names that no other text has.

    :param origin: what the text is, for the message.
    :raises WrongValue: it does not parse.
    """
    content = content.removeprefix(_BYTE_ORDER_MARK)
    is_xml = _XML_START.match(content) is not None
    syntax = ox.RdfFormat.RDF_XML if is_xml else ox.RdfFormat.TURTLE
    try:
        quads = ox.parse(
            content,
            syntax,
            base_iri="urn:skiros:file:" + os.path.basename(origin),
            rename_blank_nodes=True,
            lenient=True,
        )
        return [quad.triple for quad in quads]
    except SyntaxError as error:
        line = error.lineno or (_line_of_xml_error(content) if is_xml else None)
        place = f"{origin}, line {line}" if line else origin
        kind = "RDF/XML" if is_xml else "Turtle"
        raise WrongValue(f"{place}: expected {kind}: {error.msg}") from None


def turtle(triples: Iterable[ox.Triple], prefixes: Mapping[str, str]) -> bytes:
    """The triples as Turtle, one to a line, in an order that depends on nothing but the triples.

    So the difference of two texts shows what changed.
    """
    writer = _TurtleWriter(prefixes)
    lines = sorted({writer.line(t) for t in triples})
    text: list[str] = []
    before = ""
    for subject, _, predicate, obj in lines:
        if subject != before:
            text.append(f".\n\n{subject}\n" if before else f"{subject}\n")
        text.append(f"    {predicate} {obj} ;\n")
        before = subject
    header = [f"@prefix {prefix}: <{prefixes[prefix]}> .\n" for prefix in sorted(writer.used)]
    return "".join([*header, "\n" if header and text else "", *text, ".\n" if text else ""]).encode()


def write_file(path: Path, content: bytes) -> None:
    """Writes a file whole or not at all.

    :raises WrongValue: it cannot be written.
    """
    try:
        handle, temporary = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.parent)
        try:
            with os.fdopen(handle, "wb") as stream:
                stream.write(content)
                stream.flush()
                os.fsync(stream.fileno())
            os.chmod(temporary, 0o644)
            os.replace(temporary, path)
        except OSError:
            os.unlink(temporary)
            raise
    except OSError as error:
        raise WrongValue(f"{path}: cannot be written: {error.strerror or error}") from None


class _TurtleWriter:
    """Terms as Turtle writes them; notes which prefixes it used."""

    def __init__(self, prefixes: Mapping[str, str]) -> None:
        self._prefixes = {namespace: prefix for prefix, namespace in prefixes.items() if prefix}
        self.used: set[str] = set()

    def line(self, triple: ox.Triple) -> tuple[str, bool, str, str]:
        """Subject, whether the predicate is not `a`, predicate, object; sorts as the text is to be sorted."""
        is_type = triple.predicate.value == _RDF_TYPE
        predicate = "a" if is_type else self._term(triple.predicate)
        return self._term(triple.subject), not is_type, predicate, self._term(triple.object)

    def _term(self, term: Any) -> str:
        if isinstance(term, ox.NamedNode):
            return self._node(term)
        if not isinstance(term, ox.Literal) or term.language or term.datatype.value == _XSD_STRING:
            return str(term)
        text = str(term)
        return text[: text.rindex("^^") + 2] + self._node(term.datatype)

    def _node(self, node: ox.NamedNode) -> str:
        namespace, mark, local = node.value.rpartition("#")
        prefix = self._prefixes.get(namespace + mark)
        if prefix is None or not _PLAIN_LOCAL.fullmatch(local):
            return str(node)
        self.used.add(prefix)
        return f"{prefix}:{local}"


def _line_of_xml_error(content: bytes) -> int | None:
    """The line at which a text stops being XML, for mistakes whose line the RDF parser does not tell."""
    try:
        expat.ParserCreate().Parse(content, True)
    except expat.ExpatError as error:
        return error.lineno
    return None
