"""Each tutorial shows what happens: its commands are typed, its files written and its outputs compared.

The tutorials are followed in order, in one home folder, as a newcomer does: each may use what earlier ones have made.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

from skiros2_common.core.processes import free_port
from support.ros import ROOT, Ros, RosMaster, run_command
from support.tutorial import Reader

pytestmark = pytest.mark.timeout(180)
PAGES = sorted((ROOT / "docs/tutorials").glob("[0-9]*.md"))


@pytest.fixture(scope="module")
def reader(ros_master: RosMaster, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Reader]:
    """A newcomer whose home folder has a clone in `skiros2`."""
    home = tmp_path_factory.mktemp("home")
    (home / "skiros2").symlink_to(ROOT)
    ros = Ros(ros_master)
    env = {**ros_master.env, "HOME": str(home), "TERM": "dumb", "ROS_LANG_DISABLE": "genlisp:gencpp:geneus:gennodejs"}
    with Reader(home, env, run_command, {"8765": str(free_port())}) as made:
        yield made
    ros.stop()
    shutil.rmtree(home)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_tutorial_shows_what_happens(reader: Reader, ros_master: RosMaster, page: Path) -> None:
    reader.follow(page)
    ros_master.set_parameter("/use_sim_time", False)  # a newcomer's next roslaunch starts a new master
