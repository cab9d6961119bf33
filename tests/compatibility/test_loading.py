"""Loading and selecting implementations of existing libraries, in one process."""

from __future__ import annotations

import logging
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from compatibility.rules import rule
from skiros2_common.core.abstract_skill import State
from skiros2_common.core.errors import ConfigurationError, UnknownName, WrongType
from skiros2_skill.core.lint.findings import ERROR, WARNING
from skiros2_skill.core.lint.linter import lint_libraries
from skiros2_skill.testing import SkillBench

HEAD = """
from skiros2_common.core.abstract_skill import SkillDescription
from skiros2_common.core.params import ParamTypes
from skiros2_common.core.primitive import ParamOptions, PrimitiveBase
from skiros2_common.core.world_element import Element
from skiros2_skill.core.skill import SkillBase


class Greet(SkillDescription):
    def createDescription(self):
        self.addParam("Text", "hello", ParamTypes.Optional)
        self.addParam("Thing", Element("skiros:Product"), ParamTypes.Optional)


class greet_quietly(PrimitiveBase):
    def createDescription(self):
        self.setDescription(Greet(), "quiet greeting")

    def execute(self):
        return self.success("psst")


class greet_loudly(PrimitiveBase):
    def createDescription(self):
        self.setDescription(Greet(), "greet_loudly")

    def execute(self):
        return self.success("HELLO")


class Visit(SkillDescription):
    pass
"""


class Library:
    """A package that is imported by a bench."""

    def __init__(self, name: str, bench: SkillBench) -> None:
        self.name = name
        self.bench = bench
        self.module = f"{name}.skills"

    def load(self, *names: str) -> None:
        self.bench.library.load(names)

    @property
    def labels(self) -> set[str]:
        return {i.label for i in self.bench.library.implementations()}

    def warnings(self) -> list[str]:
        """What the linter says of it."""
        return [f.text for f in lint_libraries([self.name], self.bench.wmi) if f.severity == WARNING]


@pytest.fixture
def library(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, skill_bench: SkillBench
) -> Iterator[Callable[[str], Library]]:
    """Makes and imports a library of the skills above and some more."""
    monkeypatch.syspath_prepend(tmp_path)
    name = f"library_{tmp_path.name}"

    def make(text: str = "") -> Library:
        folder = tmp_path / name
        folder.mkdir()
        (folder / "__init__.py").touch()
        (folder / "skills.py").write_text(HEAD + text)
        skill_bench.import_libraries(name)
        return Library(name, skill_bench)

    yield make
    for module in [module for module in sys.modules if module.partition(".")[0] == name]:
        del sys.modules[module]


def visit(children: str, declares: str = "") -> str:
    """The source of a compound."""
    return f"""

class visit(SkillBase):
    def createDescription(self):
        self.setDescription(Visit(), "visit")
{declares}
    def expand(self, skill):
        skill({children})
"""


@rule("loading", "`self.skill(type, label)`: of the loaded implementations, the one with that label is used")
def test_the_loaded_implementation_with_that_label_is_used(library: Any, skill_bench: SkillBench) -> None:
    library(visit('self.skill("Greet", "quiet greeting")')).load("greet_loudly", "greet_quietly", "visit")
    task = skill_bench.command("Visit").run()
    assert task.node("quiet greeting").progress_msg == "psst"


@rule(
    "loading",
    "A label that no loaded implementation has is the name of a class in the libraries, which is loaded and "
    "used whatever its own label is, in a tree, a start request and a plan",
)
def test_label_may_be_a_class_name(library: Any, skill_bench: SkillBench) -> None:
    one = library(visit('self.skill("Greet", "greet_quietly")'))
    one.load("greet_loudly", "visit")
    task = skill_bench.command("Visit").run()
    assert task.state is State.Success, task.why
    assert task.node("quiet greeting").progress_msg == "psst"
    assert skill_bench.command("Greet", "greet_quietly").run().skill.progress_msg == "psst"
    assert one.labels == {"greet_loudly", "visit", "quiet greeting"}


@rule("loading", "A class that is loaded already under its own label is found by its class name too")
def test_a_loaded_class_is_found_by_its_class_name_too(library: Any, skill_bench: SkillBench) -> None:
    one = library()
    one.load("greet_quietly")
    assert skill_bench.command("Greet", "greet_quietly").run().skill.progress_msg == "psst"
    assert len(skill_bench.library.implementations()) == 1


@rule("loading", "A label that is neither a label nor the name of a class is an error that names the labels there are")
def test_a_label_that_is_neither_a_label_nor_a_class_is_an_error(library: Any, skill_bench: SkillBench) -> None:
    library().load("greet_loudly")
    with pytest.raises(UnknownName, match="skiros:Greet has no implementation 'greet_shyly'; it has: 'greet_loudly'"):
        skill_bench.command("Greet", "greet_shyly")


@rule("loading", "An unknown skill type in `self.skill` raises in `expand`", better="the error names the nearest types")
def test_an_unknown_type_raises_in_expand(library: Any, skill_bench: SkillBench) -> None:
    library(visit('self.skill("Greet"), self.skill("Gret")')).load("greet_loudly", "visit")
    task = skill_bench.command("Visit").run()
    assert task.state is State.Failure
    assert task.skill.progress_code == -404
    assert "no skill of type skiros:Gret; near: skiros:Greet" in task.skill.progress_msg


@rule(
    "loading",
    "With an empty label any loaded implementation of the type is used",
    better="where none is loaded, those of the libraries are looked through",
)
def test_an_empty_label_also_finds_types_that_are_not_loaded(library: Any, skill_bench: SkillBench) -> None:
    library(visit('self.skill("Greet")')).load("visit")
    task = skill_bench.command("Visit").run()
    assert task.state is State.Success, task.why


# -- classes are not checked -------------------------------------------------------------------------------------------


@rule(
    "loading",
    "The class of the element in `addParam` says what is searched; an element of any class is accepted from "
    "`specify`, a request, the blackboard and a plan",
    better="of several implementations the one that declares the class comes first",
)
def test_an_element_of_any_class_is_accepted(library: Any, skill_bench: SkillBench) -> None:
    library(
        visit(
            'self.skill("Greet", "greet_loudly", remap={"Thing": "Box"})',
            '        self.addParam("Box", Element("skiros:LargeBox"), ParamTypes.Required)\n',
        )
    ).load("greet_loudly", "visit")
    box = skill_bench.add("skiros:LargeBox", "box")
    assert skill_bench.command("Greet", Thing=box).run().skill.params["Thing"].value.id == box.id
    task = skill_bench.run(skill_bench.node("Greet", "greet_loudly", Thing=box))
    assert task.state is State.Success, task.why
    task = skill_bench.command("Visit", Box=box).run()
    assert task.node("greet_loudly").params["Thing"].value.id == box.id, task.why


@rule("loading", "`ParamOptions.RespectType` demands the declared class, as a pre-condition")
def test_respect_type_demands_the_class(library: Any, skill_bench: SkillBench) -> None:
    library("""

class Sort(SkillDescription):
    def createDescription(self):
        self.addParam("Thing", Element("skiros:Product"), ParamTypes.Required, [ParamOptions.RespectType])


class sort(PrimitiveBase):
    def createDescription(self):
        self.setDescription(Sort(), "sort")

    def execute(self):
        return self.success("")
""").load("sort")
    box, product = skill_bench.add("skiros:LargeBox", "box"), skill_bench.add("skiros:Product", "product")
    assert skill_bench.command("Sort", Thing=product).run().state is State.Success
    task = skill_bench.command("Sort", Thing=box).run()
    assert (task.state, task.skill.progress_code) == (State.Failure, -1)


# -- what is wrong is warned of, and loaded ----------------------------------------------------------------------------

#: By what is wrong with a library: its source, and what the warning says.
PROBLEMS = {
    "remap of an unknown key": (visit('self.skill("Greet", "", remap={"Txet": "Robot"})'), "remap of 'Txet'"),
    "specify of an unknown key": (visit('self.skill("Greet", "", specify={"Txet": "a"})'), "specify of 'Txet'"),
    "element of another class": (
        visit(
            'self.skill("Greet", "", remap={"Thing": "Box"})',
            '        self.addParam("Box", Element("skiros:LargeBox"), ParamTypes.Required)\n',
        ),
        "'Thing' of skiros:Greet is skiros:Product, 'Box' of the compound is skiros:LargeBox",
    ),
    "parameter that nothing sets": (
        "\n\nclass Count(SkillDescription):\n    def createDescription(self):\n"
        '        self.addParam("Times", int, ParamTypes.Required)\n\n\nclass count(PrimitiveBase):\n'
        '    def createDescription(self):\n        self.setDescription(Count(), "count")\n'
        + visit('self.skill("Count")'),
        "requires 'Times', and nothing in the tree sets it",
    ),
    "contradiction": (
        visit(
            "",
            '        self.addParam("A", Element("skiros:Product"), ParamTypes.Optional)\n'
            "        for state in (True, False):\n"
            '            self.addPreCondition(self.getIsSpecifiedCond(f"Is{state}", "A", state))\n',
        ),
        "cannot both hold",
    ),
    "contradiction of the description": (
        "\n\nclass visit(PrimitiveBase):\n    def createDescription(self):\n"
        '        self.setDescription(Greet(), "visit")\n        self.addParam("Text", 5, ParamTypes.Optional)\n',
        "'Text' is str in the description skiros:Greet, here int",
    ),
    "condition on an unknown key": (
        visit("", '        self.addPreCondition(self.getIsSpecifiedCond("Has", "Thign", True))\n'),
        "refers to 'Thign'",
    ),
}


@rule(
    "loading",
    "Remaps and values of unknown keys, other classes, parameters that nothing sets and contradictions are loaded",
    better="one warning for each library lists all of it with file, line and what is done about each",
)
@pytest.mark.parametrize("problem", PROBLEMS)
def test_problems_are_warned_of_with_file_and_line_and_loaded(
    library: Any, caplog: pytest.LogCaptureFixture, problem: str
) -> None:
    source, text = PROBLEMS[problem]
    one = library(source)
    one.load("visit", "greet_loudly")
    assert "visit" in one.labels
    (warning,) = [r.getMessage() for r in caplog.records if r.levelno == logging.WARNING]
    assert warning.startswith(f"library {one.name} has ")
    (line,) = [line for line in warning.splitlines() if text in line]
    assert "skills.py:" in line
    assert "(loaded; " in line


@rule("loading", "A remap to a name that is nowhere else is loaded", better="it is reported with the nearest name")
def test_a_remap_to_a_name_that_nothing_has_is_reported_with_the_nearest(library: Any) -> None:
    declares = '        self.addParam("Target", Element("skiros:Product"), ParamTypes.Required)\n'
    carry = """

class Carry(SkillDescription):
    def createDescription(self):
        self.addParam("To", Element("skiros:Product"), ParamTypes.Required)


class carry(PrimitiveBase):
    def createDescription(self):
        self.setDescription(Carry(), "carry")
"""
    one = library(carry + visit('self.skill("Carry", "", remap={"To": "Taget"})', declares))
    one.load("visit")
    assert "visit" in one.labels
    (text,) = one.warnings()
    assert "remap of 'To' of skiros:Carry to 'Taget'" in text
    assert "near: Target" in text


@rule("loading", "Checking a library at load runs `expand`", better="it cannot write to the world model then")
def test_nothing_is_written_when_a_library_is_checked(library: Any, skill_bench: SkillBench) -> None:
    before = skill_bench.wmi.version
    library(visit('self.wmi.instanciate("skiros:LargeBox", False, []) and self.skill("Greet")')).load("visit")
    assert skill_bench.wmi.version == before


@rule("loading", "Conditions that an implementation adds after `setDescription` count")
def test_conditions_of_the_implementation_count(library: Any, skill_bench: SkillBench) -> None:
    declares = '        self.addPreCondition(self.getIsSpecifiedCond("Has", "Robot", False))\n'
    library(visit("", declares)).load("visit")
    task = skill_bench.command("Visit").run()
    assert (task.state, task.skill.progress_code) == (State.Failure, -1)


@rule("loading", "`specify` of an unknown key at run time is logged and ignored")
def test_specify_of_an_unknown_key_is_logged_and_ignored(library: Any, skill_bench: SkillBench) -> None:
    library(visit('self.skill("Greet", "", specify={"Txet": "a"})')).load("visit")
    task = skill_bench.command("Visit").run()
    assert task.state is State.Success, task.why


@rule("loading", "A start request with an unknown key is refused")
def test_request_with_an_unknown_key_is_rejected(library: Any, skill_bench: SkillBench) -> None:
    library().load("greet_loudly")
    with pytest.raises(UnknownName, match="has no parameter 'Txet'; it has: Text, Thing, Robot"):
        skill_bench.command("Greet", Txet="a")
    with pytest.raises(WrongType):
        skill_bench.command("Greet", Text=5)


# -- skills that cannot be loaded --------------------------------------------------------------------------------------

BROKEN = {
    "__init__": "class broken(PrimitiveBase):\n    def __init__(self):\n        super().__init__()\n        1 / 0\n\n"
    '    def createDescription(self):\n        self.setDescription(Greet(), "broken")\n',
    "createDescription": "class broken(PrimitiveBase):\n    def createDescription(self):\n        1 / 0\n",
    "onInit": "class broken(PrimitiveBase):\n    def createDescription(self):\n"
    '        self.setDescription(Greet(), "broken")\n\n    def onInit(self):\n        1 / 0\n',
    "modifyDescription": "class broken(PrimitiveBase):\n    def createDescription(self):\n"
    '        self.setDescription(Greet(), "broken")\n\n    def modifyDescription(self, skill):\n        1 / 0\n',
}


@rule(
    "robustness",
    "A listed skill whose constructor, `createDescription`, `modifyDescription` or `onInit` raises is "
    "skipped, and the others load",
    better="one error names class, file, line and reason",
)
@pytest.mark.parametrize("hook", BROKEN)
def test_a_skill_that_cannot_be_loaded_is_reported_once_and_skipped(
    library: Any, skill_bench: SkillBench, caplog: pytest.LogCaptureFixture, hook: str
) -> None:
    one = library(f"\n\n{BROKEN[hook]}")
    one.load("broken", "greet_loudly")
    assert one.labels == {"greet_loudly"}
    skill_bench.command("Greet").run()
    with pytest.raises(UnknownName, match=r"was not loaded: .*ZeroDivisionError"):
        skill_bench.command("Greet", "broken")
    (error,) = [r.getMessage() for r in caplog.records if r.levelno == logging.ERROR]
    file = sys.modules[one.module].__file__
    lines = Path(file or "").read_text().splitlines()
    assert (
        f"{one.module}.broken cannot be loaded: {file}, line {lines.index('        1 / 0') + 1}: ZeroDivision" in error
    )


@rule("robustness", "A skill whose `onInit` returns False is skipped, and the others load")
def test_a_skill_that_declines_to_be_loaded_is_skipped(library: Any, caplog: pytest.LogCaptureFixture) -> None:
    source = BROKEN["onInit"].replace("1 / 0", "return False")
    one = library(f"\n\n{source}")
    one.load("broken", "greet_loudly")
    assert one.labels == {"greet_loudly"}
    assert "onInit returned False" in caplog.text


@rule("robustness", "An unknown class in `skill_list`, or an unknown library, ends the launch with one line")
def test_unknown_names_are_named_all_at_once(library: Any, skill_bench: SkillBench) -> None:
    one = library()
    with pytest.raises(
        ConfigurationError, match=r"'greet_lodly': no class .* near: greet_loudly.*; skill 'wave'"
    ) as error:
        one.load("greet_lodly", "greet_quietly", "wave")
    assert "\n" not in str(error.value)
    with pytest.raises(ConfigurationError, match="'no_such_library'"):
        skill_bench.import_libraries("no_such_library")


@rule(
    "loading",
    "A description with an unknown kind of parameter cannot be loaded",
    better="the error names the library's own line and the known kinds",
)
def test_unknown_parameter_type_error_names_the_known_types(library: Any) -> None:
    one = library("""

class odd(PrimitiveBase):
    def createDescription(self):
        self.setDescription(Greet(), "odd")
        self.addParam("Text", "a", ParamTypes.Requird)
""")
    (fault,) = [f for f in lint_libraries([one.name], one.bench.wmi) if f.severity == ERROR]
    assert fault.file == sys.modules[one.module].__file__
    assert "Required, Optional, Inferred" in fault.text


@rule(
    "robustness",
    "What a skill raises fails it with the traceback as message",
    better="the error and the library's own line come first",
)
def test_the_error_and_the_librarys_line_come_before_the_traceback(library: Any, skill_bench: SkillBench) -> None:
    one = library("""

class trip(PrimitiveBase):
    def createDescription(self):
        self.setDescription(Greet(), "trip")

    def execute(self):
        return int("twelve")
""")
    one.load("trip")
    task = skill_bench.command("Greet", "trip").run()
    first, second, *_ = task.skill.progress_msg.splitlines()
    line = 1 + (HEAD.count("\n") + 7)
    file = sys.modules[one.module].__file__
    error = "ValueError: invalid literal for int() with base 10: 'twelve'"
    assert first == f"{error} ({file}, line {line}, in execute)"
    assert second.startswith("Traceback")
    assert task.skill.progress_msg.rstrip().endswith(error)
