"""RDF: terms and Python values, Turtle and RDF/XML files in, sorted Turtle out."""

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
from skiros2_common.core.json_data import read_json
from skiros2_common.core.property import from_text
from skiros2_world_model.core.datatypes import PYTHON_TYPES, literal_parts
from skiros2_world_model.core.prefixes import RDF, XSD, Prefixes, is_iri
from skiros2_world_model.core.xml_entities import check_expansion

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
                raise WrongValue(f"{text!r} is not JSON") from None
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


def term_json(term: Any) -> dict[str, str]:
    """Converts a term to the SPARQL JSON format."""
    if isinstance(term, ox.NamedNode):
        return {"type": "uri", "value": term.value}
    if isinstance(term, ox.BlankNode):
        return {"type": "bnode", "value": term.value}
    if not isinstance(term, ox.Literal):
        return {"type": "literal", "value": str(term)}  # a quoted triple
    kind = {"xml:lang": term.language} if term.language else {"datatype": term.datatype.value}
    return {"type": "literal", "value": term.value, **kind}


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
        raise WrongValue(f"{text!r} is not an RDF term: {error}") from None
    raise WrongValue(f'{text!r} is not an RDF term: expected prefix:Name, <IRI>, _:blank or "literal"')


def _parse_literal(text: str, prefixes: Prefixes) -> ox.Literal:
    declared = "".join(f"@prefix {prefix}: <{ns}> .\n" for prefix, ns in prefixes.namespaces().items())
    triples = list(ox.parse(f"{declared}<x:s> <x:p> {text} .", ox.RdfFormat.TURTLE))
    if len(triples) != 1 or not isinstance(triples[0].object, ox.Literal):
        raise WrongValue(f"{text!r} is not one literal")
    return triples[0].object


_XML_START = re.compile(rb"\s*<(\?xml|!DOCTYPE|!--|([A-Za-z][\w.-]*:)?RDF[\s>])")
_BYTE_ORDER_MARK = b"\xef\xbb\xbf"
_PLAIN_LOCAL = re.compile(r"\w[\w-]*", re.ASCII)
_PLAIN_TEXT = re.compile(r"[\w .:+-]*", re.ASCII)
_XSD_STRING = "http://www.w3.org/2001/XMLSchema#string"
_RDF_TYPE = "http://www.w3.org/1999/02/22-rdf-syntax-ns#type"


def read_triples(path: Path) -> list[ox.Triple]:
    """Reads a Turtle or RDF/XML file. The content decides the format, not the extension.

    :raises WrongValue: the file is missing or does not parse; the text names the file, the line and the error.
    """
    try:
        content = path.read_bytes()
    except OSError as error:
        raise WrongValue(f"{path}: cannot be read: {error.strerror or error}") from None
    return parse_triples(content, str(path))


def parse_triples(content: bytes, origin: str) -> list[ox.Triple]:
    """Parses a Turtle or RDF/XML text. Blank nodes get globally unique names.

    :param origin: the name of the file, for the message.
    :raises WrongValue: the text does not parse.
    """
    content = content.removeprefix(_BYTE_ORDER_MARK)
    is_xml = _XML_START.match(content) is not None
    if is_xml:
        check_expansion(content, origin)
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
        line, column = error.lineno, error.offset
        if not line and is_xml:
            line, column = _place_of_xml_error(content)
        place = f"{origin}, line {line}" + (f", column {column}" if column else "") if line else origin
        kind = "RDF/XML" if is_xml else "Turtle"
        refused = WrongValue(f"{place}: expected {kind}: {error.msg}")
        refused.position = line or 0, column or 0
        raise refused from None


def parse_n_triples(texts: Iterable[str]) -> list[ox.Triple]:
    """Parses triples from texts as `str(triple)` writes them. Blank nodes keep their names.

    :raises SyntaxError: a text is not a triple.
    """
    content = " .\n".join(texts)
    return [quad.triple for quad in ox.parse(f"{content} .", ox.RdfFormat.N_TRIPLES)] if content else []


def turtle(triples: Iterable[ox.Triple], prefixes: Mapping[str, str]) -> bytes:
    """Serializes triples as Turtle; see `TurtleWriter`."""
    writer = TurtleWriter(prefixes)
    for triple in triples:
        writer.add(triple)
    return writer.text()


def write_file(path: Path, content: bytes) -> None:
    """Writes a file atomically.

    :raises WrongValue: the file cannot be written.
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
    """Serializes statements as sorted Turtle, one statement per line, so that text diffs show what changed. Used once.

    :param prefixes: namespace by prefix.
    """

    def __init__(self, prefixes: Mapping[str, str]) -> None:
        self._prefixes = {namespace: prefix for prefix, namespace in prefixes.items() if prefix}
        self._nodes: dict[str, str] = {}
        self._used: set[str] = set()
        self._described: dict[str, set[str]] = {}
        self._paragraphs: dict[str, str] = {}

    def has(self, subject: str) -> bool:
        """Whether there are statements on a subject."""
        return subject in self._described

    def add_paragraph(self, subject: str, text: str) -> None:
        """Adds all statements on a subject as `text` would write them; it has no others."""
        self._paragraphs[subject] = text

    def statements_on(self, subject: str) -> set[str]:
        """The statements on a subject, to add to: `predicate object`, or ` class` with a space before it.

        A space sorts before all that predicates consist of: classes are the first, and `p:Size` is before `p:SizeX`.
        """
        return self._described.setdefault(subject, set())

    def text(self) -> bytes:
        """Serializes the statements, without duplicates."""
        for subject, statements in self._described.items():
            lines = [f"    {'a' if s[0] == ' ' else ''}{s} ;\n" for s in sorted(statements)]
            self._paragraphs[subject] = f"{subject}\n{''.join(lines)}.\n"
        paragraphs = [text for _, text in sorted(self._paragraphs.items())]
        namespaces = {prefix: namespace for namespace, prefix in self._prefixes.items()}
        header = "".join(f"@prefix {prefix}: <{namespaces[prefix]}> .\n" for prefix in sorted(self._used))
        return "\n".join([header, *paragraphs] if header else paragraphs).encode()

    def add(self, triple: ox.Triple) -> None:
        """Adds a triple."""
        predicate = self.predicate(triple.predicate.value)
        self.statements_on(self._term(triple.subject)).add(f"{predicate} {self._term(triple.object)}")

    def node(self, iri: str) -> str:
        """Serializes an IRI."""
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
        """Serializes the IRI of a predicate; "" for that of classes."""
        return "" if iri == _RDF_TYPE else self.node(iri)

    def literal(self, text: str, datatype: str) -> str:
        """Serializes a literal, given by its text and the IRI of its datatype."""
        return self.quoted(text) + self.datatype(datatype)

    def quoted(self, text: str) -> str:
        """Serializes a text."""
        return f'"{text}"' if _PLAIN_TEXT.fullmatch(text) else str(ox.Literal(text))

    def datatype(self, iri: str) -> str:
        """Serializes the datatype of a literal."""
        return "" if iri == _XSD_STRING else f"^^{self.node(iri)}"

    def _term(self, term: Any) -> str:
        if isinstance(term, ox.NamedNode):
            return self.node(term.value)
        if isinstance(term, ox.Literal) and not term.language:
            return self.literal(term.value, term.datatype.value)
        return str(term)


def _place_of_xml_error(content: bytes) -> tuple[int | None, int | None]:
    """The line and column of an XML syntax error, for errors that the RDF parser reports without them."""
    try:
        expat.ParserCreate().Parse(content, True)
    except expat.ExpatError as error:
        return error.lineno, error.offset + 1
    return None, None


def workspace_file(workspace: Path | None, filename: str) -> Path:
    """Resolves the path of a file of the workspace, whether it exists or not.

    :param filename: relative to the workspace, or absolute.
    :raises WrongValue: the path is outside the workspace or not a valid file name.
    """
    if not filename:
        raise WrongValue("the name of the file is missing")
    if "\0" in filename or any("\ud800" <= c <= "\udfff" for c in filename):
        raise WrongValue(f"{filename!r} cannot be the name of a file")
    if workspace is None:
        raise WrongValue(f"{filename}: the world model has no workspace folder")
    folder = workspace.absolute()
    path = Path(folder, filename)
    parts = path.parts[len(folder.parts) :]
    if not path.is_relative_to(folder) or ".." in parts or not parts:
        raise WrongValue(f"{filename}: expected a file in the workspace {folder}")
    return path
