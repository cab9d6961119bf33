"""Messages of a small recorded run: Product A goes from Tray A to Tray B. Made without ROS, from the definitions."""

from __future__ import annotations

import functools
import itertools
import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from rosbags.rosbag1 import Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

ROOT = Path(__file__).parents[2]

PRODUCT, TRAY_A, TRAY_B = "skiros:Product-14", "demo:Tray-10", "demo:Tray-12"
GOAL = f"(skiros:contain {TRAY_B} {PRODUCT})"
PLAN = json.dumps([
    {"number": 1, "skill": "skiros:Pick", "label": "pick", "robot": "/robot",
     "arguments": {"Robot": "cora:Robot-1", "Object": PRODUCT}},
    {"number": 2, "skill": "skiros:Place", "label": "place", "robot": "/robot", "arguments": {"Container": TRAY_B}},
])  # fmt: skip


def done(*states: str) -> str:
    """The steps of `PLAN` as in a result."""
    return json.dumps([{**step, "state": state} for step, state in zip(json.loads(PLAN), states, strict=True)])


LABELS = ("pick", "place")
SUCCESS, FAILURE, RUNNING, IDLE = 1, 2, 3, 4


def element(eid: str, label: str, relations: list[tuple[str, str, str]] = (), **properties: list[Any]) -> Any:
    """A `WmElement`; property names are in the default prefix."""
    return SimpleNamespace(
        id=eid,
        type=eid.partition("-")[0],
        label=label,
        properties=[
            SimpleNamespace(key=f"skiros:{key}", dataValue=json.dumps(values), dataType=type(values[0]).__name__)
            for key, values in properties.items()
        ],
        relations=[relation(*triple) for triple in relations],
    )


def relation(subject: str, predicate: str, target: str) -> Any:
    return SimpleNamespace(subjectId=subject, predicate=predicate, objectId=target)


class Monitor:
    """Makes `WmMonitor` messages that follow one another."""

    def __init__(self) -> None:
        self._numbers = itertools.count(1)
        self._last = ""

    def __call__(self, action: str, *elements: Any, relation: list[Any] = ()) -> Any:
        previous, self._last = self._last, f"s{next(self._numbers)}"
        return SimpleNamespace(
            prev_snapshot_id=previous,
            snapshot_id=self._last,
            author="test",
            action=action,
            elements=list(elements),
            relation=list(relation),
        )


def scene() -> list[Any]:
    """Two trays, Product A in Tray A."""
    return [
        element(TRAY_A, "Tray A", [("-1", "skiros:contain", PRODUCT)], ContainerState=["Full"]),
        element(TRAY_B, "Tray B", ContainerState=["Empty"]),
        element(PRODUCT, "Product A", [(TRAY_A, "skiros:contain", "-1")], PositionX=[0.0]),
    ]


def moved() -> list[Any]:
    """The differences after Product A is in Tray B."""
    return [element(PRODUCT, "Product A", [(TRAY_B, "skiros:contain", "-1")], PositionX=[0.5])]


def tree(label: str, state: int = SUCCESS, *, ended: bool = True, task: int | None = None) -> Any:
    """The nodes of a `TreeProgress` message of a step of the plan, each a task of its own: a root and its skill."""
    task = 7 + LABELS.index(label) if task is None else task
    code = {SUCCESS: 1, FAILURE: -1}.get(state, 0) if ended else 0
    root = node(task, task, -1, ":Root", "root", state, code, "Success" if state == SUCCESS else "Failure")
    return [root, node(task, 1, task, f"skiros:{label.title()}", label, state, 1, f"{label} says so")]


def node(task: int, nid: int, parent: int, ntype: str, label: str, state: int, code: int, message: str) -> Any:
    """A `SkillProgress`."""
    return SimpleNamespace(
        robot="/robot", task_id=task, id=nid, parent_label="", parent_id=parent, type=ntype, label=label, params=[],
        processor="->*" if parent < 0 else "", state=state, progress_code=code, progress_period=0.0,
        progress_time=0.0, progress_message=message, SUCCESS=SUCCESS,
    )  # fmt: skip


def good_run() -> list[tuple[str, Any]]:
    """(kind, content) of the messages of a run in which all goes well, oldest first."""
    monitor = Monitor()
    return [
        ("change", monitor("reset", *scene())),
        ("goal", ("goal-1", GOAL)),
        ("feedback", ("goal-1", PLAN)),
        ("progress", tree("pick", RUNNING, ended=False)),
        ("progress", tree("pick")),
        ("progress", tree("place", RUNNING, ended=False)),
        ("change", monitor("update", *moved())),
        ("progress", tree("place")),
        ("result", ("goal-1", "succeeded", done("succeeded", "succeeded"))),
    ]


# -- bags -------------------------------------------------------------------------------------------------------------

_TOPICS = {
    "change": ("/wm/monitor", "WmMonitor"),
    "progress": ("/robot/monitor", "TreeProgress"),
    "goal": ("/tm/achieve/goal", "AchieveActionGoal"),
    "feedback": ("/tm/achieve/feedback", "AchieveActionFeedback"),
    "result": ("/tm/achieve/result", "AchieveActionResult"),
}


def write_bag(path: Path, messages: list[tuple[str, Any]], without: tuple[str, ...] = ()) -> Path:
    """Writes messages as `good_run` gives them to a bag, with topics for all kinds but those in `without`."""
    store = _typestore()
    with Writer(path) as bag:
        topics = {
            kind: bag.add_connection(topic, f"skiros2_msgs/msg/{name}", typestore=store)
            for kind, (topic, name) in _TOPICS.items()
            if kind not in without
        }
        for number, (kind, content) in enumerate(messages):
            message = _message(store, kind, content)
            bag.write(topics[kind], number, store.serialize_ros1(message, message.__msgtype__))
    return path


@functools.cache
def _typestore() -> Any:
    store = get_typestore(Stores.ROS1_NOETIC)
    types = {}
    for file in sorted((ROOT / "skiros2_msgs" / "msg").glob("*.msg")):
        types.update(get_types_from_msg(file.read_text(), f"skiros2_msgs/msg/{file.stem}"))
    goal, result, feedback = (ROOT / "skiros2_msgs/action/Achieve.action").read_text().split("---")
    for name, text in (("Goal", goal), ("Result", result), ("Feedback", feedback)):
        types.update(get_types_from_msg(text, f"skiros2_msgs/msg/Achieve{name}"))
        header = "Header header\n" + (
            "actionlib_msgs/GoalID goal_id" if name == "Goal" else "actionlib_msgs/GoalStatus status"
        )
        text = f"{header}\nAchieve{name} {name.lower()}\n"
        types.update(get_types_from_msg(text, f"skiros2_msgs/msg/AchieveAction{name}"))
    store.register({name: fields for name, fields in types.items() if name not in store.fielddefs})
    return store


def _message(store: Any, kind: str, content: Any) -> Any:
    types = store.types
    stamp = types["builtin_interfaces/msg/Time"](0, 0)
    header = types["std_msgs/msg/Header"](seq=0, stamp=stamp, frame_id="")

    def own(name: str, value: Any, **more: Any) -> Any:
        cls = types[f"skiros2_msgs/msg/{name}"]
        names = cls.__dataclass_fields__
        given = {key: item for key, item in {**vars(value), **more}.items() if key in names and not key.isupper()}
        return cls(**given)

    if kind == "change":
        elements = [
            own("WmElement", e, properties=[own("Property", p) for p in e.properties],
                relations=[own("Relation", r) for r in e.relations])
            for e in content.elements
        ]  # fmt: skip
        relations = [own("Relation", r) for r in content.relation]
        return own("WmMonitor", content, stamp=stamp, elements=elements, relation=relations)
    if kind == "progress":
        nodes = [own("SkillProgress", n) for n in content]
        return types["skiros2_msgs/msg/TreeProgress"](progress=nodes)
    goal_id = types["actionlib_msgs/msg/GoalID"](stamp=stamp, id=content[0])
    if kind == "goal":
        how = {"wish": "", "seconds": 0.0, "priority": 0, "max_replans": 5}
        goal = types["skiros2_msgs/msg/AchieveGoal"](author="test", goals=content[1], **how)
        return types["skiros2_msgs/msg/AchieveActionGoal"](header=header, goal_id=goal_id, goal=goal)
    status = types["actionlib_msgs/msg/GoalStatus"](goal_id=goal_id, status=1 if kind == "feedback" else 3, text="")
    if kind == "feedback":
        texts = {"phase": "running", "message": "", "steps": "", "robots": ""}
        feedback = types["skiros2_msgs/msg/AchieveFeedback"](plan=content[1], **texts)
        return types["skiros2_msgs/msg/AchieveActionFeedback"](header=header, status=status, feedback=feedback)
    result = types["skiros2_msgs/msg/AchieveResult"](content[1], message="says so", done=content[2], explanations="[]")
    return types["skiros2_msgs/msg/AchieveActionResult"](header=header, status=status, result=result)
