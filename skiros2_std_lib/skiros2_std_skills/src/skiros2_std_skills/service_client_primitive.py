"""Base of primitives that call a service."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any

from skiros2_common.core.abstract_skill import State
from skiros2_std_skills.client_primitive import NO_ANSWER, NO_SERVER, STOPPED, ClientPrimitive

__all__ = ["PrimitiveServiceClient"]


class _Call:
    """One call in its own thread. `answer` or `error` is set when `ended` is."""

    def __init__(self, client: Any, request: Any, on_end: Callable[[], None]) -> None:
        self.answer: Any = None
        self.error = ""
        self.ended = False
        self.began_at = time.monotonic()
        arguments = (client, request, on_end)
        threading.Thread(target=self._run, args=arguments, name="service call", daemon=True).start()

    def _run(self, client: Any, request: Any, on_end: Callable[[], None]) -> None:
        try:
            self.answer = client(request)
        except Exception as error:  # any error: reported by the skill
            self.error = str(error) or type(error).__name__
        self.ended = True
        on_end()


class PrimitiveServiceClient(ClientPrimitive):
    """Calls a service in its own thread, so that the tree continues meanwhile. Override `buildClient`,
    `buildRequest` and `onDone`.

    Attributes for subclasses:

    - `client`: the `rospy.ServiceProxy`;
    - `build_client_onstart`: True makes a proxy at each start, so that it may depend on the parameters; False makes one
      when the skill is loaded;
    - `call_timeout_sec`: how long the call may take before the skill fails (s of wall time); None: unlimited.

    A call abandoned by preemption or timeout is not cancelled: its answer is discarded.
    """

    build_client_onstart = False
    replays_progress = True
    call_timeout_sec: float | None = None

    def __init__(self) -> None:
        super().__init__()
        self._call: _Call | None = None

    def buildClient(self) -> Any:
        """To override: returns the `rospy.ServiceProxy`."""
        return super().buildClient()

    def buildRequest(self) -> Any:
        """To override: returns the request message for the parameters. Called at each start."""
        raise NotImplementedError(f"{self.__class__.__name__} has to define buildRequest")

    def onDone(self, response: Any) -> State:
        """To override: called with the answer, in the ticking thread. Returns `success(...)` or `fail(...)`."""
        return self.success("Done")

    def onStart(self) -> bool:
        if not super().onStart():
            return False
        self._call = _Call(self.client, self.buildRequest(), self.wake)
        return True

    def onPreempt(self) -> State:
        self._call = None
        return self.fail("Stopped; the answer will be discarded", STOPPED)

    def execute(self) -> State:
        call = self._call
        assert call is not None
        if call.ended:
            self._call = None
            return self.fail(call.error, NO_SERVER) if call.error else self.onDone(call.answer)
        if self.call_timeout_sec is not None and time.monotonic() - call.began_at > self.call_timeout_sec:
            self._call = None
            return self.fail(f"No answer from {self.client.resolved_name} within {self.call_timeout_sec} s", NO_ANSWER)
        return self.step(f"Waiting for {self.client.resolved_name}")
