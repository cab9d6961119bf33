"""Budgets of query time, one for each caller."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

from skiros2_common.core.errors import Refused

#: The defaults: the time of a caller's queries (s), the time that returns each second (s), the number at once.
BUDGET_SECONDS, BUDGET_RATE, BUDGET_PARALLEL = 60.0, 0.25, 2
#: With more callers than this, those with a full budget are forgotten.
_CALLERS = 1_000


class BudgetUsedUp(Refused):
    """A query of a caller whose earlier queries have used up the caller's budget."""

    code = "budget_used_up"


@dataclass
class _Account:
    left: float
    updated: float
    running: threading.BoundedSemaphore = field(repr=False)


class QueryBudgets:
    """Limits the time of the queries of each caller. Thread-safe.

    A caller may use `seconds` at once, and `rate` seconds in each second after that. Its further queries wait while
    `parallel` of them are running.

    :param patience: how long they wait (s).
    :param clock: the time (s), monotonic.
    """

    def __init__(
        self,
        seconds: float = BUDGET_SECONDS,
        rate: float = BUDGET_RATE,
        parallel: int = BUDGET_PARALLEL,
        patience: float = 30.0,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._seconds, self._rate, self._parallel = seconds, rate, parallel
        self._patience = patience
        self._clock = clock
        self._lock = threading.Lock()
        self._accounts: dict[str, _Account] = {}

    @contextmanager
    def query(self, caller: str) -> Iterator[None]:
        """Charges the time inside to a caller; "": this process, without a limit.

        :raises BudgetUsedUp: there is none left.
        """
        if not caller:
            yield
            return
        account = self._checked(caller)
        if not account.running.acquire(timeout=self._patience):
            raise BudgetUsedUp(f"{caller}: {self._parallel} queries are running; wait for their answers")
        try:
            self._checked(caller)
            started = self._clock()
            try:
                yield
            finally:
                with self._lock:
                    account.left -= self._clock() - started
        finally:
            account.running.release()

    def _checked(self, caller: str) -> _Account:
        with self._lock:
            now = self._clock()
            if len(self._accounts) > _CALLERS:
                self._accounts = {c: a for c, a in self._accounts.items() if self._updated(a, now) < self._seconds}
            account = self._accounts.get(caller)
            if account is None:
                running = threading.BoundedSemaphore(self._parallel)
                account = self._accounts[caller] = _Account(self._seconds, now, running)
            if self._updated(account, now) <= 0:
                wait = (1 - account.left) / self._rate
                raise BudgetUsedUp(
                    f"{caller}: its queries have used up {self._seconds:g} s; it may ask again in {wait:.0f} s"
                )
            return account

    def _updated(self, account: _Account, now: float) -> float:
        account.left = min(self._seconds, account.left + (now - account.updated) * self._rate)
        account.updated = now
        return account.left
