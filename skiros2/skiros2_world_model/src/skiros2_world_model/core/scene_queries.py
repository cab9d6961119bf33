"""The calls of a world model client that read the scene or wait for it."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

from skiros2_common.core.discrete_reasoner import reasoners
from skiros2_common.core.element_content import relation_dict
from skiros2_common.core.errors import SkirosError, UnknownName, WrongValue
from skiros2_common.core.names import full_name
from skiros2_common.core.operations import SCENE, Change, snapshot_number
from skiros2_common.core.reasoner_registry import relations_of
from skiros2_common.core.world_element import Element, Reasoner, RelationDict
from skiros2_common.core.world_model_port import Revisions
from skiros2_world_model.core.ontology_client import OntologyClient
from skiros2_world_model.core.queries import no_element
from skiros2_world_model.core.scene import ROOT, ChangeInfo
from skiros2_world_model.core.wm_errors import WmException, wm_error, wm_errors

#: How often a wait checks its condition without a change (s): for computed relations, and for the node's shutdown.
_CHECK_PERIOD = 0.5

log = logging.getLogger(__name__)


class SceneQueries(OntologyClient):
    """The calls of a client that read the scene or wait for it. Thread-safe.

    Subjects and objects may be given as elements or as ids.
    """

    @property
    def version(self) -> int:
        """A counter that changes when anything that a condition reads may have changed; -1: unknown, do not cache."""
        return self.transport.version

    @property
    def last_change_number(self) -> int:
        """The number of the last known change of the scene; 0: unknown."""
        return snapshot_number(self.transport.snapshot_id)

    @property
    def session(self) -> str:
        """The name of the scene's line of changes: it stays if the server recovers the scene."""
        self.revisions()  # a replica that does not know the scene fetches it
        return self.transport.snapshot_id.partition("-")[0]

    def add_listener(self, callback: Callable[[Change], None]) -> None:
        """Calls `callback(change)` after each change that this client sees, in order. It must return quickly."""
        self.transport.subscribe(callback)

    def remove_listener(self, callback: Callable[[Change], None]) -> None:
        """Removes a listener."""
        self.transport.unsubscribe(callback)

    # -- reading -------------------------------------------------------------------------------------------------

    def revisions(self) -> Revisions | None:
        """The current revisions of the ontologies and elements; None: unknown, do not cache."""
        return self.transport.revisions()

    def catch_up(self) -> None:
        """Waits until reads are at least as new as the server's state at this call. Blocks for one service call.

        Call it before handling a request of another node, which may refer to its latest changes.
        """
        self.transport.catch_up()

    def get_scene(self) -> tuple[list[Element], str]:
        """Returns the root of the scene and its descendants, and the snapshot id of that state."""
        with wm_errors():
            return self.transport.snapshot()

    def find_element(self, eid: str, context_id: str = SCENE) -> Element | None:
        """Returns the current state of an element, or None when it does not exist."""
        try:  # faster than `wm_errors`: a tick calls it often
            return self.transport.scene.find(eid, context_id)
        except SkirosError as error:
            raise wm_error(error)  # noqa: B904 - the error itself may be returned

    def refreshed(self, e: Element, context_id: str = SCENE) -> Element | None:
        """Returns the given element if it has not changed since it was read, else the result of `find_element`."""
        try:  # faster than `wm_errors`: a tick calls it often
            return self.transport.scene.refreshed(e, context_id)
        except SkirosError as error:
            raise wm_error(error)  # noqa: B904 - the error itself may be returned

    def removal_of(self, eid: str, context_id: str = SCENE) -> ChangeInfo | None:
        """Returns the change that removed an element, or None when it exists or nothing is known."""
        with wm_errors():
            return self.transport.scene.removal(eid, context_id)

    def get_scene_name(self) -> str:
        """The scene file with which the world model started, relative to its workspace; "": none."""
        return self.transport.server.scene_name()

    def get_scene_elements(self) -> list[Element]:
        """Returns the root of the scene and its descendants."""
        return self.get_branch(ROOT)

    def is_scene_element(self, eid: str) -> bool:
        """Whether the scene has an element."""
        return self.find_element(eid) is not None

    def get_element(self, eid: str, context_id: str = SCENE) -> Element:
        """Returns the current state of an element.

        :raises WmException: it does not exist.
        """
        found = self.find_element(eid, context_id)
        if found is None:
            raise WmException(no_element(eid, context_id), UnknownName.code)
        return found

    def get_template_element(self, uri: str, context_id: str = SCENE) -> Element:
        """Returns a template (an individual of the ontologies) as an element without id.

        :raises WmException: it does not exist.
        """
        with wm_errors():
            return self.transport.server.template(self._name(uri))

    def get_branch(
        self,
        eid: str,
        relation_filter: str = "skiros:sceneProperty",
        type_filter: str = "",
        context_id: str = SCENE,
    ) -> list[Element]:
        """Returns an element and its descendants along a relation and its subproperties, nearest first.

        :param type_filter: returns only elements of this class or its subclasses; "": all.
        :raises WmException: the element does not exist.
        """
        with wm_errors():
            return self.transport.scene.branch(id_of(eid), relation_filter, type_filter, context_id)

    def resolve_elements(self, e: Element, context_id: str = SCENE) -> list[Element]:
        """Returns the elements of the class of `e` or its subclasses that have its label and its property values.

        An empty label, and a value "" or None, matches any.
        """
        with wm_errors():
            return self.transport.scene.matching(e, context_id)

    def resolve_element(self, e: Element, context_id: str = SCENE) -> Element | None:
        """Returns the first result of `resolve_elements`, or None."""
        return next(iter(self.resolve_elements(e, context_id)), None)

    def get_relations(self, subj: Element | str, pred: str, obj: Element | str) -> list[RelationDict]:
        """Returns the relations along a predicate and its subproperties, as dicts; an empty part matches any, and so
        does the subject "-1".

        When all three are given, `src` is "-1" in the result; otherwise it is the subject's id. Relations that a
        reasoner owns are computed by it.
        """
        subj = "" if subj == "-1" else subj
        if pred and self._computes(pred) is not None:
            found = self.get_reasoner_relations(subj, pred, obj)
        else:
            found = self._related(id_of(subj), self._name(pred) if pred else "", id_of(obj))
        return [{**r, "src": "-1"} for r in found] if id_of(subj) and pred and id_of(obj) else found

    def get_reasoner(self, pred: str) -> Reasoner | None:
        """Returns the reasoner with a class name, or the one that owns a code, property or relation; None if it does
        not exist."""
        return reasoners.find(pred)

    def get_reasoner_relations(self, subj: Element | str, pred: str, obj: Element | str) -> list[RelationDict]:
        """Computes relations between two elements with a reasoner; returns them as dicts.

        :param subj, obj: elements or ids; an abstract element stands for all matching elements.
        :param pred: the relation, or the name of a reasoner for all of its relations.
        :raises UnknownName: no reasoner owns the relation.
        """
        reasoner = reasoners.get(pred)
        by_name = pred == reasoner.__class__.__name__
        return [
            relation_dict(one.id, name, other.id)
            for one, other in self._pairs(subj, obj)
            for name in reasoner.computeRelations(one, other)
            if by_name or full_name(name) == full_name(pred)
        ]

    def check_relation(self, subj: Element | str, pred: str, obj: Element | str, state: bool, abstract: bool) -> bool:
        """Whether a relation or one of its subproperties holds (`state` true) or does not hold.

        :param subj, obj: elements or ids; an abstract element stands for any matching element.
        :param abstract: checks whether the relation is stated between the elements or their templates
            (`skiros:Template`); for an element without id and name, whether the class restrictions allow it.
        """
        if not (isinstance(subj, Element) and isinstance(obj, Element)):
            subj, obj = self._element(subj), self._element(obj)
        pred = self._name(pred)
        if abstract:
            return self._stated(subj, pred, obj) == state
        if self._computes(pred) is not None:
            return bool(self.get_reasoner_relations(subj, pred, obj)) == state
        try:
            return self.transport.scene.holds(subj, pred, obj) == state
        except SkirosError as error:
            raise wm_error(error)  # noqa: B904 - the error itself may be returned

    def allows_relation(self, subject_type: str, pred: str, object_type: str) -> bool:
        """Whether the class restrictions of the ontologies allow a relation between two classes."""
        return self.transport.ontology.allows(*map(self._name, (subject_type, pred, object_type)))

    def _resolve_elements2(
        self, keys: str | Sequence[str], ph: Any, verbose: bool = False
    ) -> dict[str | tuple[str, ...], Any]:
        """Returns the combinations of elements that several parameters may take, so that their relations hold.

        A parameter with an abstract element takes any matching element; one with an element of the scene keeps it.
        Relations of an abstract element refer to other parameters by key, or to elements by id.

        :param keys: one key or several.
        :returns: an array of elements under the key; for several keys an array of rows under the tuple of keys.
        """
        names = (keys,) if isinstance(keys, str) else tuple(keys)
        found = _combinations(self, names, ph)
        if verbose:
            log.info("%s may be: %s", ", ".join(names), found.tolist())
        return {names[0]: found[:, 0]} if len(names) == 1 else {names: found}

    def wait_until(self, check: Callable[[], bool], timeout: float | None = None) -> bool:
        """Blocks until `check()` is true. It is evaluated after each change of the scene.

        :param check: reads this world model; called in the waiting thread.
        :param timeout: in s; None: no limit.
        :returns: False at the timeout, or when the node shuts down.
        """
        if timeout is not None and timeout != timeout:
            raise WrongValue("the timeout is not a number")
        deadline = None if timeout is None else time.monotonic() + timeout
        changed = threading.Event()

        def listener(_: Any) -> None:
            changed.set()

        self.add_listener(listener)
        try:
            while not check():
                remaining = _CHECK_PERIOD if deadline is None else min(_CHECK_PERIOD, deadline - time.monotonic())
                if remaining <= 0 or self.transport.server.is_shut_down():
                    return False
                changed.wait(remaining)
                changed.clear()
            return True
        finally:
            self.remove_listener(listener)

    def wait_for_relation(
        self, subj: Element | str, pred: str, obj: Element | str, state: bool = True, timeout: float | None = None
    ) -> bool:
        """Blocks until a relation holds (`state` true) or does not hold; arguments as for `check_relation`.

        :param timeout: in s; None: no limit.
        :returns: False at the timeout, or when the node shuts down.
        """
        return self.wait_until(lambda: self.check_relation(subj, pred, obj, state, False), timeout)

    # -- helpers -------------------------------------------------------------------------------------------------

    def _related(self, src: str, pred: str, dst: str) -> list[RelationDict]:
        with wm_errors():
            return self.transport.scene.related(src, pred, dst)

    def _exists(self, eid: str, context_id: str) -> bool:
        """Whether an element exists in a context, or in any other one."""
        return self.find_element(eid, context_id) is not None or self.find_element(eid, "") is not None

    def _stated(self, subj: Element, pred: str, obj: Element) -> bool:
        """Implements `check_relation` with `abstract`."""
        ones, others = _individuals(subj), _individuals(obj)
        if not ones or not others:
            return self.allows_relation(subj.type, pred, obj.type)
        return any(
            self.transport.ontology.individuals_related(one, pred, other) or bool(self._related(one, pred, other))
            for one in ones
            for other in others
        )

    def _computes(self, pred: str) -> Reasoner | None:
        """The reasoner that computes a relation; None when no reasoner does."""
        reasoner = reasoners.find_or_load(pred)
        if reasoner is None or full_name(pred) not in map(full_name, relations_of(reasoner)):
            return None
        return reasoner

    def _pairs(self, subj: Element | str, obj: Element | str) -> Iterator[tuple[Element, Element]]:
        for one in self._like(subj):
            for other in self._like(obj):
                if one.id != other.id:
                    yield one, other

    def _like(self, wanted: Element | str) -> list[Element]:
        element = self._element(wanted)
        return self.resolve_elements(element) if element.isAbstract() else [element]

    def _element(self, given: Element | str) -> Element:
        if isinstance(given, Element):
            return given
        return self.get_element(given) if given else Element("")

    def _known(self, e: Element, context: str) -> str:
        return self.get_element(e.id, context).id


def _individuals(element: Element) -> list[str]:
    """The names of an element in RDF statements: its template and its id.

    For an element without id and template, its label.
    """
    template = element.value_of("skiros:Template") or ("" if element.id else element.label)
    return [full_name(str(name)) for name in (template, element.id) if name]


def id_of(given: Element | str) -> str:
    return given.id if isinstance(given, Element) else str(given or "")


def _combinations(wm: SceneQueries, keys: Sequence[str], params: Any) -> Any:
    """The combinations of elements that match the abstract elements of parameters and their relations.

    :param params: a `ParamHandler`.
    :returns: an array of objects with a row for each combination and a column for each key.
    """
    import numpy  # only clients that call this need it

    rows: list[dict[str, Element]] = [{}]
    asked: dict[str, Element | None] = {key: _param_element(key, params) for key in keys}
    for key, wanted in asked.items():
        choices = [] if wanted is None else wm.resolve_elements(wanted) if wanted.isAbstract() else [wanted]
        rows = [{**row, key: element} for row in rows for element in choices]
        rows = [row for row in rows if all(_satisfies(wm, row, own, key, asked, params) for own in row)]
    found = numpy.empty((len(rows), len(keys)), dtype=object)
    for index, row in enumerate(rows):
        found[index, :] = [row[key] for key in keys]
    return found


def _satisfies(
    wm: SceneQueries,
    row: dict[str, Element],
    own: str,
    newest: str,
    asked: Mapping[str, Element | None],
    params: Any,
) -> bool:
    """Whether a row satisfies the relations of the abstract element of `own` that concern the newest key."""
    wanted = asked[own]
    if wanted is None or not wanted.isAbstract():
        return True
    for relation in wanted.getRelations():
        other = relation["dst"] if relation["src"] == "-1" else relation["src"]
        if newest not in (own, other) or (other in asked and other not in row):
            continue  # checked before, or later
        far = row.get(other)
        if far is None:
            far = _param_element(other, params) if params.hasParam(other) else wm.find_element(other)
            far = far or Element("", "", "" if params.hasParam(other) else other)
        subj, obj = (row[own], far) if relation["src"] == "-1" else (far, row[own])
        pred = full_name(relation["type"])
        if not wm.check_relation(subj, pred, obj, relation["state"], relation["abstract"]):
            return False
    return True


def _param_element(key: str, params: Any) -> Element | None:
    param = params.getParam(key)
    value = param.value if param.value is not None else param.default
    return value if isinstance(value, Element) else None
