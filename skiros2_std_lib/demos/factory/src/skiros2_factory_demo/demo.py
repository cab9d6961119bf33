"""Runs the factory demo: a simulated cell, the gateway, a MES with jobs by three ways, an agent that asks for one."""

from __future__ import annotations

import argparse
import asyncio
import os
import sys
import time
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any, TextIO

import rospkg
import rospy
import yaml

from skiros2_bags.core.run import Finding, Run
from skiros2_bags.core.run import check as check_bag
from skiros2_common.command_line.command import Parser
from skiros2_common.command_line.layout import Screen, table
from skiros2_common.core.errors import Refused
from skiros2_common.core.processes import free_port
from skiros2_demo.demo import ROBOT, System, add_options, run_demo, wait_until_ready
from skiros2_demo.run_check import ACHIEVE, WorldState
from skiros2_demo.simulation import Simulation
from skiros2_factory_demo.agent import ask_for_job
from skiros2_factory_demo.mes import Answer, Channel, MqttChannel, OpcuaChannel, Order, RestChannel
from skiros2_factory_demo.page_picture import page_pictures
from skiros2_gateway.core.users import read_users
from skiros2_gateway.opcua.model import NAMESPACE
from skiros2_world_model.core.scene import ROOT
from skiros2_world_model.ros.world_model_interface import WorldModelInterface

REST, OPCUA, MQTT = "REST", "OPC UA", "MQTT"
A, B = "skiros:Product-14", "skiros:Product-15"
TRAY_A, TRAY_C, TRAY_B, TRAY_D = (f"demo:Tray-{number}" for number in range(10, 14))
ALARM, AGENT_JOB = "order-11", "agent-1"
CHARGER, WORKSTATION_1, WORKSTATION_2 = "skiros:Location-5", "demo:Workstation-6", "demo:Workstation-7"


_BOTH = f"(and (skiros:at cora:Robot-1 {WORKSTATION_1}) (skiros:at cora:Robot-1 {WORKSTATION_2}))"


def jobs() -> list[tuple[str, Order]]:
    """Returns jobs with the way each is sent. The first starts at once, the others in the order of priorities.

    The last one cannot be done, which raises an alarm.
    """
    soon = (datetime.now(UTC) + timedelta(minutes=2)).isoformat()
    return [
        (REST, _put("order-01", A, TRAY_B)),
        (OPCUA, _park("order-02", CHARGER, priority=1)),
        (MQTT, _put("order-03", B, TRAY_C, priority=5)),
        (REST, {"id": "order-04", "goal": f"(skiros:contain {TRAY_A} {A})", "priority": 4}),
        (OPCUA, _put("order-05", B, TRAY_D, priority=3)),
        (MQTT, _park("order-06", WORKSTATION_1, priority=2)),
        (REST, _park("order-07", WORKSTATION_2, priority=8)),
        (OPCUA, _put("order-08", A, TRAY_B, priority=-1)),
        (MQTT, _park("order-09", CHARGER, priority=9)),
        (REST, {**_park("order-10", WORKSTATION_1), "due": soon}),
        (REST, {"id": ALARM, "goal": _BOTH, "description": "Drive to both workstations at once", "priority": -5}),
    ]


def _put(job_id: str, product: str, tray: str, priority: int = 0) -> Order:
    parameters = {"Product": product, "Tray": tray}
    return {"id": job_id, "work_master": "put_in_tray", "parameters": parameters, "priority": priority}


def _park(job_id: str, place: str, priority: int = 0) -> Order:
    return {"id": job_id, "work_master": "park", "parameters": {"Place": place}, "priority": priority}


class FactoryDemo:
    """One run of the demo.

    :param out: for the report.
    """

    #: What to type next, in the folder of the clone, and what it shows.
    next = {
        "make demo": "the cell alone: one goal, and what the robot does for it",
        ". install/setup.sh && roslaunch skiros2_sim_skills demo.launch gateway:=true": "the cell with its page",
    }

    def __init__(self, options: argparse.Namespace, out: TextIO) -> None:
        self._options = options
        self._out = out
        self._screen = Screen(os.get_terminal_size().columns) if out.isatty() else Screen()
        self._world = WorldState()
        self._states: dict[str, str] = {}
        self._started = time.monotonic()
        self._is_carrying = asyncio.Event()
        self._running: list[str] = []
        self._is_sent = False

    def run(self) -> bool:
        """Runs the demo. Returns whether all jobs succeeded, as the responses, the bag and the simulated world show.

        :raises SkirosError: a part of the system fails.
        """
        with System(self._options.folder, self._options.port) as system:
            folder = self._options.folder
            self._say(f"Starting a system of its own: master on port {system.port}, logs in {folder}")
            system.start_recording(ROBOT)
            system.init_node("factory_demo")
            for old in self._gateway_folder.glob("jobs.sqlite*"):  # the jobs of an earlier demo have the same ids
                old.unlink()
            broker = free_port()
            system.start("broker", ["mosquitto", "-p", str(broker)])
            system.launch(*self._launch_arguments(broker))
            simulation = Simulation()
            wait_until_ready(system, simulation, ROBOT)
            for name in ("address", "opcua_address"):
                system.wait_for(lambda name=name: rospy.has_param(f"/gateway/{name}"), f"the gateway's {name}")
            self._world = WorldState.of(WorldModelInterface(rospy.get_name()).get_branch(ROOT))
            answers, findings = asyncio.run(self._produce(system, broker))
            truth = [
                finding
                for product, tray in ((A, TRAY_B), (B, TRAY_D))
                for finding in simulation.check_placement(self._world.things[product], self._world.things[tray])
            ]
            system.stop_recording()
        held = self._show("What the MES has checked", findings)
        held &= self._show(f"Proof from the bag alone ({system.bag})", _check_bag(system.bag, answers))
        return self._show("Proof from the simulated world", truth) and held

    def _launch_arguments(self, broker: int) -> list[str]:
        """Returns package, file and arguments to launch."""
        masters = Path(rospkg.RosPack().get_path("skiros2_factory_demo")) / "config/demo_work_masters.yaml"
        settings = {
            "folder": str(self._gateway_folder), "http_port": 0, "opcua_port": 0, "mqtt": f"127.0.0.1:{broker}",
            "work_masters": str(masters), "agents": "ask",
        }  # fmt: skip
        options = self._options
        simulated = [f"seed:={options.seed}", f"rate:={options.rate}", f"sim_gui:={str(options.gui).lower()}"]
        text = yaml.safe_dump(settings, default_flow_style=True, width=10_000).strip()
        gateway = ["gateway:=true", f"gateway_settings:={text}"]
        return ["skiros2_demo", "demo.launch", "gui:=false", *simulated, *gateway]

    @property
    def _gateway_folder(self) -> Path:
        return Path(self._options.folder).resolve() / "gateway"

    # -- the MES -------------------------------------------------------------------------------------------------------

    async def _produce(self, system: System, broker: int) -> tuple[dict[str, Answer], list[Finding]]:
        """Sends the jobs and waits for their responses."""
        address, token = rospy.get_param("/gateway/address"), self._token("operate")
        self._say(f"The cell is ready ({self._elapsed()})")
        self._say(f"The page, until the jobs have ended: {address}, token {token}")
        rest, orders = RestChannel(address, token), jobs()
        mqtt = MqttChannel("127.0.0.1", broker, "operate", token, self._on_state)
        opcua = await OpcuaChannel.connect(rospy.get_param("/gateway/opcua_address"), "operate", token, NAMESPACE)
        channels: dict[str, Channel] = {REST: rest, OPCUA: opcua, MQTT: mqtt}
        picture = asyncio.create_task(self._take_picture(address))
        try:
            self._title(f"The MES sends {len(orders)} jobs")
            for way, order in orders:
                await channels[way].send(order)
                self._say(f"  {order['id']}  by {way:<6}  priority {order.get('priority', 0):>2}  {self._text(order)}")
            refused = await self._refused(mqtt)
            self._title("The jobs as they run")
            self._is_sent = True
            self._say_running()
            waiting = [asyncio.ensure_future(channels[way].response(order["id"])) for way, order in orders]
            await self._wait(system, waiting)
            answers = {order["id"]: task.result() for (_, order), task in zip(orders, waiting, strict=True)}
            self._is_carrying.set()
            await picture
            self._print_responses(orders, answers)
            await rest.send(orders[0][1])  # the answer of the first time got lost, for example
            findings = [*refused, *self._check(orders, answers, rest)]
            findings += await self._involve_people(address, rest)
            return {**answers, AGENT_JOB: await rest.response(AGENT_JOB)}, findings
        finally:
            picture.cancel()
            for channel in channels.values():
                await channel.close()

    async def _take_picture(self, address: str) -> None:
        """Saves a picture of the page while a robot carries something, beside the bag."""
        await self._is_carrying.wait()
        await self._take_pictures(address, {"page": ()})

    async def _take_pictures(self, address: str, wanted: dict[str, tuple[str, ...]]) -> None:
        """Saves pictures of the page beside the bag; reports why it cannot.

        :param wanted: what to click before each, by the name of the file; nothing: a robot that picks.
        """
        paths = {Path(self._options.folder) / f"{name}.png": clicks for name, clicks in wanted.items()}
        for path in paths:
            path.unlink(missing_ok=True)
        if not self._options.pictures:
            return
        try:
            async with page_pictures(address, self._token("view")) as pictures:
                for path, clicks in paths.items():
                    await (pictures.save(path, *clicks) if clicks else pictures.save_pick(path))
                    self._say(f"  {self._elapsed():>7}  picture of the page: {path}")
        except Refused as error:
            self._say(f"  no picture of the page: {error}")

    async def _involve_people(self, address: str, rest: RestChannel) -> list[Finding]:
        """Has an agent ask for a job, and a person approve it and acknowledge the alarm of the job that has failed."""
        self._title("What needs a person")
        order = {"id": AGENT_JOB, "work_master": "park", "parameters": {"Place": CHARGER}}
        reason = "No order is left, and the battery is low."
        asking = asyncio.create_task(ask_for_job(address, self._token("agent"), order, reason))
        approve = RestChannel(address, self._token("approve"))
        while not (waiting := (await asyncio.to_thread(rest.request, "GET", "/api/approvals"))["approvals"]):
            if asking.done():
                await asking
            await asyncio.sleep(0.2)
        self._say(f"  an agent asks to {self._text(order)}: {reason}")
        alarms = [alarm for alarm in rest.request("GET", "/api/alarms")["alarms"] if alarm["source"] == ALARM]
        for alarm in alarms:
            self._say(f"  an alarm: {alarm['source']}: {alarm['text'].partition(chr(10))[0]}")
        details = ".approval:has-text('Job failed') button:text-is('Details')"
        clicks = {"page_approval": ("#approvals",), "page_alarms": ("#alarms",), "page_job": ("#alarms", details)}
        await self._take_pictures(address, clicks)
        approve.request("POST", f"/api/approvals/{waiting[0]['id']}/approve", {"digest": waiting[0]["digest"]})
        await asking
        rest.request("POST", "/api/alarms/acknowledge", {"alarms": [alarm["id"] for alarm in alarms]})
        outcome = (await rest.response(AGENT_JOB))["outcome"]
        return [
            Finding(len(alarms) == 1, f"the job that has failed has raised {len(alarms)} alarm"),
            Finding(outcome == "succeeded", f"the agent's job has {outcome} after a person approved it"),
        ]

    async def _wait(self, system: System, waiting: list[asyncio.Future[Answer]]) -> None:
        deadline = time.monotonic() + self._options.timeout
        while not all(task.done() for task in waiting):
            system.check()
            if time.monotonic() > deadline:
                raise Refused(f"the jobs did not end within {self._options.timeout:.0f} s")
            await asyncio.wait(waiting, timeout=0.2)

    async def _refused(self, channel: Channel) -> list[Finding]:
        wrong = _put("order-12", "skiros:Product-41", "demo:Tray-12")
        try:
            await channel.send(wrong)
        except Refused as error:
            return [Finding(True, f"an order with a mistake is refused: {error}")]
        return [Finding(False, "an order for a product that does not exist was accepted")]

    def _check(self, orders: list[tuple[str, Order]], answers: dict[str, Answer], rest: RestChannel) -> list[Finding]:
        ended = [job_id for job_id, answer in answers.items() if answer["outcome"] in ("succeeded", "nothing_to_do")]
        first, *others = (order for _, order in orders)
        wanted = [first, *sorted(others, key=lambda order: -order.get("priority", 0))]
        began = sorted(answers, key=lambda job_id: float(answers[job_id]["started"]))
        counts = rest.request("GET", "/api/state")["counts"]
        return [
            Finding(len(ended) == len(orders) - 1, f"{len(ended)} of {len(orders)} jobs have succeeded"),
            Finding(answers[ALARM]["outcome"] == "impossible", f"{ALARM}, which has no plan, has not"),
            Finding(began == [order["id"] for order in wanted], "the jobs have started in the order of priorities"),
            Finding(sum(counts.values()) == len(orders), "an order that is sent twice is one job"),
        ]

    def _token(self, name: str) -> str:
        return next(user.token for user in read_users(self._gateway_folder / "users.yaml") if user.name == name)

    # -- the report ----------------------------------------------------------------------------------------------------

    def _print_responses(self, orders: list[tuple[str, Order]], answers: dict[str, Answer]) -> None:
        self._title("Their responses, in the order in which they started")
        ways = {order["id"]: (way, order) for way, order in orders}
        rows = []
        for job_id in sorted(answers, key=lambda job_id: float(answers[job_id]["started"])):
            (way, order), answer = ways[job_id], answers[job_id]
            quality = ", ".join(f"{_short(key)} {_value(value)}" for key, value in answer["quality"].items())
            seconds = f"{answer['ended'] - answer['started']:.1f} s"
            changes = sum(len(change["lines"]) for change in answer["changes"])
            priority = str(order.get("priority", 0))
            rows.append([job_id, way, priority, self._text(order), answer["outcome"], seconds, str(changes), quality])
        headers = ["job", "by", "priority", "task", "outcome", "time", "changes", "quality data"]
        for line in table(self._screen, rows, headers):
            self._say(f"  {line}")

    def _text(self, order: Order) -> str:
        """Returns what an order wants, with the names of the things."""
        values = [self._world.name(value) for value in order.get("parameters", {}).values()]
        if order.get("work_master") == "put_in_tray":
            return f"{values[0]} to {values[1]}"
        if order.get("work_master") == "park":
            return f"drive to {values[0]}"
        goal = str(order.get("description", order["goal"]))
        for thing in self._world.things.values():
            goal = goal.replace(thing.id, thing.name)
        return goal

    def _on_state(self, job_id: str, state: str) -> None:
        if state in ("Running", "Ended", "Aborted") and self._states.get(job_id) != state:
            self._states[job_id] = state  # a state is published again with each progress
            if (job_id, state) == ("order-03", "Running"):
                self._is_carrying.set()
            self._running.append(f"  {self._elapsed():>7}  {job_id}  {state}")
            if self._is_sent:
                self._say_running()

    def _say_running(self) -> None:
        for line in self._running:
            self._say(line)
        self._running.clear()

    def _show(self, title: str, findings: list[Finding]) -> bool:
        self._title(title)
        for finding in findings:
            self._say(f"  {'✓' if finding.holds else '✗'} {finding.text}")
        return all(finding.holds for finding in findings)

    def _title(self, text: str) -> None:
        self._say(f"\n\033[1m{text}\033[0m" if self._out.isatty() else f"\n{text}")

    def _say(self, text: str) -> None:
        self._out.write(text + "\n")
        self._out.flush()

    def _elapsed(self) -> str:
        return f"{time.monotonic() - self._started:.1f} s"


def _check_bag(bag: Path, answers: dict[str, Answer]) -> list[Finding]:
    """Compares the goals in the bag with the responses."""
    run = Run.open(bag)
    ends = {goal.call.goal_id: goal.state for goal in run.goals() if goal.call.type == ACHIEVE}
    told = {job_id: answer["outcome"] for job_id, answer in answers.items()}
    return [*check_bag(run), Finding(ends == told, f"it has the goals of {len(ends)} jobs, with the outcomes reported")]


def _short(key: str) -> str:
    return key.replace("skiros:", "").replace("ContainerState", "state")


def _value(value: Any) -> str:
    return f"{value:.3f}" if isinstance(value, float) else str(value)


def main(arguments: list[str]) -> int:
    """Runs the program. Returns the exit status: 0 all jobs succeeded, 1 not, 2 wrong arguments, 128 + n after
    signal n."""
    parser = Parser(prog="factory_demo", description=__doc__)
    add_options(parser, rate=5.0, timeout=600.0)
    return run_demo(FactoryDemo(parser.parse_args(arguments), sys.stdout), "factory_demo")
