"""Newcomers: readers of tutorials with a home folder, a clone in it, and the set-ups that the tutorials name."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from types import TracebackType

from skiros2_common.core.processes import free_port
from support.ros import ROOT, Ros, RosMaster, run_command
from support.setups import PIP, PIP_LEARNING, environment_of
from support.tutorial import Reader, needs

#: The tutorials with ROS, in the order of their numbers.
_ALL = sorted((ROOT / "docs/tutorials").glob("[0-9]*.md"))
PAGES = [page for page in _ALL if needs(page).setup not in (PIP, PIP_LEARNING)]


class Newcomer:
    """Follows tutorials on a ROS master. A context manager that ends what was left running.

    :param home: its home folder, which gets a clone in `skiros2`.
    """

    def __init__(self, home: Path, master: RosMaster) -> None:
        self.home = home
        self._master = master
        self._ros = Ros(master)
        self._followed: set[Path] = set()
        (home / "skiros2").symlink_to(ROOT)
        disabled = "genlisp:gencpp:geneus:gennodejs"
        # the journal is in ROS_HOME: what another newcomer has changed is not in the history of this one
        own = {"HOME": str(home), "ROS_HOME": f"{home}/.ros", "TERM": "dumb"}
        env = {**master.env, **own, "ROS_LANG_DISABLE": disabled}
        self._reader = Reader(home, env, partial(run_command, timeout=150), {"8765": str(free_port())})

    def __enter__(self) -> Newcomer:
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()

    def follow(self, page: Path) -> None:
        """Follows a tutorial, after those that it needs and that were not followed yet.

        Each is followed with the Python packages of the set-up that it needs. One that was wrong is not repeated: the
        later ones are about its effects, not about its text.

        :raises Wrong: one does not show what happens.
        """
        for each in [*needs(page).all_pages(), page]:
            if each == page or each not in self._followed:
                self._followed.add(each)
                self._follow(each)

    def _follow(self, page: Path) -> None:
        setup = needs(page).setup
        folder = self.home / ".setups" / setup.replace(" ", "_")
        env = environment_of(setup, folder)
        self._reader.follow(page, {**env, "PYTHONPATH": f"{env['PYTHONPATH']}:{self._master.env['PYTHONPATH']}"})
        self._master.set_parameter("/use_sim_time", False)  # a newcomer's next roslaunch starts a new master

    def check_package(self) -> None:
        """Runs the tests of the package that the tutorials make.

        :raises Wrong: one fails.
        """
        self._reader.check_package(self.home / "ws/src/my_skills")

    def close(self) -> None:
        """Ends all programs."""
        self._reader.__exit__()
        self._ros.stop()
