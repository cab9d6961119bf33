"""The ways to play a recording again."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from skiros2_bags.core.normal import NARROW, Tolerance

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


@dataclass(frozen=True)
class Settings:
    """What the code under test is, and how strictly it is judged.

    :param workspace: folder of the ontologies that the scene needs beside the platform's; None: as the bag's parameter
        `workspace_dir` of the world model says.
    :param played: labels of primitives that a re-run does not run: they do what was told of them. Those that call
        services are played anyway, since bags have no answers of services.
    :param tolerance: of measured numbers.
    :param launch: for a trace, what stands beside the platform: package, launch file, arguments. None: action servers
        answer as recorded.
    """

    workspace: Path | None = None
    played: frozenset[str] = frozenset()
    tolerance: Tolerance = NARROW
    launch: tuple[str, ...] = ()


def replay(bag: Path, kind: str, settings: Settings) -> Divergence | None:
    """Plays a bag again. None: all went as recorded. Of the kinds with nodes, one in a process.

    :raises BagError: the bag has not what that takes.
    :raises SkirosError: it cannot be played.
    """
    # Here and below, because pytest knows the kinds in each run, and ROS takes its time to be imported.
    from skiros2_bags.testing.recording import Recording

    recording = Recording(bag)
    if settings.workspace is None:
        folder = str(recording.parameters.get("/wm/workspace_dir", ""))
        settings = replace(settings, workspace=Path(folder) if folder and Path(folder).is_dir() else None)
    if kind == RERUN:
        from skiros2_bags.testing.rerun import rerun

        return rerun(recording, settings)
    from skiros2_bags.testing.component_task_manager import replay_task_manager
    from skiros2_bags.testing.component_world_model import replay_world_model
    from skiros2_bags.testing.lab import Lab
    from skiros2_bags.testing.system_replay import replay_skill_managers, replay_trace

    players = {
        TRACE: replay_trace,
        WORLD_MODEL: replay_world_model,
        SKILL_MANAGER: replay_skill_managers,
        TASK_MANAGER: replay_task_manager,
    }
    with Lab() as lab:
        lab.init_node("replay")
        return players[kind](recording, settings, lab)
