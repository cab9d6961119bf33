"""The search of the documentation's site, in Debian's chromium: `make docs`, then what somebody types."""

from __future__ import annotations

import re
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import urlencode

import pytest

from support.ros import ROOT

playwright = pytest.importorskip("playwright.sync_api", reason="needs requirements/browser.txt")

CHROMIUM = shutil.which("chromium")
#: Pages that a word should lead to, one of them among the first three.
EXPECTED = {
    "docker": ("platforms.html",),
    "debug": ("tutorials/12_when_it_fails.html", "skills.html"),
    "test": ("skills.html", "tutorials/02_first_skill.html"),
    "real robot": ("your_robot.html", "simulation.html"),
    "ROS 2": ("platforms.html",),
    "install": ("platforms.html",),
    "addParam": ("reference/authors.html", "reference/api/skiros2_common/core.skill_description.html"),
}

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="needs Debian's chromium")


@pytest.fixture(scope="module")
def site() -> Path:
    built = subprocess.run(["make", "docs"], cwd=ROOT, capture_output=True, text=True, check=False)
    assert built.returncode == 0, built.stderr
    return ROOT / "build/docs/site"


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with playwright.sync_playwright() as started:
        browser = started.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox", "--disable-gpu"])
        yield browser
        browser.close()


@pytest.mark.parametrize("words", EXPECTED)
def test_search_finds_a_page_for_the_words(site: Path, browser: Any, words: str) -> None:
    page = browser.new_page()
    page.goto(f"{(site / 'index.html').as_uri()}?{urlencode({'q': words})}")
    page.wait_for_selector(".md-search-result__item")
    links = page.eval_on_selector_all(".md-search-result__item > a", "found => found.map(each => each.href)")
    page.close()
    pages = [link.removeprefix(f"{site.as_uri()}/").partition("?")[0].partition("#")[0] for link in links]
    first = list(dict.fromkeys(pages))[:3]  # several sections of a page may be found
    assert set(first) & set(EXPECTED[words]), first


def test_page_of_the_api_has_some_40_headings_at_most(site: Path) -> None:
    pages = list((site / "reference/api").glob("skiros2*/*.html"))
    counts = {page: len(re.findall(r"<h[2-6] id=", page.read_text())) for page in pages}
    assert len(counts) > 100
    assert max(counts.values()) <= 50, max(counts, key=lambda page: counts[page])
