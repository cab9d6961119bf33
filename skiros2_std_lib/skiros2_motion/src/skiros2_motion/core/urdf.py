"""Reads URDFs: for simulated worlds, drivers of real arms and 3D views. Lengths in m, angles in rad."""

from __future__ import annotations

import math
import xml.etree.ElementTree as xml
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

from skiros2_common.core.errors import ConfigurationError
from skiros2_motion.core.geometry import Pose, Vector, from_euler

#: Types of joints that move.
MOVING = ("revolute", "continuous", "prismatic")


@dataclass
class Urdf:
    """The links, joints and materials of a model. Their elements may be changed.

    :param name: of the robot in the text.
    :param parts: in the order of the text.
    """

    name: str
    parts: list[xml.Element]

    @property
    def links(self) -> list[str]:
        """The names of the links."""
        return [part.get("name", "") for part in self.parts if part.tag == "link"]

    @property
    def joints(self) -> list[xml.Element]:
        return [part for part in self.parts if part.tag == "joint"]

    def all(self, tag: str) -> Iterator[xml.Element]:
        """Yields all elements with a tag, at any depth."""
        return (node for part in self.parts for node in part.iter(tag))

    def root(self) -> str:
        """Returns the root of the links.

        :raises ConfigurationError: the links are no tree, or have the same name.
        """
        links = self.links
        if not links or len(set(links)) < len(links):
            raise ConfigurationError(f"expected links of different names, got {links}")
        children: dict[str, list[str]] = {name: [] for name in links}
        below = set()
        for joint in self.joints:
            parent, child = of(joint, "parent", "link"), of(joint, "child", "link")
            if parent not in links or child not in links or child in below:
                raise ConfigurationError(f"joint {joint.get('name')}: expected a tree of links, got {parent}-{child}")
            below.add(child)
            children[parent].append(child)
        roots = [name for name in links if name not in below]
        reached = list(roots[:1])
        for name in reached:
            reached += children[name]
        if len(roots) != 1 or len(reached) != len(links):
            raise ConfigurationError(f"expected a tree of links, got the roots {roots}")
        return roots[0]

    def path(self, tip: str, base: str = "") -> list[xml.Element]:
        """Returns the joints between two links, from the base on.

        :param base: without it, the joints from the root on.
        :raises ConfigurationError: the tip is not a descendant of the base.
        """
        above = {of(joint, "child", "link"): joint for joint in self.joints}
        found: list[xml.Element] = []
        link = tip
        while link != base and link in above and len(found) <= len(above):
            found.insert(0, above[link])
            link = of(found[0], "parent", "link")
        if base and link != base:
            raise ConfigurationError(f"link {tip!r} is not a descendant of link {base!r}")
        return found

    def text(self) -> str:
        """Returns the model as a URDF."""
        return as_text(self.name, self.parts)


class JointLimits(NamedTuple):
    """Limits of the position, infinite without any, and the maximum velocity; 0: not given."""

    lower: float
    upper: float
    velocity: float


def parse_urdf(text: str | bytes) -> Urdf:
    """Reads a model.

    :raises ConfigurationError: it is not a URDF; the text has the reason.
    """
    try:
        top = xml.fromstring(text)
    except (xml.ParseError, ValueError, LookupError) as error:
        raise ConfigurationError(f"not a URDF: {error}") from None
    if top.tag != "robot":
        raise ConfigurationError(f"not a URDF: expected <robot>, got <{top.tag}>")
    return Urdf(top.get("name", ""), [part for part in top if part.tag in ("link", "joint", "material")])


def as_text(name: str, parts: list[xml.Element]) -> str:
    """Returns a URDF of links, joints and materials."""
    top = xml.Element("robot", name=name)
    top.extend(parts)
    return xml.tostring(top, encoding="unicode")


def of(element: xml.Element, tag: str, key: str) -> str:
    """Returns an attribute of a child of an element; "" without one."""
    found = element.find(tag)
    return found.get(key, "") if found is not None else ""


def limits_of(joint: xml.Element) -> JointLimits:
    """Returns the limits of a joint.

    :raises ValueError: one is not a finite number; the text names it.
    """
    lower, upper, velocity = (_number(joint, key) for key in ("lower", "upper", "velocity"))
    if joint.find("limit") is None or joint.get("type") == "continuous":
        lower, upper = -math.inf, math.inf
    return JointLimits(lower, upper, velocity)


def _number(joint: xml.Element, key: str) -> float:
    text = of(joint, "limit", key)
    try:
        value = float(text or "0")
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ValueError(f"{key} is {text!r}, expected a number")
    return value


def axis_of(joint: xml.Element) -> Vector:
    """Returns the axis of a joint, in its frame.

    :raises ValueError: it is not three finite numbers.
    """
    return vector(of(joint, "axis", "xyz"), "1 0 0")


def origin_of(element: xml.Element) -> Pose:
    """Return the pose that the `origin` of a joint, visual or collision states; without one, that of its parent.

    :raises ValueError: it is not three finite numbers each.
    """
    return Pose(vector(of(element, "origin", "xyz")), from_euler(*vector(of(element, "origin", "rpy"))))


def vector(text: str | None, default: str = "0 0 0") -> Vector:
    """Read three numbers.

    :raises ValueError: it is not three finite numbers.
    """
    x, y, z = map(float, (text or default).split())
    if not all(map(math.isfinite, (x, y, z))):
        raise ValueError(f"numbers are not finite: {text}")
    return x, y, z
