"""Plug-ins of the window in other packages."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from skiros2_common.ros.plugins import load_plugins

PACKAGE = """<package format="2"><name>{name}</name><version>1.0.0</version><description>d</description>
<maintainer email="a@b.cd">m</maintainer><license>BSD</license>
<export><skiros2_gui plugin="{module}"/></export></package>"""


def test_exported_modules_are_imported_and_broken_ones_logged(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    for name, source in (("sound_plugin", "VALUE = 1"), ("broken_plugin", "1 / 0")):
        package = tmp_path / "ros" / name
        package.mkdir(parents=True)
        (package / "package.xml").write_text(PACKAGE.format(name=name, module=name))
        (tmp_path / f"{name}.py").write_text(source)
    monkeypatch.setenv("ROS_PACKAGE_PATH", str(tmp_path / "ros"))
    monkeypatch.syspath_prepend(str(tmp_path))
    assert load_plugins("skiros2_gui") == ["sound_plugin"]
    assert sys.modules["sound_plugin"].VALUE == 1
    assert "broken_plugin" in caplog.text
