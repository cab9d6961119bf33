"""Thirty simulated days of a cell in ten minutes: nothing grows but what a retention bounds.

`SOAK_SECONDS=60` is the short form. Each day has jobs, edits, disturbances, and clients that come and go; nodes are
killed on some days. Retentions are scaled as the days are. The figures are printed and written to build/soak.json.
"""

from __future__ import annotations

import json
import os
import random
import socket
import sqlite3
import time
import urllib.parse
from pathlib import Path
from typing import Any

import pytest
import rosgraph
import rospy

from skiros2_common.core.world_element import Element
from skiros2_gateway.core.group_sync import LOG_LIMIT as JOBS_LOG_LIMIT
from skiros2_msgs import msg as msgs
from skiros2_msgs.srv import ResourceGetDescriptions
from skiros2_world_model.core.journal_file import LOG_LIMIT
from skiros2_world_model.core.wm_errors import WmException
from skiros2_world_model.ros.world_model_interface import WorldModelInterface
from support.job_cell import ROBOT, TOKENS, JobCell
from support.programs import Program
from support.ros import Ros, wait_until

pytestmark = [pytest.mark.long, pytest.mark.timeout(3600)]

SECONDS = float(os.environ.get("SOAK_SECONDS", "600"))
DAYS = 30
DAY = SECONDS / DAYS  # s
#: The days after which figures are taken. Nodes have their working set by the first.
START, MIDDLE, END = 6, 18, 30
#: The days on which a node is killed. Those whose figures count are killed before the first figures only.
KILLS = {1: "/gateway", 2: "/wm", 3: "/tm", 4: ROBOT, 9: ROBOT, 14: ROBOT, 21: ROBOT, 26: ROBOT}
NODES = ("/wm", "/tm", "/gateway")

JOURNAL_MB = 2.0
KEPT = max(3 * DAY, 15.0)  # s; three simulated days, but long enough to see the end of a job

#: What a node may grow by between two figures: memory (share and MB), and threads and connections. A figure is taken at
#: a moment when connections of clients that have gone may not be closed yet.
MEMORY, MEMORY_MB, HANDLES = 0.05, 6.0, 6
#: What the days differ by in the size of their jobs (KB), as in the number of rows.
JOBS_KB = 400


class SoakCell(JobCell):
    """A cell whose files have retentions of a few simulated days."""

    def _start_world_model(self) -> Program:
        journal = {"journal": str(self.folder / "journal"), "journal_megabytes": JOURNAL_MB}
        return self.ros.run("skiros2_world_model", "world_model_server_node", name="wm", params=journal)


def of_process(pid: int) -> dict[str, float]:
    """Memory (MB), threads and open files of a process."""
    status = dict(line.split(":", 1) for line in Path(f"/proc/{pid}/status").read_text().splitlines())
    memory = int(status["VmRSS"].split()[0]) / 1024
    return {"memory": memory, "threads": int(status["Threads"]), "files": len(os.listdir(f"/proc/{pid}/fd"))}


class Soak:
    """One run, with its figures."""

    def __init__(self, ros: Ros, folder: Path, seed: int) -> None:
        self.cell = SoakCell(ros, folder, products=6, keep_days=KEPT / 86_400.0)
        self.ros = ros
        self.wm = WorldModelInterface("editor")
        self.chance = random.Random(seed)
        self.figures: dict[int, dict[str, float]] = {}
        self.jobs = self.edits = self.clients = self.kills = self.disturbances = 0

    def live(self) -> None:
        begin = time.monotonic()
        for day in range(1, DAYS + 1):
            if day in KILLS:
                self.cell.kill(KILLS[day])
                self.kills += 1
                self.ros.service(f"{ROBOT}/get_skills", ResourceGetDescriptions)()
                self.cell.wait_until_ready()
            end = begin + day * DAY
            while True:
                self.work(f"{day}-{self.jobs}")
                if time.monotonic() >= end:
                    break
            if day in (START, MIDDLE, END):
                self.figures[day] = self.measure()

    def work(self, name: str) -> None:
        """A part of a day: two jobs, between which the world changes."""
        ids = [f"{name}-{number}" for number in range(2)]
        for number, job_id in enumerate(ids):
            product, store = self.chance.randrange(6), self.chance.randrange(2)
            status, answer = self.cell.rest.post("/api/jobs", self.cell.order(job_id, product, store))
            assert status == 201, answer
            self.jobs += 1
            if number == 0:
                self.disturb(product)
        self.edit()
        self.connect()
        wait_until(lambda: self.have_ended(ids), 120.0, "the end of the jobs")

    def have_ended(self, ids: list[str]) -> bool:
        """Whether jobs have ended; some may have been removed since."""
        jobs = self.cell.jobs()
        return all(jobs[job_id]["response"]["collected"] for job_id in ids if job_id in jobs)

    def disturb(self, product: int) -> None:
        """Somebody carries a product away while a job is about to."""
        cell, name = self.cell, self.cell.products[product]
        try:
            for relation in self.wm.get_element(name).getRelations("", "skiros:contain", "-1"):
                self.wm.set_relation(relation["src"], "skiros:contain", name, False)
            self.wm.set_relation(self.chance.choice([cell.shelf, *cell.stores]), "skiros:contain", name, True)
        except WmException:
            pass  # the robot was faster
        self.disturbances += 1

    def edit(self) -> None:
        """Elements come, change and go."""
        parts = [Element("skiros:Part", f"part {self.edits} {number}") for number in range(5)]
        for part in parts:
            part.addRelation(self.cell.shelf, "skiros:contain", "-1")
        self.wm.add_elements(parts)
        for part in parts:
            part.setProperty("skiros:Key", "x" * self.chance.randrange(500))
            self.wm.update_element(part)
        self.wm.query_ontology("SELECT ?x WHERE { ?x a skiros:Part }")
        for part in parts:
            self.wm.remove_element(part)
        self.edits += 15

    def connect(self) -> None:
        """Clients of the gateway, the world model and the task manager come and go."""
        address = urllib.parse.urlsplit(self.cell.rest.address)
        head = f"GET /api/events HTTP/1.1\r\nHost: cell\r\nAuthorization: Bearer {TOKENS['view']}\r\n\r\n"
        with socket.create_connection((address.hostname, address.port), 10.0) as stream:
            stream.sendall(head.encode())
            assert stream.recv(100)
        reader = WorldModelInterface("reader")
        reader.get_element(self.cell.shelf)
        reader.remote.unfollow()
        for pool in vars(reader.remote.services).values():
            if hasattr(pool, "close"):
                pool.close()
        progress = rospy.Subscriber(f"{ROBOT}/monitor", msgs.TreeProgress)
        progress.unregister()
        self.clients += 3

    def measure(self) -> dict[str, float]:
        """The figures of all nodes, when nothing is running."""
        time.sleep(min(2.0, DAY))  # connections of clients that have gone are closed
        found: dict[str, float] = {}
        for node in NODES:
            for key, value in of_process(self.ros.master.node_pid(node)).items():
                found[f"{node} {key}"] = value
        publishers, subscribers, services = rosgraph.Master("/soak").getSystemState()
        for key, entries in (("publishers", publishers), ("subscribers", subscribers)):
            found[key] = sum(len(nodes) for _, nodes in entries)
        found["services"] = len(services)
        for name in ("journal", "journal-wal", "jobs.sqlite-wal"):
            found[f"{name} KB"] = (self.cell.folder / name).stat().st_size // 1024
        with sqlite3.connect(f"file:{self.cell.folder / 'jobs.sqlite'}?mode=ro", uri=True) as db:
            pages, page_size = (db.execute(f"PRAGMA {name}").fetchone()[0] for name in ("page_count", "page_size"))
            found["jobs KB"] = pages * page_size // 1024
            for table in ("jobs", "job_events", "audit"):
                found[f"{table} rows"] = db.execute(f"SELECT COUNT(*) FROM {table}").fetchone()[0]
        return found

    def growth(self) -> list[str]:
        """What has grown from the middle to the end, or from the start to the middle, by more than its limit."""
        problems = []
        for earlier, later in ((START, MIDDLE), (MIDDLE, END)):
            before, after = self.figures[earlier], self.figures[later]
            for key, value in after.items():
                most = before[key] + HANDLES
                if key.endswith("memory"):
                    most = before[key] * (1.0 + MEMORY) + MEMORY_MB
                elif key == "journal KB":
                    most = 1024 * JOURNAL_MB * 1.5  # the content, and pages that were pruned
                elif key == "journal-wal KB":
                    most = LOG_LIMIT // 1024
                elif key == "jobs.sqlite-wal KB":
                    most = JOBS_LOG_LIMIT // 1024
                elif key == "jobs KB":
                    most = before[key] * 1.5 + JOBS_KB
                elif key.endswith("rows"):
                    most = before[key] * 1.5 + 200  # as many as the kept days have, which differs from day to day
                if value > most:
                    problems.append(f"{key}: {before[key]:.0f} after {earlier} days, {value:.0f} after {later}")
        return problems


@pytest.fixture
def soak(ros: Ros, tmp_path: Path) -> Any:
    seed = int(os.environ.get("SOAK_SEED", random.randrange(1 << 32)))
    print(f"SOAK_SEED={seed} SOAK_SECONDS={SECONDS:g}")
    return Soak(ros, tmp_path, seed)


def test_thirty_days_leave_nothing_behind(soak: Soak) -> None:
    soak.live()
    done = {key: getattr(soak, key) for key in ("jobs", "edits", "disturbances", "clients", "kills")}
    report = {"seconds": SECONDS, **done, "figures": soak.figures}
    Path("build").mkdir(exist_ok=True)
    Path("build/soak.json").write_text(json.dumps(report, indent=1))
    print(", ".join(f"{number} {key}" for key, number in done.items()))
    print(f"{'':24}" + "".join(f"{f'day {day}':>10}" for day in soak.figures))
    for key in soak.figures[END]:
        print(f"{key:24}" + "".join(f"{figures[key]:10.0f}" for figures in soak.figures.values()))
    assert soak.jobs >= DAYS
    assert soak.growth() == []
    wait_until(lambda: soak.cell.rest.get("/api/state")["ready"], what="a cell that still works")
