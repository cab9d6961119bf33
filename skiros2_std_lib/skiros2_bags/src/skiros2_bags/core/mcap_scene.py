"""The cell of a run for Foxglove's 3D view: frames and shapes of elements, and the robots, with their meshes.

Messages are JSON with Foxglove's schemas `FrameTransform` and `SceneUpdate`. Each element has topics of its own,
`/scene/frames/ID` and `/scene/elements/ID`: a viewer that jumps to a time reads the last message of each topic. The
robots are at `/scene/robots`, at the frames of tf.
"""

from __future__ import annotations

import base64
import json
import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any
from urllib.parse import unquote

from skiros2_bags.core.bag_file import MONITOR
from skiros2_bags.core.run import Run
from skiros2_common.core.errors import WrongValue
from skiros2_live.core.markers import BOX, CYLINDER, MESH, SPHERE, MarkerFactory, RobotPart, read_robot
from skiros2_world_model.core.replica import apply_change
from skiros2_world_model.core.scene import Scene

FRAME, SCENE = "foxglove.FrameTransform", "foxglove.SceneUpdate"

#: Kinds of meshes. Other files, which a bag of other people may name, are not copied.
_MEDIA = {".stl": "model/stl", ".dae": "model/vnd.collada+xml", ".obj": "model/obj", ".glb": "model/gltf-binary"}
_MAX_MESH = 50_000_000  # bytes
_WHITE = (1.0, 1.0, 1.0, 1.0)


def _object(**fields: Any) -> dict[str, Any]:
    return {"type": "object", "properties": fields}


def _list(items: dict[str, Any]) -> dict[str, Any]:
    return {"type": "array", "items": items}


_TEXT, _NUMBER, _BOOL, _INTEGER = ({"type": name} for name in ("string", "number", "boolean", "integer"))
_TIME = _object(sec=_INTEGER, nsec=_INTEGER)
_VECTOR = _object(x=_NUMBER, y=_NUMBER, z=_NUMBER)
_ROTATION = _object(x=_NUMBER, y=_NUMBER, z=_NUMBER, w=_NUMBER)
_COLOUR = _object(r=_NUMBER, g=_NUMBER, b=_NUMBER, a=_NUMBER)
_SHAPE = {"pose": _object(position=_VECTOR, orientation=_ROTATION), "color": _COLOUR}
_BYTES = {"type": "string", "contentEncoding": "base64"}
_ENTITY = _object(
    timestamp=_TIME, frame_id=_TEXT, id=_TEXT, lifetime=_TIME, frame_locked=_BOOL,
    metadata=_list(_object(key=_TEXT, value=_TEXT)), arrows=_list(_object()),
    cubes=_list(_object(**_SHAPE, size=_VECTOR)), spheres=_list(_object(**_SHAPE, size=_VECTOR)),
    cylinders=_list(_object(**_SHAPE, size=_VECTOR, bottom_scale=_NUMBER, top_scale=_NUMBER)),
    lines=_list(_object()), triangles=_list(_object()), texts=_list(_object()),
    models=_list(
        _object(**_SHAPE, scale=_VECTOR, override_color=_BOOL, url=_TEXT, media_type=_TEXT, data=_BYTES)
    ),
)  # fmt: skip

#: JSON schemas of the messages, by name.
SCHEMAS = {
    FRAME: _object(
        timestamp=_TIME, parent_frame_id=_TEXT, child_frame_id=_TEXT, translation=_VECTOR, rotation=_ROTATION
    ),
    SCENE: _object(deletions=_list(_object(timestamp=_TIME, type=_INTEGER, id=_TEXT)), entities=_list(_ENTITY)),
}


def scene_messages(run: Run) -> Iterator[tuple[float, str, str, bytes]]:
    """Yields time (s since the epoch), topic, schema and JSON of the messages, the oldest first.

    :raises BagError: the bag cannot be read.
    """
    meshes = _Meshes()
    entities = list(_robots(run, meshes))
    if entities:
        yield run.start, "/scene/robots", SCENE, _json({"deletions": [], "entities": entities})
    if MONITOR not in run.topics.values():
        return
    tf = run.messages("/tf", "/tf_static")
    moved = {t.child_frame_id.lstrip("/") for message in tf for t in message.content.transforms}
    factory, scene = MarkerFactory(lambda child, parent: child == parent), Scene()
    shown: dict[str, Any] = {}
    for timed in run.changes():
        changed = apply_change(scene, timed.change)
        for eid in changed.records:
            element = scene.element(eid)
            marker = factory.make(element) if element is not None else None
            stamp = _time(timed.time)
            if marker is None:
                if shown.pop(eid, None) is not None:
                    gone = {"deletions": [{"timestamp": stamp, "type": 0, "id": eid}], "entities": []}
                    yield timed.time, f"/scene/elements/{eid}", SCENE, _json(gone)
                continue
            own, visual = marker.own_frame, marker.visual
            before, shown[eid] = shown.get(eid, (None, None)), ((marker.frame, marker.pose), visual)
            if own not in moved and before[0] != shown[eid][0]:
                frame = {
                    "timestamp": stamp,
                    "parent_frame_id": marker.frame,
                    "child_frame_id": own,
                    **_moved(marker.pose),
                }
                yield timed.time, f"/scene/frames/{eid}", FRAME, _json(frame)
            if before[1] != visual:
                here = marker.pose._replace(position=(0.0, 0.0, 0.0), orientation=(0.0, 0.0, 0.0, 1.0))
                part = RobotPart(own, here, visual.shape, visual.size, visual.mesh, visual.colour)
                shape = {**_entity(eid, own, stamp), **_shapes([part], meshes)}
                yield timed.time, f"/scene/elements/{eid}", SCENE, _json({"deletions": [], "entities": [shape]})


def _robots(run: Run, meshes: _Meshes) -> Iterator[dict[str, Any]]:
    """Yields an entity for each link of the robots."""
    for name, (urdf, prefix) in run.robot_descriptions().items():
        links: dict[str, list[RobotPart]] = {}
        try:
            for part in read_robot(urdf, prefix.rstrip("/")):
                links.setdefault(part.frame, []).append(part)
        except WrongValue:
            continue  # the other robots are shown
        for frame, parts in links.items():
            yield {**_entity(f"{name} {frame}", frame, _time(run.start)), **_shapes(parts, meshes)}


class _Meshes:
    """Reads the files of meshes, each once."""

    def __init__(self) -> None:
        self._files: dict[str, dict[str, str] | None] = {}

    def model(self, url: str) -> dict[str, str] | None:
        """Returns media type and data of a mesh; None if its file is missing on this machine."""
        if url not in self._files:
            path = _path(url)
            is_mesh = path is not None and path.suffix.lower() in _MEDIA and path.is_file()
            self._files[url] = None
            if path is not None and is_mesh and path.stat().st_size <= _MAX_MESH:
                data = base64.b64encode(path.read_bytes()).decode()
                self._files[url] = {"media_type": _MEDIA[path.suffix.lower()], "data": data}
        return self._files[url]


def _path(url: str) -> Path | None:
    if not url.startswith("package://"):
        return Path(unquote(url.removeprefix("file://")))
    package, _, rest = url.removeprefix("package://").partition("/")
    for root in map(Path, filter(None, os.environ.get("ROS_PACKAGE_PATH", "").split(":"))):
        for folder in (root / package, *root.glob(f"*/{package}")):
            if (folder / "package.xml").is_file():
                return folder / rest
    return None


def _entity(name: str, frame: str, stamp: dict[str, int]) -> dict[str, Any]:
    lists = ("metadata", "arrows", "cubes", "spheres", "cylinders", "lines", "triangles", "texts", "models")
    entity = {"timestamp": stamp, "frame_id": frame, "id": name, "lifetime": {"sec": 0, "nsec": 0}}
    return {**entity, "frame_locked": True, **{key: [] for key in lists}}


def _shapes(parts: Sequence[RobotPart], meshes: _Meshes) -> dict[str, list[dict[str, Any]]]:
    found: dict[str, list[dict[str, Any]]] = {"cubes": [], "spheres": [], "cylinders": [], "models": []}
    for part in parts:
        moved = _moved(part.pose)
        shape = {
            "pose": {"position": moved["translation"], "orientation": moved["rotation"]},
            "color": dict(zip("rgba", part.colour or _WHITE, strict=True)),
        }
        size = dict(zip("xyz", part.size, strict=True))
        if part.shape == MESH:
            if (model := meshes.model(part.mesh)) is not None:
                scale = size if any(part.size) else {"x": 1.0, "y": 1.0, "z": 1.0}
                more = {"scale": scale, "override_color": part.colour is not None, "url": ""}
                found["models"].append({**shape, **more, **model})
        elif part.shape == CYLINDER:
            found["cylinders"].append({**shape, "size": size, "bottom_scale": 1.0, "top_scale": 1.0})
        elif part.shape in (BOX, SPHERE):
            found["cubes" if part.shape == BOX else "spheres"].append({**shape, "size": size})
    return found


def _moved(pose: Any) -> dict[str, Any]:
    position, orientation = zip("xyz", pose.position, strict=True), zip("xyzw", pose.orientation, strict=True)
    return {"translation": dict(position), "rotation": dict(orientation)}


def _time(seconds: float) -> dict[str, int]:
    nanoseconds = round(seconds * 1e9)
    return {"sec": nanoseconds // 10**9, "nsec": nanoseconds % 10**9}


def _json(data: dict[str, Any]) -> bytes:
    return json.dumps(data).encode()
