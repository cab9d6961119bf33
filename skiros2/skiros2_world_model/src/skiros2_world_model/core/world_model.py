"""The world model: contexts with scenes, ontologies, and requests that are checked, atomic, numbered and published."""

from __future__ import annotations

import logging
import threading
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from functools import partial
from pathlib import Path

import pyoxigraph as ox

from skiros2_common.core.collector import collector_paused
from skiros2_common.core.discrete_reasoner import DiscreteReasoner
from skiros2_common.core.errors import ConfigurationError, Refused, SkirosError, UnknownName, WrongValue
from skiros2_common.core.names import full_name
from skiros2_common.core.operations import (
    ONTOLOGY,
    RESET,
    SCENE,
    UPDATE,
    Apply,
    Change,
    Operation,
    Outcome,
    Relate,
    Statement,
)
from skiros2_common.core.world_element import Element
from skiros2_world_model.core.change_notifier import ChangeNotifier, Listener, PendingChange, pending_changes
from skiros2_world_model.core.checks import Checks
from skiros2_world_model.core.context import Context, Contexts, element_operations
from skiros2_world_model.core.file_content import FileContent
from skiros2_world_model.core.history import History
from skiros2_world_model.core.journal import Journal, JournalState, first_number, recorded_state
from skiros2_world_model.core.knowledge_base import AdvisoryLock, KnowledgeBase
from skiros2_world_model.core.ontology import Ontology
from skiros2_world_model.core.prefixes import is_iri
from skiros2_world_model.core.queries import SceneReader
from skiros2_world_model.core.rdf import parse_n_triples, workspace_file, write_file
from skiros2_world_model.core.reasoning import Reasoning
from skiros2_world_model.core.report import Finding
from skiros2_world_model.core.request import Part, numbered_line
from skiros2_world_model.core.request_batch import Batch, Transact
from skiros2_world_model.core.scene import Scene
from skiros2_world_model.core.transaction import template_element
from skiros2_world_model.core.triple_store import TripleStore
from skiros2_world_model.core.validation import keep_refused

log = logging.getLogger(__name__)


class WorldModel:
    """The knowledge that all robots of a cell share. Thread-safe: one lock, `lock`, guards everything.

    :param ontologies: folder of the package's ontologies; None: none.
    :param workspace: folder of the user's ontologies and scenes; None: files cannot be loaded or saved.
    :param strict: refuses names that the ontologies do not declare.
    :param journal: records every change; the world model recovers from it if the journal says so. None: no journal.
    :param initial: contexts and the files to load them from, when the world model does not recover.
    :param store: the triple store that answers queries; None: a `WorkerStore`.
    :param knowledge_base: the ontologies, in place of those of the folders; its store has no context.
    :param blank_on_error: logs and skips an initial file, or an ontology of the workspace, that is refused.
    :param recorded: the journal of another process, in place of an own one: the world model starts from its present
        state, and records nothing.
    :raises ConfigurationError: a folder is missing, an ontology does not parse, or an initial file is refused.
    """

    def __init__(
        self,
        ontologies: Path | None = None,
        workspace: Path | None = None,
        strict: bool = False,
        journal: Journal | None = None,
        initial: Iterable[tuple[str, str]] = (),
        store: TripleStore | None = None,
        blank_on_error: bool = False,
        knowledge_base: KnowledgeBase | None = None,
        recorded: Path | None = None,
    ) -> None:
        self.knowledge_base = knowledge_base or KnowledgeBase(ontologies, workspace, store, blank_on_error)
        self.lock = self.knowledge_base.lock
        self.reasoning = Reasoning()
        self._workspace = workspace
        self._using_files = threading.Lock()  # one load or save at a time, most of which needs no other lock
        self.strict = strict
        self.loaded: dict[str, Path] = {}  #: by context, the last loaded file
        self._readable: set[Path] = set()  # files that were loaded or saved by this world model
        self.findings: dict[str, frozenset[Finding]] = {}  #: by context, the findings that loading the file reported
        self.refused: dict[str, str] = {}  #: by context, why its initial file was refused
        self._contexts = Contexts(self.knowledge_base)
        self._warned: set[tuple[str, str, str]] = set()
        self.advisory_lock = AdvisoryLock()
        self.reader = self.reader_under(self.lock)
        self._journal: Journal | None = None
        self._recorded = journal.path if journal is not None else recorded
        state = journal.restore() if journal is not None else recorded_state(recorded) if recorded is not None else None
        #: Whether the state was recovered from the journal.
        self.recovered = state is not None
        if state is not None:
            self._notifier = ChangeNotifier(state.number, state.session)
            self._recover(state)
            log.info("the world model has recovered from its journal %s: %s", self._recorded, state)
        else:
            self._notifier = ChangeNotifier(max(first_number(), journal.last if journal is not None else 0))
            for context, file in initial:
                self.load_initial(file, context, blank_on_error)
            if journal is not None:
                change_info = self._notifier.next("wm")
                contents = [(c.name, c.scene, list(map(str, c.extras)), c.file) for c in self._contexts.values()]
                journal.start(self._notifier.session, change_info, contents)
                self._notifier.publish([PendingChange(RESET)], change_info, SCENE, self.scene())
        self._journal = journal

    # -- reading -----------------------------------------------------------------------------------------------

    @property
    def number(self) -> int:
        """The number of the last change."""
        return self._notifier.number

    @property
    def snapshot_id(self) -> str:
        """The name of the current state."""
        return self._notifier.snapshot_id

    @property
    def ontology(self) -> Ontology:
        """The index of the current ontologies."""
        return self.knowledge_base.index

    def contexts(self) -> list[str]:
        return list(self._contexts)

    def scene(self, context: str = SCENE) -> Scene:
        """The scene of a context, which is created when it does not exist. Read it under the lock.

        :raises WrongValue: the name is invalid.
        """
        return self._contexts.named(context).scene

    def scenes(self, context: str) -> list[Scene]:
        """The scene of a context, or for "" the scenes of all contexts. Read them under the lock."""
        return [self._contexts.named(context).scene] if context else self._contexts.scenes()

    def file_of(self, context: str) -> str:
        """The file that a context was last loaded from or saved to (successfully or not); "" when there is none."""
        return self._contexts.named(context).file

    def reader_under(self, lock: threading.RLock) -> SceneReader:
        """Creates a reader of the scenes of all contexts."""
        return SceneReader(lock, self.scenes, lambda: self.knowledge_base.index, self._contexts.home)

    def template(self, name: str) -> Element:
        """Returns a template as an element without id.

        :raises UnknownName: it does not exist.
        """
        return template_element(self.ontology, self.knowledge_base.prefixes.name(name) if is_iri(name) else name)

    @property
    def history(self) -> History:
        """Access to past states and changes. Use it without the lock, so that no request waits for it.

        :raises Refused: the world model has no journal.
        """
        if self._recorded is None:
            raise Refused("the world model has no journal, so its history is unknown")
        return History(self._recorded, None if self._journal is None else self._journal.flush)

    def query(self, query: str, context: str = "", cut_prefix: bool = True, caller: str = "") -> list[str]:
        """Answers a SPARQL query with a text for each row.

        :param context: the context to query; "": all, `ontology`: only the ontologies.
        :param caller: whose budget the query uses; "": none.
        :raises WrongValue: the query cannot be answered.
        """
        return self.knowledge_base.query(query, context, cut_prefix, lambda: self._flush(context), caller)

    def query_json(self, query: str, context: str = "", caller: str = "") -> str:
        """Answers a SPARQL query in the SPARQL JSON format; see `query`."""
        return self.knowledge_base.query_json(query, context, lambda: self._flush(context), caller)

    def _flush(self, context: str) -> None:
        for name in [context] if context else self._contexts:
            if name != ONTOLOGY:
                self._contexts.named(name).flush()

    def triples(self, context: str = SCENE) -> Iterator[ox.Triple]:
        """The triples of a context in its current state, generated lazily. Iterating needs no lock."""
        with self.lock:
            return self._contexts.named(context).triples()

    # -- requests ----------------------------------------------------------------------------------------------

    def transact(self, operations: Iterable[Operation], author: str, context: str = SCENE) -> Outcome:
        """Applies operations, all or none, and publishes the changes.

        :param context: created when it does not exist.
        :raises SkirosError: an operation is refused; nothing has changed.
        """
        [result] = self.transact_all([(list(operations), author, context)])
        if isinstance(result, Exception):
            raise result
        return result

    @property
    def syncs(self) -> bool:
        """Whether each request waits for the disk, so that `GroupCommit` saves time."""
        return self._journal is not None and self._journal.full_sync

    def transact_all(self, requests: Sequence[Transact]) -> list[Outcome | Exception]:
        """Applies requests in order, each all or none; the journal writes them together.

        A request is checked against the state that those before it lead to, and nothing is published before all are
        written. When that fails, it fails for all that were not refused, and all are rolled back.

        :returns: for each request its outcome, or why it was refused.
        """
        results: list[Outcome | Exception] = []
        with self.lock:
            while len(results) < len(requests):
                results += self._transact_next(requests[len(results) :])
                self._transact_visits()
        return results

    def _transact_next(self, requests: Sequence[Transact]) -> list[Outcome | Exception]:
        """Applies as many of the first requests as can be written together."""
        batch = Batch(self._contexts, self.reasoning, self._notifier, self._journal)
        for operations, author, context in requests:
            if len(operations) == 1 and isinstance(operations[0], Relate):
                src = self._full(operations[0].src)
                home = self._contexts.home(src, context)
                if not home and self.ontology.individual(src) is not None:
                    return batch.finish() or [self._relate_individual(operations[0], author)]
                context = home or context
            batch.apply(operations, author, context, self.ontology, partial(self.checks, author))
            if self.reasoning.has_visits:
                break
        return batch.finish()

    def _transact_visits(self) -> None:
        """Applies the requests that reasoners made beside the one that has ended."""
        for visit in self.reasoning.take_visits():
            own: list[Operation] = [Apply(visit.changes)] if visit.changes else []
            for context, operations in {SCENE: own, **visit.in_other_contexts}.items():
                try:
                    self.transact(operations, visit.author, context)
                except SkirosError as error:
                    log.error("a change of %s that depends on another one is lost with it: %s", visit.author, error)

    def checks(self, author: str) -> Checks:
        """Creates the checks of names and values for a request of an author."""
        return Checks(self.ontology, self.knowledge_base.prefixes, author, self.strict, self._warned)

    def modify(self, statements: Sequence[Statement], author: str, context: str = "") -> list[Change]:
        """Adds and removes RDF statements.

        :param context: "" and `ontology` are the ontologies.
        :raises SkirosError: a statement is refused; nothing has changed.
        """
        with self.lock:
            if context in ("", ONTOLOGY):
                removed, added = self.knowledge_base.new(*self.knowledge_base.split(statements))
                if not removed and not added:
                    return []
                change_info = self._notifier.next(author)
                if self._journal is not None:
                    with self._journal.request(change_info, change_info.version, "ontology", ONTOLOGY) as writer:
                        writer.ontology(map(str, removed), map(str, added))
                self.knowledge_base.update(removed, added)
                return self._notifier.publish([PendingChange(UPDATE)], change_info, ONTOLOGY, Scene())
            removed, added = self.knowledge_base.split(statements)
            scene = self._contexts.named(context).scene
            operations = element_operations(self.knowledge_base, scene, removed, added)
            return self.transact(operations, author, context).changes

    def load(self, filename: str, author: str, context: str = SCENE, adds_root: bool = False) -> Change:
        """Replaces a context with the content of a file. The current content stays when the file is refused.

        Reasoners are stopped before the scene is loaded and restarted afterwards. Must not be called under the lock.
        All findings of the file are logged in one warning; a strict world model refuses the file.

        :param filename: relative to the workspace; "": the file that the context was last loaded from or saved to.
        :param adds_root: adds the root to a scene without one, instead of refusing it.
        :raises SkirosError: the file is outside the workspace, missing, does not parse, or is refused.
        """
        with self.reasoning.stopped() if context == SCENE else nullcontext(), self._using_files:
            with self.lock:
                target = self._contexts.get(context) or Context(context, self.knowledge_base)
                path = workspace_file(self._workspace, filename or target.file)
            content = FileContent(target, path, self.knowledge_base, self.strict, adds_root)
            with self.lock:
                if content.index is not self.ontology:  # it changed meanwhile, which is rare
                    content = FileContent(target, path, self.knowledge_base, self.strict, adds_root)
                return self._replace(target, content, filename or target.file, author)

    @collector_paused()
    def _replace(self, target: Context, content: FileContent, file: str, author: str) -> Change:
        """Replaces a context with the content of a file. Called under the lock."""
        context, scene, extras = target.name, content.scene, content.extras
        change_info = self._notifier.next(author)
        if context == SCENE:
            self.reasoning.complete(scene)
        scene.set_change_info(change_info)
        before = target.scene, target.extras
        scene.inherit_removals(target.scene, change_info)
        target.replace(scene, extras)
        try:
            if self._journal is not None:
                with self._journal.request(change_info, change_info.version, f"load {file}", context) as writer:
                    writer.replace_context(context, scene, map(str, extras), file)
        except Exception:
            target.replace(*before)
            raise
        target.file = file
        self._contexts[context] = target
        self.loaded[context] = content.path
        self.refused.pop(context, None)
        self._readable.add(content.path)
        self.findings[context] = content.findings
        pending = [PendingChange(RESET if context == SCENE else UPDATE)]
        return self._notifier.publish(pending, change_info, context, scene)[0]

    def load_initial(self, filename: str, context: str = SCENE, blank_on_error: bool = False) -> None:
        """Loads a context at the start.

        :param blank_on_error: logs a refused file; the context is blank then, and `save` writes it to that file.
        :raises ConfigurationError: the file is refused, or the name of the context is invalid.
        """
        try:
            target = self._contexts.named(context)
            self.load(filename, "init", context, adds_root=True)
        except SkirosError as error:
            if not blank_on_error or context not in self._contexts:
                raise ConfigurationError(f"scene {error}") from None
            target.file, self.refused[context] = filename, str(error)
            log.error("%s; context %s is blank and will be saved to %s", error, context, filename)

    def save(self, filename: str, context: str = SCENE) -> Path:
        """Writes a context to a file of the workspace as sorted Turtle and returns the file's path.

        Must not be called under the lock.

        :param filename: as for `load`.
        :raises SkirosError: the file is outside the workspace or cannot be written, or the context does not exist.
        """
        with self._using_files:
            with self.lock:
                target = self._contexts.named(context)
                path = workspace_file(self._workspace, filename or target.file)
                if self.knowledge_base.reads(path):
                    raise WrongValue(f"{path}: is read as an ontology or shapes; expected the name of a scene file")
                turtle = target.snapshot()
            content = turtle()
            if path not in self._readable:
                keep_refused(path, self.knowledge_base, self.strict)
            write_file(path, content)
            with self.lock:
                self._readable.add(path)
                if self._journal is not None:
                    self._journal.write_file(context, filename or target.file)
                target.file = filename or target.file
        return path

    @contextmanager
    def unrecorded(self) -> Iterator[None]:
        """The changes within the block are not written to the journal: they end with this process."""
        with self.lock:
            journal, self._journal = self._journal, None
            try:
                yield
            finally:
                self._journal = journal

    # -- listeners ---------------------------------------------------------------------------------------------

    def add_listener(self, listener: Listener) -> None:
        """Calls `listener` after each change, in order, in the thread that made the change and under the lock."""
        with self.lock:
            self._notifier.add_listener(listener)

    def remove_listener(self, listener: Listener) -> None:
        """Removes a listener; no effect when it is unknown."""
        with self.lock:
            self._notifier.remove_listener(listener)

    def add_reasoner(self, reasoner: DiscreteReasoner) -> None:
        """Adds a reasoner, which sees every further change of the scene.

        Elements of the scene that name the reasoner get its default properties that they lack.
        """
        with self.lock:
            self.reasoning.add(reasoner)
            scene = self.scene()
            scene.begin()
            try:
                self.reasoning.complete(scene, [reasoner])
                part = Part(SCENE, scene, pending_changes(scene.changes))
                line = numbered_line([part], self._notifier, reasoner.__class__.__name__)
                if self._journal is not None and line is not None:
                    self._journal.write([line])
            except Exception:
                scene.roll_back()
                raise
            part.commit()
            self._notifier.publish(part.pending, part.change_info, SCENE, scene)

    # -- helpers -----------------------------------------------------------------------------------------------

    def _relate_individual(self, relation: Relate, author: str) -> Outcome | Exception:
        """Adds or removes a relation of an individual of the ontologies."""
        src, pred, dst = self._full(relation.src), full_name(self._full(relation.pred)), self._full(relation.dst)
        if not self._contexts.home(dst) and self.ontology.individual(dst) is None:
            return UnknownName(f"{author}: {src} {pred} {dst}: there is no element or individual {dst!r}")
        try:
            return Outcome([src], self.modify([(src, pred, dst, relation.value)], author))
        except Exception as error:
            return error

    def _full(self, name: str) -> str:
        return self.knowledge_base.prefixes.name(name) if is_iri(name) else name

    @collector_paused()
    def _recover(self, state: JournalState) -> None:
        self.knowledge_base.update(parse_n_triples(state.unstated), parse_n_triples(state.stated))
        for found in state.contexts:
            context = self._contexts.setdefault(found.name, Context(found.name, self.knowledge_base))
            context.restore(found)
