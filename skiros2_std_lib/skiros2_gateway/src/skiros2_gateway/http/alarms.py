"""The routes of alarms; see `skiros2_gateway.core.alarms`."""

from __future__ import annotations

from typing import Any

from fastapi import APIRouter
from pydantic import BaseModel, ConfigDict, Field

from skiros2_gateway.core.live import LiveView
from skiros2_gateway.http import models
from skiros2_gateway.http.callers import CallerArg, ServiceArg
from skiros2_gateway.http.errors import answers


class AlarmIds(BaseModel):
    """The ids of alarms."""

    model_config = ConfigDict(extra="forbid")

    alarms: list[str] = Field(max_length=1000)


def alarms_router(view: LiveView) -> APIRouter:
    """Returns the routes."""
    router = APIRouter(prefix="/api/alarms")

    @router.get("", responses=answers(models.Alarms))
    async def alarms(caller: CallerArg, service: ServiceArg) -> dict[str, Any]:
        """What needs a person: failed jobs, lost parts, stopped robots and unanswered approvals."""
        service.view(caller)
        return {"alarms": [{"id": alarm_id, **alarm} for alarm_id, alarm in view.alarms.items()]}

    @router.post("/acknowledge", responses=answers(models.Empty, 404))
    async def acknowledge(caller: CallerArg, service: ServiceArg, body: AlarmIds) -> dict[str, Any]:
        """Notes that the caller has seen alarms."""
        await service.acknowledge(caller, body.alarms, view.alarms)
        return {}

    return router
