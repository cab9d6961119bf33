"""A message of a bag, and the message types of the contract."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

from skiros2_bags.core.errors import BagError


@dataclass(eq=False)
class Message:
    """A recorded message.

    :param time: when it was recorded (s since the epoch; simulated time if the recorder used it).
    :param type: as `rostopic type` prints it: `std_msgs/String`.
    :param caller: the publishing node; "" if the bag does not name it.
    :param definition: of its type and of all types in it.
    :param data: the serialised message.
    :param bag: the file.
    """

    time: float
    topic: str
    type: str
    md5: str
    caller: str
    definition: str = field(repr=False)
    data: bytes = field(repr=False)
    bag: Path = field(repr=False)
    _decode: Callable[[Message], Any] = field(repr=False)

    @property
    def location(self) -> str:
        """File, topic and time, for error messages."""
        return f"{self.bag}: {self.topic} at {self.time:.3f} s"

    @cached_property
    def content(self) -> Any:
        """The decoded message.

        :raises BagError: the data does not match the type.
        """
        return self._decode(self)


MONITOR = "skiros2_msgs/WmMonitor"
PROGRESS = "skiros2_msgs/TreeProgress"

#: MD5 sums of the contract. Bags with other sums were recorded with an incompatible version.
MD5_SUMS = {
    MONITOR: "ecc40ec88cb57baaf7cf8c07fd40a3c7",
    PROGRESS: "82e5478691b0800a9d96112287389bb2",
    "skiros2_msgs/AssignTaskActionGoal": "e802f6f9a9d68b5f918998a172f98b55",
    "skiros2_msgs/AssignTaskActionResult": "fbfe2da64b877db0724fa15bf68e147a",
    "skiros2_msgs/AssignTaskActionFeedback": "6fd05a4dc6f460247a7e95d6246a678f",
}


def check_md5(message: Message) -> None:
    """Checks that a message of a contract type has the contract's MD5 sum.

    :raises BagError: the sum differs.
    """
    expected = MD5_SUMS.get(message.type)
    if expected is not None and message.md5 != expected:
        what = f"{message.location}: {message.type} has the md5 sum {message.md5}, expected {expected}"
        raise BagError(f"{what}: it was recorded with another version")
