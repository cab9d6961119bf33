"""What the force over the depth says about a latch."""

from __future__ import annotations

from collections.abc import Sequence

import pytest

from skiros2_contact_skills.core.latch_signature import Expected, LatchSignature, Verdict

#: A latch of 18 N, 3 mm above the floor.
EXPECTED = Expected(earliest=0.012, force=18.0, travel=0.003, force_tolerance=0.3, travel_tolerance=0.0015)


def signature(points: Sequence[tuple[float, float]]) -> LatchSignature:
    """Returns the signature of depths (mm) and forces (N)."""
    recorded = LatchSignature(EXPECTED)
    for depth, force in points:
        recorded.add(depth / 1000.0, force)
    return recorded


CLICK = [(2.0, 0.5), (14.0, 1.0), (15.5, 9.0), (16.9, 17.5), (18.5, 2.0), (20.0, 7.0)]


@pytest.mark.parametrize(
    ("points", "verdict"),
    [
        (CLICK, Verdict.LATCHED),
        ([(depth, force + 9.0) for depth, force in CLICK], Verdict.LATCHED),  # with friction
        ([*CLICK, (20.0, 35.0)], Verdict.LATCHED),  # the floor presses harder than the latch
        ([(2.0, 19.0), (4.0, 1.0), *CLICK[1:]], Verdict.LATCHED),  # friction at the entry is not the latch
        ([(2.0, 19.0), (4.0, 1.0)], Verdict.NO_CLICK),
        (CLICK[:4], Verdict.NO_CLICK),
        ([(2.0, 0.5), (20.0, 1.0), (20.0, 28.0)], Verdict.NO_CLICK),  # the latch is missing
        ([(2.0, 0.5), (20.0, 35.0), (20.1, 15.0), (20.0, 28.0)], Verdict.NO_CLICK),  # and the floor is hit
        ([(15.0, 4.0), (16.9, 9.0), (18.5, 0.5), (20.0, 7.0)], Verdict.WRONG_FORCE),
        ([(15.0, 9.0), (16.9, 26.0), (18.5, 0.5), (20.0, 7.0)], Verdict.WRONG_FORCE),
        ([(11.0, 9.0), (13.0, 18.0), (15.0, 0.5), (20.0, 7.0)], Verdict.WRONG_DEPTH),
        ([(15.0, 9.0), (17.0, 18.0), (18.0, 4.0), (18.0, 7.0)], Verdict.WRONG_DEPTH),  # it does not reach the floor
        ([], Verdict.NO_CLICK),
    ],
)
def test_verdict(points: Sequence[tuple[float, float]], verdict: Verdict) -> None:
    assert signature(points).verdict is verdict


def test_values_are_peak_with_its_depth_force_after_it_and_last_depth() -> None:
    assert signature([*CLICK, (20.0, 35.0)]).values() == pytest.approx([17.5, 0.0169, 2.0, 0.020])


def test_force_without_a_click_has_no_drop() -> None:
    recorded = signature(CLICK[:4])
    assert not recorded.has_clicked
    assert recorded.values() == pytest.approx([17.5, 0.0169, 17.5, 0.0169])
