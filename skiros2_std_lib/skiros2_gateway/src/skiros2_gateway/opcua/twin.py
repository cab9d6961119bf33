"""Robots and the elements of the world model as nodes: a digital twin that clients can browse and subscribe to.

Objects/Cell has `Ready`, `QueueLength` and `Robots`, with an object for each robot. Objects/World has an object for
each element, with a variable for each property and `Relations` (texts `predicate object`). The node id of an element is
the text `World/ID`.
"""

from __future__ import annotations

import asyncio
import logging
from typing import Any

from asyncua import Node, Server, ua

from skiros2_gateway.core.element_changes import ElementChanges
from skiros2_gateway.core.events import Event
from skiros2_gateway.core.service import Service

log = logging.getLogger(__name__)

#: The pause after an object was added (s). Adding one with its variables takes about as long, and the loop does nothing
#: else meanwhile: requests of others would wait until a whole scene is added.
_PAUSE = 0.01


class Twin:
    """The nodes. To be used in the gateway's loop.

    :param index: of the cell's namespace.
    """

    def __init__(self, server: Server, service: Service, index: int) -> None:
        self._server = server
        self._service = service
        self._index = index
        self._folders: dict[str, Node] = {}
        self._objects: dict[str, dict[str, Node]] = {}  # variables by key, of each object by its path

    async def start(self) -> None:
        """Adds the folders."""
        for name in ("Cell", "World"):
            self._folders[name] = await self._server.nodes.objects.add_folder(self._id(name), f"{self._index}:{name}")
        robots = await self._folders["Cell"].add_folder(self._id("Cell/Robots"), f"{self._index}:Robots")
        self._folders["Robots"] = robots

    async def on_event(self, event: Event) -> None:
        """Follows the gateway's events."""
        if event.kind in ("cell", "reset"):
            await self.show_cell()
        elif event.kind == "job":
            await self._show("Cell", self._folders["Cell"], {"QueueLength": len(self._service.control.jobs)})

    async def follow_elements(self) -> None:
        """Shows the elements, until it is cancelled. One that cannot be shown does not cost the others."""
        changes = ElementChanges(self._service.control.cell.document)
        while True:
            for eid, element in (await changes.take()).items():
                try:
                    if element is None:
                        await self._remove(f"World/{eid}")
                    else:
                        await self._show_element(element)
                except Exception:
                    log.exception("OPC UA: the element %s is not shown", eid)

    async def show_cell(self) -> None:
        """Shows the robots and the state of the cell."""
        state = self._service.control.cell.state()
        await self._show("Cell", self._folders["Cell"], {"Ready": state["ready"], "Capacity": state["capacity"]})
        for robot in state["robots"]:
            path = f"Cell/Robots/{robot['name'].lstrip('/')}"
            node = await self._object(path, self._folders["Robots"], robot["name"].lstrip("/"))
            values = {"State": robot["state"], "Reason": robot["reason"], **robot["counters"]}
            await self._show(path, node, values)

    async def _show_element(self, element: dict[str, Any]) -> None:
        path = f"World/{element['id']}"
        node = await self._object(path, self._folders["World"], element["label"] or element["id"])
        relations = sorted(f"{name} {end}" for name, end in element["relations"])
        values = {key: value[0] if len(value) == 1 else value for key, value in element["properties"].items() if value}
        await self._show(path, node, {"Type": element["type"], **values, "Relations": relations})
        await asyncio.sleep(0)  # other tasks of the loop get their turn

    async def _object(self, path: str, parent: Node, name: str) -> Node:
        if path not in self._objects:
            await parent.add_object(self._id(path), f"{self._index}:{name}")
            self._objects[path] = {}
            await asyncio.sleep(_PAUSE)
        return self._server.get_node(self._id(path))

    async def _show(self, path: str, node: Node, values: dict[str, Any]) -> None:
        """Writes variables of an object; adds those that it lacks."""
        variables = self._objects.setdefault(path, {})
        for key, value in values.items():
            variant = _variant(value)
            variable = variables.get(key)
            try:
                if variable is None:
                    made = await node.add_variable(self._id(f"{path}/{key}"), f"{self._index}:{key}", variant)
                    variables[key] = made
                else:
                    await variable.write_value(variant)
            except ua.UaStatusCodeError as error:  # such as another type than before
                log.warning("OPC UA variable %s/%s: %s", path, key, error)

    async def _remove(self, path: str) -> None:
        if self._objects.pop(path, None) is not None:
            await self._server.delete_nodes([self._server.get_node(self._id(path))], recursive=True)

    def _id(self, path: str) -> ua.NodeId:
        return ua.NodeId(path, self._index)


def _variant(value: Any) -> ua.Variant:
    if isinstance(value, list):
        kind = ua.VariantType.String
        if value and all(_is_number(each) for each in value):
            return ua.Variant([float(each) for each in value], ua.VariantType.Double, is_array=True)
        return ua.Variant([str(each) for each in value], kind, is_array=True)
    if isinstance(value, bool):
        return ua.Variant(value, ua.VariantType.Boolean)
    if _is_number(value):
        return ua.Variant(float(value), ua.VariantType.Double)
    return ua.Variant("" if value is None else str(value), ua.VariantType.String)


def _is_number(value: Any) -> bool:
    """Returns whether a value is a number that a double can carry."""
    return isinstance(value, float) or (isinstance(value, int) and not isinstance(value, bool) and abs(value) < 2**63)
