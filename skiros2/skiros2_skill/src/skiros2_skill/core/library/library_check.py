"""Checks that libraries have skills, for launch files.

A launch waits for this check before it starts its nodes. Therefore the sources are parsed, and the platform is imported
only for names that they do not have.
"""

from __future__ import annotations

import ast
from collections.abc import Iterable, Iterator, Sequence
from importlib.util import find_spec
from pathlib import Path


def check_libraries(libraries: Sequence[str], names: Iterable[str]) -> None:
    """Checks that libraries and skills exist, without loading skills.

    Parses the sources, which is several times faster than importing them. Imports the libraries only when a name is not
    found in the sources.

    :param libraries: names of Python packages.
    :param names: class names, optionally with their module.
    :raises ConfigurationError: there is no such package, it cannot be imported, or no library has such a skill.
    """
    sources = [_source_files(library) for library in libraries]
    if all(sources):
        known = {name for files in sources for file in files for name in _class_names(file)}
        if all(name.rpartition(".")[2] in known for name in names):
            return
    from skiros2_skill.core.library.library import SkillLibrary

    library = SkillLibrary(None)
    library.import_libraries(libraries)
    for name in names:
        library.find(name)


def _source_files(package: str) -> list[Path]:
    """The Python files of a package and its subpackages; [] when there is no such package."""
    try:
        spec = find_spec(package)
    except (ImportError, ValueError):
        return []
    if spec is None:
        return []
    if spec.submodule_search_locations is None:
        return [Path(spec.origin)] if spec.origin else []
    return [file for folder in spec.submodule_search_locations for file in Path(folder).rglob("*.py")]


def _class_names(file: Path) -> Iterator[str]:
    try:
        tree = ast.parse(file.read_bytes())
    except SyntaxError:  # loading logs it and skips the module
        return
    for node in ast.walk(tree):
        if isinstance(node, ast.ClassDef):
            yield node.name
