"""The list of packages, packages.txt."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

ROOT = Path(__file__).resolve().parents[2]


def package_folders() -> dict[str, str]:
    """Returns the folder of each package, relative to the repository, lower layers first."""
    lines = (ROOT / "packages.txt").read_text().splitlines()
    return {name_of(ROOT / line): line for line in lines if line and not line.startswith("#")}


def name_of(folder: Path) -> str:
    """Returns the name of the package in a folder; that of a demo's folder differs."""
    return str(ElementTree.parse(folder / "package.xml").findtext("name"))


def source_folders() -> list[Path]:
    """Returns the folders with the Python packages; packages of messages have none."""
    return [source for folder in package_folders().values() if (source := ROOT / folder / "src").is_dir()]


if __name__ == "__main__":  # for MYPYPATH
    print(*source_folders(), sep=":")
