"""Runs of the demo program, for tests."""

from __future__ import annotations

from pathlib import Path

from support.programs import ProcessId, Program
from support.ros import install_environment


class DemoRun:
    """One run of the demo with folders of its own.

    :param arguments: those that every start has.
    """

    def __init__(self, folder: Path, *arguments: str) -> None:
        self._arguments = arguments
        self.folder = folder
        self.temporary = folder / "tmp"
        self.temporary.mkdir()
        self.env = {**install_environment(), "TMPDIR": str(self.temporary), "HOME": str(folder)}
        self.env.pop("ROS_MASTER_URI", None)
        self.program: Program | None = None
        self.family: list[ProcessId] = []

    @property
    def bag(self) -> Path:
        return self.folder / "demo" / "run.bag"

    def start(self, *arguments: str) -> Program:
        command = [
            "rosrun",
            "skiros2_sim_skills",
            "pick_place_demo",
            "--folder",
            str(self.folder / "demo"),
            *self._arguments,
            *arguments,
        ]
        self.program = Program(command, self.env, cwd=self.folder)
        return self.program

    def end(self, *arguments: str, timeout: float = 60.0) -> tuple[int, str]:
        """Runs it to its end; gives status and output."""
        program = self.start(*arguments)
        return program.wait(timeout), program.output

    def check_run(self, bag: Path) -> tuple[int, str]:
        checker = Program(["rosrun", "skiros2_sim_skills", "check_run", str(bag)], self.env)
        return checker.wait(), checker.output

    def nothing_left(self) -> bool:
        return not any(process.running for process in self.family) and list(self.temporary.iterdir()) == []
