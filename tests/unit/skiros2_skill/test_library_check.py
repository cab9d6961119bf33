"""Libraries are checked before a launch: the same verdict as loading, without importing where reading is enough."""

import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from skiros2_common.core.errors import ConfigurationError
from skiros2_skill.core.library.check import check_libraries

SKILL = """
from skiros2_common.core.primitive import PrimitiveBase
class {name}(PrimitiveBase): ...
"""


@pytest.fixture
def library(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., str]:
    """Makes a Python package of these modules and returns its name."""
    monkeypatch.syspath_prepend(tmp_path)

    def make(**modules: str) -> str:
        name = f"library_{tmp_path.name}"
        folder = tmp_path / name
        folder.mkdir()
        (folder / "__init__.py").touch()
        for module, text in modules.items():
            (folder / f"{module}.py").write_text(text)
        return name

    return make


@pytest.mark.parametrize("name", ["wave", "{library}.arms.wave"], ids=["by class", "by module and class"])
def test_a_skill_that_is_there_is_found_without_importing_it(library: Callable[..., str], name: str) -> None:
    package = library(arms=SKILL.format(name="wave") + "raise RuntimeError('imported')")
    check_libraries([package], [name.format(library=package)])
    assert package not in sys.modules


def test_a_library_that_is_not_there_is_named() -> None:
    with pytest.raises(ConfigurationError, match="'no_such_library'"):
        check_libraries(["no_such_library"], [])


def test_a_skill_that_is_not_there_is_named_with_the_libraries_that_were_searched(library: Callable[..., str]) -> None:
    package = library(arms=SKILL.format(name="wave"))
    with pytest.raises(ConfigurationError, match=f"'wafe'.*{package}.*wave"):
        check_libraries([package], ["wafe"])


def test_a_skill_without_any_library_is_named() -> None:
    with pytest.raises(ConfigurationError, match="'wave'"):
        check_libraries([], ["wave"])


def test_a_class_that_only_importing_shows_is_found(library: Callable[..., str]) -> None:
    package = library(arms=SKILL.format(name="_wave") + "wave = type('wave', (_wave,), {'__module__': __name__})")
    check_libraries([package], ["wave"])


def test_a_module_that_does_not_parse_is_no_obstacle_to_the_others(library: Callable[..., str]) -> None:
    package = library(arms=SKILL.format(name="wave"), broken="class")
    check_libraries([package], ["wave"])
