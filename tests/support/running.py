"""The processes that work in a folder, to check that none remains."""

from __future__ import annotations

from pathlib import Path


def command(pid: int) -> str:
    """A process's command line; "" when it has ended."""
    try:
        return Path(f"/proc/{pid}/cmdline").read_bytes().replace(b"\0", b" ").decode()
    except OSError:
        return ""


def running_in(folder: Path) -> dict[int, str]:
    """The command lines of the processes that work in a folder or below; those that are ending have none."""
    working = [int(entry.name) for entry in Path("/proc").iterdir() if entry.name.isdigit() and works_in(entry, folder)]
    return {pid: line for pid, line in ((pid, command(pid)) for pid in working) if line}


def works_in(process: Path, folder: Path) -> bool:
    try:
        return (process / "cwd").readlink().is_relative_to(folder)
    except OSError:
        return False
