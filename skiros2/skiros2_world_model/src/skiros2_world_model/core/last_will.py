"""Last wills: cleanup actions that the world model runs when a node dies, as in MQTT.

A node sets its last will while it runs. The world model executes and deletes it when that process ends without having
withdrawn it, or when another process of the same node name sets a new one. Last wills are stored in the journal.

An open connection detects the death (`ros/node_watch.py`), not a lease with a heartbeat: a killed node is detected at
once instead of after several missed heartbeats, a stopped or busy node does not count as dead, and nodes send nothing.
"""

from __future__ import annotations

import json
import logging
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING

from skiros2_common.core.element_content import ElementChanges
from skiros2_common.core.errors import SkirosError, WrongValue
from skiros2_common.core.operations import SCENE, CleanupAction, Operation, Patch, Remove
from skiros2_common.core.property import Property
from skiros2_common.core.world_element import Element

if TYPE_CHECKING:  # clients on Debian's Python have no RDF library
    from skiros2_world_model.core.journal import Journal
    from skiros2_world_model.core.world_model import WorldModel

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class NodeProcess:
    """The process of a node: its slave API URI and process id distinguish it from other processes of the same name."""

    uri: str
    pid: int


@dataclass(frozen=True, eq=False)
class LastWill:
    """The cleanup actions of a node's process."""

    owner: str
    process: NodeProcess
    actions: Sequence[CleanupAction]


def last_will_author(owner: str) -> str:
    """The author of the changes when a last will is executed."""
    return f"last will of {owner}"


def last_wills_json(wills: Mapping[str, LastWill]) -> str:
    """Serializes last wills.

    :raises WrongValue: a value has a type that cannot be written.
    """
    try:
        return json.dumps([asdict(will) for will in wills.values()], default=lambda prop: prop.values)
    except (AttributeError, TypeError, ValueError) as error:
        raise WrongValue(f"the last wills of {', '.join(wills)} cannot be written: {error}") from None


def parse_last_wills(text: str) -> dict[str, LastWill]:
    """Parses last wills, by owner. Returns none when the text is invalid."""
    wills: dict[str, LastWill] = {}
    try:
        for will in json.loads(text or "[]"):
            actions = []
            for action in will["actions"]:
                properties = {key: Property(key, values or str) for key, values in action.pop("properties").items()}
                actions.append(CleanupAction(**action, properties=properties))
            wills[will["owner"]] = LastWill(will["owner"], NodeProcess(**will["process"]), actions)
    except (AttributeError, LookupError, TypeError, ValueError) as error:
        log.error("the last wills in the journal cannot be read and are lost: %s", error)
        return {}
    return wills


#: The meta key in the journal.
_META_KEY = "last wills"


class LastWillStore:
    """The last wills of a world model, one for each owner. Thread-safe.

    :param model: the world model; its lock guards the store.
    :param journal: persists the last wills, including those of a previous process of the world model.
    """

    def __init__(self, model: WorldModel, journal: Journal | None = None) -> None:
        self._model = model
        self._journal = journal
        self._wills = parse_last_wills(journal.get_meta(_META_KEY)) if journal is not None else {}

    def all(self) -> list[LastWill]:
        """All stored last wills."""
        with self._model.lock:
            return list(self._wills.values())

    def put(self, will: LastWill) -> None:
        """Replaces the last will of its owner. Executes the previous one if it is of another process.

        :raises WrongValue: a cleanup action lacks key or value, or has values that cannot be written.
        :raises Refused: the journal cannot be written.
        """
        if not will.owner or not all(b.key and b.value for b in will.actions):
            text = "expected an owner, and key and value in each cleanup action"
            raise WrongValue(f"the last will of {will.owner!r}: {text}")
        with self._model.lock:
            before = self._wills.get(will.owner)
            if before is not None and before.process != will.process:
                self.execute(before.owner, before.process)
            self._save({**self._wills, will.owner: will})

    def remove(self, owner: str) -> None:
        """Deletes a last will if it exists.

        :raises Refused: the journal cannot be written.
        """
        with self._model.lock:
            if owner in self._wills:
                self._save({name: will for name, will in self._wills.items() if name != owner})

    def execute(self, owner: str, process: NodeProcess) -> None:
        """Executes and deletes the last will of a node's process; no effect when there is none.

        The actions are one request. If it is refused, each action is tried on its own and refusals are logged.
        """
        with self._model.lock:
            will = self._wills.get(owner)
            if will is None or will.process != process:
                return
            author = last_will_author(owner)
            operations = self._operations(will)
            log.warning("%s has died: its last will makes %d changes", owner, len(operations))
            try:
                self._model.transact(operations, author)
            except SkirosError as error:
                log.warning("%s: %s; each action is tried on its own", author, error)
                for operation in operations:
                    self._try(operation, author)
            try:
                self.remove(owner)
            except SkirosError as error:
                log.error("%s stays in the journal: %s", author, error)
                del self._wills[owner]

    def _try(self, operation: Operation, author: str) -> None:
        try:
            self._model.transact([operation], author)
        except SkirosError as error:
            log.error("%s: %s", author, error)

    def _operations(self, will: LastWill) -> list[Operation]:
        """The operations of a last will on the current scene."""
        reader = self._model.reader
        removed: dict[str, Operation] = {}
        written: list[Operation] = []
        for action in will.actions:
            like = Element("")
            like.setProperty(action.key, action.value)
            for element in reader.matching(like, SCENE):
                if action.relation:
                    for relation in reader.related(element.id, action.relation, "", SCENE):
                        if reader.find(relation["dst"], SCENE) is not None:
                            removed[relation["dst"]] = Remove(relation["dst"], True, action.below)
                if action.properties:
                    written.append(Patch(element.id, _changes(element, action.properties)))
        return [*written, *removed.values()]

    def _save(self, wills: dict[str, LastWill]) -> None:
        if self._journal is not None:
            self._journal.set_meta(_META_KEY, last_wills_json(wills))
        self._wills = wills


def _changes(element: Element, properties: Mapping[str, Property]) -> ElementChanges:
    return ElementChanges(
        {key: prop for key, prop in properties.items() if prop.values},
        [key for key, prop in properties.items() if not prop.values and element.hasProperty(key)],
    )
