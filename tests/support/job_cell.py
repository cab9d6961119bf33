"""A small cell with the gateway's node: a robot that carries products at once, and a client of the REST interface."""

from __future__ import annotations

import http.client
import json
import os
import signal
import sys
import time
import urllib.error
import urllib.request
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import yaml

from skiros2_gateway.core.job import State
from skiros2_msgs.srv import ResourceGetDescriptions
from skiros2_world_model.ros.world_model_interface import WorldModelInterface
from support.planning_world import PlanningWorld
from support.programs import ProcessId, Program
from support.ros import Ros, RosMaster, wait_until

TESTS = Path(__file__).resolve().parents[1]
TOKENS = {name: f"{name}-0123456789abcdef" for name in ("agent", "view", "operate", "approve", "maintain")}
PERSONS = ("approve", "maintain")
ROBOT = "/porter"

#: How long a restart of nodes may take beside other load (s).
RESTART = 300.0

MASTERS = {
    "work_masters": [
        {
            "id": "carry",
            "goal": "(skiros:contain {Place} {Product})",
            "parameters": [{"id": "Product", "type": "skiros:Product"}, {"id": "Place", "type": "skiros:Location"}],
        }
    ]
}


def operator_token(number: int) -> str:
    return f"operator-{number}-0123456789abcdef"


@contextmanager
def job_cell(master: RosMaster, folder: Path, **settings: Any) -> Iterator[JobCell]:
    """Yields a cell with nodes of its own, which end with the block; see `JobCell`."""
    ros = Ros(master)
    try:
        yield JobCell(ros, folder, **settings)
    finally:
        ros.stop()


class JobCell:
    """Products on a shelf, two stores, a robot `/porter`, the task manager and the gateway.

    :param folder: for files of the nodes.
    :param skill: of `support.job_skills`.
    :param operators: further users with the role operate: `operator-0` and so on; see `operator_token`.
    :param slow_disk: time that the gateway's disk needs for each commit (s).
    :param settings: of the gateway, beside its defaults for tests.
    """

    def __init__(
        self,
        ros: Ros,
        folder: Path,
        products: int = 4,
        skill: str = "carry_at_once",
        operators: int = 0,
        slow_disk: float = 0.0,
        **settings: Any,
    ) -> None:
        self.ros = ros
        self.folder = folder
        self._carried, self._stopped = folder / "carried.txt", folder / "stopped.txt"
        self._slow_disk = slow_disk
        users = [{"name": n, "role": n, "token": token, "person": n in PERSONS} for n, token in TOKENS.items()]
        more = [(f"operator-{number}", operator_token(number)) for number in range(operators)]
        users += [{"name": name, "role": "operate", "token": token} for name, token in more]
        self.users = folder / "users.yaml"
        self.users.write_text(yaml.safe_dump({"users": users}))
        self.users.chmod(0o600)
        (folder / "masters.yaml").write_text(yaml.safe_dump(MASTERS))
        self._settings = {
            "folder": str(folder), "work_masters": str(folder / "masters.yaml"), "http_port": 0, "rate": 1e5,
            "burst": 1e5, **settings,
        }  # fmt: skip
        self._starts: dict[str, Callable[[], Program]] = {
            "/wm": self._start_world_model,
            "/tm": lambda: ros.run("skiros2_task", "task_manager_node", name="tm"),
            "/gateway": lambda: self.start_gateway("gateway"),
            ROBOT: lambda: self._start_robot(skill),
        }
        self._programs: dict[str, Program] = {}
        self._start("/wm")
        self.world = world = PlanningWorld(WorldModelInterface("tests"))
        self.shelf, *self.stores = (world.thing("skiros:Location") for _ in range(3))
        self.products = [world.thing("skiros:Product", inside=self.shelf) for _ in range(products)]
        #: A product that is at no place.
        self.lost_product = world.thing("skiros:Product")
        world.thing("cora:Robot", f"skiros:{ROBOT[1:]}")
        self._start(ROBOT)
        self._start("/tm")
        ros.service(f"{ROBOT}/get_skills", ResourceGetDescriptions)()
        self.gateway = self._start("/gateway")
        self.rest = Rest(self.parameter("/gateway/address"))
        self.wait_until_ready()

    def _start(self, node: str) -> Program:
        self._programs[node] = program = self._starts[node]()
        return program

    def _start_robot(self, skill: str) -> Program:
        env = {**self.ros.master.env, "CARRIED": str(self._carried), "STOPPED": str(self._stopped)}
        env["PYTHONPATH"] = f"{TESTS}:{env['PYTHONPATH']}"
        params: dict[str, Any] = {"libraries_list": ["support.job_skills"], "primitive_list": [skill, "wait_for_stop"]}
        params["prefix"] = "skiros"
        return self.ros.run("skiros2_skill", "skill_manager_node", name=ROBOT[1:], params=params, env=env)

    def _start_world_model(self) -> Program:
        journal = {"journal": str(self.folder / "journal")}
        return self.ros.run("skiros2_world_model", "world_model_server_node", name="wm", params=journal)

    def start_gateway(self, name: str, **settings: Any) -> Program:
        """Starts a gateway; does not wait for it."""
        if self._slow_disk:
            for key, value in {**self._settings, **settings}.items():
                self.ros.master.set_parameter(f"/{name}/{key}", value)
            script = str(TESTS / "support/slow_disk_gateway.py")
            return self.ros.program(sys.executable, script, str(self._slow_disk), f"__name:={name}")
        return self.ros.run("skiros2_gateway", "gateway_node", name=name, params={**self._settings, **settings})

    def parameter(self, name: str) -> Any:
        """Waits for a parameter, and returns it."""
        master = self.ros.master
        wait_until(lambda: name in master.parameters(), RESTART, f"a parameter {name}")
        return master.parameter(name)

    def wait_until_ready(self) -> None:
        wait_until(lambda: self.rest.get("/api/state")["ready"], RESTART, "a gateway that can start jobs")

    def order(self, job_id: str, product: int, store: int = 0) -> dict[str, Any]:
        parameters = {"Product": self.products[product], "Place": self.stores[store]}
        return {"id": job_id, "work_master": "carry", "parameters": parameters}

    def kill(self, *nodes: str) -> None:
        """Kills nodes at once and starts them again. They may still be starting."""
        self.replace(*nodes, processes=[ProcessId(self._programs[node].pid) for node in nodes])

    def silence(self, seconds: float, *nodes: str) -> None:
        """Stops the processes of nodes for a time, then lets them continue."""
        pids = [self._programs[node].pid for node in nodes]
        for pid in pids:
            os.kill(pid, signal.SIGSTOP)
        try:
            time.sleep(seconds)
        finally:
            for pid in pids:
                os.kill(pid, signal.SIGCONT)

    def replace(self, *nodes: str, processes: Sequence[ProcessId]) -> None:
        """Kills the processes of nodes, and starts the nodes again."""
        for process in processes:
            process.kill()
        wait_until(lambda: not any(process.running for process in processes), what=f"the end of {nodes}")
        if "/gateway" in nodes and "/gateway/address" in self.ros.master.parameters():
            self.ros.master.delete_parameter("/gateway/address")  # the next one has another free port
        for node in nodes:
            self._start(node)
        if "/gateway" in nodes:
            self.gateway, self.rest.address = self._programs["/gateway"], self.parameter("/gateway/address")

    def jobs(self) -> dict[str, dict[str, Any]]:
        found = self.rest.get("/api/jobs?cleared=true&limit=10000")["jobs"]
        return {job["id"]: job for job in found}

    def wait_for(self, ids: list[str], timeout: float = 60.0) -> dict[str, dict[str, Any]]:
        """Waits for the complete responses of jobs, and returns the jobs."""

        def ended() -> dict[str, dict[str, Any]] | None:
            jobs = {job_id: job for job_id, job in self.jobs().items() if job_id in ids}
            return jobs if len(jobs) == len(ids) and all(j["response"]["collected"] for j in jobs.values()) else None

        return dict(wait_until(ended, timeout, "the end of all jobs"))

    def ended(self) -> int:
        """How many jobs have ended."""
        counts = self.rest.get("/api/state")["counts"]
        return sum(number for key, number in counts.items() if key not in list(State))

    def carried(self) -> Counter[tuple[str, str]]:
        """How often each product was carried to each place."""
        return Counter((product, place) for product, place, _ in self._lines())

    def motions(self) -> list[float]:
        """When each carrying began (s since the epoch)."""
        return [float(begin) for _, _, begin in self._lines()]

    def stop_process(self) -> int:
        """The process of the gateway's stop port."""
        gateway = self.ros.master.node_pid("/gateway")
        for child in Path(f"/proc/{gateway}/task/{gateway}/children").read_text().split():
            if b"skiros2_gateway.stop.main" in Path(f"/proc/{child}/cmdline").read_bytes():
                return int(child)
        raise AssertionError("the gateway has no process for stops")

    def stopped(self) -> list[float]:
        """When each task of `wait_for_stop` was stopped (s, monotonic)."""
        text = self._stopped.read_text() if self._stopped.exists() else ""
        return [float(line) for line in text.splitlines()]

    def _lines(self) -> list[list[str]]:
        return [line.split() for line in self._carried.read_text().splitlines()] if self._carried.exists() else []

    def wrong(self, jobs: dict[str, dict[str, Any]], before: Counter[tuple[str, str]] | None = None) -> list[str]:
        """What is wrong with ended jobs: each was done once, or is reported as failed or lost.

        Jobs for the same product and place are counted together. A lost job may have been done, and a succeeded one
        whose steps and result were missed may have found nothing to do. A step that has failed, for example with the
        world model, may be repeated by another plan of its job.

        :param before: what was carried before these jobs.
        """
        problems, carried = [], self.carried() - (before or Counter())
        least: Counter[tuple[str, str]] = Counter()
        most: Counter[tuple[str, str]] = Counter()
        for job_id, job in jobs.items():
            response, values = job["response"], job["order"]["parameters"]
            key = values["Product"], values["Place"]
            outcome = response["outcome"]
            if outcome not in ("succeeded", "nothing_to_do", "failed", "lost") or not response["message"]:
                problems.append(f"{job_id} ended as {outcome!r}: {response['message']!r}")
            started = len(response["steps"])
            least[key] += outcome == "succeeded" and started > 0
            most[key] += max(1, started) if outcome != "nothing_to_do" else started
        for key in least | most | carried:
            if not least[key] <= carried[key] <= most[key]:
                problems.append(f"{key} was done {carried[key]} times, expected {least[key]} to {most[key]}")
        return problems


class Rest:
    """A client of the REST interface; it waits for a gateway that starts again."""

    def __init__(self, address: str) -> None:
        self.address = address

    def get(self, path: str, role: str = "maintain") -> Any:
        return self.request("GET", path, None, role)[1]

    def post(self, path: str, body: Any, role: str = "operate") -> tuple[int, Any]:
        return self.request("POST", path, body, role)

    def request(self, method: str, path: str, body: Any, role: str) -> tuple[int, Any]:
        """Returns the status and the decoded answer."""

        def once() -> tuple[int, Any] | None:
            data = None if body is None else json.dumps(body).encode()
            headers = {"Authorization": f"Bearer {TOKENS[role]}", "Content-Type": "application/json"}
            request = urllib.request.Request(self.address + path, data, headers, method=method)
            try:
                try:
                    with urllib.request.urlopen(request, timeout=20.0) as answer:
                        return answer.status, json.loads(answer.read())
                except urllib.error.HTTPError as error:
                    return error.code, json.loads(error.read())
            except (OSError, http.client.HTTPException, ValueError):  # it was killed, perhaps while it answered
                return None

        return tuple(wait_until(once, RESTART, f"an answer of {path}"))
