"""What is wrong with a bag."""

from __future__ import annotations

from skiros2_common.core.errors import SkirosError


class BagError(SkirosError):
    """A bag cannot be read, or lacks what is asked of it. The text names the bag, the place and what was expected."""
