"""A re-run gives skills the times that they have read while they were recorded."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import pytest

import skiros2_bags.testing.rerun as rerun_module
from skiros2_bags.testing.recording import EvidenceEntries, Recording, TaskProgress, recorded_tasks
from skiros2_bags.testing.rerun import Settings, rerun
from support.ros import ROOT


def test_skills_read_the_recorded_times(monkeypatch: pytest.MonkeyPatch) -> None:
    """The times of ticks are estimated from the progress of nodes; what a skill decides by a clock must not be."""
    recording = Recording(ROOT / "tests/bags/timed_clock.bag")
    settings = Settings(ROOT / "skiros2_std_lib/demos/timed_skills/owl", max_orders=1)
    genuine = rerun_module.tick_times

    def slower(progress: Sequence[TaskProgress]) -> list[float]:
        first, *others = genuine(progress)
        return [first, *(first + 1.1 * (time - first) for time in others)]

    monkeypatch.setattr(rerun_module, "tick_times", slower)
    found = rerun(recording, settings)
    assert found.is_as_recorded, found
    recording.events = [replace(e, readings=()) if isinstance(e, EvidenceEntries) else e for e in recording.events]
    assert rerun(recording, settings).divergence is not None


def test_readings_of_unknown_ticks_are_not_used() -> None:
    recording = Recording(ROOT / "tests/bags/timed_clock.bag")
    assert recorded_tasks(recording)[0].readings
    without_last = max(e.order for e in recording.progress)
    recording.events = [e for e in recording.events if e.order != without_last]
    assert not recorded_tasks(recording)[0].readings
