"""OPC UA in tests: the server with the node set of the set-up, and what clients need to know."""

from __future__ import annotations

from pathlib import Path

import pytest
from asyncua import Client

from skiros2_gateway.core.service import Service
from skiros2_gateway.core.settings import Settings
from skiros2_gateway.opcua.model import CELL_NAMESPACE
from skiros2_gateway.opcua.server import OpcuaServer
from support.source import ROOT

_NODESETS = ROOT / "build/nodesets"


def nodesets() -> Path:
    """Returns the folder of the node set, which `make setup` takes. Without it the test is skipped."""
    if not _NODESETS.is_dir():
        pytest.skip("needs the node set of OPC UA: npm had no network at the set-up")
    return _NODESETS


def opcua_server(service: Service, folder: Path, **settings: str) -> OpcuaServer:
    """Returns a server at a free port, to be started."""
    return OpcuaServer(service, Settings(folder=folder, opcua_port=0, **settings), nodesets())


async def cell_index(client: Client) -> int:
    """Returns the index of the cell's namespace."""
    [index] = (i for i, uri in enumerate(await client.get_namespace_array()) if uri.startswith(CELL_NAMESPACE))
    return index
