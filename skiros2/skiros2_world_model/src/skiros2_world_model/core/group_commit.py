"""Group commit: requests that wait for the disk at the same time share one sync of the journal."""

from __future__ import annotations

import threading
from collections.abc import Sequence

from skiros2_common.core.errors import Refused
from skiros2_common.core.operations import SCENE, Operation, Outcome
from skiros2_world_model.core.request_batch import Transact
from skiros2_world_model.core.world_model import WorldModel


class _Call:
    """A request of a thread.

    :ivar result: its outcome, or why it was refused; None: it has not been applied.
    :ivar wake: set when there is a result, or when the thread has to lead.
    """

    def __init__(self, request: Transact) -> None:
        self.request = request
        self.result: Outcome | Exception | None = None
        self.wake = threading.Event()


class GroupCommit:
    """Applies the requests of many threads to a world model.

    While the journal syncs a request, further ones queue up. The thread of the first of them is the next leader: it
    applies all that wait, in the order of their arrival, and writes them with one sync. N threads that write all the
    time so need two syncs for N requests. The world model's lock is held meanwhile, as for a single request, so that
    nobody reads or publishes a change that is not on disk.

    Without the journal's `full_sync` there is nothing to share: each thread applies its own request.
    """

    def __init__(self, model: WorldModel) -> None:
        self._model = model
        self._mutex = threading.Lock()  # of the following
        self._waiting: list[_Call] = []
        self._has_leader = False

    def transact(self, operations: Sequence[Operation], author: str, context: str = SCENE) -> Outcome:
        """As `WorldModel.transact`. Must not be called under the lock of the world model. Any thread.

        :raises SkirosError: an operation is refused, or the journal cannot be written; nothing has changed.
        """
        if not self._model.syncs:
            return self._model.transact(operations, author, context)
        call = _Call((operations, author, context))
        with self._mutex:
            self._waiting.append(call)
            leads, self._has_leader = not self._has_leader, True
        if not leads:
            call.wake.wait()
        if call.result is None:
            self._lead()
        assert call.result is not None
        if isinstance(call.result, Exception):
            raise call.result
        return call.result

    def _lead(self) -> None:
        """Applies the waiting requests, that of this thread included, and appoints the next leader."""
        calls: list[_Call] = []
        results: list[Outcome | Exception] = []
        try:
            with self._model.lock:
                with self._mutex:
                    calls, self._waiting = self._waiting, []
                results = self._model.transact_all([call.request for call in calls])
        finally:
            lost = [Refused("the thread that applied the request was ended")] * (len(calls) - len(results))
            for call, result in zip(calls, [*results, *lost], strict=True):
                call.result = result
                call.wake.set()
            with self._mutex:
                self._has_leader = bool(self._waiting)
                if self._has_leader:
                    self._waiting[0].wake.set()
