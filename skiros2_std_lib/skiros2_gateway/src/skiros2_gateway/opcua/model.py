"""The types of ISA-95 Job Control (OPC 10031-4) from the official node set, and the cell's instances of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from asyncua import Node, Server, ua

from skiros2_common.core.errors import ConfigurationError

#: The namespace of the types. The node set alone adds nodes to it.
NAMESPACE = "http://opcfoundation.org/UA/ISA95-JOBCONTROL_V2/"
#: The begin of the URI of a cell's namespace, which has all instances; the cell's name follows.
CELL_NAMESPACE = "urn:skiros2:cell:"
#: The file of the node set. `nodesets/take` takes it from the package at set-up.
NODESET = "opc.ua.isa95-jobcontrol.nodeset2.xml"

RECEIVER, PROVIDER, RESPONSE_RECEIVER = "JobOrderReceiver", "JobResponseProvider", "JobResponseReceiver"
RECEIVER_TYPE, PROVIDER_TYPE = "ISA95JobOrderReceiverSubStatesType", "ISA95JobResponseProviderObjectType"
RESPONSE_RECEIVER_TYPE = "ISA95JobResponseReceiverObjectType"
PROVIDER_METHODS = ("RequestJobResponseByJobOrderID", "RequestJobResponseByJobOrderState")

#: An argument of a method: name, type (or the name of a structure) and whether it is an array.
Argument = tuple[str, ua.VariantType | str, bool]

_MAX_JOBS = 10_000


@dataclass
class JobModel:
    """The instances.

    :param types, cell: indexes of the namespaces.
    :param children: variables, methods and objects of receiver, provider and response receiver, by name.
    :param owners: the objects of the methods, by name.
    :param type_methods: the methods of their types, by name; clients may call an object's method by its type's id.
    :param arguments: input arguments of the methods, by name.
    """

    types: int
    cell: int
    receiver: Node
    provider: Node
    children: Mapping[str, Node]
    owners: Mapping[str, Node]
    type_methods: Mapping[str, Node]
    arguments: Mapping[str, list[Argument]]


async def build_model(server: Server, nodesets: Path, cell: str) -> JobModel:
    """Imports the types into a server and adds the instances.

    :param nodesets: the folder of the node set.
    :param cell: the URI of the cell's namespace.
    :raises ConfigurationError: the node set is missing, or cannot be imported.
    """
    file = nodesets / NODESET
    if not file.is_file():
        raise ConfigurationError(
            f'opcua_port is set, but {file}, the types of Job Control, is missing; run: make setup FOR="gateway page"'
        )
    try:
        await server.import_xml(file)
    except Exception as error:  # asyncua does not say what it raises
        raise ConfigurationError(f"OPC UA: {file} cannot be imported: {error}") from error
    await server.load_data_type_definitions()
    types = await server.get_namespace_index(NAMESPACE)
    index = await server.register_namespace(cell)
    made, children, owners, type_methods = {}, dict[str, Node](), dict[str, Node](), dict[str, Node]()
    kinds = {RECEIVER: RECEIVER_TYPE, PROVIDER: PROVIDER_TYPE, RESPONSE_RECEIVER: RESPONSE_RECEIVER_TYPE}
    for name, kind in kinds.items():
        type_node = await find_type(server, types, kind)
        type_methods.update(methods := await _methods(server, type_node))
        made[name] = await server.nodes.objects.add_object(ua.NodeId(name, index), f"{index}:{name}", type_node.nodeid)
        owners.update(dict.fromkeys(methods, made[name]))
        for node in await made[name].get_children():
            children[(await node.read_browse_name()).Name] = node
    arguments = {
        name: await _arguments(node)
        for name, node in children.items()
        if await node.read_node_class() is ua.NodeClass.Method
    }
    await children["MaxDownloadableJobOrders"].write_value(_MAX_JOBS, ua.VariantType.UInt16)
    for name in ("EquipmentID", "MaterialClassID", "MaterialDefinitionID", "PersonnelID", "PhysicalAssetID"):
        await children[name].write_value(ua.Variant([], ua.VariantType.String, is_array=True))
    for name in ("JobOrderList", "WorkMaster", "JobOrderResponseList"):
        await children[name].write_value(ua.Variant([], ua.VariantType.ExtensionObject, is_array=True))
    return JobModel(types, index, made[RECEIVER], made[PROVIDER], children, owners, type_methods, arguments)


async def _methods(server: Server, type_node: Node) -> dict[str, Node]:
    """Returns the methods of a type and its supertypes, by name."""
    found: dict[str, Node] = {}
    while type_node.nodeid != server.nodes.base_object_type.nodeid:
        for node in await type_node.get_methods():
            found[(await node.read_browse_name()).Name] = node
        [type_node] = await type_node.get_referenced_nodes(ua.ObjectIds.HasSubtype, ua.BrowseDirection.Inverse)
    return found


async def find_type(server: Server, index: int, name: str) -> Node:
    """Returns an object type of the node set.

    :param index: of the namespace of the types.
    :raises ConfigurationError: the node set has no such type.
    """
    waiting = [server.nodes.base_object_type]
    while waiting:
        for node in await waiting.pop().get_children(refs=ua.ObjectIds.HasSubtype):
            browse_name = await node.read_browse_name()
            if browse_name == ua.QualifiedName(name, index):
                return node
            waiting.append(node)
    raise ConfigurationError(f"OPC UA: {NODESET} has no type {name}: another version of the node set?")


async def _arguments(method: Node) -> list[Argument]:
    declared: list[Any] = await (await method.get_child("0:InputArguments")).read_value()
    return [(each.Name, _kind(each.DataType), each.ValueRank >= 0) for each in declared]


def _kind(data_type: ua.NodeId) -> ua.VariantType | str:
    if data_type.NamespaceIndex == 0:
        return ua.VariantType(data_type.Identifier)
    return str(ua.extension_objects_by_datatype[data_type].__name__)
