"""Checks of what a request or a file brings: names, values, references."""

from __future__ import annotations

import logging
import re
from collections.abc import Iterable
from typing import Any

import pyoxigraph as ox

from skiros2_common.core.errors import SkirosError, UnknownName, WrongType, WrongValue
from skiros2_common.core.names import full_name
from skiros2_common.core.property import Property, as_type, format_value
from skiros2_world_model.core.datatypes import PYTHON_TYPES, as_datatype
from skiros2_world_model.core.ontology import Ontology
from skiros2_world_model.core.prefixes import Prefixes, is_iri
from skiros2_world_model.core.scene import ElementRecord

log = logging.getLogger(__name__)

#: Names that RDF can always hold. Others are tried.
_PLAIN_NAME = re.compile(r"([a-z]([a-z0-9_.-]*[a-z0-9_-])?)?:?\w[\w.-]*", re.ASCII)
#: How deep lists and dicts in a value may be nested: far more than anybody needs, far less than JSON can take.
_MOST_NESTED = 50
#: How long a whole number may be; Python itself writes none of much more than 10 000 bits.
_MOST_BITS = 4096
#: So many unknown names are remembered as told.
_TOLD_AT_MOST = 10_000


#: The kind of a note on a relation between wrong classes; other kinds are those of unknown names.
MISFIT = "misfit"


class Checks:
    """The checks of one request.

    Names that the ontologies do not know, and relations between classes that they do not allow, are noted, and warned
    of at the end; with `strict` they are refused.

    :param origin: who or what brings the names: an author, or a file.
    :param told: what was warned of before (origin, kind, name) and is not repeated; None: everything is told.
    """

    def __init__(
        self,
        ontology: Ontology,
        prefixes: Prefixes,
        origin: str,
        strict: bool = False,
        told: set[tuple[str, str, str]] | None = None,
    ) -> None:
        self._ontology = ontology
        self._prefixes = prefixes
        self._origin = origin
        self._strict = strict
        self._warned = told
        self._known: dict[str, str] = {}  # properties in full, by their names as given
        self._unknown: dict[tuple[str, str], list[str]] = {}

    def class_name(self, name: str, who: str) -> str:
        """The class in full.

        :raises WrongValue: it cannot be a name.
        """
        name = self.name(name, "class", who)
        if not self._ontology.has_class(name):
            self._note("class", name, who)
        return name

    def relation_name(self, name: str, who: str) -> str:
        """The relation in full.

        :raises WrongValue: it cannot be a name.
        """
        name = self.name(name, "relation", who)
        if not self._ontology.has_relation(name):
            self._note("relation", name, who)
        return name

    def relation_ends(self, subject: ElementRecord, relation: str, obj: ElementRecord | None, who: str) -> None:
        """Notes a relation whose ends are not of the classes of its `rdfs:domain` and `rdfs:range`.

        :param obj: None when it is no element of the scene.
        """
        for text in self._ontology.misfits(subject.type, relation, obj.type if obj is not None else ""):
            self._note(MISFIT, text, who)

    def property_name(self, name: str, who: str) -> str:
        """The property in full.

        :raises WrongValue: it cannot be a name, or is kept elsewhere.
        """
        known = self._known.get(name)
        if known is not None:
            return known
        given, name = name, self.name(name, "property", who)
        if name in ("rdf:type", "rdfs:label"):
            raise WrongValue(f"{self._origin}: {who}: {name} is written as the element's class or label")
        if self._ontology.has_data_property(name):
            self._known[given] = name
        else:
            self._note("property", name, who)
        return name

    def individual(self, name: str, who: str) -> str:
        """The name in full of something that is no element: a template, say.

        :raises WrongValue: it cannot be a name.
        :raises UnknownName: it looks like the id of an element.
        """
        name = self.name(name, "element", who)
        if re.search(r"-\d+$", name):
            raise UnknownName(f"{self._origin}: {who}: there is no element {name!r}")
        if not self._ontology.knows(name):
            self._note("individual", name, who)
        return name

    def property(self, etype: str, key: str, prop: Property, who: str) -> Property:
        """A property of its own for an element of a class, of the datatype that the ontologies tell.

        :raises WrongType: a value is of another type.
        :raises WrongValue: there are more values than allowed.
        """
        key = self.property_name(key, who)
        try:
            checked = made_property(key, prop.values, self._ontology.value_limits(etype, key), prop.dataType())
            for value in checked.values:
                _check_plain(value, key)
        except (WrongType, WrongValue) as error:
            raise type(error)(f"{self._origin}: {who}: {error}") from None
        return checked

    def label(self, text: str, who: str) -> str:
        """A label.

        :raises WrongValue: it is no text that can be written.
        """
        try:
            _check_plain(str(text), "label")
        except WrongValue as error:
            raise WrongValue(f"{self._origin}: {who}: {error}") from None
        return text

    def refuse(self, who: str, what: str, error: SkirosError, done: str = "") -> None:
        """Something in a file is refused, and so is the file; checks that go on note it.

        :param who: the element, "" for the file as a whole.
        :param what: its property or relation, "" for the element as a whole.
        :param done: what is done about it when the checks go on.
        :raises SkirosError: the error.
        """
        raise error

    def finish(self) -> None:
        """Warns of the unknown names, once for each, if they were not told before.

        :raises UnknownName, WrongValue: there are some, and the checks are strict.
        """
        lines = {}
        for (kind, name), users in self._unknown.items():
            others = f" and {len(users) - 1} more" if len(users) > 1 else ""
            lines[self._origin, kind, name] = f"{self._origin}: {noted(kind, name)} ({users[0]}{others})"
        if lines and self._strict:
            error = WrongValue if all(kind == MISFIT for _, kind, _ in lines) else UnknownName
            raise error("; ".join(lines.values()))
        for what, line in lines.items():
            if self._warned is None or what not in self._warned:
                log.warning("%s", line)
        if self._warned is not None:
            if len(self._warned) > _TOLD_AT_MOST:
                self._warned.clear()
            self._warned.update(lines)

    def name(self, name: Any, kind: str, who: str) -> str:
        """A name in full, known or not.

        :raises WrongValue: it cannot be a name.
        """
        if isinstance(name, str):
            if _PLAIN_NAME.fullmatch(name):
                return self.full(name)
            try:
                node = ox.NamedNode(self._prefixes.iri(name) if name.strip(":") else "")
                if not name.endswith((":", "#")):
                    return self._prefixes.name(node.value)
            except ValueError:
                pass  # said below
        raise WrongValue(f"{self._origin}: {who}: {name!r} cannot be the name of a {kind}")

    def full(self, name: str) -> str:
        """A name with its prefix, from an IRI too."""
        return self._prefixes.name(name) if is_iri(name) else full_name(name)

    def _note(self, kind: str, name: str, who: str) -> None:
        users = self._unknown.setdefault((kind, name), [])
        if who not in users[-1:]:
            users.append(who)


def noted(kind: str, name: str) -> str:
    """The text of a note."""
    return name if kind == MISFIT else f"unknown {kind} {name}"


def made_property(
    key: str, values: Iterable[Any], limits: tuple[str, int | None] = ("", None), empty_type: type = str
) -> Property:
    """A property with those values.

    :param limits: the datatype ("": any), and the highest number of values (None: any).
    :param empty_type: its type when there is no value and the datatype tells none.
    :raises WrongType: a value is not of the datatype.
    :raises WrongValue: there are too many values.
    """
    datatype, most = limits
    given = list(values)
    if PYTHON_TYPES.get(datatype, str) is not str:
        given = [v for v in given if v != ""]  # how scenes in the field write a number that is not known
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
    """Numbers and bools of other libraries as Python's; other values as they are."""
    if isinstance(value, (str, bool, int, float, list, dict)):
        return value
    for kind in (bool, int, float):
        try:
            return as_type(value, kind)
        except WrongType:
            continue
    return value


def _check_plain(value: Any, key: str, depth: int = 0) -> None:
    """Raises when a value cannot be written, as RDF and in messages."""
    if type(value) is float:
        return
    if isinstance(value, str):
        if not value.isascii():
            try:
                value.encode()
            except UnicodeEncodeError as error:
                raise WrongValue(f"{key}: {format_value(value)} is no text: {error.reason}") from None
    elif isinstance(value, (list, tuple, dict)):
        if depth == _MOST_NESTED:
            raise WrongValue(f"{key}: lists and dicts are nested deeper than {_MOST_NESTED} levels")
        for item in value.values() if isinstance(value, dict) else value:
            _check_plain(item, key, depth + 1)
    elif isinstance(value, int) and value.bit_length() > _MOST_BITS:
        raise WrongValue(f"{key}: a number of more than {_MOST_BITS} bits")
    elif not isinstance(value, (int, float)) and (value is not None or not depth):
        raise WrongType(
            f"{key}: expected text, numbers, bools, lists or dicts, got {type(value).__name__} {format_value(value)}"
        )
