"""Errors of bags."""

from __future__ import annotations

from skiros2_common.core.errors import SkirosError


class BagError(SkirosError):
    """A bag cannot be read, or lacks required messages. The text names the bag, the location and what was expected."""
