"""Finding plugins in a package and its subpackages."""

import sys

import pytest

from skiros2_common.core.errors import ConfigurationError
from skiros2_common.tools.plugin_loader import PluginLoader


class Base:
    pass


@pytest.fixture
def package(tmp_path, monkeypatch):
    """Makes a package of these files and removes it from the interpreter afterwards."""
    made = []

    def make(name, **files):
        root = tmp_path / name
        for path, text in {"__init__": "", **files}.items():
            file = root / (path.replace("__", "/") if path != "__init__" else path)
            file = file.with_suffix(".py")
            file.parent.mkdir(parents=True, exist_ok=True)
            (file.parent / "__init__.py").touch()
            file.write_text(text)
        made.append(name)
        return name

    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setitem(sys.modules, "base_of_plugins", sys.modules[__name__])
    yield make
    for module in [m for m in sys.modules if m.split(".")[0] in made]:
        del sys.modules[module]


PLUGIN = "from base_of_plugins import Base\nclass {0}(Base):\n    pass\n"


def test_subclasses_of_a_package_and_its_subpackages_are_found(package):
    name = package("lib_found", arm=PLUGIN.format("Arm"), base__drive=PLUGIN.format("Drive"), other="x = 1\n")
    loader = PluginLoader()
    assert {p.__name__ for p in loader.find(name, Base)} == {"Arm", "Drive"}
    assert loader.size() == 2
    assert loader.getPluginByName("Arm").__name__ == "Arm"
    assert loader.getPluginByName(f"{name}.base.drive.Drive").__name__ == "Drive"
    assert loader.named("Leg") is None
    assert len(loader.create()) == 2


def test_imported_class_is_not_a_plugin_of_the_module(package):
    name = package("lib_imports", arm=PLUGIN.format("Arm"), user="from lib_imports.arm import Arm\n")
    assert len(PluginLoader().find(name, Base)) == 1


def test_module_with_import_error_is_skipped_and_logged_with_its_cause(package):
    name = package("lib_broken", arm=PLUGIN.format("Arm"), bad="def f(:\n", worse="import no_such_thing\n")
    loader = PluginLoader()
    assert [p.__name__ for p in loader.find(name, Base)] == ["Arm"]
    assert "line 1" in str(loader.failures["lib_broken.bad"])
    assert "No module named 'no_such_thing'" in str(loader.failures["lib_broken.worse"])


def test_module_that_exits_is_skipped_and_logged(package, tmp_path):
    """As a script without a guard does; also when it is a package."""
    leaves = "import sys\nsys.exit('nothing to do')\n"
    name = package("lib_exits", arm=PLUGIN.format("Arm"), script=leaves, tools__arm=PLUGIN.format("Arm"))
    (tmp_path / name / "tools" / "__init__.py").write_text(leaves)
    loader = PluginLoader()
    assert [p.__name__ for p in loader.find(name, Base)] == ["Arm"]
    assert "line 2: SystemExit: nothing to do" in str(loader.failures["lib_exits.script"])
    assert "SystemExit: nothing to do" in str(loader.failures["lib_exits.tools"])


def test_missing_package_raises_a_configuration_error_with_its_name():
    with pytest.raises(ConfigurationError, match="library 'no_such_library': there is no Python package of that name"):
        PluginLoader().load("no_such_library", Base)
    with pytest.raises(ConfigurationError, match=r"name; near: skiros2_common\.tools"):
        PluginLoader().load("skiros2_common.tols", Base)


def test_package_with_import_error_raises_a_configuration_error_with_the_cause(package):
    name = package("lib_dead", __init__="1 / 0\n")
    with pytest.raises(ConfigurationError, match=r"lib_dead.*line 1: ZeroDivisionError"):
        PluginLoader().load(name, Base)
