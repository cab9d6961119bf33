"""A bag recorded by `rosbag record` from a SkiROS2 system, read by the bag commands."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from rosbags.rosbag1 import Reader, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from compatibility.rules import rule
from skiros2_bags.core.run import Run
from skiros2_msgs.msg import TreeProgress, WmMonitor

#: As they stand in the connection records of a recorded bag.
DEFINITIONS = {
    "Param": "string param\n",
    "Property": "string key\nstring dataValue\nstring dataType\n",
    "Relation": "string subjectId\nstring predicate\nstring objectId\n",
    "SkillProgress": (
        "int16 SUCCESS=1\nint16 FAILURE=2\nint16 RUNNING=3\nint16 IDLE=4\nstring robot\nint16 task_id\nint16 id\n"
        "string parent_label\nint16 parent_id\nstring type\nstring label\nParam[] params\nstring processor\n"
        "int16 state\nint16 progress_code\nfloat32 progress_period\nfloat32 progress_time\nstring progress_message\n"
    ),
    "TreeProgress": "SkillProgress[] progress\n",
    "WmElement": "string id\nstring type\nstring label\nProperty[] properties\nRelation[] relations\n",
    "WmMonitor": (
        "string ADD=add\nstring UPDATE=update\nstring REMOVE=remove\nstring RESET=reset\nstring prev_snapshot_id\n"
        "string snapshot_id\ntime stamp\nstring author\nstring action\nWmElement[] elements\nRelation[] relation\n"
    ),
}
PART = "skiros:Part-5"


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A task of two nodes that drives a part's position, in three changes."""
    store = get_typestore(Stores.ROS1_NOETIC)
    for name, text in DEFINITIONS.items():
        store.register(get_types_from_msg(text, f"skiros2_msgs/msg/{name}"))
    types = {name: store.types[f"skiros2_msgs/msg/{name}"] for name in DEFINITIONS}
    stamp = store.types["builtin_interfaces/msg/Time"](sec=0, nanosec=0)

    def part(x: float) -> Any:
        position = types["Property"](key="skiros:PositionX", dataValue=json.dumps([x]), dataType="float")
        where = types["Relation"](subjectId="skiros:Scene-0", predicate="skiros:contain", objectId="-1")
        return types["WmElement"](id=PART, type="skiros:Part", label="a part", properties=[position], relations=[where])

    def change(number: int, action: str, x: float) -> Any:
        return types["WmMonitor"](
            prev_snapshot_id=str(number - 1), snapshot_id=str(number), stamp=stamp, author="/robot", action=action,
            elements=[part(x)], relation=[],
        )  # fmt: skip

    def progress(state: int, code: int) -> Any:
        root = node(0, 0, -1, ":Root", "task_0", state, code)
        return types["TreeProgress"](progress=[root, node(0, 1, 0, "skiros:Drive", "drive", state, 3)])

    def node(task: int, own: int, parent: int, kind: str, label: str, state: int, code: int) -> Any:
        return types["SkillProgress"](
            robot="/robot", task_id=task, id=own, parent_label="", parent_id=parent, type=kind, label=label, params=[],
            processor="->*", state=state, progress_code=code, progress_period=0.0, progress_time=0.5,
            progress_message="End" if code == 1 else "",
        )  # fmt: skip

    messages = [
        ("/wm/monitor", "WmMonitor", change(1, "add", 0.0)),
        ("/robot/monitor", "TreeProgress", progress(3, 0)),
        ("/wm/monitor", "WmMonitor", change(2, "update", 0.5)),
        ("/wm/monitor", "WmMonitor", change(3, "update", 1.0)),
        ("/robot/monitor", "TreeProgress", progress(1, 1)),
    ]
    path = tmp_path_factory.mktemp("recorded") / "run.bag"
    with Writer(path) as writer:
        topics: dict[str, Any] = {}
        for number, (topic, name, message) in enumerate(messages):
            if topic not in topics:
                topics[topic] = writer.add_connection(topic, f"skiros2_msgs/msg/{name}", typestore=store)
            raw = store.serialize_ros1(message, f"skiros2_msgs/msg/{name}")
            writer.write(topics[topic], 10**9 * (100 + number), raw)
    return path


@rule("wire", "Bags: the message definitions have the md5 sums of SkiROS2")
def test_the_recorded_definitions_have_todays_sums(bag: Path) -> None:
    with Reader(bag) as reader:
        recorded = {connection.msgtype.split("/")[-1]: connection.digest for connection in reader.connections}
    assert recorded == {"WmMonitor": WmMonitor._md5sum, "TreeProgress": TreeProgress._md5sum}


@rule(
    "wire",
    "Bags: tasks and changes of a bag that `rosbag record` made of SkiROS2 can be read",
    better="`rosrun skiros2_bags show`, `tasks`, `skills`, `changes`, `diff` and `plot` read them without a master",
)
def test_a_bag_of_skiros2_is_read(bag: Path) -> None:
    run = Run.open(bag)
    (task,) = run.tasks()
    assert (task.robot, task.state, task.latest.message(0)) == ("/robot", "succeeded", "End")
    assert task.latest.shape.skills_text() == "drive"
    assert [(c.change.author, c.change.action) for c in run.changes()] == [
        ("/robot", "add"),
        ("/robot", "update"),
        ("/robot", "update"),
    ]


@rule(
    "wire", "Bags: a bag without a whole scene shows what its changes tell", better="`world --partial` gives the scene"
)
def test_the_world_of_a_bag_without_a_reset_is_known_in_part(bag: Path) -> None:
    scene = Run.open(bag).world(partial=True)
    assert scene.element(PART).getProperty("skiros:PositionX").value == 1.0
