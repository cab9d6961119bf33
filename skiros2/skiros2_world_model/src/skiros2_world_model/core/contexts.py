"""The contexts of a world model, by name."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from skiros2_common.core.world_element import ElementChanges
from skiros2_world_model.core.changes import Patch, relation_dict
from skiros2_world_model.core.context import Context
from skiros2_world_model.core.context_names import SCENE
from skiros2_world_model.core.ontology_base import OntologyBase
from skiros2_world_model.core.scene import Scene


class Contexts(dict[str, Context]):
    """The contexts that were named so far. Used under the world model's lock."""

    def __init__(self, base: OntologyBase) -> None:
        super().__init__()
        self._base = base
        self.named(SCENE)

    def named(self, name: str) -> Context:
        """The context, which is made when it is named for the first time.

        :raises WrongValue: no context can have that name.
        """
        found = self.get(name)
        if found is None:
            found = self[name] = Context(name, self._base)
        return found

    def scenes(self) -> list[Scene]:
        """The scenes of all contexts."""
        return [context.scene for context in self.values()]

    def others(self, name: str) -> dict[str, Scene]:
        """The scenes of the other contexts."""
        return {context.name: context.scene for context in self.values() if context.name != name}

    def home(self, eid: str, first: str = SCENE) -> str:
        """The context that has an element; "" when none has.

        :param first: is looked at first.
        """
        order = sorted(self, key=lambda name: name != first)
        return next((name for name in order if eid in self[name].scene), "")

    def dangling(self, gone: Sequence[str]) -> Iterator[tuple[str, list[Patch]]]:
        """By context, what takes away the relations to elements that no context has any more."""
        gone = [eid for eid in gone if not self.home(eid)]
        for name, context in list(self.items()):
            patches = [
                Patch(src, ElementChanges(removed_relations=[relation_dict("-1", pred, dst)]))
                for eid in gone
                for src, pred, dst in context.scene.relations(dst=eid)
            ]
            if patches:
                yield name, patches
