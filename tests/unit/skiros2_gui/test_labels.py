"""Where labels are drawn in 3D."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import pytest

from skiros2_gui.view3d.marker_set import LINE, MAX_LINES, place_labels
from skiros2_live.core.markers import AXES, BOX, TEXT_HEIGHT, ElementMarker, Visual
from skiros2_motion.core.geometry import Pose, from_euler

_UPRIGHT = (0.0, 0.0, 0.0, 1.0)


def _marker(eid: str, x: float, z: float = 0.0, frame: str = "map", text: str = "label") -> ElementMarker:
    visual = Visual("skiros:Product", 1, text, AXES, (0.0, 0.0, 0.0), "", (1.0, 1.0, 1.0, 1.0), "")
    return ElementMarker(eid, frame, Pose((x, 0.0, z), _UPRIGHT), visual, eid)


def _lifts(*markers: ElementMarker) -> dict[str, float | None]:
    return place_labels({marker.id: marker for marker in markers})


def test_labels_apart_stay_in_their_place() -> None:
    assert _lifts(_marker("a", 0.0), _marker("b", 1.0), _marker("c", 0.0, z=0.9)) == {"a": 0.0, "b": 0.0, "c": 0.0}


def test_close_labels_are_stacked() -> None:
    lifts = _lifts(_marker("a", 0.0), _marker("b", 0.0), _marker("c", 0.0, z=0.02))
    assert lifts["a"] == 0.0
    assert lifts["b"] == pytest.approx(LINE)
    assert lifts["c"] == pytest.approx(2 * LINE - 0.02)


def test_label_beside_another_one_is_raised_so_that_it_is_apart_from_above() -> None:
    lifts = _lifts(_marker("a", 0.0), _marker("b", 0.1))
    assert lifts["b"] is not None and lifts["b"] > LINE + 0.04


def test_label_of_a_large_element_is_above_those_of_small_ones() -> None:
    table = replace(_marker("table", 0.0), visual=replace(_marker("", 0.0).visual, shape=BOX, size=(1.0, 2.0, 0.0)))
    lifts = _lifts(table, _marker("nut", 0.2, z=0.02))
    assert lifts["nut"] == 0.0 and lifts["table"] is not None and lifts["table"] > LINE


def test_long_labels_need_more_room() -> None:
    texts = ("In front of a workstation", "Charging station")
    lifts = _lifts(*(_marker(text, 0.5 * n, text=text) for n, text in enumerate(texts)))
    assert lifts[texts[0]] != lifts[texts[1]]


def test_frames_of_other_elements_are_followed() -> None:
    turned = replace(_marker("box", 5.0), pose=Pose((5.0, 0.0, 0.0), from_euler(0.0, 0.0, math.pi)))
    far = _lifts(turned, _marker("inside", -1.0, frame="box"), _marker("other", 6.0))
    assert sorted(lift or 0.0 for lift in far.values()) == pytest.approx([0.0, 0.0, LINE])


def test_cycle_of_frames_is_ignored() -> None:
    assert _lifts(_marker("a", 0.0, frame="b"), _marker("b", 0.0, frame="a")) == {"a": 0.0, "b": 0.0}


def test_labels_are_hidden_where_they_are_too_dense() -> None:
    lifts = _lifts(*(_marker(f"e{n}", 0.0) for n in range(20)))
    shown = sorted(lift for lift in lifts.values() if lift is not None)
    assert len(shown) == MAX_LINES + 1
    assert all(after - before > TEXT_HEIGHT for before, after in itertools.pairwise(shown))
