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
from pathlib import Path

import reference
import yaml
from reference import ROOT, SOURCES

OUT = ROOT / "build/docs"
PAGES = OUT / "pages"
#: The pages of the repository that are outside of docs/, by their names in the site.
OUTSIDE = {"README.md": "index.md", "CONTRIBUTING.md": "contributing.md", "CHANGELOG.md": "changelog.md"}
#: The pages of docs/ in the order of the menu; those that are not here are under "More".
MENU = {
    "Guides": ("your_robot", "skills", "world_model", "planning", "window", "bags", "safety"),
    "Robots": ("demo", "simulation", "contact", "teaching", "perception", "learning", "factory"),
    "Moving from SkiROS2": ("compatibility",),
}
GENERATED = {
    "skills": reference.skills, "vocabulary": reference.vocabulary, "ros": reference.ros_interface,
    "commands": reference.commands, "errors": reference.errors,
}  # fmt: skip
#: The search of a site that is opened as a file, without a server and without the network.
WORKER = "assets/iframe-worker.js"
_LINK = re.compile(r"(!?)\[((?:[^\[\]]|\[[^\]]*\])*)\]\(([^)\s]+)\)")


def main() -> int:
    """Builds the site. Returns 0, or 1 after the list of what is missing."""
    logging.disable(logging.WARNING)
    shutil.rmtree(OUT, ignore_errors=True)
    problems: list[str] = []
    menu = stage(problems)
    write(WORKER, (ROOT / "docs/site/iframe-worker.js").read_text())
    for name, generate in GENERATED.items():
        write(f"reference/{name}.md", generate(problems))
    api = [write(f"reference/api/{package}.md", api_page(package, problems)) for package in SOURCES]
    generated = [f"reference/{name}.md" for name in GENERATED]
    menu.append({"Reference": [*generated, {"API": [page for page in api if page]}]})
    (OUT / "mkdocs.yml").write_text(yaml.safe_dump(settings(menu), sort_keys=False))
    sys.stderr.writelines(f"missing: {problem}\n" for problem in problems)
    environment = {**os.environ, "NO_MKDOCS_2_WARNING": "1"}
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--config-file", str(OUT / "mkdocs.yml")]
    built = subprocess.run(command, check=False, env=environment, stderr=subprocess.PIPE, text=True)
    sys.stderr.writelines(f"{line}\n" for line in built.stderr.splitlines() if not line.startswith("INFO"))
    if not built.returncode and not problems:
        sys.stdout.write(f"built: {OUT / 'site/index.html'}\n")
    return 1 if problems else built.returncode


def write(name: str, text: str) -> str:
    """Writes a page. Returns its name; "" for a page without text."""
    file = PAGES / name
    file.parent.mkdir(parents=True, exist_ok=True)
    if text:
        file.write_text(text)
    return name if text else ""


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
        *({title: [f"{name}.md" for name in names]} for title, names in MENU.items()), {"More": rest},
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


def api_page(package: str, problems: list[str]) -> str:
    """The modules of a package with a public class or function, for mkdocstrings; "" when there is none."""
    modules = []
    for file in sorted(SOURCES[package].rglob("*.py")):
        parts = file.relative_to(SOURCES[package].parent).with_suffix("").parts
        module = ".".join(parts).removesuffix(".__init__")
        tree = ast.parse(file.read_text())
        public = [
            node for node in tree.body
            if isinstance(node, ast.ClassDef | ast.FunctionDef) and not node.name.startswith("_")
        ]  # fmt: skip
        lacking = [node.name for node in public if isinstance(node, ast.ClassDef) and not ast.get_docstring(node)]
        problems += [f"{module}.{name}: a public class without docstring" for name in lacking]
        if public and "templates" not in parts:
            modules.append(f"## {module}\n\n::: {module}\n")
    return "\n".join([f"# {package}\n", *modules]) if modules else ""


def settings(menu: list[object]) -> dict[str, object]:
    """The configuration of MkDocs."""
    handler = {
        "paths": sorted({str(source.parent) for source in SOURCES.values()}),
        "options": {
            "docstring_style": "sphinx", "show_source": False, "show_root_heading": False, "show_root_toc_entry": False,
            "heading_level": 3, "separate_signature": True, "show_if_no_docstring": False, "members_order": "source",
            "docstring_options": {"warnings": False}, "merge_init_into_class": True, "show_bases": True,
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
        "theme": {
            "name": "material", "palette": [light, dark], "font": False,
            "features": [
                *("navigation.tabs", "navigation.indexes", "navigation.top"), "search.highlight", "content.code.copy",
            ],
        },
        "extra": {"polyfills": [WORKER]},
        "plugins": ["search", "offline", {"mkdocstrings": {"handlers": {"python": handler}}}],
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
    sys.exit(main())
