"""The reasoners that a world model node runs."""

from __future__ import annotations

import logging
import threading
from collections.abc import Sequence

from skiros2_common.core.discrete_reasoner import DiscreteReasoner, reasoners
from skiros2_common.core.errors import ConfigurationError
from skiros2_common.tools.plugin_loader import PluginLoader
from skiros2_world_model.core.local_world_model import LocalWorldModel
from skiros2_world_model.core.world_model import WorldModel

log = logging.getLogger(__name__)


def new_reasoners(packages: Sequence[str]) -> list[DiscreteReasoner]:
    """One of each kind of reasoner that the packages have.

    :raises ConfigurationError: a package does not exist, or has a module that cannot be imported.
    """
    loader = PluginLoader()
    for package in packages:
        loader.load(package, DiscreteReasoner)
    if loader.failures:
        module, cause = next(iter(loader.failures.items()))
        raise ConfigurationError(f"reasoners: module {module} cannot be imported: {cause}")
    return loader.create()


class Reasoners:
    """The reasoners that a server runs, each with a thread of its own."""

    def __init__(self, model: WorldModel, packages: list[str]) -> None:
        """Loads and starts the reasoners of some Python packages.

        :raises ConfigurationError: a package does not exist, or has a module that cannot be imported.
        """
        self._running: list[tuple[DiscreteReasoner, threading.Thread]] = []
        for reasoner in new_reasoners(packages):
            name = reasoner.__class__.__name__
            reasoners.add(reasoner)
            reasoner.init(LocalWorldModel(name, model))
            model.add_reasoner(reasoner)
            thread = threading.Thread(target=_run, args=(reasoner,), name=name, daemon=True)
            self._running.append((reasoner, thread))
            thread.start()
            log.info("reasoner %s is running", name)

    def stop(self) -> None:
        """Asks all to end, and waits for them."""
        for reasoner, _ in self._running:
            reasoner.stop()
        for _, thread in self._running:
            thread.join(2.0)


def _run(reasoner: DiscreteReasoner) -> None:
    try:
        reasoner.execute()
    except Exception:
        log.exception("reasoner %s has ended", reasoner.__class__.__name__)
