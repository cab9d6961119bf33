"""The docs name files and each other correctly."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

from support.ros import ROOT
from support.tutorial import needs

DOCS = ROOT / "docs"

#: A path in backticks: a file with a suffix, or a folder with a slash at its end.
_PATH = re.compile(r"`([\w./-]+(?:\.(?:py|md|svg|launch|msg|srv|action|toml)|/))`")
_LINK = re.compile(r"\]\(([^)#:\s]+)(?:#[^)]*)?\)")


def _repository_paths() -> set[str]:
    files = subprocess.run(
        ["git", "ls-files", "--cached", "--others", "--exclude-standard"],
        cwd=ROOT, capture_output=True, text=True, check=True,
    ).stdout.splitlines()  # fmt: skip
    existing = [Path(file) for file in files if (ROOT / file).exists()]
    return {f"/{path}" for path in existing} | {f"/{folder}/" for path in existing for folder in path.parents}


def test_every_path_in_the_architecture_page_exists() -> None:
    known = _repository_paths()
    named = _PATH.findall((DOCS / "architecture.md").read_text())
    assert named
    assert not [name for name in named if not any(path.endswith(f"/{name}") for path in known)]


def test_every_relative_link_of_the_docs_exists() -> None:
    pages = [*DOCS.rglob("*.md"), *ROOT.glob("*.md")]
    links = [(page, link) for page in pages for link in _LINK.findall(page.read_text())]
    assert not [f"{page.name}: {link}" for page, link in links if not (page.parent / link).exists()]


def test_the_index_links_every_page() -> None:
    links = set(_LINK.findall((DOCS / "README.md").read_text()))
    assert {page.name for page in DOCS.glob("*.md")} - {"README.md"} <= links


def test_the_index_of_tutorials_links_each_of_them() -> None:
    links = set(_LINK.findall((DOCS / "tutorials/README.md").read_text()))
    assert {page.name for page in (DOCS / "tutorials").glob("[0-9]*.md")} <= links


def test_marks_in_a_tutorial_are_explained_in_it_or_in_one_that_it_needs() -> None:
    marked = []
    for page in sorted((DOCS / "tutorials").glob("[0-9]*.md")):
        read = "\n".join(each.read_text() for each in (*needs(page).all_pages(), page))
        for mark, explained in (("# status ", "exit status"), ("\n^C\n", "`^C` is Ctrl-C")):
            if mark in page.read_text():
                marked.append(page.name)
                assert explained in read, f"{page.name}: {mark.strip()}"
    assert {"03_parameters.md", "06_planning.md"} <= set(marked)
