"""The world model: contexts with scenes, ontologies, and changes that are checked, atomic, numbered and announced."""

from __future__ import annotations

import logging
from collections.abc import Iterable, Sequence
from contextlib import nullcontext
from pathlib import Path

from skiros2_common.core.discrete_reasoner import DiscreteReasoner
from skiros2_common.core.errors import ConfigurationError, SkirosError, UnknownName, WrongValue
from skiros2_common.core.names import full_name
from skiros2_world_model.core.advisory_lock import AdvisoryLock
from skiros2_world_model.core.announcer import Announcer, Listener, News, news_of
from skiros2_world_model.core.changes import RESET, UPDATE, Change, Operation, Outcome, Relate
from skiros2_world_model.core.checks import Checks
from skiros2_world_model.core.context import Context
from skiros2_world_model.core.context_names import ONTOLOGY, SCENE
from skiros2_world_model.core.contexts import Contexts
from skiros2_world_model.core.file_checks import FileChecks
from skiros2_world_model.core.journal import Journal, first_number
from skiros2_world_model.core.journal_state import JournalState
from skiros2_world_model.core.ontology_base import OntologyBase
from skiros2_world_model.core.prefixes import is_iri
from skiros2_world_model.core.rdf_files import parse_n_triples, write_file
from skiros2_world_model.core.reader import SceneReader
from skiros2_world_model.core.reasoning import Reasoning
from skiros2_world_model.core.report import Finding, Report
from skiros2_world_model.core.statement import Statement
from skiros2_world_model.core.statements import element_operations
from skiros2_world_model.core.transaction import Transaction
from skiros2_world_model.core.triple_store import TripleStore
from skiros2_world_model.core.validation import keep_refused, scene_file_triples, shape_findings
from skiros2_world_model.core.workspace import workspace_file
from skiros2_world_model.core.world_model_state import WorldModelState

log = logging.getLogger(__name__)


class WorldModel(WorldModelState):
    """What all robots of a cell share. Safe to use from all threads: one lock, `lock`, guards everything.

    :param ontologies: folder of the package's ontologies; None: none.
    :param workspace: folder of the user's ontologies and scenes; without one nothing is loaded or saved.
    :param strict: whether names that the ontologies do not know are refused.
    :param journal: keeps every change; the world model goes on from it where it wants that. None: nothing is kept.
    :param initial: contexts and the files to load them from, when it does not go on from the journal.
    :param store: what answers queries; None: one in memory.
    :param blank_on_error: an initial file, or an ontology of the workspace, that is refused is logged and left out.
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
    ) -> None:
        self.base = OntologyBase(ontologies, workspace, store, blank_on_error)
        self.lock = self.base.lock
        self.reasoning = Reasoning()
        self._workspace = workspace
        self.strict = strict
        self.loaded: dict[str, Path] = {}  #: by context, the file that was loaded last
        self._readable: set[Path] = set()  # files that were loaded or saved
        self.flaws: dict[str, frozenset[Finding]] = {}  #: by context, what loading that file has warned of
        self._contexts = Contexts(self.base)
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
                self.load_initial(file, context, blank_on_error)
            if journal is not None:
                made = self._announcer.next("wm")
                contents = [(c.name, c.scene, list(map(str, c.extras)), c.file) for c in self._contexts.values()]
                journal.start(self._announcer.session, made, contents)
                self._announcer.tell(RESET, made, SCENE)
        self._journal = journal

    # -- changes -----------------------------------------------------------------------------------------------

    def transact(self, operations: Iterable[Operation], author: str, context: str = SCENE) -> Outcome:
        """Applies some operations, all or none, and announces what came of it.

        :param context: made when a request names it for the first time.
        :raises SkirosError: one of them is refused; nothing has changed.
        """
        with self.lock:
            operations = list(operations)
            if len(operations) == 1 and isinstance(operations[0], Relate):
                src = self._full(operations[0].src)
                home = self._contexts.home(src, context)
                if not home and self.ontology.individual(src) is not None:
                    return self._relate_individual(operations[0], author)
                context = home or context
            is_new = context not in self._contexts
            scene = self._contexts.named(context).scene
            transaction = Transaction(scene, self.ontology, self.checks(author), author, self._contexts.others(context))
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
                if is_new:
                    del self._contexts[context]
                raise
            if not news:
                scene.roll_back()  # all is as it was, the versions of the elements too
            scene.commit(provenance)
            self.reasoning.settle()
            for wanted, given in transaction.renamed:
                log.warning("%s: the number of %s is taken; it was added as %s", author, wanted, given)
            changes = self._announcer.tell_all(news, provenance, context, scene)
            for relation, other in transaction.elsewhere.items():
                changes += self.transact([relation], author, other).changes
            for other, patches in self._contexts.dangling([e.id for e in transaction.removed]):
                changes += self.transact(patches, author, other).changes
            return Outcome(ids, changes)

    def checks(self, author: str) -> Checks:
        """The checks of names and values in a request of an author."""
        return Checks(self.ontology, self.base.prefixes, author, self.strict, self._told)

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
            scene = self._contexts.named(context).scene
            operations = element_operations(self.base, scene, removed, added)
            return self.transact(operations, author, context).changes

    def load(self, filename: str, author: str, context: str = SCENE, adds_root: bool = False) -> Change:
        """Replaces a context with what a file of the workspace says. The present one stays when the file is refused.

        Reasoners stop before the scene is loaded and start again after it. Not to be called under the lock.
        What is not as it should be in the file is one warning; a strict world model refuses it.

        :param filename: relative to the workspace; "" is the file that the context was loaded from or saved to last.
        :param adds_root: whether a scene without a root gets one; else it is refused.
        :raises SkirosError: the file is outside the workspace, not there, does not parse, or is refused.
        """
        with self.reasoning.stopped() if context == SCENE else nullcontext(), self.lock:
            target = self._contexts.get(context) or Context(context, self.base)
            path = workspace_file(self._workspace, filename or target.file)
            checks = FileChecks(self.base, path, self.strict)
            made = self._announcer.next(author)
            scene, extras = target.read(scene_file_triples(path), checks, str(path), made, adds_root)
            if self.strict:
                Report(str(path), shape_findings(scene, extras, self.base, str(path))).refuse_violations()
            if context == SCENE:
                self.reasoning.complete(scene)
            before = target.scene, target.extras
            scene.succeed(target.scene, made)
            target.replace(scene, extras)
            file = filename or target.file
            try:
                if self._journal is not None:
                    with self._journal.request(made, made.version, f"load {file}", context) as writer:
                        writer.whole(context, scene, map(str, extras), file)
            except Exception:
                target.replace(*before)
                raise
            target.file = file
            self._contexts[context] = target
            self.loaded[context] = path
            self._readable.add(path)
            self.flaws[context] = frozenset(checks.findings)
            return self._announcer.tell(RESET if context == SCENE else UPDATE, made, context)

    def load_initial(self, filename: str, context: str = SCENE, blank_on_error: bool = False) -> None:
        """Loads a context as the launch parameters want it.

        :param blank_on_error: a file that is refused is logged; the context is blank then, and saved to that file.
        :raises ConfigurationError: the file is refused, or no context can have that name.
        """
        try:
            target = self._contexts.named(context)
            self.load(filename, "init", context, adds_root=True)
        except SkirosError as error:
            if not blank_on_error or context not in self._contexts:
                raise ConfigurationError(f"scene {error}") from None
            target.file = filename
            log.error("%s; context %s is blank, and is saved to %s", error, context, filename)

    def save(self, filename: str, context: str = SCENE) -> Path:
        """Writes a context to a file of the workspace, as sorted Turtle; returns the file.

        :param filename: as for `load`.
        :raises SkirosError: the file is outside the workspace or cannot be written, or there is no such context.
        """
        with self.lock:
            target = self._contexts.named(context)
            path = workspace_file(self._workspace, filename or target.file)
            if self.base.reads(path):
                raise WrongValue(f"{path}: is read as an ontology or shapes; expected the name of a scene file")
            content = target.turtle()
            if path not in self._readable:
                keep_refused(path, self.base, self.strict)
            write_file(path, content)
            self._readable.add(path)
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
        """From now on the reasoner is offered every change of the scene.

        Elements of the scene that name it get those of its default properties that they do not have.
        """
        with self.lock:
            self.reasoning.add(reasoner)
            scene = self.scene()
            made = self._announcer.next(reasoner.__class__.__name__)
            scene.begin()
            try:
                self.reasoning.complete(scene, [reasoner])
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

    def _relate_individual(self, relation: Relate, author: str) -> Outcome:
        """Adds or removes a relation of an individual of the ontologies."""
        src, pred, dst = self._full(relation.src), full_name(self._full(relation.pred)), self._full(relation.dst)
        if not self._contexts.home(dst) and self.ontology.individual(dst) is None:
            raise UnknownName(f"{author}: {src} {pred} {dst}: there is no element or individual {dst!r}")
        return Outcome([src], self.modify([(src, pred, dst, relation.value)], author))

    def _full(self, name: str) -> str:
        return self.base.prefixes.name(name) if is_iri(name) else name

    def _go_on_from(self, state: JournalState) -> None:
        self.base.update(parse_n_triples(state.unstated), parse_n_triples(state.stated))
        for found in state.contexts:
            context = self._contexts.setdefault(found.name, Context(found.name, self.base))
            context.restore(found)
