"""The types that runs are made of, and what tells that a bag has them as they are here."""

from __future__ import annotations

from skiros2_bags.core.errors import BagError
from skiros2_bags.core.message import Message

MONITOR = "skiros2_msgs/WmMonitor"
PROGRESS = "skiros2_msgs/TreeProgress"

#: Of the contract: bags that have others cannot be read as runs of this platform.
MD5_SUMS = {
    MONITOR: "ecc40ec88cb57baaf7cf8c07fd40a3c7",
    PROGRESS: "82e5478691b0800a9d96112287389bb2",
    "skiros2_msgs/AssignTaskActionGoal": "e802f6f9a9d68b5f918998a172f98b55",
    "skiros2_msgs/AssignTaskActionResult": "fbfe2da64b877db0724fa15bf68e147a",
    "skiros2_msgs/AssignTaskActionFeedback": "6fd05a4dc6f460247a7e95d6246a678f",
}


def check_md5(message: Message) -> None:
    """Makes sure that a message is of its type as the contract has it; those of other types are not looked at.

    :raises BagError: it is not.
    """
    expected = MD5_SUMS.get(message.type)
    if expected is not None and message.md5 != expected:
        what = f"{message.place}: {message.type} has the md5 sum {message.md5}, expected {expected}"
        raise BagError(f"{what}: it was recorded with another version")
