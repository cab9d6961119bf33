"""Base of primitives that use a server."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

from skiros2_common.core.primitive import PrimitiveBase

#: Progress codes: no server, no answer, preempted, answer lost.
NO_SERVER, NO_ANSWER, STOPPED, LOST = -101, -102, -103, -104


class ClientPrimitive(PrimitiveBase, ABC):
    """Base of the primitives with a client. Answers in the client's threads wake the tree (`wake`).

    Attributes for subclasses:

    - `client`: what `buildClient` gives;
    - `build_client_onstart`: True makes a client at each start, so that it may depend on the parameters; False makes
      one when the skill is loaded.
    """

    build_client_onstart: bool

    def __init__(self) -> None:
        super().__init__()
        self.client: Any = None

    @abstractmethod
    def createDescription(self) -> None:
        """To override: `self.setDescription(Description(), "label")`."""

    def buildClient(self) -> Any:
        """To override: returns the client. None makes the start fail."""
        return None

    def onInit(self) -> bool:
        if not self.build_client_onstart:
            self.client = self.buildClient()
        return True

    def onStart(self) -> bool:
        if self.build_client_onstart:
            # The former client is closed last: a topic that a node leaves and enters again within milliseconds may stay
            # without a connection, as a busy server takes the closing one for the new one.
            former, self.client = self.client, self.buildClient()
            if former is not self.client:
                self._close(former)
        if self.client is None:
            self.fail(f"{self.__class__.__name__}.buildClient gave no client", NO_SERVER)
            return False
        return True

    def _close(self, client: Any) -> None:
        """To override: closes the client of an earlier start; None: there was none."""
