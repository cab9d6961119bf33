"""Hostile requests to a skill manager and a task manager: each is refused with an error, nothing changes, no node ends.

Those to the world model are in `test_world_model_fuzz.py`, wrong but harmless commands in `test_bad_commands.py`.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from typing import Any

import actionlib
import pytest
import rospy
from actionlib_msgs.msg import GoalStatus

from skiros2_msgs import msg as msgs
from skiros2_msgs import srv as srvs
from support.ros import Ros, RosMaster, wait_until
from system.test_achieve import Cell

pytestmark = [pytest.mark.long, pytest.mark.timeout(400)]

ROBOT = "/porter"
LONG = "x" * 1_000_000
DEEP = "[" * 100_000
#: The most characters of an error, with a code for each of a name that is no text.
MAX_TEXT = 250_000


class NotText(str):
    """A text that is sent as bytes that are no UTF-8."""

    def encode(self, *_: Any) -> bytes:
        return b"\xff\xfe\xed\xa0\x80"


#: Texts that no field expects.
TEXTS = {
    "nothing": "", "control characters": "a\x00b\x1b[2J\n", "reversed": "\u202ea\u2066", "long": LONG, "deep": DEEP,
    "not a number": "NaN", "path": "../../etc/passwd", "no UTF-8": NotText("x"), "pattern": "(" * 10_000,
}  # fmt: skip

#: Parameters as JSON texts.
PARAMS = {
    **TEXTS,
    "deep objects": '{"a":' * 100_000,
    "deep values": json.dumps({"key": "Object", "values": [0]}).replace("0", "[" * 400 + "]" * 400),
    "NaN": '{"key": "Object", "values": [NaN]}',
    "infinity": '{"key": "Object", "values": [1e999]}',
    "5000 digits": f'{{"key": "Object", "values": [{"9" * 5000}]}}',
    "key of another type": '{"key": 7, "values": [1]}',
    "key with control characters": '{"key": "Object\\u0000\\u001b[2J", "values": [1]}',
    "values of another type": '{"key": "Object", "values": {"a": 1}}',
    "kind of another type": '{"key": "Object", "specType": [], "type": "str", "values": [1]}',
    "type of another type": '{"key": "Object", "specType": 0, "type": {}, "values": [1]}',
    "many values": json.dumps({"key": "Object", "values": [1] * 200_000}),
    "id with control characters": json.dumps({"key": "Object", "values": ["skiros:Product-1\x00\x1b"]}),
    "half a surrogate pair": '{"key": "Object", "values": ["\\ud800"]}',
    "element with a type of another type": json.dumps(
        {"key": "Object", "specType": 0, "type": "skiros_wm::Element", "values": [{"type": 7, "id": [], "label": {}}]}
    ),
    "object of many keys": json.dumps({f"k{i}": i for i in range(100_000)}),
}


def skills(*params: str, kind: str = "skiros:Carry", label: str = "carry") -> list[Any]:
    return [msgs.ResourceDescription(kind, label, [msgs.Param(param) for param in params])]


def manager_requests() -> Iterator[tuple[str, str, Any]]:
    """Yields the flaw, the service and the request."""
    for flaw, text in PARAMS.items():
        yield f"parameter: {flaw}", "command", srvs.SkillCommandRequest("tests", "start", -1, skills(text))
        yield f"parameter: {flaw}", "preview", srvs.SkillPreviewRequest(skills(text), False)
    for flaw, text in TEXTS.items():
        yield f"action: {flaw}", "command", srvs.SkillCommandRequest("tests", text, -1, skills())
        yield f"author: {flaw}", "command", srvs.SkillCommandRequest(text, "preempt", 4711, [])
        if text:
            yield f"skill: {flaw}", "command", srvs.SkillCommandRequest("tests", "start", -1, skills(kind=text))
            yield f"label: {flaw}", "preview", srvs.SkillPreviewRequest(skills(label=text), False)
            yield f"library: {flaw}", "reload", srvs.SkillReloadRequest([text])
        yield f"action: {flaw}", "stop", srvs.SkillStopRequest("tests", text or "x", -1, 1e9)
        yield f"action: {flaw}", "breakpoint", srvs.SkillBreakpointRequest(action=text)
        yield f"kind: {flaw}", "breakpoint", srvs.SkillBreakpointRequest("add", text, "x", "", 0)
        yield f"moment: {flaw}", "breakpoint", srvs.SkillBreakpointRequest("add", "node", "carry", text or "x", 0)
    many = [msgs.Param(json.dumps({"key": f"K{i}", "values": [1]})) for i in range(20_000)]
    for flaw, request in {
        "many parameters": [msgs.ResourceDescription("skiros:Carry", "carry", many)],
        "many unknown skills": skills(kind="skiros:Nothing") * 5_000,
    }.items():
        yield flaw, "command", srvs.SkillCommandRequest("tests", "start", -1, request)
        yield flaw, "preview", srvs.SkillPreviewRequest(request, False)
    for number in (-32768, -7, 32767):
        yield f"task {number}", "command", srvs.SkillCommandRequest("tests", "preempt", number, [])
        yield f"task {number}", "inspect", srvs.SkillInspectionRequest(number, number)
        yield f"task {number}", "why", srvs.SkillWhyRequest(abs(number) % 32768 or 4711)
        yield f"task {number}", "stop", srvs.SkillStopRequest("tests", "preempt", number, 1e9)
        yield f"breakpoint {number}", "breakpoint", srvs.SkillBreakpointRequest(action="remove", number=number)
    for deadline in (math.nan, -math.inf, -1.0):
        yield f"deadline {deadline}", "stop", srvs.SkillStopRequest("tests", "preempt", -1, deadline)


SERVICES = {
    "command": srvs.SkillCommand, "preview": srvs.SkillPreview, "breakpoint": srvs.SkillBreakpoint,
    "inspect": srvs.SkillInspection, "why": srvs.SkillWhy, "stop": srvs.SkillStop, "reload": srvs.SkillReload,
}  # fmt: skip

GOALS = {
    **TEXTS,
    "deep": "(and " * 50_000,
    "deep and closed": "(not " * 20_000 + "(skiros:at a b)" + ")" * 20_000,
    "long name": f"(skiros:contain {LONG} b)",
    "many parts": "(and " + "(skiros:contain a b) " * 50_000 + ")",
    "ids with control characters": "(skiros:contain skiros:Location-1\x00 skiros:Product-1\x1b)",
    "reversed": "(skiros:contain \u202eskiros:Location-1 skiros:Product-1)",
    "JSON": '{"goal": NaN}',
    "quantifiers": "(forall (?a - skiros:Product) " * 500 + "(skiros:at ?a ?a)" + ")" * 500,
    "number that is none": "(> (skiros:Weight skiros:Product-1) 1e99999)",
}


@pytest.fixture(scope="module")
def cell(ros_master: RosMaster) -> Iterator[Cell]:
    ros = Ros(ros_master)
    try:
        yield Cell(ros, {"porter": ["carry"]})
    finally:
        ros.stop()


def state(cell: Cell) -> tuple[Any, ...]:
    """The scene, the tasks and the breakpoints."""
    elements = sorted(cell.wm.get_scene_elements(), key=lambda element: element.id)
    tasks = cell.ros.service(f"{ROBOT}/tasks", srvs.SkillTasks)(-1).tasks
    found = cell.ros.service(f"{ROBOT}/breakpoint", srvs.SkillBreakpoint)(action="list")
    return [element.printState(True) for element in elements], tasks, found.json


def test_hostile_requests_to_a_skill_manager_are_refused_without_effect(cell: Cell) -> None:
    proxies = {name: cell.ros.service(f"{ROBOT}/{name}", kind) for name, kind in SERVICES.items()}
    before, wrong = state(cell), []
    for flaw, service, request in manager_requests():
        try:
            answer = proxies[service](request)
            text = "accepted" if answer.ok else str(getattr(answer, "text", "") or getattr(answer, "explanation", ""))
        except rospy.ServiceException as error:
            text = str(error)
            if "responded with an error" not in text or "error processing request" in text:
                text = f"crash: {text}"
        if text.startswith(("accepted", "crash")) or not text.strip() or len(text) > MAX_TEXT:
            wrong.append(f"{service}, {flaw}: {len(text)} characters: {text[:300]}")
    assert not wrong, "\n".join(wrong)
    assert state(cell) == before


def goals() -> Iterator[tuple[str, dict[str, Any]]]:
    for flaw, text in GOALS.items():
        yield f"goal: {flaw}", {"goals": text}
    good = "(forall (?p - skiros:Product) (skiros:at ?p ?p))"
    for seconds in (math.nan, math.inf, -1.0):
        yield f"seconds {seconds}", {"goals": good, "seconds": seconds}
    plans = {
        "steps of another type": "[7]", "an object": '{"a": 1}', "NaN": "[NaN]", "deep": DEEP, "long": LONG,
        "fields of other types": json.dumps([{"number": {}, "skill": [], "robot": 7, "arguments": "x", "after": 1}]),
    }  # fmt: skip
    for flaw, plan in plans.items():
        yield f"plan: {flaw}", {"goals": good, "plan": plan}


@pytest.mark.parametrize("action", ["achieve", "plan", "task_plan"])
def test_hostile_goals_end_with_an_error_and_without_effect(cell: Cell, action: str) -> None:
    kind = {"achieve": "Achieve", "plan": "MakePlan", "task_plan": "AssignTask"}[action]
    client = actionlib.ActionClient(f"tm/{action}", getattr(msgs, f"{kind}Action"))
    assert client.wait_for_server(rospy.Duration(60.0))
    before, wrong = state(cell), []
    for flaw, values in goals():
        fields = dict(values)
        if (plan := fields.pop("plan", None)) is not None:
            fields["wish" if action == "achieve" else "quality"] = plan
        message = getattr(msgs, f"{kind}Goal")(author="tests")
        if not fields.keys() <= set(message.__slots__):
            continue
        for key, value in fields.items():
            setattr(message, key, value)
        handle = client.send_goal(message)
        wait_until(lambda handle=handle: handle.get_result() is not None, 60.0, f"the result of {flaw}")
        result = handle.get_result()
        text = str(getattr(result, "message", "") or getattr(result, "progress_message", ""))
        if handle.get_goal_status() == GoalStatus.SUCCEEDED or not text or len(text) > MAX_TEXT:
            wrong.append(f"{flaw}: {handle.get_goal_status_text()} {len(text)} characters: {text[:300]}")
    assert not wrong, "\n".join(wrong)
    assert state(cell) == before


def test_hostile_answers_about_restarts_are_refused(cell: Cell) -> None:
    service = cell.ros.service("tm/on_restart", srvs.GoalOnRestart)
    for flaw, text in TEXTS.items():
        if text:
            answer = service("a", text)
            assert not answer.ok and 0 < len(answer.text) < MAX_TEXT, flaw


def test_cell_reaches_a_goal_afterwards(cell: Cell) -> None:
    """The last of the module."""
    goal = f"(skiros:contain {cell.store} {cell.products[0]})"
    assert cell.achieve(goal).result.state == "succeeded"
    assert cell.place_of(cell.products[0]) == cell.store
