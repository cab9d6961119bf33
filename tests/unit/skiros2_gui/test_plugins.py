"""Plug-ins of the window in other packages."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest

from skiros2_common.ros.plugins import load_plugins

PACKAGE = """<package format="2"><name>{name}</name><version>1.0.0</version><description>d</description>
<maintainer email="a@b.cd">m</maintainer><license>BSD</license>
<export><skiros2_gui plugin="{module}"/></export></package>"""


def add_package(folder: Path, name: str, module: str = "") -> Path:
    """Adds a package with a plug-in; returns its package.xml."""
    manifest = folder / "ros" / name / "package.xml"
    manifest.parent.mkdir(parents=True)
    manifest.write_text(PACKAGE.format(name=name, module=module or name))
    (folder / f"{module or name}.py").write_text("VALUE = 1")
    return manifest


def load(folder: Path, monkeypatch: pytest.MonkeyPatch, *underlays: Path) -> list[str]:
    """Returns the plug-ins that are loaded with the packages of a folder on ROS_PACKAGE_PATH."""
    monkeypatch.setenv("ROS_PACKAGE_PATH", os.pathsep.join(map(str, (folder / "ros", *underlays))))
    monkeypatch.syspath_prepend(str(folder))
    return load_plugins("skiros2_gui")


def test_exported_modules_are_imported_and_broken_ones_logged(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    add_package(tmp_path, "sound_plugin")
    add_package(tmp_path, "broken_plugin")
    (tmp_path / "broken_plugin.py").write_text("1 / 0")
    assert load(tmp_path, monkeypatch) == ["sound_plugin"]
    assert sys.modules["sound_plugin"].VALUE == 1
    assert "broken_plugin" in caplog.text


@pytest.mark.parametrize(
    "broken", [b"<package", b"\xff\xfe\x00", b"", b"<package/>", b"<package><name>p</name></package>"]
)
def test_package_xml_that_cannot_be_read_is_reported_once_and_skipped(
    broken: bytes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    add_package(tmp_path, "a_broken").write_bytes(broken)
    add_package(tmp_path, "sound_plugin")
    assert load(tmp_path, monkeypatch) == ["sound_plugin"]
    (record,) = caplog.records
    assert str(tmp_path / "ros/a_broken/package.xml") in record.getMessage()


def test_ignored_and_overlaid_packages_are_not_loaded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    add_package(tmp_path, "ignored_plugin")
    (tmp_path / "ros/ignored_plugin/CATKIN_IGNORE").touch()
    add_package(tmp_path, "same", "new_plugin")
    add_package(tmp_path / "underlay", "same", "old_plugin")
    assert load(tmp_path, monkeypatch, tmp_path / "underlay/ros") == ["new_plugin"]
