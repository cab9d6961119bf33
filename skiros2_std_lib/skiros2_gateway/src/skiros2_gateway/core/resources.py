"""Personnel, physical assets and materials that an order names besides robots."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, StringConstraints

from skiros2_gateway.core.values import Value

Name = Annotated[str, StringConstraints(max_length=200)]


class Resource(BaseModel):
    """A resource of ISA-95: kept with the order and reported to clients; the cell does not plan with it."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    kind: Literal["personnel", "physical_asset", "material"]
    id: Name = Field("", description="of a person, a class of persons or a physical asset")
    material_class: Name = ""
    material_definition: Name = ""
    lot: Name = ""
    sublot: Name = ""
    use: Name = ""
    quantity: str = Field("", max_length=50, pattern=r"^(-?[0-9]+(\.[0-9]+)?)?$", description="a decimal number")
    unit: Name = ""
    unit_code: int = Field(-1, ge=-1, lt=2**31, description="of UNECE, as in OPC UA; -1: none")
    description: str = Field("", max_length=1000)
    properties: dict[str, Value] = Field({}, max_length=100)
