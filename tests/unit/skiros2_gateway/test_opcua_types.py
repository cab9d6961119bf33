"""The address space of the OPC UA server, as a client browses it, against the official node set of OPC 10031-4."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("asyncua")

from asyncua import Client, Node, ua

from skiros2_common.core.errors import ConfigurationError
from skiros2_gateway.core.job import Method, State, Substate
from skiros2_gateway.core.settings import Settings
from skiros2_gateway.opcua.identity import cell_name
from skiros2_gateway.opcua.model import NODESET
from skiros2_gateway.opcua.server import OpcuaServer
from support.opcua import nodesets
from unit.skiros2_gateway.opcua_client import Mes

_XML = "{http://opcfoundation.org/UA/2011/03/UANodeSet.xsd}"
_TYPES = "{http://opcfoundation.org/UA/2008/02/Types.xsd}"
_CLASSES = {f"{_XML}UA{each.name}": each for each in ua.NodeClass if each.value}


@dataclass
class Expected:
    """A node of the node set; node ids and names with the index of the server's namespace."""

    node_class: ua.NodeClass
    name: ua.QualifiedName
    references: set[tuple[ua.NodeId, ua.NodeId]] = field(default_factory=set)
    data_type: ua.NodeId | None = None
    value_rank: int = -1
    fields: list[tuple[str, ua.NodeId, int, bool]] = field(default_factory=list)
    arguments: list[tuple[str, ua.NodeId, int]] = field(default_factory=list)
    number: int | None = None


class NodeSet:
    """The nodes of the file, read without asyncua."""

    def __init__(self, index: int) -> None:
        self._index = index
        root = ET.parse(nodesets() / NODESET).getroot()
        self._aliases = {each.get("Alias"): each.text or "" for each in root.iter(f"{_XML}Alias")}
        self.nodes = {self.id(each.get("NodeId", "")): self._node(each) for each in root if each.tag in _CLASSES}

    def id(self, text: str) -> ua.NodeId:
        """Returns the id of an alias or a text such as `ns=1;i=7`."""
        node = ua.NodeId.from_string(self._aliases.get(text, text))
        return ua.NodeId(node.Identifier, self._index if node.NamespaceIndex else 0)

    def _node(self, element: ET.Element) -> Expected:
        text = element.get("BrowseName", "")
        is_own = text.startswith("1:")
        name = text.removeprefix("1:")
        found = Expected(_CLASSES[element.tag], ua.QualifiedName(name, self._index if is_own else 0))
        for each in element.iter(f"{_XML}Reference"):
            if each.get("IsForward") != "false":
                found.references.add((self.id(each.get("ReferenceType", "")), self.id(each.text or "")))
        if found.node_class is ua.NodeClass.Variable:
            found.data_type = self.id(element.get("DataType", "i=24"))
            found.value_rank = int(element.get("ValueRank", "-1"))
        for each in element.iter(f"{_XML}Field"):
            kind, rank = self.id(each.get("DataType", "i=24")), int(each.get("ValueRank", "-1"))
            found.fields.append((each.get("Name", ""), kind, rank, each.get("IsOptional") == "true"))
        for each in element.iter(f"{_TYPES}Argument"):
            kind = self.id(each.findtext(f"{_TYPES}DataType/{_TYPES}Identifier", ""))
            rank = int(each.findtext(f"{_TYPES}ValueRank", "-1"))
            found.arguments.append((each.findtext(f"{_TYPES}Name", ""), kind, rank))
        if name in ("StateNumber", "TransitionNumber"):
            found.number = int(element.findtext(f"{_XML}Value/{_TYPES}UInt32", "-1"))
        return found


async def _found(node: Node, expected: Expected) -> Expected:
    """Returns what the server has of an expected node."""
    found = Expected(await node.read_node_class(), await node.read_browse_name())
    references = await node.get_references(direction=ua.BrowseDirection.Forward)
    found.references = {(each.ReferenceTypeId, each.NodeId) for each in references}
    if expected.data_type is not None:
        found.data_type, found.value_rank = await node.read_data_type(), int(await node.read_value_rank())
    if expected.fields:
        definition = await node.read_data_type_definition()
        found.fields = [(e.Name, e.DataType, int(e.ValueRank), bool(e.IsOptional)) for e in definition.Fields]
    if expected.arguments:
        found.arguments = [(e.Name, e.DataType, int(e.ValueRank)) for e in await node.read_value()]
    if expected.number is not None:
        found.number = await node.read_value()
    return found


async def _nodes_of(client: Client, index: int) -> set[ua.NodeId]:
    """Returns the ids of all nodes in a namespace that can be reached from the root."""
    seen, waiting = {client.nodes.root.nodeid}, [client.nodes.root.nodeid]
    while waiting:
        asked, waiting = waiting, []
        results = await client.browse_nodes([client.get_node(each) for each in asked])
        for _, result in results:
            for each in result.References or []:
                if each.NodeId not in seen:
                    seen.add(each.NodeId)
                    waiting.append(each.NodeId)
    return {each for each in seen if each.NamespaceIndex == index}


def test_each_node_of_the_node_set_is_there_with_its_id_and_nothing_else(in_server: Callable[..., None]) -> None:
    async def test(gateway: Any) -> None:
        async with Mes(gateway.address, "view") as mes:
            await mes.load()
            expected = NodeSet(mes.index).nodes
            kinds = [each.node_class for each in expected.values()]
            assert kinds.count(ua.NodeClass.Method) == 14 and kinds.count(ua.NodeClass.DataType) == 11
            for node_id, wanted in expected.items():
                found = await _found(mes.get_node(node_id), wanted)
                missing = wanted.references - found.references
                assert not missing, (node_id, wanted.name, missing)
                found.references = wanted.references
                assert found == wanted, node_id
            assert not await _nodes_of(mes, mes.index) - set(expected)

    in_server(test)


def test_instances_are_in_the_cells_namespace_and_have_all_parts_of_their_types(in_server: Callable[..., None]) -> None:
    async def test(gateway: Any) -> None:
        async with Mes(gateway.address, "view") as mes:
            await mes.load()
            for name in ("JobOrderReceiver", "JobResponseProvider", "JobResponseReceiver"):
                node = await mes.object(name)
                assert node.nodeid == ua.NodeId(name, mes.cell)
                type_node = mes.get_node(await node.read_type_definition())
                parts = {(await each.read_browse_name()).to_string(): each for each in await node.get_children()}
                assert {each.nodeid.NamespaceIndex for each in parts.values()} == {mes.cell}
                while type_node.nodeid.NamespaceIndex == mes.index:
                    for each in await type_node.get_children():
                        rules = await each.get_referenced_nodes(ua.ObjectIds.HasModellingRule)
                        if rules:  # states and transitions are of the type alone
                            assert (await each.read_browse_name()).to_string() in parts
                    [type_node] = await type_node.get_referenced_nodes(
                        ua.ObjectIds.HasSubtype, ua.BrowseDirection.Inverse
                    )

    in_server(test)


def test_two_cells_have_different_namespaces(tmp_path: Path) -> None:
    folders = [tmp_path / name for name in "ab"]
    for folder in folders:
        folder.mkdir()
    names = [cell_name(Settings(folder=folder)) for folder in (*folders, *folders)]
    assert names[:2] == names[2:] and names[0] != names[1]
    assert cell_name(Settings(folder=tmp_path, cell="hall-2")) == "hall-2"


def test_numbers_of_states_are_those_of_the_node_set() -> None:
    nodes = NodeSet(2).nodes
    numbers: dict[str, set[int]] = {}
    for wanted in nodes.values():
        for _, target in wanted.references:
            part = nodes.get(target)
            if part is not None and part.number is not None and part.name.Name == "StateNumber":
                numbers.setdefault(wanted.name.Name, set()).add(part.number)
    ours = {each.value: {each.number} for each in (*State, *Substate) if each}
    assert numbers == ours
    assert {each.name.Name for each in nodes.values() if each.node_class is ua.NodeClass.Method} >= set(Method)


def test_server_without_the_node_set_names_the_command_that_takes_it(
    in_gateway: Callable[..., None], tmp_path: Path
) -> None:
    async def test(gateway: Any) -> None:
        server = OpcuaServer(gateway.service, Settings(folder=gateway.path.parent, opcua_port=0), tmp_path / "none")
        with pytest.raises(ConfigurationError, match=r'none/opc\.ua.*is missing; run: make setup FOR="gateway page"'):
            await server.start()

    in_gateway(test)
