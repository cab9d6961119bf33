"""What was changed on an element."""

from __future__ import annotations

from dataclasses import dataclass, field

from skiros2_common.core.element_relations import RelationDict
from skiros2_common.core.property import Property


@dataclass
class ElementChanges:
    """What was changed on an element since a world model gave it out. False when nothing was."""

    properties: dict[str, Property] = field(default_factory=dict)
    removed_properties: list[str] = field(default_factory=list)
    added_relations: list[RelationDict] = field(default_factory=list)
    removed_relations: list[RelationDict] = field(default_factory=list)
    label: str | None = None
    type: str | None = None

    def __bool__(self) -> bool:
        return bool(
            self.properties
            or self.removed_properties
            or self.added_relations
            or self.removed_relations
            or self.label is not None
            or self.type is not None
        )
