"""The reasoners of a world model, and how each change is offered to them before it stands."""

from __future__ import annotations

import logging
from collections.abc import Iterator

from skiros2_common.core.discrete_reasoner import DiscreteReasoner
from skiros2_common.core.errors import Refused, SkirosError, UnknownName
from skiros2_common.core.world_element import REASONER_PROPERTY, Element
from skiros2_world_model.core.changes import ADD, REMOVE, UPDATE
from skiros2_world_model.core.scene import Node, Scene
from skiros2_world_model.core.transaction import Transaction

log = logging.getLogger(__name__)


class Reasoning:
    """The loaded reasoners. Used under the world model's lock."""

    def __init__(self) -> None:
        self._reasoners: dict[str, DiscreteReasoner] = {}
        self._members: dict[str, set[str]] = {}  # by reasoner, the elements that it was told of
        self._offered: list[tuple[DiscreteReasoner, Element]] = []  # in the request under way

    def add(self, reasoner: DiscreteReasoner) -> None:
        """Adds a reasoner, known by its class name."""
        self._reasoners[reasoner.__class__.__name__] = reasoner
        self._members[reasoner.__class__.__name__] = set()

    def all(self) -> list[DiscreteReasoner]:
        return list(self._reasoners.values())

    def keys_of(self, name: str) -> frozenset[str]:
        """The properties that a reasoner owns.

        :raises UnknownName: it is not loaded.
        """
        reasoner = self._reasoners.get(name)
        if reasoner is None:
            loaded = ", ".join(self._reasoners) or "none"
            raise UnknownName(f"there is no reasoner {name!r}; loaded: {loaded}")
        return frozenset([*reasoner.getAssociatedData(), REASONER_PROPERTY])

    def offer(self, scene: Scene, transaction: Transaction) -> None:
        """Offers a transaction's elements to their reasoners, which may complete them.

        Then call `settle` or `take_back`.

        :raises Refused: a reasoner rejects one.
        """
        if not self._reasoners:
            return
        for element in transaction.removed:
            for reasoner in self._told(element.id):
                self._ask(reasoner, element, REMOVE)
        for eid in scene.touched():
            element_now = scene.element(eid)
            if element_now is None:
                continue
            named, told = list(self._of(element_now)), self._told(eid)
            for reasoner in told:
                if reasoner not in named:
                    self._ask(reasoner, element_now, REMOVE)
            for reasoner in named:
                self._ask(reasoner, element_now, UPDATE if reasoner in told else ADD)
            changes = element_now.changes()
            if changes:
                transaction.patch(eid, changes, [])

    def settle(self) -> None:
        """What was offered stands."""
        self._offered = []

    def take_back(self, scene: Scene) -> None:
        """After a roll-back: tells the reasoners what they were offered as it is again."""
        for reasoner, element in reversed(self._offered):
            before = scene.element(element.id)
            if before is None or reasoner not in self._of(before):
                self._tell(reasoner, element, REMOVE)
            else:
                self._tell(reasoner, before, UPDATE if reasoner in self._told(element.id) else ADD)
        self._offered = []

    def replace(self, old: Scene, new: Scene) -> None:
        """Another scene takes the place of one.

        :raises Refused: a reasoner rejects one of the new elements; then call it with the two exchanged.
        """
        for name, reasoner in self._reasoners.items():
            for eid in list(self._members[name]):
                element = old.element(eid)
                assert element is not None
                self._tell(reasoner, element, REMOVE)
        for node in list(new):
            self.introduce(new, node.id)

    def introduce(self, scene: Scene, eid: str, only: DiscreteReasoner | None = None) -> None:
        """Offers an element that is in a scene already to its reasoners, or to one of them.

        :raises Refused: a reasoner rejects it.
        """
        node = scene.node(eid)
        assert node is not None
        if REASONER_PROPERTY not in node.properties:
            return
        element = scene.element(eid)
        assert element is not None
        for reasoner in self._of(element):
            if only is None or reasoner is only:
                self._ask(reasoner, element, ADD)
        self.settle()
        changes = element.changes()
        if changes and changes.properties:
            properties = {**node.properties, **{key: p.clone() for key, p in changes.properties.items()}}
            scene.put(Node(eid, node.type, node.label, properties, node.made))

    def _ask(self, reasoner: DiscreteReasoner, element: Element, action: str) -> None:
        self._offered.append((reasoner, element))
        name = reasoner.__class__.__name__
        try:
            accepted = self._parse(reasoner, element, action)
        except SkirosError:
            raise
        except Exception as error:
            log.exception("reasoner %s failed to %s %s", name, action, element.id)
            raise Refused(f"{name} failed to {action} {element!r}: {error}") from error
        if accepted is False:
            raise Refused(f"{name} rejects to {action} {element!r}")

    def _tell(self, reasoner: DiscreteReasoner, element: Element, action: str) -> None:
        """Likewise, of what stands whatever the reasoner says."""
        try:
            self._parse(reasoner, element, action)
        except Exception:
            log.exception("reasoner %s failed to %s %s", reasoner.__class__.__name__, action, element.id)

    def _parse(self, reasoner: DiscreteReasoner, element: Element, action: str) -> bool | None:
        members = self._members[reasoner.__class__.__name__]
        if action == REMOVE:
            members.discard(element.id)
        else:
            members.add(element.id)
        return reasoner.parse(element, action)

    def _told(self, eid: str) -> list[DiscreteReasoner]:
        """The reasoners that know of an element."""
        return [reasoner for name, reasoner in self._reasoners.items() if eid in self._members[name]]

    def _of(self, element: Element) -> Iterator[DiscreteReasoner]:
        """The loaded reasoners that an element names."""
        prop = element._props.get(REASONER_PROPERTY)
        for name in dict.fromkeys(prop.values) if prop is not None else ():
            if name in self._reasoners:
                yield self._reasoners[name]
