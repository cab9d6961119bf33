"""The pages of the documentation's site, in Markdown; tests/long/test_site.py builds the site itself."""

from __future__ import annotations

import re
import subprocess
import sys

import pytest

from support.ros import ROOT

PAGES = ROOT / "build/docs/pages"

# The timeout: it imports every package, and asks every program for its help.
pytestmark = [pytest.mark.timeout(600), pytest.mark.long]


@pytest.fixture(scope="module")
def reference() -> dict[str, str]:
    """The pages of the reference by name."""
    command = [ROOT / ".ci/in_ros", sys.executable, "docs/site/build.py", "--pages"]
    built = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert (built.returncode, built.stderr) == (0, ""), "an entry of the reference is missing"
    folder = PAGES / "reference"
    return {page.relative_to(folder).with_suffix("").as_posix(): page.read_text() for page in folder.rglob("*.md")}


def _sections(page: str) -> dict[str, str]:
    return {title: text for title, _, text in (part.partition("\n") for part in page.split("\n## ")[1:])}


def test_page_for_authors_is_short_and_names_what_the_first_tutorial_uses(reference: dict[str, str]) -> None:
    page = reference["authors"]
    assert len(re.findall(r"^\| \[", page, re.MULTILINE)) < 100
    for call in ("addParam(", "addPreCondition(", "execute()", "success(", "setDescription(", "expand(skill)"):
        assert f"[`{call}" in page


def test_modules_of_the_api_are_on_pages_of_at_most_40_entries(reference: dict[str, str]) -> None:
    pages = {name: text.count("\n::: ") for name, text in reference.items() if name.startswith("api/skiros2")}
    assert sum(pages.values()) > 500
    assert max(pages.values()) <= 40
    listed = re.findall(r"\]\((.*)\.md#", reference["api/index"])
    assert {f"api/{name}" for name in listed} == set(pages)


def test_vocabulary_begins_with_the_names_for_scenes_and_each_row_has_a_name_and_a_meaning(
    reference: dict[str, str],
) -> None:
    sections = _sections(reference["vocabulary"])
    assert list(sections)[:3] == ["Classes", "Relations", "Properties"]
    assert all(f"| `{name}` |" in sections["Classes"] for name in ("skiros:Product", "cora:Robot", "rparts:ArmDevice"))
    assert "`skiros:Condition" not in sections["Classes"]
    for row in re.findall(r"^\| (.*) \|$", reference["vocabulary"], re.MULTILINE):
        name, meaning, *_ = (cell.strip() for cell in row.split("|"))
        assert name and meaning, row
