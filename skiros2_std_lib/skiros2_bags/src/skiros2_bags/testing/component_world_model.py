"""The world model alone: what changed it in a recording comes as requests, and has to change it in the same way."""

from __future__ import annotations

import rospy

from skiros2_bags.core.errors import BagError
from skiros2_bags.core.normal import Tolerance, change_differences, element_differences, summary
from skiros2_bags.testing.divergence import Divergence
from skiros2_bags.testing.kinds import Settings
from skiros2_bags.testing.lab import Lab
from skiros2_bags.testing.past_world import operations_of, requests_of, scene_before
from skiros2_bags.testing.recording import Changed, Recording
from skiros2_bags.testing.system_nodes import start_world_model
from skiros2_msgs import srv as srvs
from skiros2_world_model.core.apply_change import apply_change
from skiros2_world_model.core.changes import RESET, Change
from skiros2_world_model.core.scene import Scene
from skiros2_world_model.ros.wire import msg2change, msg2shared_element, operation2msg

NODE = "/wm"


def replay_world_model(recording: Recording, settings: Settings, lab: Lab) -> Divergence | None:
    """Plays all changes of a recording into a world model. None: all came of them as recorded.

    It runs without reasoners: what these have completed is in the recorded changes, and so in the requests.
    """
    first = next((e for e in recording.changes if e.change.action == RESET), None)
    if first is None:
        raise BagError(f"{recording.path}: no whole scene on wm/monitor; expected it at the start")
    scene = scene_before(recording, first.order + 1)
    start_world_model(lab, scene, settings.workspace, [])
    transact = rospy.ServiceProxy(f"{NODE}/transaction", srvs.WmTransaction, persistent=True)
    tolerance = settings.tolerance
    begin = recording.events[0].time
    for request in requests_of([e for e in recording.changes if e.order > first.order]):
        found = _play(request, scene, transact, tolerance)
        if found is not None:
            where = f"{request[0].time - begin:.3f} s, a request of {request[0].change.author}"
            return Divergence(where, "the world model", *found)
    return _final(scene, tolerance)


def _play(request: list[Changed], scene: Scene, transact: object, tolerance: Tolerance) -> tuple[str, str] | None:
    """Sends one request. Returns what came of it otherwise: as recorded, and now.

    :param scene: as it is before; it follows the recording.
    """
    expected = [e.change for e in request if e.change.elements or e.change.relations]
    operations = []
    for change in expected:
        operations += operations_of(change, scene)
        apply_change(scene, change)
    if not operations:
        return None
    try:
        answer = transact(request[0].change.author, "", [operation2msg(o) for o in operations])  # type: ignore[operator]
    except rospy.ServiceException as error:
        return _summaries(expected), f"refused: {error}"
    got = [msg2change(m, "scene") for m in answer.changes]
    differences = [
        line for one, other in zip(expected, got, strict=False) for line in change_differences(one, other, tolerance)
    ]
    if len(got) == len(expected) and not differences:
        return None
    return _summaries(expected), "\n".join([_summaries(got), *differences])


def _final(scene: Scene, tolerance: Tolerance) -> Divergence | None:
    """What is otherwise in the scene at the end."""
    answer = rospy.ServiceProxy(f"{NODE}/snapshot", srvs.WmSnapshot)("")
    there = {m.id: msg2shared_element(m, 0) for m in answer.elements}
    for node in scene:
        expected = scene.element(node.id)
        assert expected is not None
        got = there.pop(node.id, None)
        if got is None:
            return Divergence("at the end", node.id, "an element of the scene", "no such element")
        outgoing = [r for r in expected._rels if r["src"] == "-1"]
        expected = type(expected).shared(node.type, node.label, node.id, node.properties, outgoing)
        differences = element_differences(expected, got, tolerance)
        if differences:
            return Divergence("at the end", node.id, "as recorded", "\n".join(differences))
    left = ", ".join(there)
    return Divergence("at the end", "the scene", "no further element", left) if left else None


def _summaries(changes: list[Change]) -> str:
    return "; ".join(map(summary, changes)) or "no change"
