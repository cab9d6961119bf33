"""The client of the ontologies over ROS."""

from __future__ import annotations

from skiros2_world_model.core.world_model_abstract_interface import OntologyAbstractInterface
from skiros2_world_model.ros.ros_transport import RosTransport

__all__ = ["OntologyInterface"]


class OntologyInterface(OntologyAbstractInterface):
    """The ontologies, and the RDF view of all contexts, of the node `wm` in this node's namespace.

    The constructor blocks until the server answers. The interface survives restarts of the server and the ROS master.

    :param author_name: the author of the changes.
    """

    def __init__(self, author_name: str = "test") -> None:
        transport = RosTransport(author_name)
        transport.follow()
        super().__init__(transport)
