"""The whole system again (`trace`), and each skill manager alone (`skill_manager`)."""

from __future__ import annotations

import time

import rospy

from skiros2_bags.core.errors import BagError
from skiros2_bags.testing.action_servers import ActionServers
from skiros2_bags.testing.divergence import Divergence
from skiros2_bags.testing.kinds import Settings
from skiros2_bags.testing.lab import Lab
from skiros2_bags.testing.live_replay import Observer, Player, SceneFollower, fetched_scene
from skiros2_bags.testing.past_reasoners import PACKAGES
from skiros2_bags.testing.past_world import scene_before
from skiros2_bags.testing.recording import Acted, Changed, Recording
from skiros2_bags.testing.run_comparison import compare_runs, compare_scenes
from skiros2_bags.testing.system_nodes import start_skill_manager, start_task_manager, start_world_model
from skiros2_bags.testing.task_runs import TaskRun, task_runs
from skiros2_common.core.errors import TimedOut
from skiros2_msgs import srv as srvs

#: The actions of a task manager whose goals make robots move.
ACHIEVE = "/tm/achieve"

#: How long the last messages may take to come (s).
_LAG = 5.0


def replay_trace(recording: Recording, settings: Settings, lab: Lab) -> Divergence | None:
    """Runs the system again with the recorded scene and goals. None: it went as recorded."""
    runs = _runs(recording)
    goals = [e for e in recording.acted if e.part == "goal" and e.action == ACHIEVE]
    own = {goal.caller for goal in goals}
    by_hand = [run.goal for run in runs if run.goal is not None and run.goal.caller not in ("/tm", *own)]
    goals += by_hand or []
    if not goals:
        raise BagError(f"{recording.path}: no goals to send again; expected some on {ACHIEVE} or MANAGER/execute")
    return _replay(recording, runs, goals, settings, lab, with_task_manager=any(g.action == ACHIEVE for g in goals))


def replay_skill_managers(recording: Recording, settings: Settings, lab: Lab) -> Divergence | None:
    """Gives the recorded goals to the skill managers, with a world model as recorded. None: they did as recorded."""
    runs = _runs(recording)
    goals = [run.goal for run in runs if run.goal is not None]
    if not goals:
        raise BagError(f"{recording.path}: no goals of skill managers; expected some on MANAGER/execute")
    return _replay(recording, runs, goals, settings, lab, with_task_manager=False)


def _runs(recording: Recording) -> list[TaskRun]:
    runs = task_runs(recording)
    if not runs:
        raise BagError(f"{recording.path}: no progress of tasks; expected a topic /MANAGER/monitor")
    return runs


def _replay(
    recording: Recording,
    runs: list[TaskRun],
    goals: list[Acted],
    settings: Settings,
    lab: Lab,
    with_task_manager: bool,
) -> Divergence | None:
    managers = sorted({run.manager for run in runs})
    begin = min(run.begin for run in runs)
    begin = min(begin, *(goal.order for goal in goals))
    scene = scene_before(recording, begin)
    start_world_model(lab, scene, settings.workspace, list(PACKAGES))
    follower = SceneFollower()
    wm_node = {"/wm", "wm"}
    made_here = {*managers, *wm_node, "/tm", "recording"}
    inputs = [
        e
        for e in recording.changes
        if e.order > begin and e.change.author not in made_here and not _is_reasoner(e) and not _is_will(e)
    ]
    driven = {e.action for e in recording.acted} - {ACHIEVE, "/tm/task_plan"} - {f"{m}/execute" for m in managers}
    servers = None
    if settings.launch:
        lab.launch(*settings.launch)
    else:
        servers = ActionServers(recording, driven, settings.tolerance)
    for manager in managers:
        start_skill_manager(lab, recording, manager, scene)
    if with_task_manager:
        start_task_manager(lab, recording)
    observer = Observer(managers)
    player = Player(recording, goals, inputs, follower.apply, lab)
    player.connect()
    lab.wait_for(lambda: observer.is_connected, "the nodes' topics")
    try:
        player.play()
    except TimedOut as late:
        return Divergence("in between", "a goal that has ended in the recording", "its end", str(late))
    _wait_for_ends(lab, observer, len(runs))
    if servers is not None:
        servers.close()
    divergence = compare_runs(recording, observer.events, settings.tolerance, managers)
    if divergence is None and servers is not None and servers.wrong:
        divergence = Divergence("in between", *servers.wrong[0])
    if divergence is None:
        last = max(run.end for run in runs)
        divergence = compare_scenes(scene_before(recording, last + 1), fetched_scene("/wm"), settings.tolerance)
    player.close()
    return divergence


def _wait_for_ends(lab: Lab, observer: Observer, number: int) -> None:
    """Waits until all tasks were told to have ended; fewer may have come."""
    end = time.monotonic() + _LAG

    def told() -> bool:
        found = task_runs(observer.events)
        return (len(found) >= number and all(run.ended for run in found)) or time.monotonic() > end

    lab.wait_for(told, "the last progress", 2 * _LAG)
    last = rospy.ServiceProxy("/wm/snapshot", srvs.WmSnapshot)("").snapshot_id
    lab.wait_for(lambda: observer.has_heard(last), "the last change of the world model")


def _is_reasoner(event: Changed) -> bool:
    return not event.change.author.startswith("/") and event.change.author.endswith("Reasoner")


def _is_will(event: Changed) -> bool:
    return event.change.author.startswith("last will of")
