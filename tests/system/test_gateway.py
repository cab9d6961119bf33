"""The gateway's node on a cell of real nodes: jobs by REST become goals, and survive kills."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from support.job_cell import ROBOT, JobCell
from support.ros import Ros, RosMaster

pytestmark = pytest.mark.timeout(180)


@pytest.fixture(scope="module")
def cell(ros_master: RosMaster, tmp_path_factory: pytest.TempPathFactory) -> Iterator[JobCell]:
    ros = Ros(ros_master)
    try:
        yield JobCell(ros, tmp_path_factory.mktemp("gateway"), products=8)
    finally:
        ros.stop()


def test_job_becomes_a_goal_and_its_response_says_what_changed(cell: JobCell) -> None:
    status, job = cell.rest.post("/api/jobs", cell.order("first", 0))
    assert (status, job["goal"]) == (201, f'(skiros:contain "{cell.stores[0]}" "{cell.products[0]}")')
    job = cell.wait_for(["first"])["first"]
    response = job["response"]
    assert (job["state"], job["substate"], response["outcome"]) == ("Ended", "Closed", "succeeded")
    assert [(step["robot"], step["state"]) for step in response["steps"]] == [(ROBOT, "succeeded")]
    assert any({cell.stores[0], cell.products[0]} <= set(change["elements"]) for change in response["changes"])
    methods = [entry["method"] for entry in cell.rest.get("/api/jobs/first/history")["history"]]
    assert methods == ["StoreAndStart", "loaded", "accepted", "ended", "collected"]


def test_order_with_unknown_names_is_rejected_with_all_of_them(cell: JobCell) -> None:
    order = cell.order("wrong", 0)
    order["parameters"] = {"Product": cell.stores[0], "Place": "skiros:Location-999"}
    status, answer = cell.rest.post("/api/jobs", {**order, "robots": ["/porte"]})
    assert (status, answer["code"]) == (422, "rejected")
    problems = {problem["where"]: problem for problem in answer["problems"]}
    assert set(problems) == {"robots.0", "parameters.Product", "parameters.Place"}
    assert problems["robots.0"]["nearest"] == [ROBOT]
    assert "wrong" not in cell.jobs()


def test_viewer_reads_and_does_not_command(cell: JobCell) -> None:
    assert cell.rest.get("/api/state", "view")["role"] == "view"
    for path, body in (("/api/jobs", cell.order("viewed", 0)), ("/api/robots/stop", {"robots": []})):
        assert cell.rest.post(path, body, "view")[0] == 403
    assert "viewed" not in cell.jobs()


def test_each_job_is_done_once_or_reported_although_nodes_are_killed(cell: JobCell) -> None:
    ids = [f"job-{number}" for number in range(len(cell.products))]
    for number, job_id in enumerate(ids):
        assert cell.rest.post("/api/jobs", cell.order(job_id, number, store=1))[0] == 201
    for node in ("/gateway", "/tm", "/wm"):
        cell.kill(node)
    jobs, carried = cell.wait_for(ids, 120.0), cell.carried()
    for number, job_id in enumerate(ids):
        times = carried[cell.products[number], cell.stores[1]]
        response = jobs[job_id]["response"]
        assert response["outcome"] in ("succeeded", "failed", "lost"), response
        attempts = sum(step["state"] != "stopped" for step in response["steps"])
        assert times <= max(1, attempts), f"{job_id} was done {times} times: {response}"
        if response["outcome"] == "succeeded":
            assert times >= 1, f"{job_id} was not done: {response}"
        else:
            assert response["message"]
    assert cell.gateway.running
