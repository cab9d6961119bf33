"""Clean Debian systems: chroots with git and make only, and the network of this machine. They need root."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

#: What a chroot has of the network: names, certificates, mirrors of packages.
NETWORK = ("etc/resolv.conf", "etc/hosts", "etc/pip.conf", "etc/ssl/certs/ca-certificates.crt")
VARIABLES = ("NODE_EXTRA_CA_CERTS",)
#: Lays a system over the base and runs a command in it, in namespaces of its own: all mounts and processes end with it.
_ENTER = """
mount -t overlay overlay -o lowerdir=$1,upperdir=$2/changed,workdir=$2/work $2/root
for each in sys dev dev/pts dev/shm; do mount --bind /$each $2/root/$each; done
mount -t proc proc $2/root/proc
cd /
exec chroot $2/root "${@:3}"
"""
HOME = "/home/newcomer"


def can_make() -> bool:
    """Whether this process may make chroots."""
    return os.geteuid() == 0 and shutil.which("debootstrap") is not None


def make_base(folder: Path) -> Path:
    """Makes the system on which chroots are laid: bookworm, or SUITE of the environment; CHROOT names one."""
    if "CHROOT" in os.environ:
        return Path(os.environ["CHROOT"])
    suite = os.environ.get("SUITE", "bookworm")
    packages = "--include=git,make,ca-certificates"
    subprocess.run(["debootstrap", "--variant=minbase", packages, suite, str(folder)], check=True, capture_output=True)
    apt = Path("/etc/apt/apt.conf.d").glob("99*")
    for file in (*(Path("/", name) for name in NETWORK), *apt):
        if file.exists():
            (folder / file.relative_to("/")).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(file, folder / file.relative_to("/"))
    return folder


class Chroot:
    """A system of its own; what it changes does not change the base.

    :param base: by `make_base`.
    :param folder: new, for what it changes.
    """

    def __init__(self, base: Path, folder: Path) -> None:
        self._folders = (str(base), str(folder))
        for name in ("changed", "work", "root"):
            (folder / name).mkdir(parents=True)
        #: Where its files lie that the base does not have.
        self.changed = folder / "changed"
        self.home = self.changed / HOME.strip("/")
        self.home.mkdir(parents=True)

    def command(self, script: str) -> list[str]:
        """The command that runs a script of bash in it, in the home folder of somebody who has just logged in."""
        env = [f"{name}={os.environ[name]}" for name in VARIABLES if name in os.environ]
        env += (f"HOME={HOME}", "PATH=/usr/sbin:/usr/bin:/sbin:/bin", "LANG=C.UTF-8", "TERM=dumb")
        own = ("unshare", "--mount", "--pid", "--fork", "--kill-child")
        run = ("env", "-i", *env, "bash", "-c", f"cd ~ && {script}")
        return [*own, "bash", "-ec", _ENTER, "enter", *self._folders, *run]

    def run(self, script: str) -> str:
        """Runs a script of bash. Returns what it prints.

        :raises AssertionError: it fails; with the end of what it has printed.
        """
        command = self.command(script)
        done = subprocess.run(
            command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False
        )
        assert done.returncode == 0, f"{script}\n{done.stdout[-8000:]}"
        return done.stdout
