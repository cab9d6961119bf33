"""The world model: contexts with scenes, ontologies, and changes that are checked, atomic, numbered and announced."""

from __future__ import annotations

import logging
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import pyoxigraph as ox

from skiros2_common.core.discrete_reasoner import DiscreteReasoner
from skiros2_common.core.errors import ConfigurationError, Refused, SkirosError, UnknownName, WrongValue
from skiros2_common.core.world_element import Element
from skiros2_world_model.core.advisory_lock import AdvisoryLock
from skiros2_world_model.core.announcer import Announcer, Listener, News, news_of
from skiros2_world_model.core.changes import RESET, UPDATE, Change, Operation, Outcome
from skiros2_world_model.core.checks import Checks
from skiros2_world_model.core.context import Context
from skiros2_world_model.core.context_names import ONTOLOGY, SCENE
from skiros2_world_model.core.history import History
from skiros2_world_model.core.journal import Journal, first_number
from skiros2_world_model.core.journal_state import JournalState
from skiros2_world_model.core.ontology import Ontology
from skiros2_world_model.core.ontology_base import OntologyBase
from skiros2_world_model.core.prefixes import is_iri
from skiros2_world_model.core.rdf_files import parse_n_triples, write_file
from skiros2_world_model.core.reader import SceneReader
from skiros2_world_model.core.reasoning import Reasoning
from skiros2_world_model.core.report import Report
from skiros2_world_model.core.scene import Scene
from skiros2_world_model.core.statement import Statement
from skiros2_world_model.core.statements import element_operations
from skiros2_world_model.core.templates import template_element
from skiros2_world_model.core.transaction import Transaction
from skiros2_world_model.core.triple_store import TripleStore
from skiros2_world_model.core.validation import scene_file_triples, shape_findings
from skiros2_world_model.core.workspace import workspace_file

log = logging.getLogger(__name__)

class WorldModel:
    """What all robots of a cell share. Safe to use from all threads: one lock, `lock`, guards everything.

    :param ontologies: folder of the package's ontologies; None: none.
    :param workspace: folder of the user's ontologies and scenes; without one nothing is loaded or saved.
    :param strict: whether names that the ontologies do not know are refused.
    :param journal: keeps every change; the world model goes on from it where it wants that. None: nothing is kept.
    :param initial: contexts and the files to load them from, when it does not go on from the journal.
    :param store: what answers queries; None: one in memory.
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
    ) -> None:
        self.base = OntologyBase(ontologies, workspace, store)
        self.lock = self.base.lock
        self.reasoning = Reasoning()
        self._workspace = workspace
        self.strict = strict
        self.loaded: dict[str, Path] = {}  #: by context, the file that was loaded last
        self._contexts = {SCENE: Context(SCENE, self.base)}
        self._told: set[tuple[str, str, str]] = set()
        self.advisory_lock = AdvisoryLock()
        self.reader = SceneReader(self.lock, self.scenes, lambda: self.ontology)
        self._journal: Journal | None = None
        state = journal.restore() if journal is not None else None
        #: Whether this is what the journal had.
        self.went_on = state is not None
        if state is not None:
            self._announcer = Announcer(state.number, state.session)
            self._go_on_from(state)
            log.info("the world model goes on from its journal %s: %s", journal.path if journal else "", state)
        else:
            self._announcer = Announcer(max(first_number(), journal.last if journal is not None else 0))
            for context, file in initial:
                self.load_initial(file, context)
            if journal is not None:
                made = self._announcer.next("wm")
                contents = [(c.name, c.scene, list(map(str, c.extras)), c.file) for c in self._contexts.values()]
                journal.start(self._announcer.session, made, contents)
                self._announcer.tell(RESET, made, SCENE)
        self._journal = journal

    # -- state -------------------------------------------------------------------------------------------------

    @property
    def number(self) -> int:
        """The number of the last change."""
        return self._announcer.number

    @property
    def snapshot_id(self) -> str:
        """The name of the present state."""
        return self._announcer.snapshot_id

    @property
    def ontology(self) -> Ontology:
        """What the ontologies say now."""
        return self.base.index

    def contexts(self) -> list[str]:
        return list(self._contexts)

    def scene(self, context: str = SCENE) -> Scene:
        """The scene of a context, to be read under the lock.

        :raises UnknownName: there is no such context.
        """
        return self._context(context).scene

    def scenes(self, context: str) -> list[Scene]:
        """The scene of a context, or for "" those of all, to be read under the lock.

        :raises UnknownName: there is no such context.
        """
        return [self.scene(context)] if context else [c.scene for c in self._contexts.values()]

    def template(self, name: str) -> Element:
        """A template as an element without id.

        :raises UnknownName: there is none.
        """
        return template_element(self.ontology, self.base.prefixes.name(name) if is_iri(name) else name)

    @property
    def history(self) -> History:
        """What was, and who changed it. To be asked without the lock: it holds up no request.

        :raises Refused: nothing is kept, as there is no journal.
        """
        if self._journal is None:
            raise Refused("the world model keeps no journal: its past is not known")
        return History(self._journal.path)

    def query(self, query: str, context: str = "", cut_prefix: bool = True) -> list[str]:
        """The rows that a SPARQL query gives, as texts.

        :param context: the one to ask; "" asks all, `ontology` the ontologies alone.
        :raises UnknownName: there is no such context.
        :raises WrongValue: the query cannot be answered.
        """

        def flush() -> None:
            for name in [context] if context else self._contexts:
                if name != ONTOLOGY:
                    self._context(name).flush()

        return self.base.query(query, context, cut_prefix, flush)

    def triples(self, context: str = SCENE) -> Iterator[ox.Triple]:
        """All that a context holds now; the triples are made while they are read, which needs no lock."""
        with self.lock:
            return self._context(context).triples()

    # -- changes -----------------------------------------------------------------------------------------------

    def transact(self, operations: Iterable[Operation], author: str, context: str = SCENE) -> Outcome:
        """Applies some operations, all or none, and announces what came of it.

        :param context: made when a request names it for the first time.
        :raises SkirosError: one of them is refused; nothing has changed.
        """
        with self.lock:
            made = context not in self._contexts
            target = self._context(context, make=True)
            scene = target.scene
            checks = Checks(self.ontology, self.base.prefixes, author, self.strict, self._told)
            transaction = Transaction(scene, self.ontology, checks, author, self._exists)
            scene.begin()
            try:
                ids = transaction.run(operations)
                if context == SCENE:
                    self.reasoning.offer(scene, transaction)
                news = news_of(transaction, scene) if context == SCENE else [News(UPDATE)]
                provenance = self._announcer.next(author)
                if news and self._journal is not None:
                    last = self.number + len(news)
                    with self._journal.request(provenance, last, "change", context) as writer:
                        writer.step(context, scene)
            except Exception:
                scene.roll_back()
                self.reasoning.take_back(scene)
                if made:
                    del self._contexts[context]
                raise
            if not news:
                scene.roll_back()  # all is as it was, the versions of the elements too
            scene.commit(provenance)
            self.reasoning.settle()
            for wanted, given in transaction.renamed:
                log.warning("%s: the number of %s is taken; it was added as %s", author, wanted, given)
            return Outcome(ids, self._announcer.tell_all(news, provenance, context, scene))

    def modify(self, statements: Sequence[Statement], author: str, context: str = "") -> list[Change]:
        """Adds and removes statements in a context; in "" and `ontology` those of the ontologies.

        :raises SkirosError: one of them is refused; nothing has changed.
        """
        with self.lock:
            if context in ("", ONTOLOGY):
                removed, added = self.base.new(*self.base.split(statements))
                if not removed and not added:
                    return []
                made = self._announcer.next(author)
                if self._journal is not None:
                    with self._journal.request(made, made.version, "ontology", ONTOLOGY) as writer:
                        writer.ontology(map(str, removed), map(str, added))
                self.base.update(removed, added)
                return [self._announcer.tell(UPDATE, made, ONTOLOGY)]
            removed, added = self.base.split(statements)
            scene = self._context(context, make=True).scene
            operations = element_operations(self.base, scene, removed, added)
            return self.transact(operations, author, context).changes

    def load(self, filename: str, author: str, context: str = SCENE) -> Change:
        """Replaces a context with what a file of the workspace says. The present one stays when the file is refused.

        :param filename: relative to the workspace; "" is the file that the context was loaded from or saved to last.
        :raises SkirosError: the file is outside the workspace, not there, does not parse, or is refused.
        """
        with self.lock:
            target = self._contexts.get(context) or Context(context, self.base)
            path = workspace_file(self._workspace, filename or target.file)
            checks = Checks(self.ontology, self.base.prefixes, str(path), self.strict)
            made = self._announcer.next(author)
            scene, extras = target.read(scene_file_triples(path), checks, str(path), made)
            if self.strict:
                Report(str(path), shape_findings(scene, extras, self.base, str(path))).refuse_violations()
            before = target.scene, target.extras
            target.replace(scene, extras)
            file = filename or target.file
            try:
                if context == SCENE:
                    self.reasoning.replace(before[0], scene)
                if self._journal is not None:
                    with self._journal.request(made, made.version, f"load {file}", context) as writer:
                        writer.whole(context, scene, map(str, extras), file)
            except Exception:
                target.replace(*before)
                if context == SCENE:
                    self.reasoning.replace(scene, before[0])
                raise
            target.file = file
            self._contexts[context] = target
            self.loaded[context] = path
            return self._announcer.tell(RESET if context == SCENE else UPDATE, made, context)

    def load_initial(self, filename: str, context: str = SCENE) -> None:
        """Loads a context as the launch parameters want it.

        :raises ConfigurationError: that is not possible.
        """
        try:
            self.load(filename, "init", context)
        except SkirosError as error:
            raise ConfigurationError(f"scene {error}") from None

    def save(self, filename: str, context: str = SCENE) -> Path:
        """Writes a context to a file of the workspace, as sorted Turtle; returns the file.

        :param filename: as for `load`.
        :raises SkirosError: the file is outside the workspace or cannot be written, or there is no such context.
        """
        with self.lock:
            target = self._context(context)
            path = workspace_file(self._workspace, filename or target.file)
            if self.base.reads(path):
                raise WrongValue(f"{path}: is read as an ontology or shapes; expected the name of a scene file")
            content = target.turtle()
            write_file(path, content)
            if self._journal is not None:
                self._journal.write_file(context, filename or target.file)
            target.file = filename or target.file
        return path

    # -- announcements -----------------------------------------------------------------------------------------

    def add_listener(self, listener: Listener) -> None:
        """`listener` is called after each change, in its order, by the thread that made it and under the lock."""
        with self.lock:
            self._announcer.add_listener(listener)

    def remove_listener(self, listener: Listener) -> None:
        """The listener is called no more."""
        with self.lock:
            self._announcer.remove_listener(listener)

    def add_reasoner(self, reasoner: DiscreteReasoner) -> None:
        """From now on the reasoner is offered the elements that name it, those of the scene first."""
        with self.lock:
            self.reasoning.add(reasoner)
            scene = self.scene()
            made = self._announcer.next(reasoner.__class__.__name__)
            scene.begin()
            try:
                for node in list(scene):
                    self.reasoning.introduce(scene, node.id, reasoner)
                completed = scene.touched()
                if completed and self._journal is not None:
                    with self._journal.request(made, made.version, "change", SCENE) as writer:
                        writer.step(SCENE, scene)
            except Exception:
                scene.roll_back()
                raise
            scene.commit(made)
            if completed:
                self._announcer.tell_all([News(UPDATE, ids=completed)], made, SCENE, scene)

    # -- shared ------------------------------------------------------------------------------------------------

    def _context(self, name: str, make: bool = False) -> Context:
        found = self._contexts.get(name)
        if found is None:
            if not make:
                known = ", ".join(sorted(self._contexts))
                raise UnknownName(f"there is no context {name!r}; there are: {known}")
            found = self._contexts[name] = Context(name, self.base)
        return found

    def _go_on_from(self, state: JournalState) -> None:
        self.base.update(parse_n_triples(state.unstated), parse_n_triples(state.stated))
        for found in state.contexts:
            context = self._contexts.setdefault(found.name, Context(found.name, self.base))
            context.restore(found)

    def _exists(self, eid: str) -> bool:
        return any(eid in context.scene for context in self._contexts.values())
