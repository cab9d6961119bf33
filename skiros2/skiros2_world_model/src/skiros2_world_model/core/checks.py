"""Checks of the names, values and references in a request or file."""

from __future__ import annotations

import logging
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import pyoxigraph as ox

from skiros2_common.core.errors import SkirosError, UnknownName, WrongType, WrongValue
from skiros2_common.core.names import full_name, local_name
from skiros2_common.core.property import Property, as_type, format_value
from skiros2_world_model.core.datatypes import PYTHON_TYPES, as_datatype
from skiros2_world_model.core.knowledge_base import KnowledgeBase
from skiros2_world_model.core.ontology import Ontology
from skiros2_world_model.core.ontology_lint import (
    UNKNOWN_CLASS,
    UNKNOWN_PROPERTY,
    UNKNOWN_RELATION,
    WRONG_ENDS,
    did_you_mean,
)
from skiros2_world_model.core.prefixes import Prefixes, is_iri
from skiros2_world_model.core.report import VIOLATION, WARNING, Finding
from skiros2_world_model.core.scene import ElementRecord

log = logging.getLogger(__name__)

#: Names that are always valid in RDF. Other names are validated one by one.
_PLAIN_NAME = re.compile(r"([a-z]([a-z0-9_.-]*[a-z0-9_-])?)?:?\w[\w.-]*", re.ASCII)
#: The maximum nesting of lists and dicts in a value, well below the limit of JSON parsers.
_MAX_NESTING = 50
#: The maximum size of an integer; Python cannot format integers of much more than 10 000 bits.
_MAX_BITS = 4096
#: The maximum number of remembered warnings about unknown names.
_MAX_WARNED = 10_000


#: The kind of issue of a relation between wrong classes; other kinds are unknown names.
DOMAIN_RANGE = "domain or range"


class Checks:
    """The checks of one request.

    Unknown names, and relations between classes that the ontologies do not allow, are collected and logged at the end;
    with `strict` they are refused.

    :param origin: the author or file, for messages.
    :param warned: earlier warnings (origin, kind, name), which are not repeated; None: none.
    """

    def __init__(
        self,
        ontology: Ontology,
        prefixes: Prefixes,
        origin: str,
        strict: bool = False,
        warned: set[tuple[str, str, str]] | None = None,
    ) -> None:
        self.ontology = ontology
        self.prefixes = prefixes
        self.origin = origin
        self._strict = strict
        self._warned = warned
        self._known: dict[str, str] = {}  # full names of known properties, by given name
        self._unknown: dict[tuple[str, str], list[str]] = {}

    def class_name(self, name: str, who: str) -> str:
        """The full name of a class.

        :raises WrongValue: the name is invalid.
        """
        name = self.name(name, "class", who)
        if not self.ontology.has_class(name):
            self._add_issue("class", name, who)
        return name

    def relation_name(self, name: str, who: str) -> str:
        """The full name of a relation.

        :raises WrongValue: the name is invalid.
        """
        name = self.name(name, "relation", who)
        if not self.ontology.has_relation(name):
            self._add_issue("relation", name, who)
        return name

    def relation_ends(self, subject: ElementRecord, relation: str, obj: ElementRecord | None, who: str) -> None:
        """Reports a relation whose ends are not of the classes of its `rdfs:domain` and `rdfs:range`.

        :param obj: None when it is not an element of the scene.
        """
        for text in self.ontology.domain_range_violations(subject.type, relation, obj.type if obj is not None else ""):
            self._add_issue(DOMAIN_RANGE, text, who)

    def property_name(self, name: str, who: str) -> str:
        """The full name of a property.

        :raises WrongValue: the name is invalid, or stands for the class or label.
        """
        known = self._known.get(name)
        if known is not None:
            return known
        given, name = name, self.name(name, "property", who)
        if name in ("rdf:type", "rdfs:label"):
            raise WrongValue(f"{self.origin}: {who}: {name} is written as the element's class or label")
        if self.ontology.has_data_property(name):
            self._known[given] = name
        else:
            self._add_issue("property", name, who)
        return name

    def individual(self, name: str, who: str) -> str:
        """The full name of an individual that is not an element, such as a template.

        :raises WrongValue: the name is invalid.
        :raises UnknownName: the name has the form of an element id.
        """
        name = self.name(name, "element", who)
        if re.search(r"-\d+$", name):
            raise UnknownName(f"{self.origin}: {who}: there is no element {name!r}")
        if not self.ontology.knows(name):
            self._add_issue("individual", name, who)
        return name

    def property(self, etype: str, key: str, prop: Property, who: str) -> Property:
        """A copy of a property, converted to the datatype that the ontologies declare for a class.

        :raises WrongType: a value has another type.
        :raises WrongValue: there are more values than allowed.
        """
        key = self.property_name(key, who)
        try:
            checked = made_property(key, prop.values, self.ontology.value_limits(etype, key), prop.dataType())
            for value in checked.values:
                _check_plain(value, key)
        except (WrongType, WrongValue) as error:
            raise error.with_text(f"{self.origin}: {who}: {error}") from None
        return checked

    def plain_types(self, etype: str, key: str) -> tuple[type, ...]:
        """The types, of float, bool and str, of which `property` accepts any one value for a class without an issue;
        texts if they are Unicode, as those of files are."""
        datatype, most = self.ontology.value_limits(etype, key)
        is_known = self.full(key) == key and self.ontology.has_data_property(key)
        if not is_known or most == 0 or any(self.ontology.domain_range_violations(etype, key, "")):
            return ()
        kind = PYTHON_TYPES.get(datatype)
        return tuple(each for each in (float, bool, str) if kind in (None, each))

    def label(self, text: str, who: str) -> str:
        """Checks a label and returns it.

        :raises WrongValue: the text cannot be encoded.
        """
        try:
            _check_plain(str(text), "label")
        except WrongValue as error:
            raise WrongValue(f"{self.origin}: {who}: {error}") from None
        return text

    def report(self, who: str, what: str, error: SkirosError, done: str = "") -> None:
        """Reports a part of a file as wrong: refuses the file. `CollectingChecks` records it instead.

        :param who: the element; "": the file as a whole.
        :param what: its property or relation; "": the element as a whole.
        :param done: how loading handles it, if the file is not refused.
        :raises SkirosError: the error.
        """
        raise error

    def finish(self) -> None:
        """Logs each unknown name and each wrong relation once, unless it was logged before.

        :raises UnknownName, WrongValue: there are some, and the checks are strict.
        """
        lines = {}
        for (kind, name), users in self._unknown.items():
            others = f" and {len(users) - 1} more" if len(users) > 1 else ""
            lines[self.origin, kind, name] = f"{self.origin}: {issue_text(kind, name)} ({users[0]}{others})"
        if lines and self._strict:
            error = WrongValue if all(kind == DOMAIN_RANGE for _, kind, _ in lines) else UnknownName
            raise error("; ".join(lines.values()))
        for what, line in lines.items():
            if self._warned is None or what not in self._warned:
                log.warning("%s", line)
        if self._warned is not None:
            if len(self._warned) > _MAX_WARNED:
                self._warned.clear()
            self._warned.update(lines)

    def name(self, name: Any, kind: str, who: str) -> str:
        """The full name, known or not.

        :raises WrongValue: the name is invalid.
        """
        if isinstance(name, str):
            if _PLAIN_NAME.fullmatch(name):
                return self.full(name)
            try:
                node = ox.NamedNode(self.prefixes.iri(name) if name.strip(":") else "")
                if not name.endswith((":", "#")):
                    return self.prefixes.name(node.value)
            except ValueError:
                pass  # raised below
        raise WrongValue(f"{self.origin}: {who}: {name!r} cannot be the name of a {kind}")

    def full(self, name: str) -> str:
        """The name with its prefix, for a name or an IRI."""
        return self.prefixes.name(name) if is_iri(name) else full_name(name)

    def _add_issue(self, kind: str, name: str, who: str) -> None:
        users = self._unknown.setdefault((kind, name), [])
        if who not in users[-1:]:
            users.append(who)


def issue_text(kind: str, name: str) -> str:
    """Formats an issue."""
    return name if kind == DOMAIN_RANGE else f"unknown {kind} {name}"


def made_property(
    key: str, values: Iterable[Any], limits: tuple[str, int | None] = ("", None), empty_type: type = str
) -> Property:
    """Creates a property, converting its values to the datatype.

    :param limits: the datatype ("": any), and the maximum number of values (None: any).
    :param empty_type: the type of a property without values and datatype.
    :raises WrongType: a value cannot be converted to the datatype.
    :raises WrongValue: there are too many values.
    """
    datatype, most = limits
    given = list(values)
    if PYTHON_TYPES.get(datatype, str) is not str:
        given = [v for v in given if v != ""]  # existing scenes write an unknown number as ""
    if most is not None and len(given) > most:
        raise WrongValue(f"{key} has {len(given)} values {format_value(given)}, allowed are {most}")
    if datatype in PYTHON_TYPES:
        if len(given) == 1 and type(given[0]) is PYTHON_TYPES[datatype]:
            return Property(key, given[0])
        prop = Property(key, PYTHON_TYPES[datatype])
        try:
            prop.assign([as_datatype(v, datatype) for v in given])
        except WrongType as error:
            raise WrongType(f"{key}: {error}") from None
        return prop
    given = [_as_python(v) for v in given]
    kinds = {type(v) for v in given}
    if len(kinds) > 1:
        given = [as_type(v, float) for v in given] if kinds <= {int, float} else [str(v) for v in given]
    prop = Property(key, type(given[0]) if given else empty_type)
    if given:
        prop.assign(given)
    return prop


def _as_python(value: Any) -> Any:
    """Converts numbers and bools of other libraries to Python's; returns other values unchanged."""
    if isinstance(value, (str, bool, int, float, list, dict)):
        return value
    for kind in (bool, int, float):
        try:
            return as_type(value, kind)
        except WrongType:
            continue
    return value


def _check_plain(value: Any, key: str, depth: int = 0) -> None:
    """Raises an error for a value that RDF or messages cannot hold."""
    if type(value) is float:
        return
    if isinstance(value, str):
        if not value.isascii():
            try:
                value.encode()
            except UnicodeEncodeError as error:
                raise WrongValue(f"{key}: {format_value(value)} is not text: {error.reason}") from None
    elif isinstance(value, (list, tuple, dict)):
        if depth == _MAX_NESTING:
            raise WrongValue(f"{key}: lists and dicts are nested deeper than {_MAX_NESTING} levels")
        for item in value.values() if isinstance(value, dict) else value:
            _check_plain(item, key, depth + 1)
    elif isinstance(value, int) and value.bit_length() > _MAX_BITS:
        raise WrongValue(f"{key}: a number of more than {_MAX_BITS} bits")
    elif not isinstance(value, (int, float)) and (value is not None or not depth):
        raise WrongType(
            f"{key}: expected text, numbers, bools, lists or dicts, got {type(value).__name__} {format_value(value)}"
        )


#: The maximum number of unknown names of a file for which the nearest name is searched; each takes some ms.
_MAX_HINTS = 20
#: By kind of issue.
_CODES = {"class": UNKNOWN_CLASS, "relation": UNKNOWN_RELATION, "property": UNKNOWN_PROPERTY, DOMAIN_RANGE: WRONG_ENDS}

KEPT = "kept"
LEFT_OUT = "left out"


class CollectingChecks(Checks):
    """Checks that collect findings instead of raising errors."""

    def __init__(self, knowledge_base: KnowledgeBase, origin: str, strict: bool) -> None:
        super().__init__(knowledge_base.index, knowledge_base.prefixes, origin, strict)
        self.findings: dict[Finding, str] = {}  #: each finding, and how loading handles it

    def report(self, who: str, what: str, error: SkirosError, done: str = LEFT_OUT) -> None:
        text = str(error).removeprefix(f"{self.origin}: ")
        if text.startswith((f"{who}: ", f"{who} {what} ")):  # the finding names them itself
            text = text.partition(": ")[2]
        text = text.removeprefix(f"{what}: ")
        self.findings[Finding(VIOLATION, self.origin, who, what, text)] = done

    def property(self, etype: str, key: str, prop: Property, who: str) -> Property:
        checked = super().property(etype, key, prop, who)
        for text in self.ontology.domain_range_violations(etype, self.full(key), ""):
            self._add_issue(DOMAIN_RANGE, text, who)
        return checked

    def finish(self) -> None:
        severity = VIOLATION if self._strict else WARNING
        for number, ((kind, name), users) in enumerate(self._unknown.items()):
            element, *predicate = users[0].split(" ")  # an element, or a relation
            prop = predicate[0] if predicate else name if kind in ("property", "relation") else ""
            others = f" ({len(users) - 1} more have it)" if len(users) > 1 else ""
            near = did_you_mean(name, self._known_names(kind)) if number < _MAX_HINTS else ""
            text = f"{issue_text(kind, name)}{near}{others}"
            finding = Finding(severity, self.origin, element, prop, text, _CODES.get(kind, ""))
            self.findings[finding] = KEPT

    def _known_names(self, kind: str) -> list[str]:
        """The declared names of a kind of name."""
        ontology = self.ontology
        if kind == "class":
            return [name for name in ontology.classes() if ontology.types(name)]
        return {"relation": ontology.relations, "property": ontology.data_properties}.get(kind, list)()


class FileChecks(CollectingChecks):
    """Checks of a loaded file: all findings are logged in one warning; with `strict` they refuse the file."""

    def __init__(self, knowledge_base: KnowledgeBase, path: Path, strict: bool) -> None:
        super().__init__(knowledge_base, str(path), strict)
        self._path = path

    def finish(self) -> None:
        """Logs all findings in one warning.

        :raises WrongValue: there are findings, and the checks are strict; the text lists all of them.
        """
        super().finish()
        if not self.findings:
            return
        lines = SourceLines(self._path)
        text = "\n    ".join(self._format(*finding, lines) for finding in self.findings.items())
        count = f"{len(self.findings)} problem{'s' if len(self.findings) > 1 else ''}"
        if self._strict:
            raise WrongValue(f"{self._path}: refused with {count}:\n    {text}")
        log.warning("%s: loaded with %s:\n    %s", self._path, count, text)

    def _format(self, found: Finding, done: str, lines: SourceLines) -> str:
        line = lines.find(found.element, found.property)
        location = f"{self._path}, line {line}" if line else str(self._path)
        what = " ".join(part for part in (found.element, found.property) if part)
        text = ": ".join(part for part in (location, what, found.text) if part)
        return text if self._strict else f"{text}; {done}"


class SourceLines:
    """Finds the lines of names in a Turtle or RDF/XML file."""

    def __init__(self, path: Path) -> None:
        try:
            self._lines = path.read_text(errors="replace").splitlines()
        except OSError:
            self._lines = []

    def find(self, element: str, prop: str = "") -> int | None:
        """The line number (from 1) of an element's description, or of its property there; None when it is not found."""
        if not element:
            return None
        name = _token(element)
        subject = re.compile(rf"(?:^|\.)\s*(?:[\w.-]*:|<[^<>\s]*[#/]){name}|about=\"[^\"]*{name}")
        start = next((i for i, line in enumerate(self._lines) if subject.search(line)), None)
        if start is None or not prop:
            return None if start is None else start + 1
        wanted = re.compile(rf"[:#/<]{_token(prop)}")
        for index in range(start, len(self._lines)):
            if wanted.search(self._lines[index]):
                return index + 1
            if index > start and subject.pattern and _ENDS.search(self._lines[index]):
                break
        return start + 1

    def mention(self, name: str) -> int | None:
        """The number of the first line with a name (`prefix:Local`, or `prefix:` for its declaration)."""
        if not name:
            return None
        pattern = rf"(?<![\w.-]){re.escape(name)}(?![\w-])" if local_name(name) else f"prefix {re.escape(name)}"
        wanted = re.compile(pattern)
        return next((i + 1 for i, line in enumerate(self._lines) if wanted.search(line)), None)


#: The end of a description: of a Turtle statement, or of an RDF/XML element.
_ENDS = re.compile(r"(?:^|\s)\.\s*(?:#.*)?$|^\s*</(?:\w+:)?(?:NamedIndividual|Description)>")


def _token(name: str) -> str:
    return re.escape(local_name(name).rpartition("#")[2]) + r"(?![\w-])"
