"""The knowledge base: all graphs, the ontologies with their index, the prefixes, queries, and the advisory lock."""

from __future__ import annotations

import json
import logging
import os
import threading
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import pyoxigraph as ox

from skiros2_common.core.errors import ConfigurationError, UnknownName, WrongValue
from skiros2_common.core.operations import ONTOLOGY, Statement
from skiros2_world_model.core.ontology import ALIVE_QUERY, STRUCTURE_QUERY, NamedTriple, Ontology
from skiros2_world_model.core.ontology_lint import OntologyLint, literal_findings
from skiros2_world_model.core.prefixes import OWL, Prefixes
from skiros2_world_model.core.query_budget import QueryBudgets
from skiros2_world_model.core.query_store import WorkerStore
from skiros2_world_model.core.rdf import RDF_TYPE, parse_term, python_value, read_triples, term_json, term_text
from skiros2_world_model.core.report import Finding
from skiros2_world_model.core.triple_store import Answer, StoreLost, TripleStore

log = logging.getLogger(__name__)

_ONTOLOGY_CLASS = ox.NamedNode(OWL + "Ontology")

#: The maximum number of logged mistakes of a file.
_MAX_LOGGED = 10

#: Files of the workspace whose names contain this are ontologies.
_ONTOLOGY_INFIX = ".owl"


def is_shapes_file(name: str) -> bool:
    """Whether a file with this name holds shapes."""
    return ".shapes." in name


def shape_files(*folders: Path | None) -> list[Path]:
    """The shape files in folders and their subfolders, without duplicates.

    :raises ConfigurationError: a file does not parse.
    """
    found: dict[Path, Path] = {}
    for folder in folders:
        for parent, _, names in os.walk(folder) if folder is not None else ():
            for name in filter(is_shapes_file, names):
                path = Path(parent, name)
                found.setdefault(path.resolve(), path)
    files = sorted(found.values())
    for path in files:
        try:
            read_triples(path)
        except WrongValue as error:
            raise ConfigurationError(f"shapes {error}") from None
    return files


def is_knowledge_file(name: str) -> bool:
    """Whether a file of the workspace with this name holds an ontology or shapes."""
    return _ONTOLOGY_INFIX in name or is_shapes_file(name)


class KnowledgeBase:
    """The graphs of all contexts and of the ontologies, with an index of the ontologies.

    :param ontologies: folder of the package's ontologies (`.ttl` files).
    :param workspace: folder of the user's ontologies: all files in it and its subfolders whose names contain `.owl`. In
        both folders, files whose names contain `.shapes.` hold shapes.
    :param store: the triple store that answers queries; None: a `WorkerStore`.
    :param skip_broken: logs and skips a file of the workspace that does not parse.
    :raises ConfigurationError: a folder is missing, or a file does not parse (the text names file and line).
    """

    def __init__(
        self,
        ontologies: Path | None = None,
        workspace: Path | None = None,
        store: TripleStore | None = None,
        skip_broken: bool = False,
    ) -> None:
        self.prefixes = Prefixes()
        self.store = WorkerStore() if store is None else store
        self.budgets = QueryBudgets()
        self.lock = threading.RLock()
        self._index: Ontology | None = None
        #: The files with shapes for validation.
        self.shapes = shape_files(ontologies, workspace)
        files = _ontology_files(ontologies, workspace)
        self._files = frozenset(path.resolve() for path in files)
        own = ontologies.resolve() if ontologies is not None else None
        given = [path for path in files if path.parent.resolve() != own]
        self._load(files, given if skip_broken else (), given)

    @property
    def index(self) -> Ontology:
        """The index of the current ontologies. Immutable: a change of the ontologies creates a new one."""
        index = self._index
        if index is None:
            with self.lock:
                index = self._index = Ontology(self._named(t) for t in self.store.triples(ONTOLOGY))
        return index

    def reads(self, path: Path) -> bool:
        """Whether a file is read as an ontology or as shapes, now or at the next start; no scene may overwrite it."""
        return path.resolve() in self._files or is_knowledge_file(path.name)

    def triples(self) -> list[ox.Triple]:
        """All triples of the ontologies."""
        return self.store.triples(ONTOLOGY)

    def update(self, removed: Iterable[ox.Triple], added: Iterable[ox.Triple]) -> bool:
        """Removes triples from the ontologies and adds others. Returns False when nothing changes."""
        with self.lock:
            removed, added = self.new(removed, added)
            if not removed and not added:
                return False
            for triple in added:
                self._declare(triple)
            self.store.update(ONTOLOGY, removed, added)
            index = self._index
            only_classes = index and not removed and index.with_classes([self._named(t) for t in added])
            self._index = only_classes or None
        return True

    def new(self, removed: Iterable[ox.Triple], added: Iterable[ox.Triple]) -> tuple[list[ox.Triple], list[ox.Triple]]:
        """Filters triples to remove and to add down to those that change the ontologies."""
        return (
            [t for t in removed if self.store.has(ONTOLOGY, t)],
            [t for t in added if not self.store.has(ONTOLOGY, t)],
        )

    def modify(self, statements: Sequence[Statement], author: str, context: str = "") -> bool:
        """Adds and removes statements, all or none. Returns False when nothing changes.

        :param context: "" or `ontology`.
        :raises WrongValue: a text is not an RDF term.
        :raises UnknownName: it is another context.
        """
        if context not in ("", ONTOLOGY):
            raise UnknownName(f"{author}: there is no context {context!r}; this node serves only the ontologies")
        return self.update(*self.split(statements))

    def split(self, statements: Sequence[Statement]) -> tuple[list[ox.Triple], list[ox.Triple]]:
        """Parses statements into the triples to remove and those to add.

        :raises WrongValue: a text is not an RDF term.
        """
        removed: list[ox.Triple] = []
        added: list[ox.Triple] = []
        for subject, predicate, obj, value in statements:
            (added if value else removed).append(self.triple(subject, predicate, obj))
        return removed, added

    def triple(self, subject: str, predicate: str, obj: str) -> ox.Triple:
        """Parses a triple.

        :raises WrongValue: a text is not an RDF term, or not valid in its position.
        """
        s, p, o = (parse_term(text, self.prefixes) for text in (subject, predicate, obj))
        if isinstance(s, ox.Literal) or not isinstance(p, ox.NamedNode):
            raise WrongValue(f"{subject} {predicate} {obj} is not an RDF statement")
        return ox.Triple(s, p, o)

    def query(
        self,
        query: str,
        context: str = "",
        cut_prefix: bool = True,
        flush: Callable[[], None] = lambda: None,
        caller: str = "",
    ) -> list[str]:
        """Answers a SPARQL query with a text for each row; in rows of several columns a space follows each value.

        :param context: the context to query; "": all.
        :param cut_prefix: returns `prefix:name` and plain values instead of N3.
        :param flush: writes pending changes to the store. Called under the lock; the query runs without it.
        :param caller: whose budget the query uses; "": none.
        :raises WrongValue: the query cannot be answered.
        :raises TimedOut: the query takes too long.
        :raises Refused: the store is not available, or the caller's budget is used up.
        """
        rows = self._answer(query, context, flush, caller).rows
        texts = ([term_text(term, self.prefixes, cut_prefix) for term in row] for row in rows)
        return [row[0] if len(row) == 1 else "".join(f"{text} " for text in row) for row in texts]

    def query_json(
        self, query: str, context: str = "", flush: Callable[[], None] = lambda: None, caller: str = ""
    ) -> str:
        """Answers a SPARQL query in the SPARQL JSON format; see `query`."""
        names, rows = self._answer(query, context, flush, caller)
        if not names:
            return json.dumps({"head": {}, "boolean": rows[0][0].value == "true"})
        bindings = [{n: term_json(t) for n, t in zip(names, row, strict=True) if t is not None} for row in rows]
        return json.dumps({"head": {"vars": names}, "results": {"bindings": bindings}})

    def _answer(self, query: str, context: str, flush: Callable[[], None], caller: str) -> Answer:
        if context == ONTOLOGY and query in (STRUCTURE_QUERY, ALIVE_QUERY):
            return self._answer_of_clients(query)
        for attempt in (1, 2, 3):
            try:
                if context != ONTOLOGY:
                    self.store.prepare()
                with self.lock:
                    generation = self.store.generation
                    flush()
                self.store.sync()
                with self.budgets.query(caller):
                    answer = self.store.query(query, context, self.prefixes.namespaces())
                if generation == self.store.generation:
                    return answer
            except StoreLost:
                if attempt == 3:
                    raise
        raise StoreLost("SPARQL: the graphs were lost again and again while they were queried; try again")

    def _answer_of_clients(self, query: str) -> Answer:
        """The answers that every client needs, whatever happens to the processes for queries."""
        if query == ALIVE_QUERY:
            return Answer([], [(ox.Literal(True),)])
        triples = self.store.triples(ONTOLOGY)
        rows = [(t.subject, t.predicate, t.object) for t in triples if not isinstance(t.object, ox.Literal)]
        return Answer(["s", "p", "o"], rows)

    # -- loading -----------------------------------------------------------------------------------------------

    def _load(self, files: Sequence[Path], skipped: Sequence[Path], linted: Sequence[Path]) -> None:
        """Reads the ontologies.

        :param skipped: files that are logged and skipped when they do not parse.
        :param linted: files whose mistakes are logged.
        """
        loaded: list[tuple[Path, list[ox.Triple]]] = []
        for path in files:
            try:
                loaded.append((path, read_triples(path)))
            except WrongValue as error:
                if path not in skipped:
                    raise ConfigurationError(f"ontology {error}") from None
                log.error("ontology %s; the file is skipped", error)
        known = self.store.knowledge()
        for triples in [*(triples for _, triples in loaded), known]:
            for triple in triples:
                self._declare(triple)
            self.store.extend(ONTOLOGY, triples)
        for path, triples in loaded:
            if path in linted and (found := self.lint(path, triples)):
                lines = [str(finding) for finding in found[:_MAX_LOGGED]]
                more = [f"and {len(found) - len(lines)} more"] if len(found) > len(lines) else []
                count = "1 mistake" if len(found) == 1 else f"{len(found)} mistakes"
                log.warning("\n    ".join([f"ontology {path} has {count}:", *lines, *more]))

    def _declare(self, triple: ox.Triple) -> None:
        is_declared = triple.predicate == RDF_TYPE and triple.object == _ONTOLOGY_CLASS
        if is_declared and isinstance(triple.subject, ox.NamedNode):
            prefix = self.prefixes.add_ontology(triple.subject.value)
            if not self.prefixes.has(prefix):
                log.warning("ontology %s: another ontology has its prefix; its names stay IRIs", triple.subject.value)

    def _named(self, triple: ox.Triple) -> NamedTriple:
        obj: Any = triple.object
        if isinstance(obj, ox.Literal):
            datatype = self.prefixes.name(obj.datatype.value)
            try:
                obj = (python_value(obj), datatype)
            except WrongValue:
                obj = (obj.value, "xsd:string")
        else:
            obj = self._node_name(obj)
        return self._node_name(triple.subject), self.prefixes.name(triple.predicate.value), obj

    def _node_name(self, node: Any) -> str:
        return self.prefixes.name(node.value) if isinstance(node, ox.NamedNode) else str(node)

    def lint(self, path: Path, triples: Sequence[ox.Triple] | None = None) -> list[Finding]:
        """The mistakes in an ontology file that is loaded.

        :param triples: those of the file; None: they are read.
        :raises WrongValue: the file does not parse.
        """
        triples = read_triples(path) if triples is None else triples
        described = {self._node_name(triple.subject) for triple in self.triples()}
        named = OntologyLint(self.index, described).findings(path, map(self._named, triples))
        return [*literal_findings(path, triples, self.prefixes), *named]


def _ontology_files(ontologies: Path | None, workspace: Path | None) -> list[Path]:
    files: list[Path] = []
    if ontologies is not None:
        files += sorted(_folder(ontologies, "ontologies").glob("*.ttl"))
    if workspace is not None:
        found = [
            Path(folder, name)
            for folder, _, names in os.walk(_folder(workspace, "workspace"))
            for name in names
            if _ONTOLOGY_INFIX in name
        ]
        files += sorted(found)
    return [path for path in files if not is_shapes_file(path.name)]


def _folder(path: Path, what: str) -> Path:
    if not path.is_dir():
        raise ConfigurationError(f"{what} folder {path}: there is no such folder")
    return path


class AdvisoryLock:
    """A lock with one owner, which any client may release. Thread-safe."""

    def __init__(self) -> None:
        self._free = threading.Condition()
        self.owner: str | None = None

    def acquire(self, owner: str, timeout: float | None = None) -> bool:
        """Blocks until the lock is free and acquires it. Returns False at the timeout.

        :param owner: the name of the new owner.
        :param timeout: in s; None: no limit.
        """
        with self._free:
            if not self._free.wait_for(lambda: self.owner is None, timeout):
                return False
            self.owner = owner
            return True

    def release(self, owner: str | None = None) -> bool:
        """Releases the lock. Returns False when it is free, or held by another owner than `owner` (None: any)."""
        with self._free:
            if self.owner is None or owner not in (None, self.owner):
                return False
            self.owner = None
            self._free.notify()
            return True
