"""The routes of figures; see `skiros2_gateway.core.figures`."""

from __future__ import annotations

import csv
import io
import time
from collections.abc import Callable
from datetime import UTC, datetime
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Query, Response
from pydantic import BaseModel, FiniteFloat

from skiros2_gateway.core.figures import report
from skiros2_gateway.http import models
from skiros2_gateway.http.callers import CallerArg, ServiceArg
from skiros2_gateway.http.errors import answers, errors_of

#: The latest time of a period (s since the epoch).
_LATEST = 1e11

_TABLES: dict[str, type[BaseModel]] = {
    "robots": models.RobotFigures,
    "skills": models.SkillFigures,
    "jobs": models.JobFigures,
    "failures": models.FailureFigures,
    "throughput": models.ThroughputFigures,
    "durations": models.DurationFigures,
}
Time = Annotated[FiniteFloat | None, Query(ge=0.0, le=_LATEST)]
_CSV: dict[int | str, Any] = {**errors_of(), 200: {"content": {"text/csv": {"schema": {"type": "string"}}}}}


def figures_router(write: Callable[[], None]) -> APIRouter:
    """Returns the routes.

    :param write: writes the newest figures to the store.
    """
    router = APIRouter(prefix="/api/figures")

    def read(service: ServiceArg, begin: float | None, end: float | None) -> dict[str, Any]:
        write()
        return report(service.store, begin or 0.0, time.time() if end is None else end)

    @router.get("", responses=answers(models.Figures))
    async def figures(caller: CallerArg, service: ServiceArg, begin: Time = None, end: Time = None) -> dict[str, Any]:
        """The figures of robots, skills and jobs in a period (s since the epoch), which is extended to whole hours."""
        service.view(caller)
        return read(service, begin, end)

    @router.get("/{table}.csv", response_class=Response, responses=_CSV)
    async def figures_csv(
        caller: CallerArg,
        service: ServiceArg,
        table: Literal["robots", "skills", "jobs", "failures", "throughput", "durations"],
        begin: Time = None,
        end: Time = None,
    ) -> Response:
        """A table of the figures as CSV. Times are ISO 8601, UTC."""
        service.view(caller)
        rows = read(service, begin, end)[table]
        text = io.StringIO()
        writer = csv.DictWriter(text, list(_TABLES[table].model_fields), lineterminator="\n")
        writer.writeheader()
        writer.writerows({key: _cell(key, value) for key, value in row.items()} for row in rows)
        headers = {"Content-Disposition": f"attachment; filename={table}.csv"}
        return Response(text.getvalue(), media_type="text/csv", headers=headers)

    return router


def _cell(key: str, value: Any) -> Any:
    """Returns a value for a table: spreadsheets would evaluate a text that begins like a formula."""
    if key == "begin":
        return datetime.fromtimestamp(value, UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
    return f"'{value}" if isinstance(value, str) and value[:1] in ("=", "+", "-", "@", "\t", "\r") else value
