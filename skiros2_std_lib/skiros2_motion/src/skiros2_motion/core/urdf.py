"""Poses and vectors in a URDF."""

from __future__ import annotations

import math
import xml.etree.ElementTree as xml

from skiros2_motion.core.geometry import Pose, Vector, from_euler


def origin_of(element: xml.Element) -> Pose:
    """Return the pose that the `origin` of a joint, visual or collision states; without one, that of its parent.

    :raises ValueError: it is not three finite numbers each.
    """
    origin = element.find("origin")
    stated = origin.attrib if origin is not None else {}
    return Pose(vector(stated.get("xyz")), from_euler(*vector(stated.get("rpy"))))


def vector(text: str | None, default: str = "0 0 0") -> Vector:
    """Read three numbers.

    :raises ValueError: it is not three finite numbers.
    """
    x, y, z = map(float, (text or default).split())
    if not all(map(math.isfinite, (x, y, z))):
        raise ValueError(f"numbers are not finite: {text}")
    return x, y, z
