"""Each tutorial shows what happens: its commands are typed, its files written and its outputs compared.

The tutorials are followed in order, in one home folder, as a newcomer does; each with the Python packages of the set-up
that it names, and no others. Those that a selected one needs are followed before it. `tests/long/test_tutorials.py`
follows each after only those that it needs, and in other orders; `tests/long/test_clean_debian.py` on a clean Debian.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

from support.newcomers import PAGES, Newcomer
from support.ros import RosMaster

pytestmark = pytest.mark.timeout(600)  # alone, a page is followed after four others


#: So many are followed by `make test`: what each newcomer does.
_FIRST = 5


def _name(page: Path) -> str:
    return page.stem


@pytest.fixture(scope="module")
def newcomer(ros_master: RosMaster, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Newcomer]:
    home = tmp_path_factory.mktemp("home")
    with Newcomer(home, ros_master) as made:
        yield made
    shutil.rmtree(home)


@pytest.mark.parametrize(
    "page", [*PAGES[:_FIRST], *(pytest.param(page, marks=pytest.mark.long) for page in PAGES[_FIRST:])], ids=_name
)
def test_tutorial_shows_what_happens(newcomer: Newcomer, page: Path) -> None:
    newcomer.follow(page)


@pytest.mark.long
def test_tests_of_the_package_pass_after_all_tutorials(newcomer: Newcomer) -> None:
    newcomer.check_package()
