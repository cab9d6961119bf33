"""A message of a bag, as it was recorded."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any


@dataclass(eq=False)
class Message:
    """A message.

    :param time: when it was recorded (s since the epoch; of simulated time where the recorder had that).
    :param type: of the message, as `rostopic type` tells it: `std_msgs/String`.
    :param caller: the node that published it; "" where the bag does not tell.
    :param definition: of its type, with those of all types in it.
    :param data: as it was sent.
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
    def place(self) -> str:
        """Where it stands, for errors."""
        return f"{self.bag}: {self.topic} at {self.time:.3f} s"

    @cached_property
    def content(self) -> Any:
        """The message as an object with a field for each of the message's.

        :raises BagError: the data is not of the type that the bag tells.
        """
        return self._decode(self)
