"""Loads and runs the reasoners of a world model node."""

from __future__ import annotations

import logging

from skiros2_common.core.discrete_reasoner import reasoners
from skiros2_common.core.errors import FOREIGN_ERRORS
from skiros2_common.ros.reasoners import new_reasoners
from skiros2_world_model.core.reasoner_world_model import ReasonerWorldModel
from skiros2_world_model.core.world_model import WorldModel

log = logging.getLogger(__name__)


class Reasoners:
    """The reasoners that a server runs."""

    def __init__(self, model: WorldModel, packages: list[str]) -> None:
        """Loads and starts the reasoners of some Python packages.

        :raises ConfigurationError: a package does not exist.
        """
        self._reasoning = model.reasoning
        wmi = ReasonerWorldModel(model)
        for reasoner in new_reasoners(packages):
            try:
                reasoner.init(wmi)
                reasoners.add(reasoner)
            except FOREIGN_ERRORS:
                log.exception("reasoner %s cannot be initialised and is skipped", reasoner.__class__.__name__)
                continue
            model.add_reasoner(reasoner)
        self._reasoning.execute()
        log.info("reasoners: %s", ", ".join(r.__class__.__name__ for r in self._reasoning.all()) or "none")

    def stop(self) -> None:
        """Stops all reasoners and waits for them."""
        self._reasoning.stop()
