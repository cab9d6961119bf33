"""Adds to explanations who last changed the facts they name, from the world model's journal. Not for use in a tick."""

from __future__ import annotations

import logging
import time
from collections.abc import Iterable

from skiros2_common.core.errors import SkirosError
from skiros2_common.core.explanation import Change, Explanation
from skiros2_common.core.world_model_port import WorldModelPort

log = logging.getLogger(__name__)

#: How many changes of an element are searched.
MAX_ENTRIES = 1000


def add_authors(explanations: Iterable[Explanation], wmi: WorldModelPort, timeout: float = 2.0) -> None:
    """Sets time and author of the last change of each fact before the failure.

    Changes that the journal does not have, and all when the world model does not answer, are left unset.

    :param timeout: s, after which no further query starts.
    """
    deadline = time.monotonic() + timeout
    for explanation in explanations:
        for change in explanation.all_changes():
            if not change.author and time.monotonic() < deadline:
                _add_author(change, explanation.stamp, wmi)


def _add_author(change: Change, until: float, wmi: WorldModelPort) -> None:
    try:
        names = [change.name, *wmi.get_sub_properties(change.name)] if change.name else []
        entries = wmi.history(change.element, until=until, limit=MAX_ENTRIES)
    except SkirosError as error:
        log.debug("the author of %s %s is not known: %s", change.element, change.name, error)
        return
    entry = next((e for e in reversed(entries) if not names or e.affects(names)), None)
    if entry is not None:
        change.number, change.stamp, change.author = entry.number, entry.stamp, entry.author
