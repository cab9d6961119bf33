"""The ontologies of scenes, read once per process: reading them takes longer than loading a scene."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from skiros2_world_model.core.knowledge_base import KnowledgeBase
from skiros2_world_model.core.local_world_model import LocalWorldModel, source_ontologies
from skiros2_world_model.core.world_model import WorldModel

#: By scene, knowledge bases that no world model uses, as they were read.
_free: dict[Path, list[KnowledgeBase]] = {}


@contextmanager
def fresh_world_model(scene: Path) -> Iterator[LocalWorldModel]:
    """Makes a new world model with a scene. It equals the first one of a process: a knowledge base that an execution
    has changed is not used again. Any thread.

    :param scene: file; the ontologies in its folder are loaded.
    :raises ConfigurationError: a file does not parse.
    """
    known = _free.setdefault(scene, [])
    try:
        knowledge_base = known.pop()
    except IndexError:
        knowledge_base = KnowledgeBase(source_ontologies(), scene.parent)
    index = knowledge_base.index
    model = WorldModel(workspace=scene.parent, knowledge_base=knowledge_base)
    model.load_initial(scene.name)
    yield LocalWorldModel("test", model)
    # a query writes the scene to the store
    if knowledge_base.index is index and not any(knowledge_base.store.triples(name) for name in model.contexts()):
        known.append(knowledge_base)
