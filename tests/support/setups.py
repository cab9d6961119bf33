"""The set-ups that tutorials name: what each installs, and processes that see no more of `.venv` than that."""

from __future__ import annotations

import functools
import importlib.metadata
import re
import shlex
import subprocess
from pathlib import Path

from support.ros import ROOT

PIP = "pip install ."
PIP_LEARNING = "pip install '.[learning]'"

#: The Python packages of `.venv`, and Debian's.
SITE = next((ROOT / ".venv/lib").glob("python3*/site-packages"), ROOT)
DEBIAN = Path("/usr/lib/python3/dist-packages")

#: Imports what a set-up does not install from elsewhere than `.venv`: from Debian's packages. Python imports it at its
#: start, by its name.
_SITE = """
import sys
from importlib.machinery import PathFinder

class Hider:
    hidden = {hidden!r}

    @classmethod
    def find_spec(cls, name, path=None, target=None):
        if path is not None or name not in cls.hidden:
            return None
        spec = PathFinder.find_spec(name, [place for place in sys.path if not place.startswith({site!r})])
        if spec is None:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)
        return spec

sys.meta_path.insert(0, Hider)
"""


@functools.cache
def lists_of(setup: str) -> tuple[str, ...]:
    """The lists in requirements/ that a command such as `make demo` installs, as the Makefile says."""
    if setup in (PIP, PIP_LEARNING):  # as setup.py says
        return ("core", "planner", *(("sim", "learning") if setup == PIP_LEARNING else ()))
    command = shlex.split(setup)
    steps = subprocess.run([*command, "-n"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    installed = re.search(r"\.ci/setup *(.*)", steps)
    assert installed, f"{setup}: no .ci/setup in its steps: {steps}"
    known = {file.stem for file in (ROOT / "requirements").glob("*.txt")}
    named = [word for word in installed[1].split() if word in known]
    return tuple(named or sorted(known - {"docs", "bench"}))


def _name(text: str) -> str:
    return re.sub(r"[-_.]+", "-", text).lower()


def packages_of(setup: str) -> set[str]:
    """The names of the Python packages that a command such as `make demo` installs."""
    texts = [(ROOT / "requirements" / f"{name}.txt").read_text() for name in lists_of(setup)]
    return {_name(found) for text in texts for found in re.findall(r"^([^ #\n=]+)==", text, re.M)}


def environment_of(setup: str, folder: Path) -> dict[str, str]:
    """Variables for processes of `.venv` that find no more Python packages than a set-up installs.

    :param folder: a file is made in it.
    """
    everything = _distributions(SITE)
    installed = packages_of(setup)
    seen = {_module(top) for name, tops in everything if name in installed for top in tops}
    hidden = {_module(top) for name, tops in everything if name not in installed for top in tops} - seen
    hidden -= {"pip", "setuptools", "pkg_resources", "_distutils_hack"}
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "sitecustomize.py").write_text(_SITE.format(hidden=hidden, site=str(SITE)))
    # pytest would load those of its plugins that are hidden: it does not ask other finders
    return {"PYTHONPATH": str(folder), "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"}


def link_packages(setup: str, folder: Path) -> None:
    """Fills a folder with links to the Python packages that a set-up installs, for processes without other packages."""
    folder.mkdir(parents=True)
    installed = packages_of(setup)
    for site in (DEBIAN, SITE):  # what is here in the version that is wanted is not in `.venv`
        for tops in (tops for name, tops in _distributions(site) if name in installed):
            for top in tops:
                (folder / top).unlink(missing_ok=True)
                (folder / top).symlink_to(site / top)


def _distributions(site: Path) -> list[tuple[str, set[str]]]:
    """The packages in a folder, each with the names of its files and folders."""
    found = []
    for distribution in importlib.metadata.distributions(path=[str(site)]):
        tops = {file.parts[0] for file in distribution.files or []} - {"..", "__pycache__"}
        found.append((_name(distribution.metadata["Name"]), {top for top in tops if (site / top).exists()}))
    return found


def _module(top: str) -> str:
    return Path(top).stem.partition(".")[0]
