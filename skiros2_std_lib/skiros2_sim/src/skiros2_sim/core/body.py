"""A body of the simulated world that is not a robot."""

from __future__ import annotations

from collections.abc import Sequence

from skiros2_common.core.errors import ConfigurationError
from skiros2_motion.core.geometry import Pose, Vector
from skiros2_motion.core.urdf import as_text
from skiros2_sim.core.bored_box import bored_box
from skiros2_sim.core.load_test import load_error
from skiros2_sim.core.physics import Part, Physics
from skiros2_sim.core.scene_spec import BodySpec, Colour
from skiros2_sim.core.urdf import MESHES, boxes_link, find_model, read_urdf

#: Radius of the edges of a bored box (m). PyBullet's default is 1 mm: a peg slips in with an offset of a millimetre.
#: With none, it bumps over the edges between the boxes.
_BROKEN_EDGE = 0.0003
#: Rolling friction of movable models (m). Boxes do not roll. With rolling friction the engine's solver does not
#: converge on things at rest: two boxes on a table took half of the time of a step of a whole cell.
_ROLLING = 0.0005
_FIXED_COLOURS: tuple[Colour, ...] = ((0.76, 0.69, 0.57, 1.0), (0.62, 0.66, 0.7, 1.0), (0.55, 0.6, 0.5, 1.0))
_MOVABLE_COLOURS: tuple[Colour, ...] = (
    (0.85, 0.15, 0.12, 1.0),
    (0.1, 0.45, 0.85, 1.0),
    (0.15, 0.65, 0.25, 1.0),
    (0.95, 0.7, 0.1, 1.0),
    (0.55, 0.25, 0.7, 1.0),
    (0.1, 0.65, 0.65, 1.0),
)


class Body:
    """A body, fixed in the map or movable.

    :param number: index among the bodies of its kind, for its colour.
    :raises ConfigurationError: its model does not load, or it has neither a model nor a size.
    :raises WrongValue: a bore is invalid.
    """

    def __init__(self, physics: Physics, spec: BodySpec, folders: Sequence[str] = (), number: int = 0) -> None:
        self.id = spec.id
        self.spec = spec
        self.movable = spec.movable
        self._physics = physics
        colours = _MOVABLE_COLOURS if spec.movable else _FIXED_COLOURS
        self.colour: Colour = spec.colour or colours[number % len(colours)]
        if spec.model:
            self.body = self._load_model(folders)
        else:
            self.body = self._make_bored_box() if spec.bores else self._make_box()
        rolling = _ROLLING if spec.movable and spec.model else None
        physics.set_surface(self.body, -1, spec.own_friction, spinning=0.005, rolling=rolling, bounce=0.0)

    def pose(self) -> Pose:
        """Pose in the map: of the centre of a box, of the root frame of a model."""
        return self._physics.pose(self.body)

    def velocity(self) -> tuple[Vector, Vector]:
        """Linear (m/s) and angular (rad/s) velocity in the map."""
        return self._physics.velocity(Part(self.body))

    def place(self, pose: Pose) -> None:
        """Moves the body to a pose, at rest."""
        self._physics.place(self.body, pose)

    @property
    def mass(self) -> float:
        """In kg; 0 for a fixed body."""
        return self.spec.own_mass if self.spec.movable else 0.0

    def _make_box(self) -> int:
        size = self.spec.size
        if size is None:
            raise ConfigurationError(f"{self.id}: expected a size or a model")
        return self._physics.add_box(size, self.mass, self.spec.pose, self.colour)

    def _make_bored_box(self) -> int:
        """Makes a model of boxes around the bores: a shape of PyBullet has at most 16."""
        size, mass = self.spec.size, self.mass
        if size is None:
            raise ConfigurationError(f"{self.id}: expected a size")
        shapes = bored_box(size, self.spec.bores)
        x, y, z = (edge**2 for edge in size)
        inertia = (mass * (y + z) / 12, mass * (x + z) / 12, mass * (x + y) / 12)
        text = as_text("bored_box", [boxes_link("box", shapes, mass, inertia, self.colour)])
        return self._physics.load_urdf(text, self.spec.pose, not self.movable, margin=_BROKEN_EDGE)

    def _load_model(self, folders: Sequence[str]) -> int:
        file = find_model(self.spec.model, folders)
        if file.suffix.lower() == ".urdf":
            text = read_urdf(file).text()
            return self._physics.load_urdf(text, self.spec.pose, not self.movable, exact_cylinders=True)
        if file.suffix.lower() not in MESHES:
            raise ConfigurationError(f"{file}: expected a .urdf, {' or '.join(MESHES)} file")
        fault = load_error(file)
        if fault:
            raise ConfigurationError(f"{file}: {fault}")
        return self._physics.add_mesh(file, self.mass, self.spec.pose, self.colour)
