"""What primitives share that have a server do the work."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

from skiros2_common.core.primitive import PrimitiveBase

#: Progress codes: there is no server; it does not answer; the skill was stopped; the server's answer was lost.
NO_SERVER, NO_ANSWER, STOPPED, LOST = -101, -102, -103, -104


class ClientPrimitive(PrimitiveBase, ABC):
    """Base of the primitives with a client. What the client's threads bring wakes the tree (`wake`).

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
        """To override: the client. None: there is none yet, and a start fails."""
        return None

    def onInit(self) -> bool:
        if not self.build_client_onstart:
            self.client = self.buildClient()
        return True

    def onStart(self) -> bool:
        if self.build_client_onstart:
            self._close_client()
            self.client = self.buildClient()
        if self.client is None:
            self.fail(f"{self.__class__.__name__}.buildClient gave no client", NO_SERVER)
            return False
        return True

    # -- for the two kinds of clients --------------------------------------------------------------------------

    def _give_up(self) -> None:
        """To override: what was asked for is not wanted any more."""

    def _close_client(self) -> None:
        """To override: ends the client of an earlier start, where there is one."""
