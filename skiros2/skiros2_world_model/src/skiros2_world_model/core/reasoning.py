"""The reasoners of a world model, and how each change is offered to them before it stands."""

from __future__ import annotations

from collections.abc import Iterator

from skiros2_common.core.discrete_reasoner import DiscreteReasoner
from skiros2_common.core.errors import Refused, UnknownName
from skiros2_common.core.world_element import REASONER_PROPERTY, Element
from skiros2_world_model.core.changes import ADD, REMOVE, UPDATE
from skiros2_world_model.core.scene import Node, Scene
from skiros2_world_model.core.transaction import Transaction


class Reasoning:
    """The loaded reasoners. Used under the world model's lock."""

    def __init__(self) -> None:
        self._reasoners: dict[str, DiscreteReasoner] = {}
        self._offered: list[tuple[DiscreteReasoner, Element]] = []

    def add(self, reasoner: DiscreteReasoner) -> None:
        """Adds a reasoner, known by its class name."""
        self._reasoners[reasoner.__class__.__name__] = reasoner

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

        :raises Refused: a reasoner rejects one.
        """
        self._offered = []
        if not self._reasoners:
            return
        for element in transaction.removed:
            for reasoner in self._of(element):
                self._ask(reasoner, element, REMOVE)
        for eid in scene.touched():
            element_now = scene.element(eid)
            if element_now is None:
                continue
            for reasoner in self._of(element_now):
                self._ask(reasoner, element_now, ADD if eid in transaction.added else UPDATE)
            changes = element_now.changes()
            if changes:
                transaction.patch(eid, changes, [])
        self._offered = []

    def take_back(self, scene: Scene) -> None:
        """After a roll-back: tells the reasoners what they were offered as it is again."""
        for reasoner, element in self._offered:
            before = scene.element(element.id)
            if before is None:
                reasoner.parse(element, REMOVE)
            else:
                reasoner.parse(before, UPDATE)
        self._offered = []

    def replace(self, old: Scene, new: Scene) -> None:
        """Another scene takes the place of one.

        :raises Refused: a reasoner rejects one of the new elements.
        """
        if not self._reasoners:
            return
        for node in old:
            element = old.element(node.id)
            assert element is not None
            for reasoner in self._of(element):
                reasoner.parse(element, REMOVE)
        for node in list(new):
            self.introduce(new, node.id)

    def introduce(self, scene: Scene, eid: str, only: DiscreteReasoner | None = None) -> None:
        """Offers an element that is in a scene already to its reasoners, or to one of them.

        :raises Refused: a reasoner rejects it.
        """
        element = scene.element(eid)
        node = scene.node(eid)
        assert element is not None and node is not None
        for reasoner in self._of(element):
            if only is None or reasoner is only:
                self._ask(reasoner, element, ADD)
        changes = element.changes()
        if changes and changes.properties:
            properties = {**node.properties, **{key: p.clone() for key, p in changes.properties.items()}}
            scene.put(Node(eid, node.type, node.label, properties, node.made))
        self._offered = []

    def _ask(self, reasoner: DiscreteReasoner, element: Element, action: str) -> None:
        self._offered.append((reasoner, element))
        if reasoner.parse(element, action) is False:
            raise Refused(f"{reasoner.__class__.__name__} rejects to {action} {element!r}")

    def _of(self, element: Element) -> Iterator[DiscreteReasoner]:
        prop = element._props.get(REASONER_PROPERTY)
        if prop is not None:
            for name in prop.values:
                if name in self._reasoners:
                    yield self._reasoners[name]
