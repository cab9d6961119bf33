"""The client of the world model over ROS, with or without a replica of the scene."""

from __future__ import annotations

from collections.abc import Callable

from skiros2_common.core.discrete_reasoner import reasoners
from skiros2_common.core.world_element import Element
from skiros2_common.ros.parameters import texts_param
from skiros2_common.ros.reasoners import available_reasoners
from skiros2_msgs import msg as msgs
from skiros2_world_model.core.ontology_client import OntologyClient
from skiros2_world_model.core.replica_transport import ReplicaTransport
from skiros2_world_model.core.wm_errors import WmConflict, WmException
from skiros2_world_model.core.world_model_abstract_interface import WorldModelAbstractInterface
from skiros2_world_model.ros.ontology_interface import OntologyInterface
from skiros2_world_model.ros.ros_transport import SERVER, RosTransport

__all__ = ["Element", "WmConflict", "WmException", "WorldModelInterface"]


class WorldModelInterface(OntologyInterface, WorldModelAbstractInterface):
    """The world model node `wm` in this node's namespace. The constructor blocks until the server answers.

    :param author_name: the author of the changes.
    :param make_cache: keeps a replica of the scene, so that reads need no service calls.
    """

    def __init__(self, author_name: str = "test", make_cache: bool = False) -> None:
        #: The transport to the node, without the replica.
        self.remote = RosTransport(author_name)
        OntologyClient.__init__(self, ReplicaTransport(self.remote) if make_cache else self.remote)
        self.remote.follow()
        load_reasoners(SERVER)

    def set_monitor_cb(self, cb: Callable[[msgs.WmMonitor], None] | None) -> None:
        """Calls `cb(message)` with each `WmMonitor`, in the thread of the subscription. None removes the callback."""
        self.remote.monitor_cb = cb


def load_reasoners(server: str) -> None:
    """Loads the server's reasoners in this process, if they are installed."""
    for reasoner in available_reasoners(texts_param(f"{server}/reasoners_pkgs"), reasoners.names()):
        reasoners.add(reasoner)
