"""A client of Job Control by OPC UA."""

from __future__ import annotations

from typing import Any

from asyncua import Client, Node, ua

from skiros2_gateway.opcua.model import NAMESPACE
from support.opcua import cell_index
from unit.skiros2_gateway.conftest import TOKENS

NO_COMMENT = ua.Variant([], ua.VariantType.LocalizedText, is_array=True)
PROVIDER = "JobResponseProvider"


class Mes(Client):  # type: ignore[misc]
    """A client that knows the structures of the server."""

    def __init__(self, address: str, user: str = "operate", password: str = "") -> None:
        super().__init__(address, timeout=10)
        self.set_user(user)
        self.set_password(password or TOKENS[user])

    async def load(self) -> Mes:
        await self.load_data_type_definitions()
        self.index, self.cell = await self.get_namespace_index(NAMESPACE), await cell_index(self)
        return self

    async def object(self, name: str) -> Node:
        return await self.nodes.objects.get_child(f"{self.cell}:{name}")

    async def call(self, method: str, *arguments: Any, of: str = "JobOrderReceiver") -> Any:
        return await (await self.object(of)).call_method(f"{self.index}:{method}", *arguments)


def order(job_id: str, **parameters: Any) -> Any:
    made = ua.ISA95JobOrderDataType(JobOrderID=job_id, Priority=3)
    master = parameters.pop("master", "")
    made.WorkMasterID = [ua.ISA95WorkMasterDataType(ID=master)] if master else None
    parameters = parameters or {"Goal": "(at robot home)"}
    made.JobOrderParameters = [
        ua.ISA95ParameterDataType(ID=key, Value=ua.Variant(value)) for key, value in parameters.items()
    ]
    made.EquipmentRequirements = [ua.ISA95EquipmentDataType(ID="/robot")]
    return made
