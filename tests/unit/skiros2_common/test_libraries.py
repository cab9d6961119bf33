"""Packages with skills are found where they lie: in the working directory and beside a scene."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path

import pytest

from skiros2_common.tools.libraries import find_libraries, libraries_beside


@pytest.fixture(autouse=True)
def path(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[list[str]]:
    """A copy of Python's path, and a working directory without packages."""
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    monkeypatch.setattr(sys, "path", [*sys.path])
    yield sys.path


def package(folder: Path) -> Path:
    folder.mkdir(parents=True)
    (folder / "__init__.py").touch()
    return folder


@pytest.mark.parametrize("place", ["tea_skills", "src/tea_skills", "tea_skills/src/tea_skills"])
@pytest.mark.parametrize("base", ["", "lab", "lab/owl"])
def test_package_is_found_beside_the_scene(tmp_path: Path, base: str, place: str) -> None:
    folder = package(tmp_path / base / place)
    (tmp_path / "lab/owl").mkdir(parents=True, exist_ok=True)
    find_libraries(["tea_skills.pots"], tmp_path / "lab/owl", tmp_path / "lab")
    assert sys.path[0] == str(folder.parent)
    spec = find_spec("tea_skills")
    assert spec is not None
    assert spec.origin == str(folder / "__init__.py")


def test_package_in_the_working_directory_comes_first(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    package(tmp_path / "lab/src/tea_skills")
    here = package(tmp_path / "here/tea_skills/src/tea_skills")
    monkeypatch.chdir(tmp_path / "here")
    find_libraries(["tea_skills"], tmp_path / "lab")
    assert sys.path[0] == str(here.parent)


def test_package_that_python_finds_stays(tmp_path: Path, path: list[str]) -> None:
    package(tmp_path / "lab/src/skiros2_std_skills")
    before = [*path]
    find_libraries(["skiros2_std_skills", "no_skills"], tmp_path / "lab")
    assert sys.path == before


def test_libraries_beside_a_scene(tmp_path: Path) -> None:
    assert libraries_beside(tmp_path / "lab/owl/scene.ttl") == []
    package(tmp_path / "lab/owl/flat_skills")
    assert libraries_beside(tmp_path / "lab/owl/scene.ttl") == ["flat_skills"]
    package(tmp_path / "lab/src/tea_skills")
    package(tmp_path / "lab/src/cup_skills")
    assert libraries_beside(tmp_path / "lab/owl/scene.ttl") == ["cup_skills", "tea_skills"]
