"""The markers of elements, also invalid ones, and of changes."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from skiros2_common.core.world_element import Element
from skiros2_gui.view3d.marker_set import MarkerSet
from skiros2_live.core.markers import AXES, BOX, MESH, MarkerFactory, view_number
from skiros2_motion.core.geometry import Pose
from skiros2_std_reasoners.core import spatial_data as space

PARENTS = {"skiros:Product": "skiros:Manipulatable", "demo:Arm": "sumo:Device", "demo:Shelf": "skiros:Location"}


def is_subclass(child: str, parent: str) -> bool:
    return PARENTS.get(child) == parent


def placed(eid: str = "skiros:Product-7", label: str = "Bolt", x: float = 1.0, **properties: object) -> Element:
    element = Element(eid.rpartition("-")[0], label, eid)
    space.set_pose(element, Pose((x, 2.0, 3.0), (0.0, 0.0, 0.0, 1.0)))
    space.set_text(element, space.BASE_FRAME, "map")
    for key, value in properties.items():
        element.setProperty(f"skiros:{key}", value)
    return element


def sized(x: float, y: float, z: float, **more: object) -> Element:
    return placed(SizeX=x, SizeY=y, SizeZ=z, **more)


@pytest.fixture
def factory(tmp_path: Path) -> MarkerFactory:
    (tmp_path / "bolt.stl").touch()
    return MarkerFactory(is_subclass, [tmp_path])


# -- shapes ------------------------------------------------------------------------------------------------------


def test_element_with_size_is_drawn_as_box(factory: MarkerFactory) -> None:
    marker = factory.make(sized(0.2, 0.4, 0.6))
    assert marker is not None and marker.visual.shape == BOX and marker.visual.size == (0.2, 0.4, 0.6)
    assert (marker.frame, marker.pose.position, marker.visual.text) == ("map", (1.0, 2.0, 3.0), "Bolt")
    assert marker.text_position == pytest.approx((1.0, 2.0, 3.0 + 0.3 + 0.08))


def test_element_with_mesh_is_drawn_as_mesh(factory: MarkerFactory, tmp_path: Path) -> None:
    marker = factory.make(sized(1.0, 1.0, 1.0, CadModel="bolt.stl"))
    assert marker is not None and (marker.visual.shape, marker.visual.mesh) == (MESH, f"file://{tmp_path}/bolt.stl")
    package = factory.make(placed(CadModel="package://parts/bolt.dae"))
    assert package is not None and package.visual.mesh == "package://parts/bolt.dae"


@pytest.mark.parametrize("model", ["arm.urdf", "nowhere.stl", "\0.stl", "x" * 5000 + ".stl", ".", "", "../.stl"])
def test_invalid_mesh_falls_back_to_box(factory: MarkerFactory, model: str) -> None:
    marker = factory.make(sized(1.0, 1.0, 1.0, CadModel=model))
    assert marker is not None and marker.visual.shape == BOX


@pytest.mark.parametrize("size", [(0.0, 1.0, 1.0), (-1.0, 1.0, 1.0), (float("nan"), 1.0, 1.0), (1e30, 1.0, 1.0)])
def test_element_without_valid_size_is_drawn_as_axes(factory: MarkerFactory, size: tuple[float, float, float]) -> None:
    marker = factory.make(sized(*size))
    assert marker is not None and (marker.visual.shape, marker.visual.size) == (AXES, (0.0, 0.0, 0.0))


@pytest.mark.parametrize(
    "spoil",
    [
        lambda e: e.removeProperty(space.POSITION[0]),
        lambda e: e.setProperty(space.POSITION[0], float("nan")),
        lambda e: e.setProperty(space.POSITION[0], 1e30),
        lambda e: e.removeProperty(space.BASE_FRAME),
        lambda e: space.set_text(e, space.BASE_FRAME, "skiros:Product-7"),
        lambda e: space.set_text(e, space.FRAME, "map"),
    ],
)
def test_element_without_valid_pose_has_no_marker(factory: MarkerFactory, spoil: Callable[[Element], None]) -> None:
    element = placed()
    spoil(element)
    assert factory.make(element) is None


def test_marker_text_is_label_or_id(factory: MarkerFactory) -> None:
    texts = [factory.make(placed(label=label)) for label in ("", "demo:left_arm", "a" * 500)]
    assert [marker.visual.text for marker in texts if marker] == ["Product-7", "left_arm", "a" * 59 + "…"]


def test_colours_differ_by_class_and_are_stable(factory: MarkerFactory) -> None:
    elements = [placed(f"{etype}-1") for etype in (*PARENTS, "odd:Thing")]
    colours = [marker.visual.colour for element in elements if (marker := factory.make(element))]
    assert len(set(colours)) == 4 and all(0.0 <= part <= 1.0 for colour in colours for part in colour)
    again = [marker.visual.colour for element in elements if (marker := MarkerFactory(is_subclass).make(element))]
    assert again == colours


def test_view_number_fits_int32() -> None:
    assert view_number("skiros:Product-7") == 7
    for odd in ("", "Product", "skiros:Product-99999999999", "skiros:Product--3"):
        assert 0 <= view_number(odd) < 2**31


def test_marker_update_contains_changed_visuals_only(factory: MarkerFactory) -> None:
    markers = MarkerSet(factory.make)
    one, two = placed("skiros:Product-1"), placed("skiros:Product-2")
    assert [s.id for s in markers.replace_all([one, two]).changed] == [one.id, two.id]
    two.setProperty("skiros:Weight", 3.0)
    assert not markers.replace({one.id: one, two.id: two})
    moved = markers.replace({two.id: placed(two.id, x=5.0), "skiros:Product-3": None})
    assert [s.pose.position[0] for s in moved.changed] == [5.0] and not moved.removed
    assert [s.id for s in markers.replace({one.id: None}).removed] == [one.id]
    two.removeProperty(space.BASE_FRAME)
    assert [s.id for s in markers.replace({two.id: two}).removed] == [two.id]
    assert markers.get(two.id) is None


def test_replace_all_removes_old_markers(factory: MarkerFactory) -> None:
    markers = MarkerSet(factory.make)
    markers.replace_all([placed("skiros:Product-1"), placed("skiros:Product-2")])
    update = markers.replace_all([placed("skiros:Product-2"), placed("skiros:Product-3")])
    assert [s.id for s in update.changed] == ["skiros:Product-3"]
    assert [s.id for s in update.removed] == ["skiros:Product-1"]


def test_labels_placed_are_kept_by_later_updates(factory: MarkerFactory) -> None:
    markers = MarkerSet(factory.make)
    one, two = placed("skiros:Product-1"), placed("skiros:Product-2")
    markers.replace_all([one, two])
    assert [marker.id for marker in markers.place_labels().changed] == [two.id]
    assert not markers.place_labels() and not markers.replace_all([one, two])
    moved = markers.replace({two.id: placed(two.id, x=5.0)})
    assert [marker.lift for marker in moved.changed] != [0.0]
    assert [marker.lift for marker in markers.place_labels().changed] == [0.0]
