"""Replay of the world model alone: sends the recorded changes as requests and compares the resulting changes."""

from __future__ import annotations

import rospy

from skiros2_bags.core.errors import BagError
from skiros2_bags.core.tolerance import Tolerance, diff_changes, diff_elements, summary
from skiros2_bags.testing.divergence import Divergence
from skiros2_bags.testing.recorded_world import change_operations, group_requests, scene_before
from skiros2_bags.testing.recording import Recording, WorldChange
from skiros2_bags.testing.replay_settings import Settings
from skiros2_bags.testing.replay_system import ReplaySystem, start_world_model
from skiros2_msgs import srv as srvs
from skiros2_world_model.core.apply_change import apply_change
from skiros2_world_model.core.changes import RESET, Change
from skiros2_world_model.core.scene import Scene
from skiros2_world_model.ros.wire import msg2change, msg2shared_element, operation2msg

NODE = "/wm"


def replay_world_model(recording: Recording, settings: Settings, system: ReplaySystem) -> Divergence | None:
    """Plays all recorded changes into a world model. Returns the first divergence; None without one.

    The world model runs without reasoners: the recorded changes contain their additions.
    """
    first = next((e for e in recording.changes if e.change.action == RESET), None)
    if first is None:
        raise BagError(f"{recording.path}: no whole scene on wm/monitor; expected it at the start")
    scene = scene_before(recording, first.order + 1)
    start_world_model(system, scene, settings.workspace, [])
    transact = rospy.ServiceProxy(f"{NODE}/transaction", srvs.WmTransaction, persistent=True)
    tolerance = settings.tolerance
    begin = recording.events[0].time
    for request in group_requests([e for e in recording.changes if e.order > first.order]):
        found = _play_request(request, scene, transact, tolerance)
        if found is not None:
            where = f"{request[0].time - begin:.3f} s, a request of {request[0].change.author}"
            return Divergence(where, "the world model", *found)
    return _diff_final_scene(scene, tolerance)


def _play_request(
    request: list[WorldChange], scene: Scene, transact: object, tolerance: Tolerance
) -> tuple[str, str] | None:
    """Sends one request. Returns a mismatch (recorded, now); None without one.

    :param scene: the recorded scene before the request; updated.
    """
    expected = [e.change for e in request if e.change.elements or e.change.relations]
    operations = []
    for change in expected:
        operations += change_operations(change, scene)
        apply_change(scene, change)
    if not operations:
        return None
    try:
        answer = transact(request[0].change.author, "", [operation2msg(o) for o in operations])  # type: ignore[operator]
    except rospy.ServiceException as error:
        return _summaries(expected), f"refused: {error}"
    got = [msg2change(m, "scene") for m in answer.changes]
    differences = [
        line for one, other in zip(expected, got, strict=False) for line in diff_changes(one, other, tolerance)
    ]
    if len(got) == len(expected) and not differences:
        return None
    return _summaries(expected), "\n".join([_summaries(got), *differences])


def _diff_final_scene(scene: Scene, tolerance: Tolerance) -> Divergence | None:
    """Compares the final scene with the recorded one."""
    answer = rospy.ServiceProxy(f"{NODE}/snapshot", srvs.WmSnapshot)("")
    remaining = {m.id: msg2shared_element(m, 0) for m in answer.elements}
    for node in scene:
        expected = scene.element(node.id)
        assert expected is not None
        got = remaining.pop(node.id, None)
        if got is None:
            return Divergence("at the end", node.id, "an element of the scene", "no such element")
        outgoing = [r for r in expected._rels if r["src"] == "-1"]
        expected = type(expected).shared(node.type, node.label, node.id, node.properties, outgoing)
        differences = diff_elements(expected, got, tolerance)
        if differences:
            return Divergence("at the end", node.id, "as recorded", "\n".join(differences))
    extra = ", ".join(remaining)
    return Divergence("at the end", "the scene", "no further element", extra) if extra else None


def _summaries(changes: list[Change]) -> str:
    return "; ".join(map(summary, changes)) or "no change"
