"""World-model calls through the ROS services, beside a bare rospy service with messages of the same size.

Each call is timed with a new connection, as `rospy.ServiceProxy` makes by default, on both sides.
"""

from __future__ import annotations

import itertools
import sys
from collections.abc import Callable, Iterator
from io import BytesIO
from pathlib import Path
from typing import Any

from benchmarks.measurement import Measurement, paired, seconds_per_call
from skiros2_common.core.world_element import Element
from skiros2_common.ros.utils import element2msg, msg2element
from skiros2_msgs import srv as srvs
from support.ros import Ros

RUNS = 9
CALLS = 50
ELEMENTS = 1000

BARE_SERVICE = '''#!/usr/bin/env python3
"""Answers each request with a text of the length that it names before the first space."""
import rospy
from skiros2_msgs.srv import WoQuery, WoQueryResponse

rospy.init_node("bare")
rospy.Service("~echo", WoQuery, lambda r: WoQueryResponse(["x" * int(r.query_string.split(" ", 1)[0])]))
rospy.spin()
'''


def measure(ros: Ros, folder: Path) -> Iterator[Measurement]:
    ros.launch("skiros2", "world_model_server.launch", gui=False)
    get = ros.service("/wm/get", srvs.WmGet)
    modify = ros.service("/wm/modify", srvs.WmModify)
    eid = _fill(modify)
    bare = _bare_service(ros, folder)

    element = get(action="get", element=element2msg(Element(eid=eid))).elements[0]
    weights = itertools.count()

    def update() -> Any:
        changed = msg2element(element)
        changed.setProperty("skiros:Weight", float(next(weights)))
        return modify(author="bench", action="update_properties", context="scene", elements=[element2msg(changed)])

    calls: list[tuple[str, Callable[[], Any], Any]] = [
        (
            "get",
            lambda: get(action="get", context="scene", element=element2msg(Element(eid=eid))),
            srvs.WmGetRequest(action="get", context="scene", element=element2msg(Element(eid=eid))),
        ),
        (
            "resolve",
            lambda: get(action="resolve", context="scene", element=element2msg(Element("skiros:Starter"))),
            srvs.WmGetRequest(action="resolve", context="scene", element=element2msg(Element("skiros:Starter"))),
        ),
        (
            "update",
            update,
            srvs.WmModifyRequest(author="bench", action="update_properties", context="scene", elements=[element]),
        ),
    ]
    for name, call, request in calls:
        answer = call()
        echo = _echo(bare, _size(request), _size(answer))
        yield paired(
            f"world model {name} by service, {ELEMENTS} elements",
            lambda call=call: 1e3 * seconds_per_call(call, CALLS),  # type: ignore[misc]
            "a bare rospy service, same sizes",
            lambda echo=echo: 1e3 * seconds_per_call(echo, CALLS),  # type: ignore[misc]
            unit="ms",
            runs=RUNS,
        )


def _fill(modify: Any) -> str:
    """Adds the elements, ten of them of a class of their own. Returns the id of one with ten properties."""
    elements = []
    for number in range(ELEMENTS):
        element = Element("skiros:Starter" if number < 10 else "skiros:Product", f"product {number}")
        for key in ("PositionX", "PositionY", "PositionZ", "SizeX", "SizeY", "SizeZ", "Weight"):
            element.setProperty(f"skiros:{key}", float(number))
        elements.append(element2msg(element))
    answer = modify(author="bench", action="add", context="scene", elements=elements)
    return str(answer.elements[-1].id)


def _bare_service(ros: Ros, folder: Path) -> Any:
    script = folder / "bare"
    script.write_text(BARE_SERVICE)
    ros.program(sys.executable, str(script))
    return ros.service("/bare/echo", srvs.WoQuery)


def _echo(bare: Any, request_size: int, answer_size: int) -> Callable[[], Any]:
    text = f"{answer_size} ".ljust(request_size, "x")
    return lambda: bare(query_string=text)


def _size(message: Any) -> int:
    buffer = BytesIO()
    message.serialize(buffer)
    return len(buffer.getvalue())
