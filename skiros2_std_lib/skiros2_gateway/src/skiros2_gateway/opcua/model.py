"""The types of ISA-95 Job Control (OPC 10031-4) in a server's address space: structures, object types, methods, events.

They have the browse names, fields and arguments of the companion specification, in its namespace. The numbers of their
node ids are the server's own.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from asyncua import Node, Server, ua
from asyncua.common.structures104 import new_struct, new_struct_field

NAMESPACE = "http://opcfoundation.org/UA/ISA95-JOBCONTROL_V2/"

_STRING, _TEXT, _TIME = ua.VariantType.String, ua.VariantType.LocalizedText, ua.VariantType.DateTime
_UNIT = ua.NodeId(ua.ObjectIds.EUInformation)

#: The fields of each structure: name, type (or the name of a structure above), and flags: `*` an array, `?` optional.
_STRUCTURES: dict[str, tuple[tuple[str, Any, str], ...]] = {
    "ISA95PropertyDataType": (
        ("ID", _STRING, ""), ("Value", ua.VariantType.Variant, ""), ("Description", _TEXT, "*?"),
        ("EngineeringUnits", _UNIT, "?"),
    ),
    "ISA95ParameterDataType": (
        ("ID", _STRING, ""), ("Value", ua.VariantType.Variant, ""), ("Description", _TEXT, "*?"),
        ("EngineeringUnits", _UNIT, "?"),
    ),
    "ISA95EquipmentDataType": (
        ("ID", _STRING, ""), ("Description", _TEXT, "*?"), ("EquipmentUse", _STRING, "?"), ("Quantity", _STRING, "?"),
        ("EngineeringUnits", _UNIT, "?"), ("Properties", "ISA95PropertyDataType", "*?"),
    ),
    "ISA95WorkMasterDataType": (
        ("ID", _STRING, ""), ("Description", _TEXT, "?"), ("Parameters", "ISA95ParameterDataType", "*?"),
    ),
    "ISA95StateDataType": (
        ("BrowsePath", ua.NodeId(ua.ObjectIds.RelativePath), ""), ("StateText", _TEXT, ""),
        ("StateNumber", ua.VariantType.UInt32, ""),
    ),
    "ISA95JobOrderDataType": (
        ("JobOrderID", _STRING, ""), ("Description", _TEXT, "*?"), ("WorkMasterID", "ISA95WorkMasterDataType", "*?"),
        ("StartTime", _TIME, "?"), ("EndTime", _TIME, "?"), ("Priority", ua.VariantType.Int16, "?"),
        ("JobOrderParameters", "ISA95ParameterDataType", "*?"),
        ("EquipmentRequirements", "ISA95EquipmentDataType", "*?"),
    ),
    "ISA95JobOrderAndStateDataType": (
        ("JobOrder", "ISA95JobOrderDataType", ""), ("State", "ISA95StateDataType", "*"),
    ),
    "ISA95JobResponseDataType": (
        ("JobResponseID", _STRING, ""), ("Description", _TEXT, "?"), ("JobOrderID", _STRING, ""),
        ("StartTime", _TIME, "?"), ("EndTime", _TIME, "?"), ("JobState", "ISA95StateDataType", "*"),
        ("JobResponseData", "ISA95ParameterDataType", "*?"), ("EquipmentActuals", "ISA95EquipmentDataType", "*?"),
    ),
}  # fmt: skip

_ORDER = (("JobOrder", "ISA95JobOrderDataType", False), ("Comment", _TEXT, True))
_ID = (("JobOrderID", _STRING, False), ("Comment", _TEXT, True))
_STATUS = (("ReturnStatus", ua.VariantType.UInt64, False),)

#: Methods of the receiver of job orders: name, input and output arguments (name, type, is array).
RECEIVER_METHODS: dict[str, tuple[tuple[Any, ...], tuple[Any, ...]]] = {
    **dict.fromkeys(("Store", "StoreAndStart", "Update"), (_ORDER, _STATUS)),
    **dict.fromkeys(("Start", "RevokeStart", "Pause", "Resume", "Stop", "Abort", "Cancel", "Clear"), (_ID, _STATUS)),
}
#: Methods of the provider of job responses.
PROVIDER_METHODS: dict[str, tuple[tuple[Any, ...], tuple[Any, ...]]] = {
    "RequestJobResponseByJobOrderID": (
        (("JobOrderID", _STRING, False),), (("JobResponse", "ISA95JobResponseDataType", False), *_STATUS),
    ),
    "RequestJobResponseByJobOrderState": (
        (("JobOrderState", "ISA95StateDataType", True),),
        (("JobResponses", "ISA95JobResponseDataType", True), *_STATUS),
    ),
}  # fmt: skip

RECEIVER_TYPE, PROVIDER_TYPE = "ISA95JobOrderReceiverObjectType", "ISA95JobResponseProviderObjectType"


@dataclass
class JobTypes:
    """The object types, and the namespace index of the model."""

    index: int
    receiver: Node
    provider: Node


async def build_types(server: Server) -> JobTypes:
    """Adds the types to a server and returns them."""
    index = await server.register_namespace(NAMESPACE)
    ids: dict[str, ua.NodeId] = {}
    for name, fields in _STRUCTURES.items():
        made = [
            new_struct_field(key, ids.get(kind, kind), array="*" in flags, optional="?" in flags)
            for key, kind, flags in fields
        ]
        node, _ = await new_struct(server, index, name, made)
        ids[name] = node.nodeid
    await server.load_data_type_definitions()
    receiver = await server.nodes.base_object_type.add_object_type(index, RECEIVER_TYPE)
    provider = await server.nodes.base_object_type.add_object_type(index, PROVIDER_TYPE)
    for parent, methods in ((receiver, RECEIVER_METHODS), (provider, PROVIDER_METHODS)):
        for name, (inputs, outputs) in methods.items():
            arguments = ([_argument(each, ids) for each in side] for side in (inputs, outputs))
            method = await parent.add_method(index, name, _not_linked, *arguments)
            await method.set_modelling_rule(True)
    variables = (
        (receiver, "JobOrderList", ids["ISA95JobOrderAndStateDataType"]),
        (receiver, "WorkMaster", ids["ISA95WorkMasterDataType"]),
        (receiver, "EquipmentID", ua.NodeId(ua.ObjectIds.String)),
        (provider, "JobOrderResponseList", ids["ISA95JobResponseDataType"]),
    )
    for parent, name, kind in variables:
        variant = ua.VariantType.String if kind.NamespaceIndex == 0 else ua.VariantType.ExtensionObject
        value = ua.Variant([], variant, is_array=True)
        variable = await parent.add_variable(index, name, value, datatype=kind)
        await variable.write_value_rank(ua.ValueRank.OneDimension)
        await variable.set_modelling_rule(True)
    limit = await receiver.add_property(index, "MaxDownloadableJobOrders", 10_000, ua.VariantType.UInt16)
    await limit.set_modelling_rule(True)
    return JobTypes(index, receiver, provider)


def _argument(described: tuple[Any, ...], ids: dict[str, ua.NodeId]) -> ua.Argument:
    name, kind, is_array = described
    argument = ua.Argument(Name=name)
    argument.DataType = ids[kind] if isinstance(kind, str) else ua.NodeId(kind.value)
    argument.ValueRank = ua.ValueRank.OneDimension if is_array else ua.ValueRank.Scalar
    argument.ArrayDimensions = [0] if is_array else []
    return argument


def _not_linked(parent: Any, *arguments: Any) -> ua.StatusCode:
    """The method of the type; that of the object is linked by the server."""
    return ua.StatusCode(ua.StatusCodes.BadNotImplemented)
