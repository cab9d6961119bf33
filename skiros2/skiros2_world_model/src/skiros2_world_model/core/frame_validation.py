"""Validation of the frames that the spatial reasoner publishes on tf."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator
from typing import Any

from skiros2_common.core.world_element import REASONER_PROPERTY
from skiros2_world_model.core.changes import SPATIAL
from skiros2_world_model.core.ontology import Ontology
from skiros2_world_model.core.report import WARNING, Finding
from skiros2_world_model.core.scene import ROOT, Node, Scene

_SPATIAL_REASONER = "AauSpatialReasoner"
_PUBLISH = "skiros:PublishTf"
_POSE = [f"skiros:Position{axis}" for axis in "XYZ"] + [f"skiros:Orientation{axis}" for axis in "XYZW"]


def unconnected_frames(scene: Scene, ontology: Ontology, origin: str) -> Iterator[Finding]:
    """The published elements with a pose in the frame of an element of which no pose is known.

    A pose in the frame of an element that has a pose and is not published counts as one in the frame above that. An
    element without a pose may have a `skiros:FrameId` of its own: that frame is supposed to come from another node.
    """
    holding = ontology.subproperties(SPATIAL)
    for node in scene:
        if not _is_spatial(node) or not _is_published(node) or not _has_pose(node):
            continue
        frame, base, passed = node, _above(scene, holding, node), {node.id}
        while base is not None and base.id not in passed and _has_pose(base) and not _is_published(base):
            passed.add(base.id)
            frame, base = base, _above(scene, holding, base)
        if base is None or base.id == ROOT or _has_pose(base) or _text(base, "skiros:LinkedToFrameId"):
            continue
        if _text(base, "skiros:FrameId") in ("", base.id) and _text(frame, "skiros:BaseFrameId") in ("", base.id):
            text = f"its frame is connected to nothing: {base.id}, in whose frame it is, has no complete pose"
            yield Finding(WARNING, origin, node.id, _PUBLISH, text)


def _above(scene: Scene, holding: Collection[str], node: Node) -> Node | None:
    """The nearest element above that has a frame."""
    waiting, seen = [node.id], {node.id}
    for eid in waiting:
        for src, _, _ in scene.relations("", holding, eid):
            found = scene.node(src)
            if found is not None and src not in seen:
                if _is_spatial(found):
                    return found
                seen.add(src)
                waiting.append(src)
    return None


def _is_spatial(node: Node) -> bool:
    prop = node.properties.get(REASONER_PROPERTY)
    return prop is not None and _SPATIAL_REASONER in prop.values


def _is_published(node: Node) -> bool:
    return _text(node, _PUBLISH).lower() in ("", "true", "1")  # true by default


def _has_pose(node: Node) -> bool:
    try:
        return all(math.isfinite(float(_value(node, key))) for key in _POSE)
    except (TypeError, ValueError):
        return False


def _text(node: Node, key: str) -> str:
    value = _value(node, key)
    return "" if value is None else str(value)


def _value(node: Node, key: str) -> Any:
    prop = node.properties.get(key)
    return prop.value if prop is not None else None
