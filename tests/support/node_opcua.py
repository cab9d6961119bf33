"""A client of OPC 10031-4 that shares no code with the server: node-opcua, in a process of node."""

from __future__ import annotations

import asyncio
import json
import os
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest

from support.certificates import make_certificate
from support.source import ROOT

_PROGRAM = ROOT / "tests/support/opcua_client/client.cjs"
#: The folder of npm's packages, which `make setup` installs.
_MODULES = ROOT / ".venv/opcua_client/node_modules"
URI = "urn:skiros2:test:node-opcua"


class NodeOpcua:
    """A connected client."""

    def __init__(self, process: asyncio.subprocess.Process) -> None:
        self._process = process

    async def call(self, method: str, *arguments: Any, of: str = "JobOrderReceiver") -> list[Any]:
        """Calls a method, see client.cjs. Returns the outputs.

        :raises AssertionError: the call has failed, or the program has ended.
        """
        assert self._process.stdin is not None and self._process.stdout is not None
        self._process.stdin.write(f"{json.dumps([of, method, arguments])}\n".encode())
        line = await self._process.stdout.readline()
        assert line, f"node-opcua has ended with {await self._process.wait()}"
        answer = json.loads(line)
        assert "error" not in answer, answer
        result: list[Any] = answer["result"]
        return result

    async def status(self, method: str, *arguments: Any) -> int:
        """Calls a method of the receiver with a comment. Returns `ReturnStatus`."""
        [status] = await self.call(method, *arguments, ["by node-opcua"])
        return int(status)


@asynccontextmanager
async def node_opcua(address: str, folder: Path, user: str, token: str, trusted: Path) -> AsyncIterator[NodeOpcua]:
    """Connects with a certificate of its own.

    :param folder: of the client's files.
    :param trusted: the server's folder of accepted certificates.
    """
    if not _MODULES.is_dir():
        pytest.skip("needs node-opcua: npm had no network at the set-up")
    certificate, key = make_certificate(folder, "node", URI, days=100)
    (trusted / "node.pem").write_bytes(certificate.read_bytes())
    certificate.rename(folder / "certificate.pem")
    key.rename(folder / "key.pem")
    process = await asyncio.create_subprocess_exec(
        str(ROOT / ".venv/bin/node"), str(_PROGRAM), address, str(folder), URI, user, token,
        stdin=asyncio.subprocess.PIPE, stdout=asyncio.subprocess.PIPE, env={**os.environ, "NODE_PATH": str(_MODULES)},
    )  # fmt: skip
    try:
        yield NodeOpcua(process)
        assert process.stdin is not None
        process.stdin.close()
        assert await process.wait() == 0
    finally:
        if process.returncode is None:
            process.kill()
            await process.wait()


def order(job_id: str, master: str = "", **parameters: Any) -> dict[str, Any]:
    """Returns a job order as client.cjs reads it: of a work master, or of a goal."""
    values = parameters or {"Goal": "(at robot home)"}
    fields: dict[str, Any] = {"jobOrderID": job_id, "priority": 3}
    if master:
        fields["workMasterID"] = [_structure("ISA95WorkMasterDataType", ID=master)]
    fields["jobOrderParameters"] = [
        _structure("ISA95ParameterDataType", ID=key, value={"variant": value}) for key, value in values.items()
    ]
    fields["equipmentRequirements"] = [_structure("ISA95EquipmentDataType", ID="/robot")]
    return _structure("ISA95JobOrderDataType", **fields)


def response(job_id: str, response_id: str, **values: Any) -> dict[str, Any]:
    """Returns the response of another system to a job, which has ended there."""
    data = [_structure("ISA95ParameterDataType", ID=key, value={"variant": value}) for key, value in values.items()]
    fields = {"jobResponseID": response_id, "jobOrderID": job_id, "jobResponseData": data}
    return _structure("ISA95JobResponseDataType", **fields, jobState=[_structure("ISA95StateDataType", stateNumber=5)])


def states(*numbers: int) -> dict[str, Any]:
    """Returns a list of states by their numbers."""
    return {"type": "ISA95StateDataType", "value": [{"stateNumber": number} for number in numbers]}


def _structure(kind: str, **fields: Any) -> dict[str, Any]:
    return {"type": kind, "value": fields}
