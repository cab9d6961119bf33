"""The kinds of replay."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from skiros2_bags.testing.replay_settings import ReplayResult, Settings

RERUN, TRACE = "rerun", "trace"

KINDS = {
    RERUN: "the trees, ticked again in one process",
    TRACE: "the whole system again, with the recorded scene and goals",
}


def replay(bag: Path, kind: str, settings: Settings) -> ReplayResult:
    """Replays a bag. A trace can run once per process.

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
    from skiros2_bags.testing.trace import replay_trace

    with ReplaySystem() as system:
        system.init_node("replay")
        return ReplayResult(replay_trace(recording, settings, system))
