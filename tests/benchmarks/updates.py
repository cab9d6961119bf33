"""Updates of one property through `WorldModelInterface`, journal on: beside a bare rospy service, from four programs.

The peer's messages have the size of ours: a patch, and the change that it led to.
"""

from __future__ import annotations

import itertools
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import rospy

from benchmarks.measurement import Measurement, paired, seconds_per_call
from benchmarks.services import _bare_service, _echo, _size
from skiros2_common.core.element_content import ElementChanges
from skiros2_common.core.operations import Patch
from skiros2_common.core.property import Property
from skiros2_common.core.world_element import Element
from skiros2_msgs import srv as srvs
from skiros2_world_model.ros.wire import operation2msg
from skiros2_world_model.ros.world_model_interface import WorldModelInterface
from support.ros import Ros

RUNS = 9
CALLS = 100
CLIENTS = 4
SECONDS = 2.0


def measure(ros: Ros, folder: Path) -> Iterator[Measurement]:
    ros.launch("skiros2", "world_model_server.launch", gui=False)
    wmi = WorldModelInterface("bench")
    bare = _bare_service(ros, folder)
    kept = rospy.ServiceProxy("/bare/echo", srvs.WoQuery, persistent=True)
    numbers = itertools.count()
    elements: list[Element] = []
    for size in (100, 1000, 5000):
        new = [_element(number) for number in range(len(elements), size)]
        wmi.add_elements(new)
        elements += new
        element = wmi.get_element(elements[size // 2].id)

        def update(element: Element = element) -> None:
            element.setProperty("skiros:Weight", float(next(numbers)))
            wmi.update_element(element)

        sizes = _messages(element)
        for what, peer, target in (
            ("a bare rospy service, same sizes, new connections", _echo(bare, *sizes), 0.5),
            ("the limit: the same, the connection kept", _echo(kept, *sizes), None),
        ):
            yield paired(
                f"update of a property, {size} elements, journal on",
                lambda call=update: 1e3 * seconds_per_call(call, CALLS),  # type: ignore[misc]
                what,
                lambda call=peer: 1e3 * seconds_per_call(call, CALLS),  # type: ignore[misc]
                unit="ms",
                runs=RUNS,
                target=target,
            )
    for is_synced, target in ((False, 1.0), (True, 0.7)):
        ros.master.set_parameter("/wm/journal_sync", is_synced)  # the node follows while the programs start
        yield paired(
            f"time for an update, {CLIENTS} programs at once{', journal synced' if is_synced else ''}",
            lambda: _time_for_one(ros, folder, CLIENTS),
            "one program alone",
            lambda: _time_for_one(ros, folder, 1),
            unit="ms",
            runs=3,
            warm_up=0,
            target=target,
        )


def _element(number: int) -> Element:
    element = Element("skiros:Product", f"updated {number}")
    for key in ("PositionX", "PositionY", "PositionZ", "SizeX", "SizeY", "SizeZ", "Weight"):
        element.setProperty(f"skiros:{key}", float(number))
    element.addRelation("skiros:Scene-0", "skiros:contain", "-1")
    return element


def _messages(element: Element) -> tuple[int, int]:
    """The sizes of an update's request and answer."""
    patch = Patch(element.id, ElementChanges({"skiros:Weight": Property("skiros:Weight", 0.25)}))
    request = srvs.WmTransactionRequest("bench", "scene", [operation2msg(patch)])
    answer = rospy.ServiceProxy("/wm/transaction", srvs.WmTransaction)(request)
    return _size(request), _size(answer)


PROGRAM = '''"""Updates an element of its own for some seconds; prints how often. The last update has to be there."""
import sys, time
import rospy
from skiros2_common.core.world_element import Element
from skiros2_world_model.ros.world_model_interface import WorldModelInterface

rospy.init_node("updater", anonymous=True, disable_signals=True)
wmi = WorldModelInterface(rospy.get_name())
mine = Element("skiros:Product", "mine")
wmi.add_element(mine)
print("ready", flush=True)
sys.stdin.readline()
end = time.monotonic() + float(sys.argv[1])
count = 0
while time.monotonic() < end:
    count += 1
    mine.setProperty("skiros:Weight", float(count))
    wmi.update_element(mine)
assert wmi.get_element(mine.id).value_of("skiros:Weight") == count
print(count, flush=True)
rospy.signal_shutdown("done")
'''


def _time_for_one(ros: Ros, folder: Path, clients: int) -> float:
    """Milliseconds for each update when so many programs write at once."""
    script = folder / "updater.py"
    script.write_text(PROGRAM)
    programs = [
        subprocess.Popen(
            [sys.executable, str(script), str(SECONDS)],
            env=ros.master.env, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        )
        for _ in range(clients)
    ]  # fmt: skip
    for program in programs:
        assert program.stdout is not None and program.stdout.readline() == "ready\n"
    start = time.perf_counter()
    for program in programs:
        assert program.stdin is not None
        program.stdin.write("\n")
        program.stdin.flush()
    counts = [int(program.communicate()[0]) for program in programs]
    assert time.perf_counter() - start >= SECONDS
    return 1e3 * SECONDS / sum(counts)
