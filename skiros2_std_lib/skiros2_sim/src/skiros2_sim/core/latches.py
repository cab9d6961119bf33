"""Latches of bores: forces between a plug and the body with the bore.

PyBullet has no springs, and a catch of some grams between two stiff contacts is not stable at 1 kHz. The catch is
therefore a law of the depth of the plug. It resists with a force that grows up to the latch's depth; behind it there is
no force. When the plug is pulled back from there, the catch holds it like a stiff spring, up to the retention force.
"""

from __future__ import annotations

import math
from enum import Enum

from skiros2_motion.core.bore import Bore, Latch
from skiros2_motion.core.geometry import Pose, composed, cross, inverted, rotated
from skiros2_sim.core.body import Body
from skiros2_sim.core.physics import Part, Physics

#: Depth before the latch at which the catch is touched (m), and give of the catch at the retention force (m).
_RISE, _GIVE = 0.003, 0.0008
#: Largest stiffness and damping of a catch for a free plug, as parts of those at which a step is not stable.
_STIFFEST, _DAMPING = 0.5, 0.5


class _Catch(Enum):
    OPEN = "before the latch"
    LATCHED = "behind it"
    PULLED_OUT = "forced open by a pull; the plug has not left it yet"


class Latches:
    """The latches of a world.

    :param dt: duration of a step (s).
    """

    def __init__(self, physics: Physics, dt: float) -> None:
        self._physics, self._dt = physics, dt
        self._sockets: list[tuple[Body, Bore, Latch]] = []
        self._plugs: list[Body] = []
        self._catches: dict[tuple[Bore, int, int], _Catch] = {}

    def add(self, body: Body) -> None:
        """Adds a body: as a socket if it has bores with latches, and as a plug if it is movable."""
        self._sockets += [(body, bore, bore.latch) for bore in body.spec.bores if bore.latch is not None]
        if body.movable and body.spec.size is not None:
            self._plugs.append(body)

    def remove(self, body: Body) -> None:
        """Removes a body."""
        self._sockets = [socket for socket in self._sockets if socket[0] is not body]
        self._plugs = [plug for plug in self._plugs if plug is not body]

    def update(self) -> None:
        """Applies the forces for the next step."""
        for socket, bore, latch in self._sockets:
            size = socket.spec.size
            assert size is not None
            rim = composed(socket.pose(), Pose((bore.x, bore.y, size[2] / 2.0), (0.0, 0.0, 0.0, 1.0)))
            for plug in self._plugs:
                key = (bore, socket.body, plug.body)
                force = self._force(key, latch, _depth(plug, rim, bore), plug, socket)
                if force:
                    self._apply(plug, socket, rim, force)

    def _force(self, key: tuple[Bore, int, int], latch: Latch, depth: float, plug: Body, socket: Body) -> float:
        """Returns the force on the plug out of the bore (N); a negative one holds it."""
        catch = self._catches.get(key, _Catch.OPEN)
        short = latch.depth - depth
        if short <= 0.0:
            self._catches[key] = _Catch.LATCHED
            return 0.0
        if short >= _RISE:
            self._catches.pop(key, None)
            return 0.0
        mass = self._physics.mass(Part(plug.body))
        outwards = rotated(socket.pose().orientation, (0.0, 0.0, 1.0))
        speed = sum(a * (b - c) for a, b, c in zip(outwards, plug.velocity()[0], socket.velocity()[0], strict=True))
        damping = _DAMPING * mass / self._dt * speed
        if catch is _Catch.OPEN:
            return max(0.0, latch.force * (1.0 - short / _RISE) - damping)
        if catch is _Catch.LATCHED:
            stiffness = min(latch.retention / _GIVE, _STIFFEST * mass / self._dt**2)
            if stiffness * short < latch.retention:
                return min(0.0, -stiffness * short - damping)
            self._catches[key] = _Catch.PULLED_OUT
        return 0.0

    def _apply(self, plug: Body, socket: Body, rim: Pose, force: float) -> None:
        x, y, z = (force * part for part in rotated(rim.orientation, (0.0, 0.0, 1.0)))
        self._physics.push(Part(plug.body), (x, y, z), (0.0, 0.0, 0.0))
        if socket.movable:
            at = self._physics.mass_pose(Part(plug.body)).position
            centre = self._physics.mass_pose(Part(socket.body)).position
            lever = (at[0] - centre[0], at[1] - centre[1], at[2] - centre[2])
            self._physics.push(Part(socket.body), (-x, -y, -z), cross(lever, (-x, -y, -z)))


def _depth(plug: Body, rim: Pose, bore: Bore) -> float:
    """Returns the depth of the lower end of a plug below a rim (m); -inf if it is not in the bore."""
    size, pose = plug.spec.size, plug.pose()
    assert size is not None
    if math.dist(pose.position, rim.position) > size[2] + bore.depth:
        return -math.inf
    inside = composed(inverted(rim), composed(pose, Pose((0.0, 0.0, -size[2] / 2.0), (0.0, 0.0, 0.0, 1.0))))
    x, y, z = inside.position
    return -z if math.hypot(x, y) < bore.diameter / 4.0 else -math.inf
