"""Base of primitives that call a service."""

from __future__ import annotations

import threading
import time
from abc import ABC, abstractmethod
from typing import Any

import rospy

from skiros2_common.core.abstract_skill import State
from skiros2_common.core.primitive import PrimitiveBase

__all__ = ["PrimitiveServiceClient"]


class _Call:
    """One call in a thread of its own. `answer` or `error` is set when `ended`."""

    def __init__(self, client: Any, request: Any) -> None:
        self.answer: Any = None
        self.error = ""
        self.began_at = time.monotonic()
        self._thread = threading.Thread(target=self._run, args=(client, request), name="service call", daemon=True)
        self._thread.start()

    @property
    def ended(self) -> bool:
        return not self._thread.is_alive()

    def _run(self, client: Any, request: Any) -> None:
        try:
            self.answer = client(request)
        except (rospy.ServiceException, rospy.ROSException) as error:
            self.error = str(error)


class PrimitiveServiceClient(PrimitiveBase, ABC):
    """Calls a service in a thread of its own, so that the tree goes on meanwhile. Override `buildClient`,
    `buildRequest` and `onDone`.

    Attributes for subclasses:

    - `client`: the `rospy.ServiceProxy`;
    - `build_client_onstart`: True makes a proxy at each start, so that it may depend on the parameters; False makes one
      when the skill is loaded;
    - `call_timeout_sec`: how long the call may take before the skill fails (s of wall time); None: for ever.

    A call that is given up, by preemption or timeout, is not taken back: its answer is dropped.
    """

    build_client_onstart = False
    call_timeout_sec: float | None = None

    def __init__(self) -> None:
        super().__init__()
        self.client: Any = None
        self._call: _Call | None = None

    @abstractmethod
    def createDescription(self) -> None:
        """To override: `self.setDescription(Description(), "label")`."""

    def buildClient(self) -> Any:
        """To override: the `rospy.ServiceProxy`."""
        raise NotImplementedError(f"{self.__class__.__name__} has to define buildClient")

    def buildRequest(self) -> Any:
        """To override: the request message, from the parameters. Called at each start."""
        raise NotImplementedError(f"{self.__class__.__name__} has to define buildRequest")

    def onDone(self, response: Any) -> State:
        """To override: called with the answer, by the thread that ticks. Returns `success(...)` or `fail(...)`."""
        return self.success("Done")

    def onInit(self) -> bool:
        if not self.build_client_onstart:
            self.client = self.buildClient()
        return True

    def onStart(self) -> bool:
        if self.build_client_onstart:
            self.client = self.buildClient()
        self._call = _Call(self.client, self.buildRequest())
        return True

    def onPreempt(self) -> State:
        self._call = None
        return self.fail("Stopped, the answer is dropped", -103)

    def execute(self) -> State:
        call = self._call
        assert call is not None
        if call.ended:
            self._call = None
            return self.fail(call.error, -101) if call.error else self.onDone(call.answer)
        if self.call_timeout_sec is not None and time.monotonic() - call.began_at > self.call_timeout_sec:
            self._call = None
            return self.fail(f"No answer from {self.client.resolved_name} within {self.call_timeout_sec} s", -102)
        return self.step(f"Waiting for {self.client.resolved_name}")
