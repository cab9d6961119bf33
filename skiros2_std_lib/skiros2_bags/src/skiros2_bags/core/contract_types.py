"""The types that runs are made of, and what tells that a bag has them as they are here."""

from __future__ import annotations

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
