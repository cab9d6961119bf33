"""An independent copy of a scene, on which plans and starts are simulated."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from typing import Any, NoReturn

from skiros2_common.core.world_element import Element, RelationDict
from skiros2_world_model.core.change_notifier import ChangeNotifier, PendingChange
from skiros2_world_model.core.changes import REMOVE, UPDATE, Operation, Outcome, Statement
from skiros2_world_model.core.checks import Checks
from skiros2_world_model.core.last_will import CleanupAction
from skiros2_world_model.core.ontology import Ontology
from skiros2_world_model.core.prefixes import Prefixes
from skiros2_world_model.core.queries import SceneReader
from skiros2_world_model.core.replica import scene_of
from skiros2_world_model.core.scene import Scene
from skiros2_world_model.core.transaction import Transaction
from skiros2_world_model.core.world_model_abstract_interface import WmException, wm_errors
from skiros2_world_model.core.world_model_client import WorldModelAbstractInterface

_SCENE = "scene"


class PreviewCopy(WorldModelAbstractInterface):
    """A copy of the scene of a world model. Neither sees later changes of the other.

    It checks and applies requests as the world model does, but without reasoners. It shares the ontologies of the world
    model and cannot change them.

    :param wm: the world model. Its scene is read once.
    :param strict: whether unknown names, and relations between wrong classes, are refused.
    :raises WmException: the world model does not answer.
    """

    def __init__(self, wm: WorldModelAbstractInterface, strict: bool = False) -> None:
        super().__init__()
        self._wm = wm
        self._strict = strict
        self._lock = threading.RLock()
        self._scene = scene_of(wm.resolve_elements(Element()))
        self._notifier = ChangeNotifier(0, "preview")
        self._warned: set[tuple[str, str, str]] = set()
        self._reader = SceneReader(self._lock, self._scenes, lambda: self._ontology)

    @property
    def author(self) -> str:
        return "preview"

    @property
    def version(self) -> int:
        return self._notifier.number

    def is_connected(self) -> bool:
        return True

    def add_listener(self, callback: Callable[[Any], None]) -> None:
        self._notifier.add_listener(callback)

    def remove_listener(self, callback: Callable[[Any], None]) -> None:
        self._notifier.remove_listener(callback)

    # -- calls that a copy does not support --------------------------------------------------------------------

    def lock(self) -> bool:
        """True: a copy has one user."""
        return True

    def unlock(self) -> bool:
        """True: a copy has one user."""
        return True

    def load(self, filename: str = "", context: str = _SCENE) -> NoReturn:
        """:raises WmException: always."""
        raise WmException("a copy of a scene cannot load files")

    def save(self, filename: str = "", context: str = _SCENE) -> NoReturn:
        """:raises WmException: always."""
        raise WmException("a copy of a scene cannot be saved")

    def validate(self, context_id: str = _SCENE) -> NoReturn:
        """:raises WmException: always."""
        raise WmException("a copy of a scene cannot be validated")

    def set_last_will(self, actions: Sequence[CleanupAction]) -> None:
        """No effect: the copy ends with its process."""

    # -- the port ----------------------------------------------------------------------------------------------

    @property
    def _ontology(self) -> Ontology:
        return self._wm._ontology

    def _local(self, context: str) -> SceneReader:
        return self._reader

    def _scenes(self, context: str) -> list[Scene]:
        return [self._scene] if context in ("", _SCENE) else []

    def _query(self, query: str, cut_prefix: bool, context: str) -> list[str]:
        if context != "ontology":
            raise WmException("a copy of a scene can only query the ontologies")
        return self._wm._query(query, cut_prefix, context)

    def _query_json(self, query: str, context: str) -> str:
        if context != "ontology":
            raise WmException("a copy of a scene can only query the ontologies")
        return self._wm._query_json(query, context)

    def _modify(self, statements: Sequence[Statement], context: str) -> NoReturn:
        raise WmException("a copy of a scene cannot change the ontologies")

    def get_scene(self) -> tuple[list[Element], str]:
        with self._lock:
            return self.get_scene_elements(), self._notifier.snapshot_id

    def _related(self, src: str, pred: str, dst: str) -> list[RelationDict]:
        return self._reader.related(src, pred, dst, _SCENE)

    def _template(self, name: str) -> Element:
        return self._wm._template(name)

    def transact(self, operations: Sequence[Operation], context_id: str = "scene") -> Outcome:
        with self._lock:
            # Prefixes matter only for names that are IRIs; a scene has none.
            checks = Checks(self._ontology, Prefixes(), self.author, self._strict, self._warned)
            transaction = Transaction(self._scene, self._ontology, checks, self.author)
            self._scene.begin()
            try:
                with wm_errors():
                    ids = transaction.run(operations)
            except Exception:
                self._scene.roll_back()
                raise
            provenance = self._notifier.next(self.author)
            committed = self._scene.commit(provenance)
            changed = [eid for eid in committed.ids() if eid in self._scene]
            pending = [PendingChange(UPDATE, ids=changed), PendingChange(REMOVE, committed.removed())]
            return Outcome(ids, self._notifier.publish(pending, provenance, _SCENE, self._scene))
