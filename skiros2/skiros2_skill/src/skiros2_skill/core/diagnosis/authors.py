"""Who last changed what an explanation speaks of. The world model's journal is asked, not in a tick."""

from __future__ import annotations

import logging
import time
from collections.abc import Iterable
from typing import Any

from skiros2_common.core.errors import SkirosError
from skiros2_common.core.explanation import Change, Explanation

log = logging.getLogger(__name__)

#: Of an element that changes often, no more than so many changes are looked through.
MOST_ENTRIES = 1000


def name_authors(explanations: Iterable[Explanation], wmi: Any, timeout: float = 2.0) -> None:
    """Fills in when, and by whom, the facts in some explanations were last changed before the failure.

    A change that the world model cannot tell, as it keeps no journal or does not answer, stays without.

    :param timeout: s; no further question is asked then.
    """
    end = time.monotonic() + timeout
    for explanation in explanations:
        for change in explanation.all_changes():
            if not change.author and time.monotonic() < end:
                _name_author(change, explanation.stamp, wmi)


def _name_author(change: Change, until: float, wmi: Any) -> None:
    try:
        names = [change.name, *wmi.get_sub_properties(change.name)] if change.name else []
        entries = wmi.history(change.element, until=until, limit=MOST_ENTRIES)
    except SkirosError as error:
        log.debug("who changed %s %s is not known: %s", change.element, change.name, error)
        return
    entry = next((e for e in reversed(entries) if not names or e.touches(names)), None)
    if entry is not None:
        change.number, change.stamp, change.author = entry.number, entry.stamp, entry.author
