"""SPARQL queries of users. The world model gives each user a budget of their own."""

from __future__ import annotations

import asyncio
import threading
from collections import Counter, OrderedDict
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from skiros2_common.core.errors import SkirosError, TimedOut
from skiros2_gateway.core.problems import Problem, TooMany, WrongQuery
from skiros2_msgs import srv as srvs
from skiros2_world_model.core.ontology_client import table
from skiros2_world_model.core.query_budget import BudgetUsedUp
from skiros2_world_model.core.triple_store import QueryError, QueryNotAllowed, QueryTooLarge
from skiros2_world_model.core.wm_errors import WmException
from skiros2_world_model.ros.ros_transport import SERVER
from skiros2_world_model.ros.service_pool import ServicePool

#: Queries at once: of all users, and of one.
_THREADS, _OF_A_USER = 8, 2
#: Users with an open connection.
_USERS = 16
#: When a user with many queries may ask again (s).
_RETRY_AFTER = 10.0


class UserQueries:
    """Runs the queries of users in threads of their own, so that they delay nothing else. Call it in the loop."""

    def __init__(self) -> None:
        self._threads = ThreadPoolExecutor(_THREADS, "query")
        self._running: Counter[str] = Counter()
        self._pools: OrderedDict[str, ServicePool] = OrderedDict()
        self._lock = threading.Lock()

    def close(self) -> None:
        self._threads.shutdown(wait=False, cancel_futures=True)

    async def ask(self, user: str, text: str) -> dict[str, Any]:
        """Returns `columns` and `rows` of a query.

        :raises WrongQuery: the query cannot be answered, or is not allowed.
        :raises TooMany: the user has two queries running, or has used up the budget.
        """
        with self._lock:
            if self._running[user] >= _OF_A_USER:
                raise TooMany(f"{user}: {_OF_A_USER} queries are running; wait for their answers", 1.0)
            self._running[user] += 1
        # A client that has gone does not end the thread: only its end counts.
        future = asyncio.get_running_loop().run_in_executor(self._threads, self._ask, user, text)
        columns, rows = await asyncio.shield(future)
        return {"columns": columns, "rows": [[str(value) for value in row] for row in rows]}

    def _ask(self, user: str, text: str) -> tuple[list[str], list[list[Any]]]:
        try:
            return table(str(self._pool(user).call(srvs.WmSparqlRequest(text, "")).json))
        except WmException as error:
            raise _problem(error) from error
        finally:
            with self._lock:
                self._running[user] -= 1
                self._running += Counter()  # without the users that have none

    def _pool(self, user: str) -> ServicePool:
        with self._lock:
            pool = self._pools.pop(user, None) or ServicePool(f"{SERVER}/ontology/sparql", srvs.WmSparql, user=user)
            self._pools[user] = pool
            if len(self._pools) > _USERS:
                self._pools.popitem(last=False)[1].close()
            return pool


def _problem(error: WmException) -> SkirosError:
    if error.code in (QueryError.code, QueryNotAllowed.code, QueryTooLarge.code):
        return WrongQuery([Problem(error.code, "query", str(error))])
    if error.code == BudgetUsedUp.code:
        return TooMany(str(error), _RETRY_AFTER)
    return TimedOut(str(error)) if error.code == TimedOut.code else error
