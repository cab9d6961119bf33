"""Libraries are checked before a launch: the same verdict as loading, without importing where reading is enough."""

import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from skiros2_common.core.errors import ConfigurationError
from skiros2_skill.core.library.library_check import check_libraries

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
def test_existing_skill_is_found_without_import(library: Callable[..., str], name: str) -> None:
    package = library(arms=SKILL.format(name="wave") + "raise RuntimeError('imported')")
    check_libraries([package], [name.format(library=package)])
    assert package not in sys.modules


def test_missing_library_is_named() -> None:
    with pytest.raises(ConfigurationError, match="'no_such_library'"):
        check_libraries(["no_such_library"], [])


def test_missing_skill_is_named_with_the_searched_libraries(library: Callable[..., str]) -> None:
    package = library(arms=SKILL.format(name="wave"))
    with pytest.raises(ConfigurationError, match=f"'wafe'.*{package}.*wave"):
        check_libraries([package], ["wafe"])


def test_skill_without_library_is_named() -> None:
    with pytest.raises(ConfigurationError, match="'wave'"):
        check_libraries([], ["wave"])


def test_class_that_needs_an_import_is_found(library: Callable[..., str]) -> None:
    package = library(arms=SKILL.format(name="_wave") + "wave = type('wave', (_wave,), {'__module__': __name__})")
    check_libraries([package], ["wave"])


def test_module_with_a_syntax_error_does_not_hide_others(library: Callable[..., str]) -> None:
    package = library(arms=SKILL.format(name="wave"), broken="class")
    check_libraries([package], ["wave"])
