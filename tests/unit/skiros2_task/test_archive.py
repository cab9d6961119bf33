"""The archive of planning requests."""

from __future__ import annotations

import logging
from pathlib import Path

import pytest

from skiros2_task.core.store import Archive


def test_request_has_folder_and_latest_pddl_is_on_top(tmp_path: Path) -> None:
    archive = Archive(tmp_path / "planner")
    archive.keep({"domain.pddl": "one", "p01.pddl": "p", "goal.txt": "g"})
    archive.keep({"domain.pddl": "two", "p01.pddl": "p"})
    top = tmp_path / "planner"
    assert {p.name: p.read_text() for p in top.iterdir() if p.is_file()} == {
        "domain.pddl": "two",
        "p01.pddl": "p",
    }
    kept = sorted(sorted(f.name for f in p.iterdir()) for p in top.iterdir() if p.is_dir())
    assert kept == [["domain.pddl", "goal.txt", "p01.pddl"], ["domain.pddl", "p01.pddl"]]


def test_old_requests_are_pruned_and_other_files_kept(tmp_path: Path) -> None:
    (tmp_path / "mine").mkdir()
    archive = Archive(tmp_path, count=3)
    for _ in range(5):
        archive.keep({"goal.txt": "g"})
    assert len([p for p in tmp_path.iterdir() if p.is_dir()]) == 4
    assert (tmp_path / "mine").is_dir()


def test_oldest_requests_are_pruned_first_within_a_second(tmp_path: Path) -> None:
    archive = Archive(tmp_path, count=3)
    for number in range(20):
        archive.keep({"goal.txt": str(number)})
    assert {(p / "goal.txt").read_text() for p in tmp_path.iterdir()} == {"17", "18", "19"}


def test_unwritable_folder_is_logged(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    (tmp_path / "planner").write_text("a file")
    with caplog.at_level(logging.WARNING):
        Archive(tmp_path / "planner").keep({"goal.txt": "g"})
    assert "not archived" in caplog.text
