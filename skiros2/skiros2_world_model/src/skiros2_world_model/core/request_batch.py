"""Requests that are written to the journal together: with its `full_sync`, they wait for one sync of the disk."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence

from skiros2_common.core.errors import Refused
from skiros2_common.core.operations import Operation, Outcome
from skiros2_world_model.core.change_notifier import ChangeNotifier
from skiros2_world_model.core.checks import Checks
from skiros2_world_model.core.context import Contexts
from skiros2_world_model.core.journal import Journal
from skiros2_world_model.core.ontology import Ontology
from skiros2_world_model.core.reasoning import Reasoning
from skiros2_world_model.core.request import Request

log = logging.getLogger(__name__)

#: A request: its operations, its author and its context.
Transact = tuple[Sequence[Operation], str, str]


class Batch:
    """Requests that are applied one after the other, then written and published together. Used once, under the lock.

    :param journal: None: nothing is written.
    """

    def __init__(
        self, contexts: Contexts, reasoning: Reasoning, notifier: ChangeNotifier, journal: Journal | None
    ) -> None:
        self._contexts = contexts
        self._reasoning = reasoning
        self._notifier = notifier
        self._journal = journal
        self._done: list[Request | Exception] = []  # an exception: why it was refused

    def apply(
        self,
        operations: Sequence[Operation],
        author: str,
        context: str,
        ontology: Ontology,
        checks: Callable[[], Checks],
    ) -> None:
        """Applies a request to the state that those before it have led to, or notes why it is refused."""
        request = Request(self._contexts, ontology, self._reasoning, checks, author)
        try:
            request.apply(operations, context)
            request.commit(self._notifier)
        except Exception as error:
            request.roll_back()
            self._done.append(error)
            return
        self._done.append(request)
        for wanted, assigned in request.renamed:
            log.warning("%s: the number of %s is taken; the element was added as %s", author, wanted, assigned)

    def finish(self) -> list[Outcome | Exception]:
        """Writes and publishes all requests. When they cannot be written, all are rolled back and refused.

        :returns: for each request its outcome, or why it was refused.
        """
        requests = [request for request in self._done if isinstance(request, Request)]
        lines = [request.line for request in requests if request.line is not None]
        try:
            if self._journal is not None and lines:
                self._journal.write(lines)
        except Exception as error:
            for request in reversed(requests):
                request.roll_back()
                self._notifier.number -= len(request.changes)
            return [Refused(str(error)) if isinstance(one, Request) else one for one in self._done]
        for request in requests:
            for change in request.changes:
                self._notifier.notify(change)
        return [one.outcome if isinstance(one, Request) else one for one in self._done]
