"""Translates personnel, physical assets and materials of orders between the gateway and the structures of OPC UA."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from asyncua import ua

from skiros2_gateway.core.problems import Problem
from skiros2_gateway.core.resources import Resource

#: The begin of the field of an order or response and its structure, by the kind of the resource; and the name of the
#: use in the structure.
_FIELDS = {
    "personnel": ("Personnel", "ISA95PersonnelDataType", "PersonnelUse"),
    "physical_asset": ("PhysicalAsset", "ISA95PhysicalAssetDataType", "PhysicalAssetUse"),
    "material": ("Material", "ISA95MaterialDataType", "MaterialUse"),
}
#: The end of the field of an order, and of a response.
REQUIREMENTS, ACTUALS = "Requirements", "Actuals"
_MATERIAL = {
    "material_class": "MaterialClassID", "material_definition": "MaterialDefinitionID", "lot": "MaterialLotID",
    "sublot": "MaterialSublotID",
}  # fmt: skip
_UNITS = "http://www.opcfoundation.org/UA/units/un/cefact"


def resources_data(structure: Any, end: str, problems: list[Problem]) -> list[dict[str, Any]]:
    """Returns the resources of an order or a response as JSON data; adds what cannot be kept.

    :param end: `REQUIREMENTS` or `ACTUALS`.
    """
    found = []
    for kind, (begin, _, use) in _FIELDS.items():
        field = begin + end
        for number, each in enumerate(getattr(structure, field) or []):
            place = f"{field}.{number}.Properties"
            properties = each.Properties or []
            problems += [
                Problem("wrong_value", f"{place}.{p.ID}", "Subproperties", "a value")
                for p in properties
                if p.Subproperties
            ]
            ids = [str(p.ID) for p in properties]
            if len(set(ids)) < len(ids):
                problems.append(Problem("wrong_value", place, "two have one ID", "one value for each ID"))
            units = each.EngineeringUnits
            found.append(
                {
                    "kind": kind,
                    **_texts(each, _MATERIAL if kind == "material" else {"id": "ID"}),
                    **_texts(each, {"use": use, "quantity": "Quantity"}),
                    "unit": (units.DisplayName.Text or "") if units else "",
                    "unit_code": units.UnitId if units else -1,
                    "description": "\n".join(text.Text or "" for text in each.Description or []),
                    "properties": {
                        str(p.ID): p.Value.Value if isinstance(p.Value, ua.Variant) else p.Value for p in properties
                    },
                }
            )
    return found


def add_resources(make: Any, resources: Iterable[Resource]) -> None:
    """Adds resources to the structure of an order."""
    for resource in resources:
        begin, structure, use = _FIELDS[resource.kind]
        each = getattr(ua, structure)()
        names = _MATERIAL if resource.kind == "material" else {"id": "ID"}
        for own, name in {**names, "use": use, "quantity": "Quantity"}.items():
            if text := getattr(resource, own):
                setattr(each, name, text)
        if resource.unit or resource.unit_code >= 0:
            text = ua.LocalizedText(resource.unit)
            each.EngineeringUnits = ua.EUInformation(_UNITS, resource.unit_code, text, text)
        if resource.description:
            each.Description = [ua.LocalizedText(resource.description)]
        if resource.properties:
            each.Properties = [
                ua.ISA95PropertyDataType(ID=key, Value=ua.Variant(value)) for key, value in resource.properties.items()
            ]
        field = begin + REQUIREMENTS
        setattr(make, field, [*(getattr(make, field) or []), each])


def _texts(structure: Any, names: dict[str, str]) -> dict[str, str]:
    return {own: str(getattr(structure, name) or "") for own, name in names.items()}
