"""A clean clone builds with `catkin_make_isolated`, which configures each package by itself."""

from __future__ import annotations

from pathlib import Path

import pytest

from support.builds import PYTHON, assert_all_is_found, clone, outside, run

pytestmark = pytest.mark.long


def test_catkin_make_isolated_builds_a_workspace_with_a_clone(tmp_path: Path) -> None:
    clone(tmp_path / "src/skiros2")
    env = outside() | {"ROS_LANG_DISABLE": "genlisp:gencpp:genpy"}  # messages are built by the other tests
    run("catkin_make_isolated", f"-DPYTHON_EXECUTABLE={PYTHON}", "-DCATKIN_ENABLE_TESTING=OFF", env=env, cwd=tmp_path)
    assert_all_is_found(tmp_path / "devel_isolated/setup.bash", messages="")
