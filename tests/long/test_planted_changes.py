"""Each change of the catalogue is found by the re-run of one recorded run, or that re-run lists it as not compared."""

from __future__ import annotations

import functools
import sys
from collections import Counter

import pytest

from skiros2_bags.core.bag_file import BagError
from skiros2_bags.testing.recording import Recording
from skiros2_bags.testing.rerun import Settings, rerun
from skiros2_common.core.errors import SkirosError
from support.ros import ROOT

sys.path.append(str(ROOT / "tests" / "libraries"))
from support.planted_changes import CHANGES, PlantedChange

pytestmark = pytest.mark.long

WORKSPACE = ROOT / "skiros2_std_lib/demos/timed_skills/owl"


@functools.cache
def recording(bag: str) -> Recording:
    return Recording(ROOT / "tests" / "bags" / bag)


def test_catalogue_has_all_groups() -> None:
    numbers = Counter(change.group for change in CHANGES)
    assert len(CHANGES) >= 45
    assert all(number >= 8 for number in numbers.values()), numbers


@pytest.mark.parametrize("bag", sorted({change.bag for change in CHANGES}))
def test_unchanged_code_does_and_plans_what_is_recorded(bag: str) -> None:
    found = rerun(recording(bag), Settings(WORKSPACE, plans=True))
    assert found.is_as_recorded and not found.plans.different, found


@pytest.mark.parametrize("change", CHANGES, ids=str)
def test_change_is_found(change: PlantedChange, monkeypatch: pytest.MonkeyPatch) -> None:
    change.plant(monkeypatch)
    try:
        plans = change.group == "planner"
        found = rerun(recording(change.bag), Settings(WORKSPACE, change.played, max_orders=4, plans=plans))
    except (BagError, SkirosError) as error:
        assert not change.not_compared, error
        return
    if change.not_compared:
        assert any(change.not_compared in line for line in found.not_compared), found
    else:
        assert not found.is_as_recorded or found.plans.different, found
