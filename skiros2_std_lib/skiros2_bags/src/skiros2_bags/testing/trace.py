"""Replay of the whole system (`trace`)."""

from __future__ import annotations

import time

import rospy

from skiros2_bags.core.errors import BagError
from skiros2_bags.testing.action_servers import ActionServers
from skiros2_bags.testing.compare_recordings import compare_runs, compare_scenes
from skiros2_bags.testing.live_replay import Player, RunObserver, WorldModelWriter
from skiros2_bags.testing.recorded_task import recorded_tasks
from skiros2_bags.testing.recorded_world import PACKAGES, scene_before
from skiros2_bags.testing.recording import Recording, WorldChange
from skiros2_bags.testing.replay_settings import Settings
from skiros2_bags.testing.replay_system import ReplaySystem, start_skill_manager, start_task_manager, start_world_model
from skiros2_common.core.errors import TimedOut
from skiros2_msgs import srv as srvs
from skiros2_runs.core.compare import Divergence

#: Action of the task manager that executes goals.
ACHIEVE = "/tm/achieve"

#: Timeout for the last messages (s).
_LAG = 5.0


def replay_trace(recording: Recording, settings: Settings, system: ReplaySystem) -> Divergence | None:
    """Runs the system with the recorded scene and goals. Returns the first divergence; None without one.

    :raises BagError: the bag has no tasks or no goals.
    """
    runs = recorded_tasks(recording)
    if not runs:
        raise BagError(f"{recording.path}: no progress of tasks; expected a topic /MANAGER/monitor")
    goals = [e for e in recording.action_messages if e.part == "goal" and e.action == ACHIEVE]
    needs_task_manager = bool(goals)
    senders = {goal.caller for goal in goals}
    goals += [run.goal for run in runs if run.goal is not None and run.goal.caller not in ("/tm", *senders)]
    if not goals:
        raise BagError(f"{recording.path}: no goals to send again; expected some on {ACHIEVE} or MANAGER/execute")
    managers = sorted({run.manager for run in runs})
    begin = min(run.begin for run in runs)
    begin = min(begin, *(goal.order for goal in goals))
    scene = scene_before(recording, begin)
    start_world_model(system, scene, settings.workspace, list(PACKAGES))
    writer = WorldModelWriter()
    own_authors = {*managers, "/wm", "wm", "/tm", "recording"}
    inputs = [
        e
        for e in recording.changes
        if e.order > begin and e.change.author not in own_authors and not _is_reasoner(e) and not _is_last_will(e)
    ]
    servers = None
    if settings.launch:
        system.launch(*settings.launch)
    else:
        platform_actions = {ACHIEVE, "/tm/task_plan", *(f"{m}/execute" for m in managers)}
        driver_actions = {e.action for e in recording.action_messages} - platform_actions
        servers = ActionServers(recording, driver_actions, settings.tolerance)
    for manager in managers:
        start_skill_manager(system, recording, manager, scene)
    if needs_task_manager:
        start_task_manager(system, recording)
    observer = RunObserver(managers)
    player = Player(recording, goals, inputs, writer.apply, system)
    player.connect()
    system.wait_for(lambda: observer.is_connected, "the nodes' topics")
    try:
        player.play()
    except TimedOut as late:
        return Divergence("in between", "a goal that has ended in the recording", "its end", str(late))
    _wait_for_ends(system, observer, len(runs))
    if servers is not None:
        servers.close()
    divergence = compare_runs(recording, observer.events, settings.tolerance, managers)
    if divergence is None and servers is not None and servers.mismatches:
        divergence = Divergence("in between", *servers.mismatches[0])
    if divergence is None:
        last = max(run.end for run in runs)
        divergence = compare_scenes(scene_before(recording, last + 1), writer.scene(), settings.tolerance)
    player.close()
    return divergence


def _wait_for_ends(system: ReplaySystem, observer: RunObserver, number: int) -> None:
    """Waits until all tasks have ended, or for `_LAG`."""
    end = time.monotonic() + _LAG

    def has_ended() -> bool:
        found = recorded_tasks(observer.events)
        return (len(found) >= number and all(task.run.latest.has_ended for task in found)) or time.monotonic() > end

    system.wait_for(has_ended, "the last progress", 2 * _LAG)
    last = rospy.ServiceProxy("/wm/snapshot", srvs.WmSnapshot)("").snapshot_id
    system.wait_for(lambda: observer.has_received(last), "the last change of the world model")


def _is_reasoner(event: WorldChange) -> bool:
    return not event.change.author.startswith("/") and event.change.author.endswith("Reasoner")


def _is_last_will(event: WorldChange) -> bool:
    return event.change.author.startswith("last will of")
