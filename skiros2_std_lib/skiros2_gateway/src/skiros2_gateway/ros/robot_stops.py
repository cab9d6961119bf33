"""Stops, pauses and resumes tasks of robots: each robot by a thread and a connection of its own."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Collection, Sequence
from concurrent.futures import ThreadPoolExecutor

from skiros2_common.core.errors import SkirosError, TimedOut, UnknownName
from skiros2_common.core.manager_names import matching_name
from skiros2_common.core.names import nearest
from skiros2_skill.client.manager import ALL
from skiros2_skill.client.stop_line import StopLine

#: How long a command may take (s).
TIME_LIMIT = 2.0
#: Commands at once; nothing else uses these threads, and each is free again after its time limit.
_THREADS = 64
#: The command of a skill manager for an action.
_COMMANDS = {"stop": "preempt", "pause": "pause", "resume": "start"}


class RobotStops:
    """To be used in one thread, that of a loop. Call `close` at the end."""

    def __init__(self) -> None:
        self._lines: dict[str, StopLine] = {}
        self._threads = ThreadPoolExecutor(_THREADS, "stop")

    @property
    def robots(self) -> list[str]:
        """The node names of the robots' managers."""
        return sorted(self._lines)

    def set_robots(self, names: Collection[str]) -> None:
        """Opens connections to new robots, and closes those to robots that are gone."""
        for name in set(self._lines) - set(names):
            self._lines.pop(name).close()
        for name in set(names) - set(self._lines):
            self._lines[name] = StopLine(name)
            self._lines[name].keep_open()

    def close(self) -> None:
        self.set_robots(())
        self._threads.shutdown(wait=False, cancel_futures=True)

    async def command(
        self, action: str, robots: Sequence[str], author: str, task: int = ALL, limit: float = TIME_LIMIT
    ) -> dict[str, int]:
        """Preempts, pauses or resumes (`stop`, `pause`, `resume`) tasks.

        :param robots: none named: all.
        :param task: of one robot, or `ALL`.
        :param limit: how long it may take (s).
        :returns: the number of tasks by robot.
        :raises UnknownName: such a robot is not connected; nothing was done.
        :raises SkirosError: robots have refused, or have not answered in time and do not do it later.
        """
        deadline, loop = time.monotonic() + min(limit, TIME_LIMIT), asyncio.get_running_loop()
        names = [self._name(robot) for robot in robots] if robots else self.robots

        def send(line: StopLine) -> list[int]:
            return line.send(author, _COMMANDS[action], task, deadline - time.monotonic())

        sent = [loop.run_in_executor(self._threads, send, self._lines[name]) for name in names]
        answers = dict(zip(names, await asyncio.gather(*sent, return_exceptions=True), strict=True))
        done: dict[str, int] = {}
        failed: dict[str, BaseException] = {}
        for name, answer in answers.items():
            if isinstance(answer, BaseException):
                failed[name] = answer
            else:
                done[name] = len(answer)
        if failed:
            others = f"; done for {', '.join(done)}" if done else ""
            text = "; ".join(f"{name}: {error}" for name, error in failed.items()) + others
            first = next(iter(failed.values()))
            if isinstance(first, SkirosError) and not isinstance(first, TimedOut) and not done:
                raise first
            raise TimedOut(text)
        return done

    def _name(self, robot: str) -> str:
        name = matching_name(robot, self._lines)
        if not name:
            near = ", ".join(nearest(robot, self._lines) or self.robots) or "none"
            raise UnknownName(f"no robot {robot!r} is connected; near: {near}")
        return name
