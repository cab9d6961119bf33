"""The project's Python source as syntax trees."""

from __future__ import annotations

import ast
import functools
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from support.packages import ROOT, package_folders

#: The folders of the packages with Python, bottom first: a package imports itself and what stands before it.
PACKAGES = {name: folder for name, folder in package_folders().items() if (ROOT / folder / "src").is_dir()}
#: The window is divided by subject instead of by layer: the folder `widgets` of a subject holds its Qt widgets, the
#: folder `ros` its ROS adapters, and every other module of a subject is a core.
WINDOW_SUBJECTS = ("app", "skills", "run", "world", "goal", "learning", "teach", "view3d", "approvals")


@dataclass(frozen=True)
class SourceFile:
    """A Python file of a package.

    :param path: relative to the repository.
    :param part: `core`, `tools`, `ros` or `widgets`; `nodes` for executables; otherwise "".
    """

    path: Path
    package: str
    part: str

    @property
    def text(self) -> str:
        return (ROOT / self.path).read_text()

    @functools.cached_property
    def tree(self) -> ast.Module:
        return ast.parse(self.text, str(self.path))

    @functools.cached_property
    def nodes(self) -> tuple[ast.AST, ...]:
        """All nodes of the tree. To list them takes ten times as long as to look at them."""
        return tuple(ast.walk(self.tree))

    @property
    def is_program(self) -> bool:
        """Whether it is a command-line program: an executable, or a module that can be run with `python -m`."""
        return self.part == "nodes" or '__name__ == "__main__"' in self.text

    def imports(self) -> Iterator[tuple[int, str]]:
        """The lines and full names of what it imports, also inside functions and for type checkers only."""
        for node in self.nodes:
            if isinstance(node, ast.Import):
                for name in node.names:
                    yield node.lineno, name.name
            elif isinstance(node, ast.ImportFrom):
                module = node.module or ""
                if node.level:
                    parents = self._module_parts()[: -node.level]
                    module = ".".join([*parents, module] if module else parents)
                for name in node.names:
                    yield node.lineno, f"{module}.{name.name}"

    @property
    def module(self) -> str:
        """The module's full name; of a package, that of the package."""
        return ".".join(part for part in self._module_parts() if part != "__init__")

    def _module_parts(self) -> list[str]:
        parts = list(self.path.with_suffix("").parts)
        return parts[parts.index("src") + 1 :]

    def __str__(self) -> str:
        return str(self.path)


def source_files() -> list[SourceFile]:
    files = []
    for package, folder in PACKAGES.items():
        source = ROOT / folder / "src" / package
        for path in sorted(path for path in source.rglob("*.py") if "templates" not in path.parts):
            files.append(SourceFile(path.relative_to(ROOT), package, _part(path.relative_to(source).parts)))
        for path in sorted((ROOT / folder / "nodes").glob("*")):
            if path.is_file():
                files.append(SourceFile(path.relative_to(ROOT), package, "nodes"))
    return files


def _part(parts: tuple[str, ...]) -> str:
    folder = parts[0]
    if folder in WINDOW_SUBJECTS:
        return parts[1] if parts[1] in ("widgets", "ros") else "core"
    return folder if folder in ("core", "tools", "ros") else ""
