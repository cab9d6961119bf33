"""Libraries are imported again with changed code; running tasks keep the old code, and a failure keeps all of it."""

import sys

import pytest

from skiros2_common.core.abstract_skill import State
from skiros2_common.core.errors import ConfigurationError, UnknownName
from skiros2_skill.core.library.library import SkillLibrary
from skiros2_skill.core.library.reload import reloading
from skiros2_skill.core.tree.skill_node import SkillWrapper
from skiros2_skill.testing.bench_task import BenchTask

SKILLS = """
from skiros2_common.core.abstract_skill import SkillDescription
from skiros2_common.core.params import ParamTypes
from skiros2_common.core.primitive import PrimitiveBase
from skiros2_skill.core.skill import SkillBase


class Speak(SkillDescription):
    def createDescription(self):
        self.addParam("Volume", {volume}, ParamTypes.Optional)


class speak(PrimitiveBase):
    def createDescription(self):
        self.setDescription(Speak(), "speak")

    def execute(self):
        return self.success("{word}")


class Talk(SkillDescription):
    pass


class talk(SkillBase):
    def createDescription(self):
        self.setDescription(Talk(), "talk")

    def expand(self, skill):
        skill(self.skill("Pause"), self.skill("Speak"))


class Pause(SkillDescription):
    pass


class pause(PrimitiveBase):
    ticks = 0

    def createDescription(self):
        self.setDescription(Pause(), "pause")

    def execute(self):
        self.ticks += 1
        return self.step("") if self.ticks < 3 else self.success("")
"""


class Package:
    """A Python package that a test writes."""

    def __init__(self, folder, name):
        self.name = name
        self.folder = folder / name
        self.folder.mkdir()
        (self.folder / "__init__.py").touch()

    def write(self, module="words", **parts):
        (self.folder / f"{module}.py").write_text(SKILLS.format(**{"word": "old", "volume": 1, **parts}))

    def spoil(self, text):
        (self.folder / "words.py").write_text(text)


@pytest.fixture
def package(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    package = Package(tmp_path, f"reloaded_{tmp_path.name}")
    package.write()
    yield package
    for name in [name for name in sys.modules if name.startswith(package.name)]:
        del sys.modules[name]


@pytest.fixture
def library(bench, package):
    library = SkillLibrary(bench.wmi)
    library.import_libraries([package.name])
    library.load(["speak", "talk", "pause"])
    return library


def word(bench, library):
    task = BenchTask(bench.wmi)
    task.root(SkillWrapper("Speak", "speak", library))
    assert task.run().state is State.Success
    return task.skill.progress_msg


def test_reload_uses_new_code_and_description(bench, library, package):
    assert word(bench, library) == "old"
    package.write(word="new", volume=2)
    with reloading(library) as fresh:
        pass
    assert word(bench, fresh) == "new"
    assert fresh.by_label("speak").declared.params["Volume"].value == 2
    assert [i.label for i in fresh.implementations()] == [i.label for i in library.implementations()]


def test_running_task_keeps_old_code(bench, library, package):
    task = BenchTask(bench.wmi)
    task.root(SkillWrapper("Talk", "", library))
    assert task.tick() is State.Running
    package.write(word="new")
    with reloading(library) as fresh:
        pass
    assert task.run().state is State.Success
    assert task.node("speak").progress_msg == "old"
    assert word(bench, fresh) == "new"


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("def", r"words.*words\.py, line 1: invalid syntax"),
        ("import no_such_module", "No module named 'no_such_module'"),
        ("", "skill 'speak': no class of that name"),
        (
            SKILLS.format(word="new", volume="nothing_of_that_name"),
            r"speak cannot be loaded: .*words\.py, line \d+: NameError",
        ),
    ],
)
def test_failed_reload_keeps_old_code(bench, library, package, text, why):
    before = {name: module for name, module in sys.modules.items() if name.startswith(package.name)}
    package.spoil(text)
    with pytest.raises(ConfigurationError, match=why), reloading(library):
        raise AssertionError("it was loaded")
    assert word(bench, library) == "old"
    assert {name: module for name, module in sys.modules.items() if name.startswith(package.name)} == before
    package.write(word="new")
    with reloading(library) as fresh:
        pass
    assert word(bench, fresh) == "new"


def test_exception_during_reload_restores_modules(library, package):
    before = sys.modules[f"{package.name}.words"]
    package.write(word="new")
    with pytest.raises(RuntimeError), reloading(library):
        raise RuntimeError("the world model is gone")
    assert sys.modules[f"{package.name}.words"] is before


def test_reload_of_unknown_library_is_refused(library, package):
    refusal = f"no library 'nothing' was loaded; there are: {package.name}"
    with pytest.raises(UnknownName, match=refusal), reloading(library, ["nothing"]):
        pass


def test_reload_includes_only_dependent_libraries(bench, package, tmp_path):
    user, other = Package(tmp_path, f"{package.name}_user"), Package(tmp_path, f"{package.name}_other")
    (user.folder / "louder.py").write_text(
        f"from {package.name}.words import speak\n\n\nclass shout(speak):\n"
        '    def createDescription(self):\n        super().createDescription()\n        self.setLabel("shout")\n'
    )
    other.write()
    library = SkillLibrary(bench.wmi)
    library.import_libraries([package.name, user.name, other.name])
    before = {
        name: sys.modules[name] for name in (f"{package.name}.words", f"{user.name}.louder", f"{other.name}.words")
    }
    with reloading(library, [package.name]):
        pass
    changed = [name for name, module in before.items() if sys.modules[name] is not module]
    assert changed == [f"{package.name}.words", f"{user.name}.louder"]
