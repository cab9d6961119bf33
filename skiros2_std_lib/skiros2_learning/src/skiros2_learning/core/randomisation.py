"""Domain randomisation: a scene as it might be in reality, drawn from a random generator."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any

import numpy as np
from pydantic import PlainValidator

from skiros2_learning.core.sections import Keyed, NotNegative, Positive, Section, Text, UnknownNames, near, read
from skiros2_motion.core.geometry import Pose, from_euler, multiplied
from skiros2_sim.core.scene_spec import BodySpec, SceneSpec
from skiros2_sim.core.wrist_sensor import EXACT, SensorModel

#: Default limit of normal distributions, in standard deviations.
_CLIP = 2.0
#: Smallest factor of a mass or a size.
_LEAST_FACTOR = 0.1


@dataclass(frozen=True)
class BodySpread(Section):
    """How a body may differ from the scene. All distributions are normal, clipped at `clip` standard deviations.

    :param position: standard deviation of x and y (m).
    :param height: of z (m).
    :param yaw: of the rotation about the vertical (rad).
    :param mass, size: of a factor of the mass, of all edges.
    :param friction: of the friction coefficient, around `mean_friction`.
    :param mean_friction: None for the friction of the body in the scene.
    """

    position: NotNegative = 0.0
    height: NotNegative = 0.0
    yaw: NotNegative = 0.0
    mass: NotNegative = 0.0
    size: NotNegative = 0.0
    friction: NotNegative = 0.0
    mean_friction: NotNegative | None = None
    clip: Positive = _CLIP


@dataclass(frozen=True)
class _Noise(Section):
    force_noise: NotNegative = 0.0
    torque_noise: NotNegative = 0.0


def _read_sensor(data: Any) -> SensorModel:
    noise = read(_Noise, data)
    return SensorModel(noise.force_noise, noise.torque_noise)


@dataclass(frozen=True)
class Randomisation(Section):
    """The differences between executions.

    :param bodies: by label.
    :param sensor: noise of the force/torque sensors at the wrists.
    :param starts: names of postures of the arm, one of which is the start configuration; (): that of the simulator.
    """

    bodies: Keyed[BodySpread] = field(default_factory=dict)
    sensor: Annotated[SensorModel, PlainValidator(_read_sensor)] = EXACT
    starts: tuple[Text, ...] = ()


#: Each execution is as the scene.
NO_RANDOMISATION = Randomisation()


@dataclass(frozen=True)
class Draw:
    """One possible reality.

    :param friction: coefficient by id of the body.
    :param start: name of the start posture; "" for that of the simulator.
    """

    scene: SceneSpec
    friction: Mapping[str, float]
    start: str


@dataclass(frozen=True)
class Quantity:
    """A randomised quantity, for people.

    :param centre: the value that it is drawn around, with its unit.
    :param spread: how far.
    """

    name: str
    centre: str
    spread: str


def draw(scene: SceneSpec, randomisation: Randomisation, random: np.random.Generator) -> Draw:
    """Draws one reality. The order of the bodies in the scene determines the order of random numbers.

    :raises UnknownNames: bodies are not in the scene.
    """
    labels = {body.label for body in scene.bodies}
    unknown = [label for label in randomisation.bodies if label not in labels]
    if unknown:
        raise UnknownNames({label: f"no body is labelled {label!r}; {near(label, labels)}" for label in unknown})
    friction: dict[str, float] = {}
    bodies: list[BodySpec] = []
    for body in scene.bodies:
        spread = randomisation.bodies.get(body.label)
        if spread is None:
            bodies.append(body)
            continue
        # always the same number of random numbers, so that one spread does not change the others
        dx, dy, dz, turn, mass, size, rub = np.clip(random.standard_normal(7), -spread.clip, spread.clip).tolist()
        bodies.append(_changed(body, spread, (dx, dy, dz, turn, mass, size)))
        if spread.friction or spread.mean_friction is not None:
            friction[body.id] = max(0.0, _mean_friction(body, spread) + spread.friction * rub)
    start = ""
    if randomisation.starts:
        start = randomisation.starts[int(random.integers(len(randomisation.starts)))]
    return Draw(dataclasses.replace(scene, bodies=tuple(bodies)), friction, start)


def quantities(scene: SceneSpec, randomisation: Randomisation) -> list[Quantity]:
    """Returns the randomised quantities of a scene."""
    found: list[Quantity] = []
    for body in scene.bodies:
        spread = randomisation.bodies.get(body.label)
        if spread is None:
            continue
        x, y, z = body.pose.position
        around = {
            "x": (f"{x:.4g} m", spread.position, " m"),
            "y": (f"{y:.4g} m", spread.position, " m"),
            "z": (f"{z:.4g} m", spread.height, " m"),
            "yaw": ("that of the scene", spread.yaw, " rad"),
            "mass": (f"{body.own_mass:.4g} kg", spread.mass * body.own_mass, " kg"),
            "size": (" x ".join(f"{edge:.4g}" for edge in body.size or ()) + " m", 100.0 * spread.size, " %"),
            "friction": (f"{_mean_friction(body, spread):.4g}", spread.friction, ""),
        }
        limit = f"at most {spread.clip:g} times that"
        found += [
            Quantity(f"{body.label}: {name}", centre, f"standard deviation {deviation:.4g}{unit}, {limit}")
            for name, (centre, deviation, unit) in around.items()
            if deviation
        ]
        mean = spread.mean_friction
        if mean is not None and mean != body.own_friction:
            text = f"the scenario's, instead of {body.own_friction:.4g} of the scene"
            found.append(Quantity(f"{body.label}: mean friction", f"{mean:.4g}", text))
    return [*found, *sensor_quantities(randomisation.sensor), *_start_quantities(randomisation.starts)]


def sensor_quantities(sensor: SensorModel) -> list[Quantity]:
    """Returns the noises of the sensors at the wrists."""
    noises = (("force", sensor.force_noise, "N"), ("torque", sensor.torque_noise, "Nm"))
    return [
        Quantity(f"sensor: {name}", "the true one", f"standard deviation {noise:.4g} {unit}")
        for name, noise, unit in noises
        if noise
    ]


def _start_quantities(starts: Sequence[str]) -> list[Quantity]:
    return [Quantity("start posture", "-", f"one of {', '.join(starts)}")] if starts else []


def _mean_friction(body: BodySpec, spread: BodySpread) -> float:
    return body.own_friction if spread.mean_friction is None else spread.mean_friction


def _changed(body: BodySpec, spread: BodySpread, numbers: Sequence[float]) -> BodySpec:
    dx, dy, dz, turn, mass, size = numbers
    x, y, z = body.pose.position
    position = (x + spread.position * dx, y + spread.position * dy, z + spread.height * dz)
    yaw = from_euler(0.0, 0.0, spread.yaw * turn)
    changes: dict[str, object] = {"pose": Pose(position, multiplied(yaw, body.pose.orientation))}
    if spread.size and body.size is not None:
        factor = max(_LEAST_FACTOR, 1.0 + spread.size * size)
        a, b, c = body.size
        changes["size"] = (a * factor, b * factor, c * factor)
        # it keeps standing on what it stood on
        changes["pose"] = Pose((*position[:2], position[2] + c * (factor - 1.0) / 2.0), changes["pose"].orientation)  # type: ignore[attr-defined]
    if spread.mass:
        changes["mass"] = body.own_mass * max(_LEAST_FACTOR, 1.0 + spread.mass * mass)
    return dataclasses.replace(body, **changes)  # type: ignore[arg-type]
