"""A system of its own for the demo: a master on a free port, a recorder, and what the launch file starts."""

from __future__ import annotations

import time
from pathlib import Path

from skiros2_common.ros.private_system import PrivateSystem

#: How long the recorder may lag behind what is published (s).
RECORDER_LAG = 1.0


class System(PrivateSystem):
    """A running system; a context manager.

    :param folder: where the bag goes, and a log of each process.
    :param port: the master's; 0 takes a free one.
    """

    def __init__(self, folder: Path, port: int = 0) -> None:
        super().__init__("demo", folder, port)
        self.bag = folder / "run.bag"
        folder.mkdir(parents=True, exist_ok=True)
        for old in (self.bag, self.bag.with_suffix(".bag.active")):
            old.unlink(missing_ok=True)

    def start_recording(self, robot: str) -> None:
        """Starts a recorder of all that a run needs, and waits until it listens.

        :param robot: the skill manager whose tasks it awaits.
        :raises SystemDown: it ends.
        :raises TimedOut: it does not get ready.
        """
        command = ["rosrun", "skiros2_bags", "record", "--force", "--no-check", "-o", str(self.bag), "--robots", robot]
        self.start("recorder", command)
        self.wait_for(lambda: "recording to" in self.log("recorder").read_text(errors="replace"), "the recorder")

    def stop_recording(self) -> None:
        """Ends the recorder, so that the bag is whole."""
        # A recorder tells nobody what it has got. What was published last is with it in milliseconds, on a busy machine
        # in more. The nodes cannot end first: they take their skills out of the world, which is no part of the run.
        time.sleep(RECORDER_LAG)
        self.end("recorder")
