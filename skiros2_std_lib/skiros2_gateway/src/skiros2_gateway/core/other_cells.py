"""The gateways of other cells, of which the page lists state and alarms."""

from __future__ import annotations

import asyncio
import json
import ssl
import time
import urllib.request
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from skiros2_common.core.errors import ConfigurationError
from skiros2_common.core.yaml_text import read_yaml
from skiros2_gateway.core.problems import problems_of

_TIMEOUT = 3.0  # s, of each request
#: How old an answer may be: many viewers cause no more requests than one (s).
_AGE = 2.0
_MAX_ANSWER = 50_000_000  # bytes


class OtherCell(BaseModel):
    """A gateway in the file.

    :param token: of a user of that gateway with the role view; the file is readable by its owner only.
    :param ca: file with the certificate that signs the gateway's; "": those that the machine trusts.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    name: str = Field(min_length=1, max_length=100)
    address: str = Field(pattern=r"^https?://[^\s/]+$")
    token: str
    ca: str = ""


class _Cells(BaseModel):
    model_config = ConfigDict(extra="forbid")
    cells: list[OtherCell] = Field(max_length=200)


def read_cells(path: Path) -> list[OtherCell]:
    """
    :raises ConfigurationError: the file has mistakes, or others may read it.
    """
    try:
        if path.stat().st_mode & 0o077:
            raise ConfigurationError(f"{path} has tokens and may be read by others; expected: chmod 600 {path}")
        return _Cells.model_validate(read_yaml(path.read_text())).cells
    except (OSError, ValueError) as error:
        reasons = problems_of(error) if isinstance(error, ValidationError) else [error]
        raise ConfigurationError(f"{path}: " + "; ".join(map(str, reasons))) from error


class OtherCells:
    """Reads the state of other cells. To be used in one loop."""

    def __init__(self, cells: list[OtherCell]) -> None:
        self._cells = cells
        self._asked = -_AGE
        self._answer: asyncio.Future[list[dict[str, Any]]] | None = None

    async def states(self) -> list[dict[str, Any]]:
        """Returns {name, address, is_up, text, robots, alarms} of each cell: how many robots it has by state, and how
        many alarms that nobody has acknowledged.
        """
        if self._answer is None or (self._answer.done() and time.monotonic() - self._asked > _AGE):
            self._asked = time.monotonic()
            self._answer = asyncio.gather(*(asyncio.to_thread(_state, cell) for cell in self._cells))
        return await asyncio.shield(self._answer)


def _state(cell: OtherCell) -> dict[str, Any]:
    found = {"name": cell.name, "address": cell.address, "is_up": False, "text": "", "robots": {}, "alarms": 0}
    try:
        robots = _get(cell, "/api/state")["robots"]
        alarms = _get(cell, "/api/alarms")["alarms"]
        states = [str(robot["state"]) for robot in robots]
        found["robots"] = {state: states.count(state) for state in sorted(set(states))}
        found["alarms"] = sum(not alarm.get("acknowledged") for alarm in alarms)
        found["is_up"] = True
    except (OSError, ValueError, LookupError, TypeError, AttributeError) as error:
        reason = getattr(error, "reason", error)
        found["text"] = str(getattr(reason, "strerror", "") or reason)[:200] or "it does not answer"
    return found


def _get(cell: OtherCell, path: str) -> Any:
    request = urllib.request.Request(cell.address + path, headers={"Authorization": f"Bearer {cell.token}"})
    context = ssl.create_default_context(cafile=cell.ca or None) if cell.address.startswith("https:") else None
    with urllib.request.urlopen(request, timeout=_TIMEOUT, context=context) as answer:
        return json.loads(answer.read(_MAX_ANSWER))
