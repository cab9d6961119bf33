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
_PLAIN_TEXT = re.compile(r"[\w .:+-]*", re.ASCII)
_XSD_STRING = "http://www.w3.org/2001/XMLSchema#string"
_RDF_TYPE = "http://www.w3.org/1999/02/22-rdf-syntax-ns#type"

#: Subject, predicate and object as Turtle writes them.
WrittenStatement = tuple[str, str, str]


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


def parse_n_triples(texts: Iterable[str]) -> list[ox.Triple]:
    """The triples that texts write, each as `str(triple)` does; blank nodes keep their names.

    :raises SyntaxError: a text is none.
    """
    content = " .\n".join(texts)
    return [quad.triple for quad in ox.parse(f"{content} .", ox.RdfFormat.N_TRIPLES)] if content else []


def turtle(triples: Iterable[ox.Triple], prefixes: Mapping[str, str]) -> bytes:
    """The triples as Turtle; see `TurtleWriter`."""
    writer = TurtleWriter(prefixes)
    return writer.text(map(writer.statement, triples))


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


class TurtleWriter:
    """Writes statements as Turtle, one to a line, in an order that depends on nothing but the statements.

    So the difference of two texts shows what changed. Used for one text.

    :param prefixes: namespace by prefix.
    """

    def __init__(self, prefixes: Mapping[str, str]) -> None:
        self._prefixes = {namespace: prefix for prefix, namespace in prefixes.items() if prefix}
        self._nodes: dict[str, str] = {}
        self._used: set[str] = set()

    def text(self, statements: Iterable[WrittenStatement]) -> bytes:
        """The statements as they are to be written, each once."""
        described: dict[str, set[tuple[bool, str, str]]] = {}
        for subject, predicate, obj in statements:
            described.setdefault(subject, set()).add((predicate != "a", predicate, obj))
        paragraphs = []
        for subject in sorted(described):
            lines = [f"    {predicate} {obj} ;\n" for _, predicate, obj in sorted(described[subject])]
            paragraphs.append(f"{subject}\n{''.join(lines)}.\n")
        namespaces = {prefix: namespace for namespace, prefix in self._prefixes.items()}
        header = "".join(f"@prefix {prefix}: <{namespaces[prefix]}> .\n" for prefix in sorted(self._used))
        return "\n".join([header, *paragraphs] if header else paragraphs).encode()

    def statement(self, triple: ox.Triple) -> WrittenStatement:
        """A triple as it is written."""
        predicate = self.predicate(triple.predicate.value)
        return self._term(triple.subject), predicate, self._term(triple.object)

    def node(self, iri: str) -> str:
        """An IRI as it is written."""
        written = self._nodes.get(iri)
        if written is None:
            namespace, mark, local = iri.rpartition("#")
            prefix = self._prefixes.get(namespace + mark)
            if prefix is None or not _PLAIN_LOCAL.fullmatch(local):
                written = f"<{iri}>"
            else:
                self._used.add(prefix)
                written = f"{prefix}:{local}"
            self._nodes[iri] = written
        return written

    def predicate(self, iri: str) -> str:
        """The IRI of a predicate as it is written."""
        return "a" if iri == _RDF_TYPE else self.node(iri)

    def literal(self, text: str, datatype: str) -> str:
        """A literal as it is written: its text, and the IRI of its datatype."""
        quoted = f'"{text}"' if _PLAIN_TEXT.fullmatch(text) else str(ox.Literal(text))
        return quoted if datatype == _XSD_STRING else f"{quoted}^^{self.node(datatype)}"

    def _term(self, term: Any) -> str:
        if isinstance(term, ox.NamedNode):
            return self.node(term.value)
        if isinstance(term, ox.Literal) and not term.language:
            return self.literal(term.value, term.datatype.value)
        return str(term)


def _line_of_xml_error(content: bytes) -> int | None:
    """The line at which a text stops being XML, for mistakes whose line the RDF parser does not tell."""
    try:
        expat.ParserCreate().Parse(content, True)
    except expat.ExpatError as error:
        return error.lineno
    return None
