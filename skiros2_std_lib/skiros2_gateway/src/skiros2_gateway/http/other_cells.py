"""The route of other cells; see `skiros2_gateway.core.other_cells`."""

from __future__ import annotations

from typing import Any

from fastapi import APIRouter

from skiros2_gateway.core.other_cells import OtherCells
from skiros2_gateway.http import models
from skiros2_gateway.http.callers import CallerArg, ServiceArg
from skiros2_gateway.http.errors import answers


def other_cells_router(cells: OtherCells) -> APIRouter:
    """Returns the route."""
    router = APIRouter(prefix="/api")

    @router.get("/cells", responses=answers(models.Cells))
    async def other_cells(caller: CallerArg, service: ServiceArg) -> dict[str, Any]:
        """The other cells that the gateway knows, with the number of alarms that nobody has acknowledged."""
        service.view(caller)
        return {"cells": await cells.states()}

    return router
