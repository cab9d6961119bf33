"""The names of the contract for the clients of a world model, and the errors of their calls."""

from __future__ import annotations

from skiros2_world_model.core.ontology_client import OntologyClient
from skiros2_world_model.core.wm_errors import WmConflict, WmException
from skiros2_world_model.core.world_model_client import WorldModelClient

__all__ = ["OntologyAbstractInterface", "WmConflict", "WmException", "WorldModelAbstractInterface"]


class OntologyAbstractInterface(OntologyClient):
    """`OntologyClient` under its name of the contract."""


class WorldModelAbstractInterface(WorldModelClient):
    """`WorldModelClient` under its name of the contract."""
