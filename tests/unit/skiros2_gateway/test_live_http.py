"""The routes of the live view and of the page."""

from __future__ import annotations

import asyncio
import json
import os
import shutil
import subprocess
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from urllib.parse import quote

import pytest

from skiros2_bags.core.bag_file import BagError
from skiros2_common.core.errors import UnknownName
from skiros2_gateway.core import bag_cache, recorded_bag
from skiros2_gateway.core.bags import Bags
from skiros2_gateway.core.live import LiveView
from skiros2_gateway.http.live import live_router, page_router
from skiros2_live.core.cell import CellDocument
from skiros2_live.core.patch import EntriesChanged, GoalProgress, ManagerConnection, TaskProgress
from skiros2_live.core.scene_view import SceneView
from skiros2_runs.core.values import ConditionStatus, NodeStatus
from support.http_gateway import curl, served
from support.source import ROOT
from unit.skiros2_gateway.conftest import TOKENS

Run = Callable[..., None]
#: Bags of the pick-and-place cell; in the second one goals name the tasks of their steps.
BAG = ROOT / "tests/bags/timed_pick_place.bag"
GOAL_BAG = ROOT / "tests/bags/timed_goal.bag"
#: A bag of a cell with two arms, with tf and the robots' description.
CONTACT_BAG = ROOT / "tests/bags/contact.bag"
IDLE, RUNNING, FAILURE, SUCCESS = 4, 3, 2, 1

pytestmark = pytest.mark.skipif(shutil.which("curl") is None, reason="needs Debian's curl")


class _Cell:
    """Implements `LiveCell`: notes the commands."""

    def __init__(self) -> None:
        self.commands: list[tuple[str, str, int]] = []
        self.inspected: list[tuple[str, int, int]] = []

    async def inspect(self, robot: str, task: int, node: int) -> NodeStatus:
        self.inspected.append((robot, task, node))
        return NodeStatus(node, "skiros:Pick", "pick", conditions=[ConditionStatus("PRE", "Near", "near", "holds")])

    async def why(self, robot: str, task: int) -> dict[str, Any]:
        return {"text": "the gripper is full", "explanations": []}

    async def command(self, action: str, robot: str, task: int) -> None:
        self.commands.append((action, robot, task))

    def stop_goal(self, goal_id: str) -> None:
        self.commands.append(("stop", goal_id, -1))

    def recorded_view(self) -> SceneView:
        return SceneView(lambda child, parent: child == parent)

    def mesh_file(self, url: str) -> Path:
        raise UnknownName(f"no element or robot has the mesh {url}")


def _nodes(*states: int) -> list[Any]:
    """A task 7 with a chain of nodes, one for each state."""
    return [
        SimpleNamespace(
            robot="robot", task_id=7, id=index, parent_id=index - 1, type="skiros:Pick" if index else ":Root",
            label=f"pick_{index}" if index else "", processor="", state=state, progress_code=state if index else 0,
            progress_message=f"state {state}", progress_time=0.1, progress_period=0.0, params=[], parent_label="",
        )
        for index, state in enumerate(states)
    ]  # fmt: skip


class _Live:
    def __init__(self, address: str, view: LiveView, cell: _Cell) -> None:
        self.address, self.view, self.cell = address, view, cell

    def record(self, nodes: list[Any]) -> None:
        self.view.cell.apply(TaskProgress("/robot", nodes, self.view.cell.clock()))

    def goal(self, stamp: float, **message: Any) -> None:
        """Applies a message of the goal job-1."""
        self.view.cell.apply(GoalProgress("job-1", SimpleNamespace(**message), stamp))

    async def get(self, path: str, role: str = "view") -> tuple[int, Any]:
        return await curl(self.address, path, token=TOKENS[role])

    async def post(self, path: str, role: str = "operate") -> tuple[int, Any]:
        return await curl(self.address, path, token=TOKENS[role], body={})


@asynccontextmanager
async def _live(
    gateway: Any, bags: Path | None = None, page: Path = Path("/nothing"), clock: Callable[[], float] = time.time
) -> AsyncIterator[_Live]:
    view, cell = LiveView(CellDocument(clock=clock)), _Cell()
    async with served(gateway.service, routers=[live_router(view, cell, Bags(bags)), page_router(page)]) as address:
        yield _Live(address, view, cell)


def test_document_has_the_tree_and_the_styles_of_its_states(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        async with _live(gateway) as live:
            live.record(_nodes(RUNNING, SUCCESS, RUNNING))
            answer = (await live.get("/api/live"))[1]
            tree = answer["document"]["trees"]["run-1"]
            assert tree["shape"]["parents"] == [-1, 0, 1]
            assert [tree["rows"][str(i)][0] for i in range(3)] == [RUNNING, SUCCESS, RUNNING]
            assert answer["styles"]["node"][str(SUCCESS)] == {"symbol": "✓", "word": "succeeded", "role": "success"}
            colours = (await live.get("/page/states.css"))[1]
            assert all(f"--{style['role']}:" in colours for style in answer["styles"]["task"].values())

    in_gateway(test)


def test_viewer_sees_everything_and_commands_nothing(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        async with _live(gateway) as live:
            live.record(_nodes(RUNNING, RUNNING))
            assert (await curl(live.address, "/api/live"))[0] == 401
            assert (await live.get("/api/live/runs/run-1"))[0] == 200
            assert (await live.post("/api/live/runs/run-1/stop", "view"))[0] == 403
            assert live.cell.commands == []
            assert (await live.post("/api/live/runs/run-1/stop"))[0] == 200
            assert live.cell.commands == [("stop", "/robot", 7)]
            status, answer = await live.post("/api/live/runs/run-2/stop")
            assert (status, answer["code"]) == (404, "unknown_name")

    in_gateway(test)


def test_values_of_a_node_that_was_read_are_known_after_the_end(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        async with _live(gateway) as live:
            live.record(_nodes(RUNNING, RUNNING))
            assert (await live.get("/api/live/runs/run-1/nodes/1"))[1]["conditions"][0]["verdict"] == "holds"
            nodes = _nodes(SUCCESS, SUCCESS)
            nodes[0].progress_code = 1  # the end
            live.record(nodes)
            assert (await live.get("/api/live/runs/run-1/nodes/1"))[1]["label"] == "pick"
            assert (await live.get("/api/live/runs/run-1/nodes/0"))[0] == 404
            assert (await live.post("/api/live/runs/run-1/stop"))[0] == 409

    in_gateway(test)


def _feedback(*steps: tuple[str, int]) -> SimpleNamespace:
    """A goal that was sent at a time, with steps `pick` of `/robot`, each with its state and the number of its task."""
    plan = [{"number": n, "skill": "skiros:Pick", "label": "pick", "robot": "/robot"} for n in range(1, len(steps) + 1)]
    states = [{"number": n, "state": state, "task": task} for n, (state, task) in enumerate(steps, 1)]
    return SimpleNamespace(phase="running", message="", plan=json.dumps(plan), steps=json.dumps(states))


def test_goal_is_one_run_with_the_trees_of_its_steps(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        async with _live(gateway) as live:
            start = time.time()
            live.view.cell.apply(EntriesChanged("elements", {"demo:Tray-1": {"label": "Tray B"}}))
            live.record(_nodes(RUNNING, RUNNING, RUNNING))
            assert (await live.get("/api/live"))[1]["document"]["trees"].keys() == {"run-1"}
            live.goal(start, goal=SimpleNamespace(goals='(skiros:contain "demo:Tray-1" "skiros:Product-2")'))
            live.goal(time.time(), feedback=_feedback(("running", 7), ("waiting", 8)))
            document = (await live.get("/api/live"))[1]["document"]
            assert document["runs"]["run-1"]["goal"] == "run-2" and document["trees"].keys() == {"run-2"}
            assert document["goals"]["job-1"]["title"] == "Tray B contains Product-2"
            goal, tree = document["runs"]["run-2"], document["trees"]["run-2"]
            assert (goal["robot"], goal["name"], goal["state"]) == ("goals", "Tray B contains Product-2", "running")
            assert tree["shape"]["names"] == ["Tray B contains Product-2", "pick_1", "pick_2", "pick"]
            assert [tree["rows"][str(i)][0] for i in range(4)] == [RUNNING, RUNNING, RUNNING, IDLE]

            ids = tree["shape"]["ids"]
            assert (await live.get(f"/api/live/runs/run-2/nodes/{ids[1]}"))[1]["label"] == "pick"
            assert live.cell.inspected == [("/robot", 7, 1)]
            assert [(await live.get(f"/api/live/runs/run-2/nodes/{ids[i]}"))[0] for i in (0, 3)] == [404, 404]
            assert (await live.post("/api/live/runs/run-2/pause"))[0] == 200
            assert (await live.post("/api/live/runs/run-2/stop"))[0] == 200
            assert live.cell.commands == [("pause", "/robot", 7), ("stop", "job-1", -1)]

            nodes = _nodes(FAILURE, FAILURE, FAILURE)
            nodes[0].progress_code = -1
            live.record(nodes)
            live.goal(time.time(), result=SimpleNamespace(state="failed", message="no plan is left", done=""))
            assert (await live.get("/api/live/runs/run-2/why"))[1]["text"].startswith("no plan is left\n")
            assert (await live.get("/api/live/runs/run-2"))[1]["summary"]["state"] == "failed"

    in_gateway(test)


def test_history_of_a_bag_is_shown_at_any_time(in_gateway: Run, tmp_path: Path) -> None:
    (tmp_path / "runs").mkdir()
    shutil.copy(GOAL_BAG, tmp_path / "runs" / "cell.bag")

    async def test(gateway: Any) -> None:
        async with _live(gateway, bags=tmp_path) as live:
            [bag] = (await live.get("/api/live/bags"))[1]["bags"]
            opened = (await live.get(f"/api/live/bags/{bag['name']}"))[1]
            [goal] = opened["goals"].values()
            assert (goal["phase"], goal["goal"]) == ("succeeded", "(skiros:contain demo:Tray-12 skiros:Product-14)")
            assert goal["plan"][0]["label"] == "drive"
            states = [goal["steps"][str(step["number"])] for step in goal["plan"]]
            assert {step["state"] for step in states} == {"succeeded"}
            begins = [goal["start"], *(step["began"] for step in states)]
            assert begins == sorted(begins)
            [key] = [key for key, run in opened["runs"].items() if "goal" not in run]
            summary = opened["runs"][key]
            assert (summary["robot"], summary["name"]) == ("goals", "Tray B contains Product A")
            assert goal["title"] == summary["name"]
            assert {run["goal"] for each, run in opened["runs"].items() if each != key} == {key}
            end = (await live.get(f"/api/live/runs/{key}"))[1]
            assert (end["state"], end["summary"]["state"]) == (summary["state"], summary["state"])
            shape = end["tree"]["shape"]
            steps = [name for name, parent in zip(shape["names"], shape["parents"], strict=True) if parent == 0]
            assert steps == ["drive", "pick", "drive", "place"] and len(shape["names"]) > len(steps) + 1
            early = (await live.get(f"/api/live/runs/{key}?time={end['first'] + 0.1}"))[1]
            assert early["state"] == "running"
            assert 0 < len(early["log"]) < len(end["log"])
            assert (await live.get("/api/live/bags/other.bag"))[0] == 404

    in_gateway(test)


def test_strange_files_between_the_bags_hide_none(in_gateway: Run, tmp_path: Path) -> None:
    shutil.copy(BAG, tmp_path / "run #1 100%?.bag")
    for name, target in (("gone.bag", "/nothing"), ("circle.bag", "circle.bag"), ("zeros.bag", "/dev/zero")):
        (tmp_path / name).symlink_to(target)
    (tmp_path / "folder.bag").mkdir()
    os.mkfifo(tmp_path / "pipe.bag")
    (tmp_path / os.fsdecode(b"latin-\xe9.bag")).write_bytes(b"")

    async def test(gateway: Any) -> None:
        async with _live(gateway, bags=tmp_path) as live:
            names = [bag["name"] for bag in (await live.get("/api/live/bags"))[1]["bags"]]
            assert sorted(names) == ["latin-\\xe9.bag", "run #1 100%?.bag"]
            status, problem = await live.get(f"/api/live/bags/{quote(names[0])}")
            assert (status, problem["code"]) == (409, "bag")  # it is empty
            opened = (await live.get(f"/api/live/bags/{quote('run #1 100%?.bag')}"))[1]
            for key in opened["runs"]:
                assert (await live.get(f"/api/live/runs/{quote(key)}"))[0] == 200

    in_gateway(test)


@pytest.mark.long
def test_bag_with_any_file_name_is_listed_and_opened(in_gateway: Run, tmp_path: Path) -> None:
    folders = ["", "x", "x~", "\u202ex", "\\u{7e}"]
    names = ["x~y", "~", "", ".", "..", "x\\u{7e}y", "a/b", "a;b&c=d#e?f%2Fg", "äöü☃", "n" * 251, "bag"]
    names += ["a\nb", "\x01", "\xa0"]
    paths = [tmp_path / folder / f"{name}.bag" for folder in folders for name in names]
    for path in paths:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.symlink_to(BAG)

    async def test(gateway: Any) -> None:
        async with _live(gateway, bags=tmp_path) as live:
            found = [bag["name"] for bag in (await live.get("/api/live/bags"))[1]["bags"]]
            assert len(set(found)) == len(found) == len(set(paths))
            for name in [each for each in found if "~" not in each]:  # of the main folder
                status, opened = await live.get(f"/api/live/bags/{quote(name, safe='')}")
                assert (status, bool(opened["runs"])) == (200, True), name
                key = next(iter(opened["runs"]))
                assert (await live.get(f"/api/live/runs/{quote(key)}"))[0] == 200, name

    in_gateway(test)


def test_damaged_bag_shows_its_readable_part_and_the_damage(in_gateway: Run, tmp_path: Path) -> None:
    content = BAG.read_bytes()
    (tmp_path / "cut.bag").write_bytes(content[: len(content) * 9 // 10])
    (tmp_path / "lost.bag").write_bytes(content[:13] + b"\xff\xff\xff\x7f" + content[17:])  # the first header's length

    async def test(gateway: Any) -> None:
        async with _live(gateway, bags=tmp_path) as live:
            opened = (await live.get("/api/live/bags/cut.bag"))[1]
            assert opened["runs"] and "cut.bag: the bag is cut off after" in opened["damage"]
            status, problem = await live.get("/api/live/bags/lost.bag")
            assert status == 409 and "lost.bag: the bag is cut off after 13 of" in problem["detail"]

    in_gateway(test)


def test_user_who_waits_for_bags_asks_for_no_more(in_gateway: Run, tmp_path: Path) -> None:
    shutil.copy(BAG, tmp_path / "cell.bag")

    async def test(gateway: Any) -> None:
        async with _live(gateway, bags=tmp_path) as live:
            found = await asyncio.gather(*(live.get("/api/live/bags/cell.bag") for _ in range(4)))
            assert sorted(status for status, _ in found) == [200, 200, 429, 429]
            assert (await live.get("/api/live/bags/cell.bag"))[0] == 200

    in_gateway(test)


def test_scene_of_a_bag_is_shown_at_any_time(in_gateway: Run, tmp_path: Path) -> None:
    shutil.copy(CONTACT_BAG, tmp_path / "cell.bag")

    async def test(gateway: Any) -> None:
        async with _live(gateway, bags=tmp_path) as live:
            opened = (await live.get("/api/live/bags/cell.bag"))[1]
            forces = [signal["samples"] for signal in opened["signals"].values() if signal["unit"] == "N"]
            [samples] = filter(None, forces)  # the forces of one arm were recorded
            assert any(low < high for _, low, high in samples)
            key, summary = next(iter(opened["runs"].items()))
            early, late = [
                (await live.get(f"/api/live/runs/{key}/scene?time={moment}"))[1]
                for moment in (summary["start"], summary["end"])
            ]
            assert list(early["bodies"]) == ["piston_cell"]
            assert early["frames"].keys() == late["frames"].keys()
            moved = [name for name, frame in early["frames"].items() if frame != late["frames"][name]]
            assert any(name.startswith("piston_cell/right_arm") for name in moved), moved
            assert early["elements"] != late["elements"]
            assert (await live.get("/api/live/runs/bag/other.bag/0/scene?time=0"))[0] == 404

    in_gateway(test)


def test_scene_of_the_cell_is_shown_as_it_was(in_gateway: Run) -> None:
    now = [1000.0]

    async def test(gateway: Any) -> None:
        async with _live(gateway, clock=lambda: now[0]) as live:
            live.record(_nodes(RUNNING, RUNNING))
            for x in range(3):
                now[0] += 1.0
                live.view.put("frames", "base", ["map", x, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
            live.view.put("elements", "Box-1", {"label": "box"})
            now[0] += 1.0
            live.view.put("elements", "Box-1", None)
            moments = (1001.5, 1002.5, 1003.5, 1004.5)
            scenes = [(await live.get(f"/api/live/runs/run-1/scene?time={moment}"))[1] for moment in moments]
            assert [scene["frames"]["base"][1] for scene in scenes] == [0, 1, 2, 2]
            assert [list(scene["elements"]) for scene in scenes] == [[], [], ["Box-1"], []]

    in_gateway(test)


def test_without_the_page_the_gateway_says_how_to_get_it(in_gateway: Run, tmp_path: Path) -> None:
    async def test(gateway: Any) -> None:
        async with _live(gateway) as live:
            status, text = await curl(live.address, "/")
            assert status == 404
            assert "make" in text
        (tmp_path / "index.html").write_text("<p>page</p>")
        async with _live(gateway, page=tmp_path) as live:
            assert await curl(live.address, "/") == (200, "<p>page</p>")
            assert (await curl(live.address, "/page/..%2fusers.yaml"))[0] == 404

    in_gateway(test)


def test_bag_is_read_in_a_process_with_limits(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(recorded_bag, "MAX_MEMORY", 2**20)
    with pytest.raises(BagError, match="more than 1 MB of memory"):
        recorded_bag.read_runs(BAG)
    monkeypatch.undo()
    with pytest.raises(BagError, match="does not begin"):
        (tmp_path / "a.bag").write_bytes(b"")
        recorded_bag.read_runs(tmp_path / "a.bag")
    monkeypatch.setattr(recorded_bag, "_MAX_TIME", 0.01)
    with pytest.raises(BagError, match="not read within"):
        recorded_bag.read_scene(BAG)


def test_bag_is_read_once_until_it_changes_also_after_a_restart(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copy(BAG, tmp_path / "run.bag")
    reads, run = [], subprocess.run
    monkeypatch.setattr(subprocess, "run", lambda *args, **options: reads.append(args) or run(*args, **options))
    first = Bags(tmp_path, tmp_path / "cache").open("run.bag")
    for _ in range(2):
        bags = Bags(tmp_path, tmp_path / "cache")
        assert bags.open("run.bag") == bags.open("run.bag") == first
    assert len(reads) == 1
    os.utime(tmp_path / "run.bag", (1.0, 1.0))
    assert bags.open("run.bag") == first
    assert len(reads) == 2
    monkeypatch.setattr(bag_cache, "_MAX_BYTES", 1)
    os.utime(tmp_path / "run.bag", (2.0, 2.0))
    bags.open("run.bag")
    assert len([*(tmp_path / "cache").iterdir()]) == 1
    assert (tmp_path / "cache").stat().st_mode & 0o777 == 0o700


def test_list_has_the_progress_of_a_bag_that_is_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shutil.copy(BAG, tmp_path / "run.bag")
    bags, seen, run = Bags(tmp_path), [], subprocess.run

    def slowly(*args: Any, **options: Any) -> Any:
        done = run(*args, **options)
        seen.extend(bags.list())  # what the process has written at last
        return done

    monkeypatch.setattr(subprocess, "run", slowly)
    bags.open("run.bag")
    assert 0.0 < seen[0]["progress"] < 1.0
    assert "progress" not in bags.list()[0]


def test_viewer_gets_beats_while_nothing_changes_and_patches_at_once(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        async with _live(gateway) as live:
            url = f"{live.address}/api/live/patches?beats=true"
            command = ["curl", "-sN", "-m", "20", url, "-H", f"Authorization: Bearer {TOKENS['view']}"]
            process = await asyncio.create_subprocess_exec(*command, stdout=asyncio.subprocess.PIPE)
            assert process.stdout is not None
            clocks: list[float] = []
            async for line in process.stdout:
                if line == b"event: beat\n":
                    clocks.append(float((await process.stdout.readline()).removeprefix(b"data: ")))
                    assert clocks[-1] <= time.monotonic() + 0.001  # rounded
                if len(clocks) == 2:
                    live.record(_nodes(RUNNING, RUNNING))
                if line == b"event: patch\n":
                    break
            process.kill()
            await process.wait()
            assert 0.9 < clocks[1] - clocks[0] < 5.0
            assert len(clocks) <= 3

    in_gateway(test)


def test_runs_of_a_robot_that_is_gone_are_lost(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        async with _live(gateway) as live:
            live.record(_nodes(RUNNING, RUNNING))
            live.view.cell.apply(ManagerConnection("/robot", False))
            assert (await live.get("/api/live"))[1]["document"]["runs"]["run-1"]["state"] == "lost"

    in_gateway(test)
