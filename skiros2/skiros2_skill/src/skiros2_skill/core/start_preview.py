"""What a start of skills would do, as clients see it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from skiros2_common.core.explanation import Explanation
from skiros2_common.core.world_element import Element


@dataclass(frozen=True)
class StartPreview:
    """What a start would do.

    :param label: of the implementation that would run the first skill; "" if none would.
    :param elements: the inferred elements and the robot, by key; without their properties.
    :param values: of all parameters of the first skill, by key, as JSON data; elements by their ids.
    :param refusal: why the skills would not start; None if they would.
    """

    label: str = ""
    elements: Mapping[str, Element] = field(default_factory=dict)
    values: Mapping[str, list[Any]] = field(default_factory=dict)
    refusal: Explanation | None = None
