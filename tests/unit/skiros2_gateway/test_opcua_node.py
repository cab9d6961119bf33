"""The whole life of job orders by node-opcua, a client of other authors, against the specification's return status."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("asyncua")

from support.node_opcua import node_opcua, order, response, states
from unit.skiros2_gateway.conftest import TOKENS

SUCCESS, UNKNOWN_JOB, INVALID_STATE, NOT_ACCEPTED = 1, 2, 8, 16
PROVIDER = "JobResponseProvider"


def test_node_opcua_runs_the_life_of_job_orders(in_server: Callable[..., None], tmp_path: Path) -> None:
    async def test(gateway: Any) -> None:
        trusted = gateway.path.parent / "opcua/trusted/certs"
        async with node_opcua(gateway.address, tmp_path, "operate", TOKENS["operate"], trusted) as mes:

            async def shown(job_id: str) -> list[str]:
                """Returns the states in the response, which has the job's id."""
                response, status = await mes.call("RequestJobResponseByJobOrderID", job_id, of=PROVIDER)
                assert (status, response["jobOrderID"]) == (SUCCESS, job_id)
                return [state["stateText"]["text"] for state in response["jobState"]]

            # store, start, revoke, pause, resume, end, clear
            assert await mes.status("Store", order("n1", "place", Tray="Tray-1", Speed=0.5)) == SUCCESS
            assert gateway.job("n1").order.parameters["Speed"] == 0.5 and gateway.job("n1").robots == ("/robot",)
            assert await shown("n1") == ["NotAllowedToStart", "Ready"]
            for method in ("RevokeStart", "Pause", "Resume", "Stop", "Clear"):
                assert await mes.status(method, "n1") == INVALID_STATE, method
            assert await mes.status("Start", "n1") == SUCCESS
            assert await shown("n1") == ["AllowedToStart", "Loaded"]
            gateway.cell.run("n1")
            assert await mes.status("Pause", "n1") == SUCCESS
            assert await shown("n1") == ["Interrupted", "Held"]
            assert await mes.status("Pause", "n1") == INVALID_STATE
            assert await mes.status("Resume", "n1") == SUCCESS
            assert await shown("n1") == ["Running"]
            gateway.cell.end("n1")
            await gateway.collected("n1")
            assert await shown("n1") == ["Ended", "Closed"]
            found, status = await mes.call("RequestJobResponseByJobOrderState", states(5), of=PROVIDER)
            assert status == SUCCESS and "n1" in [each["jobOrderID"] for each in found]
            measured = response("n1", "m1", Weight=1.5, Passed=True)
            assert await mes.call("ReceiveJobResponse", measured, of="JobResponseReceiver") == [SUCCESS]
            assert gateway.job("n1").received[0]["values"] == {"Weight": 1.5, "Passed": True}
            assert await mes.status("Clear", "n1") == SUCCESS

            # stop, cancel, update, abort
            assert await mes.status("StoreAndStart", order("n2")) == SUCCESS
            gateway.cell.run("n2")
            assert await mes.status("Stop", "n2") == SUCCESS
            assert gateway.job("n2").wanted == "Stop"
            assert await mes.status("Store", order("n3")) == SUCCESS
            assert await mes.status("Update", order("n3", "place", Tray="Tray-1")) == SUCCESS
            assert gateway.job("n3").order.work_master == "place"
            assert await mes.status("Cancel", "n3") == SUCCESS
            assert await mes.status("StoreAndStart", order("n4")) == SUCCESS
            gateway.cell.run("n4")
            assert await mes.status("Abort", "n4") == SUCCESS
            assert gateway.job("n4").wanted == "Abort"

            # refused
            assert await mes.status("Store", order("n5", "plaice")) == NOT_ACCEPTED
            assert await mes.status("Update", order("nobody")) == UNKNOWN_JOB
            for method in ("Start", "RevokeStart", "Pause", "Resume", "Stop", "Cancel", "Abort", "Clear"):
                assert await mes.status(method, "nobody") == UNKNOWN_JOB, method
            _, status = await mes.call("RequestJobResponseByJobOrderID", "nobody", of=PROVIDER)
            assert status == UNKNOWN_JOB
        comments = [entry["comment"] for entry in gateway.store.history("n1") if entry["method"] == "Pause"]
        assert comments == ["by node-opcua"]

    in_server(test)
