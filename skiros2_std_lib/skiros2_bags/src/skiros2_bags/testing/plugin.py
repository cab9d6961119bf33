"""The pytest plugin: bags as tests.

    pytest_plugins = ["skiros2_bags.testing"]  # in the top conftest.py

    pytest --replay runs/pick.bag --replay-workspace owl

    @pytest.mark.replay("runs/pick.bag", workspace="owl")
    def test_pick_goes_as_recorded(replayed):
        assert replayed is None, replayed

Bags on the command line become tests of their own. File names are relative to the folder of the test, or to the
working directory.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from skiros2_runs.core.tolerance import NARROW, Tolerance

if TYPE_CHECKING:
    from skiros2_bags.testing.field_tolerances import FieldTolerances
    from skiros2_bags.testing.rerun import Settings


def pytest_addoption(parser: pytest.Parser) -> None:
    group = parser.getgroup("replay", "recorded runs of skills")
    group.addoption("--replay", action="append", default=[], metavar="BAG", help="re-run a bag as a test; repeatable")
    group.addoption("--replay-workspace", default="", metavar="FOLDER", help="folder of the ontologies of the scenes")
    for name in ("relative", "absolute"):
        text = f"{name} tolerance of measured numbers"
        group.addoption(f"--replay-{name}", type=float, default=getattr(NARROW, name), metavar="NUMBER", help=text)
    text = "tolerance of one field, such as pose; repeatable"
    group.addoption("--replay-tolerance", action="append", default=[], metavar="FIELD=ABSOLUTE[,RELATIVE]", help=text)
    group.addoption("--replay-plans", action="store_true", help="make the plans again, and compare them")


def pytest_configure(config: pytest.Config) -> None:
    config.addinivalue_line(
        "markers",
        "replay(bag, workspace=None, played=(), relative=..., absolute=..., tolerances=(), plans=False): the bag for "
        "the fixture `replayed`",
    )


def pytest_collection_modifyitems(session: pytest.Session, config: pytest.Config, items: list[pytest.Item]) -> None:
    bags = config.getoption("--replay")
    if not bags:
        return
    from skiros2_bags.testing.rerun import Settings  # imported when needed, as ROS is slow to import

    workspace = config.getoption("--replay-workspace")
    tolerances = _tolerances(*(config.getoption(f"--replay-{name}") for name in ("relative", "absolute", "tolerance")))
    folder, plans = Path(workspace).resolve() if workspace else None, config.getoption("--replay-plans")
    settings = Settings(folder, tolerances=tolerances, plans=plans)
    for bag in bags:
        items.append(ReplayItem.from_parent(session, name=bag, bag=Path(bag).resolve(), settings=settings))


class Diverged(AssertionError):
    """A re-run differs from its recording."""


class ReplayItem(pytest.Item):
    """A bag from the command line."""

    def __init__(self, *, bag: Path, settings: Settings, **more: Any) -> None:
        super().__init__(**more)
        self._bag = bag
        self._settings = settings

    def runtest(self) -> None:
        from skiros2_bags.testing.rerun import replay

        found = replay(self._bag, self._settings)
        if not found.is_as_recorded:
            raise Diverged(str(found))

    def repr_failure(self, excinfo: pytest.ExceptionInfo[BaseException], style: Any = None) -> Any:
        if isinstance(excinfo.value, Diverged):
            return str(excinfo.value)
        return super().repr_failure(excinfo, style)

    def reportinfo(self) -> tuple[Path, int | None, str]:
        return self._bag, None, self.name


@pytest.fixture
def replayed(request: pytest.FixtureRequest) -> Iterator[str | None]:
    """What differs in a re-run of the bag that the marker `replay` of the test names, as text; None if nothing does."""
    marker = request.node.get_closest_marker("replay")
    if marker is None or len(marker.args) != 1:
        raise pytest.UsageError("the fixture `replayed` needs a marker: @pytest.mark.replay(BAG, ...)")
    from skiros2_bags.testing.rerun import Settings, replay

    given = dict(marker.kwargs)
    workspace = given.pop("workspace", None)
    measured = (given.pop("relative", NARROW.relative), given.pop("absolute", NARROW.absolute))
    settings = Settings(
        _file(request, workspace) if workspace is not None else None,
        frozenset(given.pop("played", ())),
        _tolerances(*measured, given.pop("tolerances", ())),
        plans=given.pop("plans", False),
    )
    if given:
        raise pytest.UsageError(f"marker replay: unknown {', '.join(given)}")
    found = replay(_file(request, marker.args[0]), settings)
    yield None if found.is_as_recorded else str(found)


def _tolerances(relative: float, absolute: float, fields: Sequence[str]) -> FieldTolerances:
    from skiros2_bags.testing.field_tolerances import FieldTolerances, field_tolerances

    try:
        return FieldTolerances(Tolerance(relative, absolute), field_tolerances(fields))
    except ValueError as error:
        raise pytest.UsageError(str(error)) from error


def _file(request: pytest.FixtureRequest, name: str | Path) -> Path:
    candidate = request.path.parent / name
    return candidate if candidate.exists() else Path(name).resolve()
