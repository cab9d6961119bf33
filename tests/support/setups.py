"""The set-ups that tutorials name: what each installs, and processes that see no more of `.venv` than that."""

from __future__ import annotations

import functools
import importlib.metadata
import re
import shlex
import subprocess
from pathlib import Path

from support.ros import ROOT

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
    site = ROOT / ".venv/lib"
    everything = [each for path in site.glob("python3*/site-packages") for each in _distributions(path)]
    installed = packages_of(setup)
    seen = {module for name, modules in everything if name in installed for module in modules}
    hidden = {module for name, modules in everything if name not in installed for module in modules} - seen
    hidden -= {"pip", "setuptools", "pkg_resources", "_distutils_hack"}
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "sitecustomize.py").write_text(_SITE.format(hidden=hidden, site=str(site)))
    return {"PYTHONPATH": str(folder)}


def _distributions(site: Path) -> list[tuple[str, set[str]]]:
    """The packages in a folder, each with the names of its modules."""
    found = []
    for distribution in importlib.metadata.distributions(path=[str(site)]):
        files = distribution.files or []
        tops = {file.parts[0] for file in files if file.suffix in (".py", ".so") or len(file.parts) > 1}
        tops = {top for top in tops if ".dist-info" not in top and not top.startswith("..")}
        modules = {Path(top).stem.partition(".")[0] for top in tops}
        found.append((_name(distribution.metadata["Name"]), modules - {"__pycache__", ""}))
    return found
