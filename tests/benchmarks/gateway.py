"""The gateway on a cell of real nodes: latency of a job, 100 clients, load, the page, kills, hostile requests.

A program of its own: `make bench-gateway`, or `.ci/in_ros .venv/bin/python3 tests/benchmarks/gateway.py --short`. The
cell has one robot with a skill that takes no time, so that the times are those of the platform.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import statistics
import sys
import tempfile
import time
import tomllib
import urllib.request
from collections import Counter
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from random import Random
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
folders = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["pytest"]["ini_options"]["pythonpath"]
sys.path[:0] = [str(ROOT / folder) for folder in folders]

import rospy  # noqa: E402 - after the path

from benchmarks.gateway_load import load  # noqa: E402
from benchmarks.page import page  # noqa: E402
from skiros2_factory_demo.mes import Channel, MqttChannel, OpcuaChannel, RestChannel  # noqa: E402
from skiros2_gateway.opcua.model import NAMESPACE  # noqa: E402
from skiros2_task.ros.task_manager_interface import TaskManagerInterface  # noqa: E402
from support.broker import broker  # noqa: E402
from support.hostile import FORBIDDEN, Hostile, fuzz_mqtt, fuzz_opcua, fuzz_rest  # noqa: E402
from support.job_cell import TOKENS, JobCell  # noqa: E402
from support.ros import Ros, RosMaster, wait_until  # noqa: E402
from support.stop_load import PLANNERS, full_load, stop_times, summary  # noqa: E402

Row = dict[str, Any]


def main(arguments: Sequence[str]) -> int:
    """Runs the program. Returns 0, or 1 if a job was lost or a request was carried out without the role."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--short", action="store_true", help="a tenth of everything: some minutes")
    parser.add_argument("--parts", default="latency,clients,load,page,stop,kills,hostile", help="default: %(default)s")
    parser.add_argument("--seed", type=int, default=1, help="of kills and hostile requests (%(default)s)")
    parser.add_argument("--json", type=Path, default=ROOT / "build/gateway.json", help="where the figures go")
    options = parser.parse_args(arguments)
    scale = 0.1 if options.short else 1.0
    parts: dict[str, Callable[[JobCell, int], Row]] = {
        "latency": lambda cell, port: asyncio.run(latency(cell, port, round(200 * scale))),
        "clients": lambda cell, port: clients(cell, 100),
        "load": lambda cell, port: load(cell, 10_000, 60.0 * max(0.2, scale), round(50 * max(0.2, scale))),
        "page": lambda cell, port: page(cell, 30.0 * max(0.2, scale)),
        "stop": lambda cell, port: stop(cell, round(100 * max(0.2, scale))),
        "kills": lambda cell, port: kills(cell, round(1000 * scale), round(20 * scale), Random(options.seed)),
        "hostile": lambda cell, port: asyncio.run(hostile(cell, port, round(10_000 * scale), options.seed)),
    }
    found: dict[str, Row] = {}
    with (
        tempfile.TemporaryDirectory(prefix="skiros2-bench-") as folder,
        broker() as port,
        RosMaster(Path(folder)) as master,
    ):
        os.environ.update({key: master.env[key] for key in ("ROS_MASTER_URI", "ROS_HOSTNAME", "ROS_HOME")})
        rospy.init_node("tests", disable_signals=True)
        ros = Ros(master)
        try:
            users = {"operators": PLANNERS // 2}
            cell = JobCell(ros, Path(folder), products=10, **users, opcua_port=0, mqtt=f"127.0.0.1:{port}")
            for part in options.parts.split(","):
                found[part] = parts[part](cell, port)
                print(part, json.dumps(found[part], indent=1), flush=True)
                options.json.parent.mkdir(parents=True, exist_ok=True)
                options.json.write_text(json.dumps(found, indent=1))
        finally:
            ros.stop()
            rospy.signal_shutdown("the measurements have ended")
    return 1 if any(row.get("wrong") for row in found.values()) else 0


# -- latency -----------------------------------------------------------------------------------------------------------


async def latency(cell: JobCell, port: int, count: int) -> Row:
    """Measures the time from the request to the first motion: the start of the skill.

    The ways take turns, with the bare action among them.
    """
    token = TOKENS["operate"]
    tasks = TaskManagerInterface()
    rest = RestChannel(cell.rest.address, token)
    mqtt = MqttChannel("127.0.0.1", port, "operate", token, lambda job_id, state: None)
    opcua = await OpcuaChannel.connect(cell.parameter("/gateway/opcua_address"), "operate", token, NAMESPACE)
    channels: dict[str, Channel | None] = {"action": None, "REST": rest, "OPC UA": opcua, "MQTT": mqtt}
    times: dict[str, list[float]] = {way: [] for way in channels}
    for number in range(count):
        for way, channel in channels.items():
            moves = len(cell.motions())
            order = cell.order(f"{way.replace(' ', '')}-{number}", 0, moves % 2)
            goal = f"(skiros:contain {order['parameters']['Place']} {order['parameters']['Product']})"
            begin = time.time()
            if channel is None:
                tasks.achieve(goal)
                await asyncio.to_thread(tasks.wait_for_result)
            else:
                await channel.send(order)
                await channel.response(order["id"])
            times[way].append(cell.motions()[moves] - begin)
    for channel in filter(None, channels.values()):
        await channel.close()
    row: Row = {way: {"median_ms": _ms(statistics.median(t)), "p90_ms": _ms(_p90(t))} for way, t in times.items()}
    base = statistics.median(times["action"])
    more = {way: _ms(statistics.median(t) - base) for way, t in times.items() if way != "action"}
    return {**row, "more_than_the_action_ms": more, "repetitions": count}


def _p90(times: list[float]) -> float:
    return sorted(times)[int(0.9 * (len(times) - 1))]


def _ms(seconds: float) -> float:
    return round(1000.0 * seconds, 1)


# -- clients -----------------------------------------------------------------------------------------------------------


def clients(cell: JobCell, count: int) -> Row:
    """Connects viewers of the events, and sends a job from each of as many clients at once."""
    headers = {"Authorization": f"Bearer {TOKENS['view']}"}

    def follow(number: int) -> float:
        """Returns when the response of the last job came (s since the epoch)."""
        request = urllib.request.Request(f"{cell.rest.address}/api/events?kinds=response", headers=headers)
        with urllib.request.urlopen(request, timeout=150.0) as stream:
            for line in stream:
                if line.startswith(b"data:") and json.loads(line[5:])["data"].get("job") == "last":
                    return time.time()
        raise RuntimeError("the stream has ended")

    def send(number: int) -> float:
        begin = time.monotonic()
        status, answer = cell.rest.post("/api/jobs", {**cell.order(f"client-{number}", number % 10), "start": False})
        assert status == 201, answer
        return time.monotonic() - begin

    before = cell.rest.get("/api/state")["viewers"]  # other parts of the gateway follow the events too
    with ThreadPoolExecutor(2 * count) as threads:
        viewers = [threads.submit(follow, number) for number in range(count)]
        wait_until(lambda: cell.rest.get("/api/state")["viewers"] - before >= count, 120.0, "all viewers")
        answers = list(threads.map(send, range(count)))
        cell.rest.post("/api/jobs", cell.order("last", 0))
        ended = cell.wait_for(["last"])["last"]["response"]["ended"]
        delays = [viewer.result() - ended for viewer in viewers]
    return {"clients": count, "answer_p90_ms": _ms(_p90(answers)), "event_p90_ms": _ms(_p90(delays))}


# -- stop --------------------------------------------------------------------------------------------------------------


def stop(cell: JobCell, count: int) -> Row:
    """Measures the time from a request to the robot's stop command, by the stop port; see `support.stop_load`."""
    address = cell.parameter("/gateway/stop_address")
    row: Row = {"free": summary(stop_times(cell, count, address))}
    with full_load(cell):
        row["full_load"] = summary(stop_times(cell, count, address))
        row["full_load_by_http_port"] = summary(stop_times(cell, 5, cell.rest.address))
    return {**row, "load_average": os.getloadavg()[0], "repetitions": count}


# -- kills -------------------------------------------------------------------------------------------------------------


def kills(cell: JobCell, jobs: int, number: int, random: Random) -> Row:
    """Queues jobs, kills nodes while they run, and counts how often each was done."""
    ids = [f"job-{k}" for k in range(jobs)]
    begin, before, ended = time.monotonic(), cell.carried(), cell.ended()
    for k, job_id in enumerate(ids):
        assert cell.rest.post("/api/jobs", cell.order(job_id, k % 10, (k // 10) % 2))[0] == 201
    killed: Counter[str] = Counter()
    for k in range(number):
        due = (k + 1) * jobs / (number + 1)
        wait_until(lambda due=due: cell.ended() - ended >= due, 3600.0, "the next kill")
        node = random.choice(("/gateway", "/tm", "/wm"))
        cell.kill(node)
        killed[node] += 1
    wait_until(lambda: cell.ended() - ended >= jobs, 3600.0, "the end of all jobs")
    done = cell.wait_for(ids)
    outcomes = Counter(job["response"]["outcome"] for job in done.values())
    return {
        "jobs": jobs, "killed": dict(killed), "outcomes": dict(outcomes), "wrong": cell.wrong(done, before),
        "jobs_per_s": round(jobs / (time.monotonic() - begin), 2),
    }  # fmt: skip


# -- hostile requests --------------------------------------------------------------------------------------------------


async def hostile(cell: JobCell, port: int, count: int, seed: int) -> Row:
    """Sends hostile requests by each interface, and checks that the gateway is the same process afterwards."""
    rest = await fuzz_rest(cell.rest.address, TOKENS, Hostile(seed), count)
    mqtt = await fuzz_mqtt(port, "skiros2", TOKENS, Hostile(seed + 1), count)
    opcua: Counter[str] = Counter()
    for user in ("view", "operate"):
        channel = await OpcuaChannel.connect(cell.parameter("/gateway/opcua_address"), user, TOKENS[user], NAMESPACE)
        opcua += await fuzz_opcua(channel.client, channel.index, Hostile(seed + 2), count // 2)
        await channel.close()
    forbidden = [job_id for job_id in cell.jobs() if job_id.startswith(FORBIDDEN)]
    audit = cell.rest.get("/api/audit?limit=10000")["audit"]
    done = {entry["user"] for entry in audit if entry["outcome"] == "done"}
    wrong = [*forbidden, *(done - {"operate"}), *([] if cell.gateway.running else ["the gateway has ended"])]
    return {"REST": _sorted(rest), "MQTT": _sorted(mqtt), "OPC UA": _sorted(opcua), "wrong": wrong}


def _sorted(found: Counter[Any]) -> dict[str, int]:
    return {str(key): number for key, number in found.most_common()}


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
