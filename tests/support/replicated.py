"""A transport in this process whose scene can be replicated, as that of a node."""

from __future__ import annotations

from skiros2_world_model.core.local_world_model import LocalTransport
from skiros2_world_model.core.replica import Snapshot


class ReplicatedTransport(LocalTransport):
    """A `RemoteTransport` without ROS."""

    @property
    def ontology_version(self) -> int:
        return self._model.number

    def fetch(self) -> Snapshot:
        with self._model.lock:
            scene = self._model.scene()
            elements = [element for node in scene if (element := scene.element(node.id)) is not None]
            return Snapshot(self._model.snapshot_id, self._model.number, elements)
