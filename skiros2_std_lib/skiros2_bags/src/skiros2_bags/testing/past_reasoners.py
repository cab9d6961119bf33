"""The reasoners of a world model that is replayed: they complete what is written, and write nothing by themselves."""

from __future__ import annotations

from collections.abc import Sequence

from skiros2_common.core.discrete_reasoner import reasoners
from skiros2_common.core.world_element import REASONER_PROPERTY
from skiros2_common.ros.reasoners import new_reasoners
from skiros2_world_model.core.reasoner_world_model import ReasonerWorldModel
from skiros2_world_model.core.world_model import WorldModel

#: As the launch files have it.
PACKAGES = ("skiros2_std_reasoners",)


def add_reasoners(model: WorldModel, packages: Sequence[str] = PACKAGES) -> None:
    """Adds the reasoners that elements of the scene name, without their loops: what those wrote is recorded.

    :param packages: where they are.
    :raises ConfigurationError: a package does not exist.
    """
    scene = model.scene()
    naming = (node.properties[REASONER_PROPERTY] for node in scene if REASONER_PROPERTY in node.properties)
    named = {name for prop in naming for name in prop.values}
    if not named:
        return
    for reasoner in new_reasoners(packages):
        name = reasoner.__class__.__name__
        if name in named:
            reasoners.add(reasoner)
            reasoner.init(ReasonerWorldModel(model))
            model.add_reasoner(reasoner)
            reasoner.run = lambda: None  # type: ignore[method-assign]
            reasoner.execute()
