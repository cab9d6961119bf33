"""The programs that take the screenshots of the docs."""

from __future__ import annotations

import signal
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest
from python_qt_binding.QtCore import Qt
from python_qt_binding.QtGui import QImage

from support.programs import Program, descendants
from support.ros import install_environment

pytestmark = [pytest.mark.long, pytest.mark.timeout(300)]

PICTURES = ("start", "goal", "skills", "running", "dark", "world", "rviz")
SCREENSHOTS = (sys.executable, "-m", "support.window.screenshots")
TESTS = Path(__file__).parents[1]
#: Of each picture (bytes).
MOST_BYTES = 200_000


def start(folder: Path, *command: str, path: Path = TESTS) -> Program:
    """Starts a program where there is no display and no master.

    :param path: of additional modules.
    """
    env = {**install_environment(), "HOME": str(folder)}
    for name in ("DISPLAY", "QT_QPA_PLATFORM", "ROS_MASTER_URI"):
        env.pop(name, None)
    env["PYTHONPATH"] = f"{path}:{TESTS}:{env.get('PYTHONPATH', '')}"
    return Program([*command, str(folder / "pictures")], env)


#: A package `rviz` whose first import crashes the process; later ones import Debian's.
CRASHES_ONCE = """
import os, signal, sys
from importlib.machinery import PathFinder
from pathlib import Path

here = Path(__file__).parent
crashed = here / "crashed"
if not crashed.exists():
    crashed.touch()
    os.kill(os.getpid(), signal.SIGSEGV)
spec = PathFinder.find_spec("rviz", [path for path in sys.path if Path(path) != here.parent])
__path__ = spec.submodule_search_locations
spec.loader.exec_module(sys.modules["rviz"])
"""


def test_screenshots_show_each_tab_during_a_run_also_if_rviz_crashes_once(tmp_path: Path) -> None:
    package = tmp_path / "python/rviz"
    package.mkdir(parents=True)
    (package / "__init__.py").write_text(CRASHES_ONCE)
    program = start(tmp_path, *SCREENSHOTS, path=package.parent)
    assert program.wait(280.0) == 0, program.output
    assert "rviz has crashed (SIGSEGV); starting it again" in program.output
    check(tmp_path, PICTURES)


def test_screenshots_of_cells_show_signals_and_teaching(tmp_path: Path) -> None:
    program = start(tmp_path, sys.executable, "-m", "support.window.cell_screenshots")
    assert program.wait(200.0) == 0, program.output
    check(tmp_path, ("signals", "teach"))


def check(tmp_path: Path, names: Sequence[str]) -> None:
    for name in names:
        path = tmp_path / f"pictures/window_{name}.png"
        picture = QImage(str(path))
        assert (picture.width(), picture.height()) == (1280, 800)
        assert path.stat().st_size < MOST_BYTES
        average = picture.scaled(1, 1, Qt.IgnoreAspectRatio, Qt.SmoothTransformation).pixelColor(0, 0)
        is_dark = average.lightness() < 128
        assert is_dark == (name in ("dark", "rviz"))


def test_terminated_screenshot_program_ends_its_processes(tmp_path: Path) -> None:
    program = start(tmp_path, *SCREENSHOTS)
    program.wait_for_line("window_start")
    family = descendants(program.pid)
    program.signal(signal.SIGTERM)
    assert program.wait(100.0) == 128 + signal.SIGTERM, program.output
    assert not any(process.running for process in family)
