"""Builds the documentation's site in build/docs/site: the pages of docs/ and a generated reference. See `make docs`.

It fails when a link is broken, or when an entry of the reference is missing: a public class without docstring, a launch
argument without `doc`, a term without comment, a command without help.
"""

from __future__ import annotations

import ast
import logging
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import reference
import yaml
from reference import ROOT, SOURCES, parsed, table

OUT = ROOT / "build/docs"
PAGES = OUT / "pages"
#: The pages of the repository that are outside of docs/, by their names in the site.
OUTSIDE = {"README.md": "index.md", "CONTRIBUTING.md": "contributing.md", "CHANGELOG.md": "changelog.md"}
#: The pages of docs/ in the order of the menu; those that are not here are under "Project".
MENU = {
    "Guides": (
        *("platforms", "local", "your_robot", "skills", "world_model", "planning"),
        *("window", "browser", "bags", "safety"),
    ),
    "Robots": ("demo", "simulation", "contact", "teaching", "perception", "learning", "factory"),
    "From SkiROS2": ("compatibility",),
}
#: Headings of a page of the API, at most; a module with more has a page of its own.
HEADINGS = 40
#: The weight of pages in the search, by the beginning of their names; others have 1.
WEIGHTS = {
    "platforms": 2.0, "reference/authors": 2.0, "reference/api/": 0.1, "reference/": 0.5, "architecture": 0.5,
    "changelog": 0.2, "contributing": 0.2, "compatibility": 0.5, "pages": 0.1, "index": 0.5,
}  # fmt: skip
#: What separates words in the search: `addParam(key, value)` has three.
SEPARATORS = r"""[\s\-,:;!?=()\[\]{}"'`./]+"""
#: The pages of the reference before those of the API; the first one is for most readers.
GENERATED = {
    "authors": reference.authors, "skills": reference.skills, "vocabulary": reference.vocabulary,
    "ros": reference.ros_interface, "commands": reference.commands, "errors": reference.errors,
}  # fmt: skip
#: The search of a site that is opened as a file, without a server and without the network.
WORKER = "assets/iframe-worker.js"
STYLE = "assets/style.css"
_LINK = re.compile(r"(!?)\[((?:[^\[\]]|\[[^\]]*\])*)\]\(([^)\s]+)\)")


def main(arguments: Sequence[str]) -> int:
    """Builds the site, with `--pages` only its pages in Markdown. Returns 0, or 1 after the list of what is missing."""
    logging.disable(logging.WARNING)
    shutil.rmtree(PAGES, ignore_errors=True)
    problems: list[str] = []
    menu = stage(problems)
    for name, file in {WORKER: "iframe-worker.js", STYLE: "style.css"}.items():
        write(name, (ROOT / "docs/site" / file).read_text())
    for name, generate in GENERATED.items():
        write(f"reference/{name}.md", generate(problems))
    api: dict[str, list[str]] = {}
    for name, title, text in api_pages(problems):
        api.setdefault(name.partition("/")[0], []).append(write(f"reference/api/{name}.md", text, title))
    api_menu = [*api.pop("index"), *({package: pages} for package, pages in api.items())]
    menu.append({"Reference": [*(f"reference/{name}.md" for name in GENERATED), {"API": api_menu}]})
    (OUT / "mkdocs.yml").write_text(yaml.safe_dump(settings(menu), sort_keys=False))
    sys.stderr.writelines(f"missing: {problem}\n" for problem in problems)
    if problems or "--pages" in arguments:
        return 1 if problems else 0
    environment = {**os.environ, "NO_MKDOCS_2_WARNING": "1"}
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--config-file", str(OUT / "mkdocs.yml")]
    built = subprocess.run(command, check=False, env=environment, stderr=subprocess.PIPE, text=True)
    sys.stderr.writelines(f"{line}\n" for line in built.stderr.splitlines() if not line.startswith("INFO"))
    if not built.returncode:
        sys.stdout.write(f"built: {OUT / 'site/index.html'}\n")
    return built.returncode


def write(name: str, text: str, title: str = "") -> str:
    """Writes a page, with its weight in the search. Returns its name.

    :param title: in the menu; "": the heading.
    """
    file = PAGES / name
    file.parent.mkdir(parents=True, exist_ok=True)
    meta: dict[str, object] = {"title": title} if title else {}
    if name == "index.md":
        meta["hide"] = ["navigation"]  # it would list only this page
    if weight := next((weight for beginning, weight in WEIGHTS.items() if name.startswith(beginning)), None):
        meta["search"] = {"boost": weight}
    file.write_text(f"---\n{yaml.safe_dump(meta)}---\n\n{text}" if meta else text)
    return name


def stage(problems: list[str]) -> list[object]:
    """Copies the pages, with links that fit the site. Returns the menu."""
    docs = ROOT / "docs"
    for file in docs.rglob("*"):
        relative = file.relative_to(docs)
        if file.is_dir() or relative.parts[0] == "site":
            continue
        if file.suffix == ".md":
            name = "pages.md" if relative == Path("README.md") else relative.as_posix()
            write(name.replace("tutorials/README.md", "tutorials/index.md"), linked(file, problems))
        else:
            (PAGES / relative).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(file, PAGES / relative)
    for name, page in OUTSIDE.items():
        write(page, linked(ROOT / name, problems))
    tutorials = sorted(f"tutorials/{file.name}" for file in (PAGES / "tutorials").glob("*.md"))
    tutorials.sort(key=lambda name: "index" not in name)
    known = {name for names in MENU.values() for name in names}
    rest = sorted(file.name for file in PAGES.glob("*.md") if file.stem not in {*known, "index"})
    return [
        {"SkiROS2": "index.md"}, {"Tutorials": tutorials},
        *({title: [f"{name}.md" for name in names]} for title, names in MENU.items()), {"Project": rest},
    ]  # fmt: skip


def linked(page: Path, problems: list[str]) -> str:
    """The text of a page with links to pages of the site. Links to other files of the repository become texts."""

    def replaced(match: re.Match[str]) -> str:
        image, text, target = match.groups()
        path, _, anchor = target.partition("#")
        if "://" in target or not path:
            return match[0]
        file = (page.parent / path).resolve()
        if not file.exists():
            problems.append(f"{page.relative_to(ROOT)}: the link {target}")
        found = _page_of(file)
        if found is None:
            return text
        here = _page_of(page)
        assert here is not None
        way = os.path.relpath(found, Path(here).parent)
        return f"{image}[{text}]({way}{'#' + anchor if anchor else ''})"

    return _LINK.sub(replaced, page.read_text())


def _page_of(file: Path) -> str | None:
    """The name of a file in the site; None for a file that is not in it."""
    relative = file.relative_to(ROOT).as_posix()
    if relative in OUTSIDE:
        return OUTSIDE[relative]
    inner = relative.removeprefix("docs/")
    if inner == relative or not file.is_file():
        return None
    return {"README.md": "pages.md", "tutorials/README.md": "tutorials/index.md"}.get(inner, inner)


@dataclass(frozen=True)
class _Module:
    """A module with public classes or functions.

    :param members: the names that are defined in it, not those that it imports.
    :param headings: of its entries, with its own.
    """

    name: str
    about: str
    members: list[str]
    headings: int

    def __str__(self) -> str:
        return f"## {self.name}\n\n::: {self.name}\n    options:\n      members: {self.members}\n"


def api_pages(problems: list[str]) -> Iterator[tuple[str, str, str]]:
    """The pages of the API, for mkdocstrings: names, titles and texts. Each has as many modules as `HEADINGS` allows;
    the page `index` lists all."""
    overview = ["# API", "All packages. What skills use is on [one page](../authors.md)."]
    for package in SOURCES:
        modules = list(_modules(package, problems))
        rows = []
        for some in _split(modules):
            first, last = (each.name.removeprefix(f"{package}.") for each in (some[0], some[-1]))
            span = first if first == last else f"{first} – {last}"
            name = f"{package}/{first}"
            yield name, span, "\n".join([f"# {package}: {span}\n", *map(str, some)])
            rows += [(f"[`{m.name}`]({name}.md#{m.name.replace('.', '')})", m.about) for m in some]
        if rows:
            overview += [f"## {package}", table(("module", "contents"), rows)]
    yield "index", "", "\n\n".join(overview)


def _split(modules: Sequence[_Module]) -> Iterator[list[_Module]]:
    """The modules of a package, in order, page by page."""
    page: list[_Module] = []
    for module in modules:
        if page and sum(each.headings for each in page) + module.headings > HEADINGS:
            yield page
            page = []
        page.append(module)
    if page:
        yield page


def _modules(package: str, problems: list[str]) -> Iterator[_Module]:
    for file in sorted(SOURCES[package].rglob("*.py")):
        parts = file.relative_to(SOURCES[package].parent).with_suffix("").parts
        name = ".".join(parts).removesuffix(".__init__")
        tree = parsed(file)
        public = _public(tree)
        lacking = [node.name for node in public if isinstance(node, ast.ClassDef) and not ast.get_docstring(node)]
        problems += [f"{name}.{each}: a public class without docstring" for each in lacking]
        if public and "templates" not in parts:
            about = (ast.get_docstring(tree) or "").partition("\n\n")[0]
            yield _Module(name, about, [node.name for node in public], 1 + sum(map(_headings, public)))


def _public(node: ast.Module | ast.ClassDef) -> list[ast.ClassDef | ast.FunctionDef]:
    return [
        each for each in node.body
        if isinstance(each, ast.ClassDef | ast.FunctionDef) and not each.name.startswith("_")
    ]  # fmt: skip


def _headings(node: ast.ClassDef | ast.FunctionDef) -> int:
    """The headings of a class or function: each with a docstring has one."""
    inner = sum(map(_headings, _public(node))) if isinstance(node, ast.ClassDef) else 0
    return inner + (ast.get_docstring(node) is not None)


def settings(menu: list[object]) -> dict[str, object]:
    """The configuration of MkDocs."""
    handler = {
        "paths": sorted({str(source.parent) for source in SOURCES.values()}),
        "options": {
            "docstring_style": "sphinx", "show_source": False, "show_root_heading": False, "show_root_toc_entry": False,
            "heading_level": 3, "separate_signature": True, "show_if_no_docstring": False, "members_order": "source",
            "docstring_options": {"warnings": False}, "show_signature_annotations": True, "merge_init_into_class": True,
            "show_bases": True,
        },
    }  # fmt: skip
    light = {"media": "(prefers-color-scheme: light)", "scheme": "default", "primary": "blue grey"}
    dark = {"media": "(prefers-color-scheme: dark)", "scheme": "slate", "primary": "blue grey"}
    light["toggle"] = {"icon": "material/weather-night", "name": "Dark"}
    dark["toggle"] = {"icon": "material/weather-sunny", "name": "Light"}
    return {
        "site_name": "SkiROS2",
        "docs_dir": str(PAGES),
        "site_dir": str(OUT / "site"),
        "use_directory_urls": False,
        "hooks": [str(ROOT / "docs/site/hooks.py")],
        "theme": {
            "name": "material", "palette": [light, dark], "font": False,
            "features": [
                *("navigation.tabs", "navigation.indexes", "navigation.top", "navigation.prune", "navigation.footer"),
                *("search.highlight", "content.code.copy"),
            ],
        },
        "extra": {"polyfills": [WORKER], "generator": False},
        "extra_css": [STYLE],
        "plugins": [
            {"search": {"separator": SEPARATORS}}, "offline", {"mkdocstrings": {"handlers": {"python": handler}}},
        ],
        "markdown_extensions": [
            *("tables", "admonition", "pymdownx.highlight", "pymdownx.superfences"), {"toc": {"permalink": True}},
        ],
        "validation": {
            "nav": {"omitted_files": "warn", "not_found": "warn"},
            "links": {"not_found": "warn", "anchors": "warn", "unrecognized_links": "warn"},
        },
        "nav": menu,
    }  # fmt: skip


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
