"""The ROS system of the demo: a master on a free port, a recorder, and the launched nodes."""

from __future__ import annotations

import time
from pathlib import Path

from skiros2_common.ros.private_system import PrivateSystem

#: Maximum delay of the recorder (s).
RECORDER_LAG = 1.0


class System(PrivateSystem):
    """A running system; a context manager.

    :param folder: for the bag and the logs.
    :param port: of the master; 0 for a free one.
    """

    def __init__(self, folder: Path, port: int = 0) -> None:
        super().__init__("demo", folder, port)
        self.bag = folder / "run.bag"
        folder.mkdir(parents=True, exist_ok=True)
        for old in (self.bag, self.bag.with_suffix(".bag.active")):
            old.unlink(missing_ok=True)

    def start_recording(self, robot: str) -> None:
        """Starts a recorder, and waits until it has subscribed.

        :param robot: the skill manager to expect.
        :raises SystemDown: the recorder exits.
        :raises TimedOut: the recorder is not ready in time.
        """
        command = ["rosrun", "skiros2_bags", "record", "--force", "--no-check", "-o", str(self.bag), "--robots", robot]
        self.start("recorder", command)
        self.wait_for(lambda: "recording to" in self.log("recorder").read_text(errors="replace"), "the recorder")

    def stop_recording(self) -> None:
        """Stops the recorder, which completes the bag."""
        # There is no acknowledgement: wait for the last messages. The nodes must not exit first: they remove their
        # skills from the scene, which is not part of the run.
        time.sleep(RECORDER_LAG)
        self.end("recorder")
