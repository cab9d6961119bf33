"""How a part fits into a bore, from the world model: depth, search and attempts of an insertion. Metres.

| property | of | default |
|---|---|---|
| `skiros:Depth` | bore | 0.06 |
| `skiros:Clearance` | bore or part | `skiros:Diameter` of the bore minus the width of the part |
| `skiros:SearchRadius` | bore or part | 3 sigma of `skiros:PoseCovariance`, plus 2 mm; 0.0052 without one |
| `skiros:InsertionAttempts` | bore or part | 6 |
| `skiros:GripWidth` | grasping pose of the part | not known |

A property of the bore takes precedence over that of the part.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from skiros2_common.core.errors import WrongValue
from skiros2_common.core.world_element import Element
from skiros2_common.core.world_model_port import WorldModelPort
from skiros2_contact_skills.pose_errors import position_deviation
from skiros2_motion.core.payload_estimate import GRAVITY
from skiros2_std_reasoners.core.scene_poses import has_size, size_of

DEPTH, DIAMETER, CHAMFER = "skiros:Depth", "skiros:Diameter", "skiros:Chamfer"
CLEARANCE, RADIUS, ATTEMPTS = "skiros:Clearance", "skiros:SearchRadius", "skiros:InsertionAttempts"
WIDTH = "skiros:GripWidth"

#: Of a part and a bore without these properties.
USUAL_DEPTH, USUAL_RADIUS, USUAL_ATTEMPTS = 0.06, 0.0052, 6
#: Depth below the rim at which a part is in the bore, and the largest part of the bore's depth that this may be.
_DROP, _LARGEST_DROP = 0.0012, 0.5
#: Standard deviations that a search covers, errors of grasp and arm, and its largest radius.
_SIGMAS, _OTHER_ERRORS, _LARGEST_RADIUS = 3.0, 0.002, 0.02


@dataclass(frozen=True)
class Fit:
    """Values of an insertion.

    :param depth: of the inserted part below the rim.
    :param clearance: difference of the diameters; None: not known.
    :param search_radius: of the spiral.
    :param drop_depth: below the rim, at which the bore is found.
    :param attempts: at most.
    """

    depth: float = USUAL_DEPTH
    clearance: float | None = None
    search_radius: float = USUAL_RADIUS
    drop_depth: float = _DROP
    attempts: int = USUAL_ATTEMPTS


def fit_of(wmi: WorldModelPort, part: Element | None, bore: Element | None) -> Fit:
    """Returns how a part fits into a bore; what the world model does not state has its default.

    :raises WrongValue: a property is not a number in its range, or the part is wider than the bore.
    """
    depth = _number(bore, DEPTH)
    clearance = _of_either(bore, part, CLEARANCE)
    diameter = _number(bore, DIAMETER)
    if clearance is None and part is not None and diameter is not None and has_size(part):
        width, other, _ = size_of(part)
        clearance = diameter - width if width == other else None  # others have a collar or a handle
    if clearance is not None and clearance < 0.0:
        raise WrongValue(f"{_name(part)} does not fit into {_name(bore)}: it is {-1000.0 * clearance:.2f} mm too wide")
    radius = _of_either(bore, part, RADIUS)
    if radius is None and bore is not None and (deviation := position_deviation(wmi, bore)) is not None:
        radius = min(_SIGMAS * deviation + _OTHER_ERRORS, _LARGEST_RADIUS)
    attempts = _of_either(bore, part, ATTEMPTS)
    if attempts is not None and (attempts < 1.0 or attempts != int(attempts)):
        raise WrongValue(f"{_name(bore)}, {_name(part)}: {ATTEMPTS} is {attempts:g}, expected 1, 2, ...")
    drop = _DROP + (_number(bore, CHAMFER) or 0.0)
    return Fit(
        depth or USUAL_DEPTH,
        clearance,
        USUAL_RADIUS if radius is None else radius,
        min(drop, _LARGEST_DROP * depth) if depth else drop,
        USUAL_ATTEMPTS if attempts is None else int(attempts),
    )


def grip_width(wmi: WorldModelPort, part: Element) -> float | None:
    """Returns the width of a part where it is gripped (m), `skiros:GripWidth` of its grasping pose; None if the world
    model does not state it.

    :raises WrongValue: it is not a length.
    """
    grasps = [each["dst"] for each in part.getRelations("-1", "skiros:hasA", "")]
    widths = [_number(wmi.get_element(grasp), WIDTH) for grasp in grasps]
    return next((width for width in widths if width is not None), None)


def weight_of(part: Element) -> float | None:
    """Returns the weight of a part (N), from `skiros:Weight` (kg); None if the world model does not state it.

    :raises WrongValue: it is not a number of 0 or more.
    """
    mass = _number(part, "skiros:Weight")
    return None if mass is None else mass * GRAVITY


def _of_either(bore: Element | None, part: Element | None, key: str) -> float | None:
    found = _number(bore, key)
    return _number(part, key) if found is None else found


def _number(element: Element | None, key: str) -> float | None:
    value = element.value_of(key) if element is not None else None
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value) or value < 0.0:
        raise WrongValue(f"{_name(element)}: {key} is {value!r}, expected a number of 0 or more")
    return float(value)


def _name(element: Element | None) -> str:
    return str((element.label or element.id) if element is not None else "the part")
