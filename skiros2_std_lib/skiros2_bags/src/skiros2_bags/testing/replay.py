"""The kinds of replay."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from skiros2_bags.testing.replay_settings import Settings

if TYPE_CHECKING:
    from skiros2_bags.testing.divergence import Divergence

RERUN, TRACE = "rerun", "trace"
WORLD_MODEL, SKILL_MANAGER, TASK_MANAGER = "world_model", "skill_manager", "task_manager"

KINDS = {
    RERUN: "the trees, ticked again in one process",
    TRACE: "the whole system again, with the recorded scene and goals",
    WORLD_MODEL: "the world model alone, with the recorded changes as requests",
    SKILL_MANAGER: "each skill manager alone, with actions that answer as recorded",
    TASK_MANAGER: "the task manager alone, with the recorded goals and scenes",
}


def replay(bag: Path, kind: str, settings: Settings) -> Divergence | None:
    """Replays a bag. Returns the first divergence; None without one. Kinds with nodes can run once per process.

    :raises BagError: the bag lacks required messages.
    :raises SkirosError: the replay fails.
    """
    # Imported here, because the pytest plugin needs only the names of the kinds, and ROS is slow to import.
    from skiros2_bags.testing.recording import Recording

    recording = Recording(bag)
    if settings.workspace is None:
        folder = str(recording.parameters.get("/wm/workspace_dir", ""))
        settings = replace(settings, workspace=Path(folder) if folder and Path(folder).is_dir() else None)
    if kind == RERUN:
        from skiros2_bags.testing.rerun import rerun

        return rerun(recording, settings)
    from skiros2_bags.testing.replay_system import ReplaySystem
    from skiros2_bags.testing.system_replay import replay_skill_managers, replay_trace
    from skiros2_bags.testing.task_manager_replay import replay_task_manager
    from skiros2_bags.testing.world_model_replay import replay_world_model

    players = {
        TRACE: replay_trace,
        WORLD_MODEL: replay_world_model,
        SKILL_MANAGER: replay_skill_managers,
        TASK_MANAGER: replay_task_manager,
    }
    with ReplaySystem() as system:
        system.init_node("replay")
        return players[kind](recording, settings, system)
