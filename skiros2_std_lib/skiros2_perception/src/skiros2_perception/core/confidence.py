"""How confident the world model is that an object is where it was last seen.

Each view in which the object should be visible changes its confidence c exponentially, weighted with the part v of its
surface that the view tells about:

    seen:      1 - c  <-  (1 - c) * 2^-v
    not seen:  c  <-  c * 2^-v

Below `MISSING_BELOW` the object is marked as missing. An object that perception has added is removed below
`REMOVED_BELOW`; others never are. A hidden object, or one out of view, keeps its confidence.
"""

from __future__ import annotations

#: Confidence below which an object is marked as missing: after three views that do not show it.
MISSING_BELOW = 0.2
#: Confidence below which an unknown object is removed: after six such views.
REMOVED_BELOW = 0.02
#: Confidence of an object that was seen once.
NEW = 0.5


def seen(confidence: float, part: float) -> float:
    """Returns the confidence after a view that shows the object.

    :param part: of its surface that was seen, 0 to 1.
    """
    return float(1.0 - (1.0 - confidence) * 2.0**-part)


def not_seen(confidence: float, part: float) -> float:
    """Returns the confidence after a view that does not show the object.

    :param part: of its surface that should have been seen, 0 to 1.
    """
    return float(confidence * 2.0**-part)
