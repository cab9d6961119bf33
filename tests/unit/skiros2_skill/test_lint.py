"""Faults of skills are found before they run, with file and line; correct skills have none."""

import ast
import json
import re
import sys
import threading
from pathlib import Path

import pytest

import skiros2_demo_skills
from skiros2_common.core.errors import SkirosError, UnknownName
from skiros2_common.core.params import ParamTypes
from skiros2_common.core.primitive import PrimitiveBase
from skiros2_common.core.world_element import Element
from skiros2_common.core.world_model_port import WorldModelPort, read_only_calls
from skiros2_skill.command_line import lint as lint_command
from skiros2_skill.core import lint as lint_package
from skiros2_skill.core.library.description import ReadOnlyWorldModel
from skiros2_skill.core.library.library import SkillLibrary
from skiros2_skill.core.lint.codes import MEANINGS
from skiros2_skill.core.lint.findings import ERROR, NOT_DESCRIBED, NOTE, UNKNOWN_SKILL, WARNING
from skiros2_skill.core.lint.linter import Linter, lint_libraries, log_findings
from skiros2_skill.core.skill import SkillBase
from skiros2_world_model.core.local_world_model import LocalWorldModel, source_ontologies
from skiros2_world_model.core.ontology_lint import (
    UNKNOWN_CLASS,
    UNKNOWN_PROPERTY,
    UNKNOWN_RELATION,
    UNUSED_PREFIX,
    WRONG_ENDS,
    WRONG_LITERAL,
)
from skiros2_world_model.core.world_model import WorldModel
from unit.skiros2_skill.skills import REQUIRED, Note, Work, describe, primitive

FAULTY = Path(__file__).parents[2] / "libraries"
_MARK = re.compile(r"# (error|warning): ([\w-]+)")


@pytest.fixture(scope="module")
def wmi():
    return LocalWorldModel("test")


@pytest.fixture
def faulty_path(monkeypatch):
    monkeypatch.syspath_prepend(str(FAULTY))
    yield
    for name in [name for name in sys.modules if name.partition(".")[0] == "faulty_skills"]:
        del sys.modules[name]


def planted():
    for path in sorted((FAULTY / "faulty_skills").glob("*.py")):
        for number, line in enumerate(path.read_text().splitlines(), 1):
            for severity, code in _MARK.findall(line):
                if not line.startswith('"""'):
                    yield path.name, number, severity, code


def found(packages, wmi):
    return [f for f in lint_libraries(packages, wmi) if f.severity != NOTE]


def test_planted_fault_is_found_once_with_file_and_line(faulty_path, wmi):
    faults = found(["faulty_skills"], wmi)
    assert sorted((Path(f.file).name, f.line, f.severity, f.code) for f in faults) == sorted(planted())


def test_fault_text_names_the_expectation(faulty_path, wmi):
    texts = {f.code: f.text for f in found(["faulty_skills"], wmi)}
    assert "near: skiros:Say" in texts["unknown-skill"] or "there are: say" in texts["unknown-skill"]
    by_skill = {(f.skill, f.code): f.text for f in found(["faulty_skills"], wmi)}
    assert by_skill["skiros:Tell-wrong_values", "unknown-specify"] == (
        "specify of 'Tmies': skiros:Say has no such parameter; near: Times"
    )
    assert by_skill["skiros:Tell-wrong_types", "wrong-type"] in (
        "'Text' of skiros:Say is str, 'Volume' of the compound is float",
        "'Object' of skiros:Fetch-fetch is skiros:Product, 'Listener' of the compound is sumo:Agent",
    )
    assert "'Object' is skiros:Product in the description skiros:Fetch, here sumo:Object" in " ".join(
        f.text for f in found(["faulty_skills"], wmi) if f.skill == "skiros:Fetch-widened"
    )


@pytest.mark.parametrize("package", ["skiros2_demo_skills", "skiros2_std_skills", "catalogue"])
def test_own_library_has_no_faults(package):
    demo = Path(skiros2_demo_skills.__file__).parents[2] / "owl"
    wmi = LocalWorldModel("test", WorldModel(source_ontologies(), demo))
    faults = lint_libraries([package], wmi, used=["skiros2_std_skills"])
    assert [f for f in faults if f.severity != NOTE and "skiros2_msgs" not in f.text] == []


# -- what is not a fault -----------------------------------------------------------------------------------------------


def compound(name, expand, params=(), **attributes):
    def create(self):
        self.setDescription(describe(name, params)(), name.lower())
        self.__dict__.update(attributes)

    return type(name.lower(), (SkillBase,), {"createDescription": create, "expand": expand})


def faults_of(wmi, *classes):
    return [f for cls in classes for f in Linter(classes, wmi).lint(cls) if f.severity in (ERROR, WARNING)]


def test_remap_of_a_descendants_key_is_accepted(wmi):
    inner = compound("Inner", lambda self, skill: skill(self.skill("Note")))
    middle = compound("Middle", lambda self, skill: skill(self.skill("Inner", remap={"Text": "Line"})))
    outer = compound(
        "Outer", lambda self, skill: skill(self.skill("Middle", remap={"Line": "Words"})), [("Words", str, REQUIRED)]
    )
    assert [f for f in faults_of(wmi, primitive(Note, "note"), inner, middle, outer) if f.code == "unknown-remap"] == []
    assert faults_of(wmi, primitive(Note, "note"), middle, inner, outer)[0].skill != "skiros:Outer-outer"


def test_parameter_declared_at_start_is_accepted(wmi):
    def on_start(self):
        self.addParam("Later", str, ParamTypes.Optional)
        return True

    late = primitive(Work, "late", onStart=on_start)
    late.onStart = on_start
    user = compound(
        "User", lambda self, skill: skill(self.skill("Work", "late", remap={"Later": "A"}, specify={"B": 1}))
    )
    assert faults_of(wmi, late, user) == []


def declare(skill):
    skill.addParam("Later", str, ParamTypes.Optional)


def plain(description, label, **hooks):
    """A primitive as authors write it: its hooks are its own functions."""
    body = {"createDescription": lambda self: self.setDescription(description(), label), **hooks}
    return type(label, (PrimitiveBase,), body)


def nested(self):
    def inner():
        self.addParam("Later", str, ParamTypes.Optional)

    inner()
    return True


@pytest.mark.parametrize("on_start", [lambda self: declare(self) or True, nested, lambda self: [declare(self)] != []])
def test_parameter_declared_by_another_function_is_accepted(wmi, on_start):
    late = plain(Work, "late", onStart=on_start)
    user = compound("User", lambda self, skill: skill(self.skill("Work", "late", remap={"Later": "A"})))
    assert faults_of(wmi, late, user) == []


def test_skill_that_does_not_pass_itself_on_is_checked(wmi):
    def on_start(self):
        self.count = 1
        return self.params["Robot"].value is not None

    closed = plain(Work, "closed", onStart=on_start)
    user = compound("User", lambda self, skill: skill(self.skill("Work", "closed", remap={"Later": "A"})))
    assert [f.code for f in faults_of(wmi, closed, user)] == ["unknown-remap"]


def test_abandoned_expand_cannot_write(bench):
    gate, done, refused = threading.Event(), threading.Event(), []

    def expand(self, skill):
        gate.wait(20)
        try:
            self.wmi.add_element(Element("skiros:Product", "made by lint"))
        except SkirosError as error:
            refused.append(error)
        finally:
            done.set()

    before = bench.wmi.version
    assert [f.code for f in faults_of(bench.wmi, compound("Slow", expand))] == ["slow-expand"]
    gate.set()
    assert done.wait(20)
    assert refused
    assert bench.wmi.version == before


def test_int_for_a_float_parameter_is_a_warning(wmi):
    class real(primitive(Work, "real")):
        def createDescription(self):
            self.setDescription(describe("Count", [("Number", 1, ParamTypes.Optional)])(), "real")
            self.addParam("Number", 1.0, ParamTypes.Optional)

    assert [(f.severity, f.code) for f in faults_of(wmi, real)] == [(WARNING, "contradicts-description")]


def ring(*labels):
    """Compounds of which each has the next as its child, and the last the first."""
    following = dict(zip(labels, (*labels[1:], labels[0]), strict=True))
    return [compound(one, lambda self, skill, to=to: skill(self.skill(to))) for one, to in following.items()]


@pytest.mark.parametrize("labels", [("One",), ("One", "Two"), ("One", "Two", "Three")])
def test_recursion_is_reported_once(wmi, labels):
    linter = Linter(classes := ring(*labels), wmi)
    for _ in range(2):  # asked again, it says the same
        (fault,) = [f for cls in classes for f in linter.lint(cls) if f.severity == WARNING]
        assert (fault.code, fault.skill) == ("recursion", "skiros:One-one")
        assert all(f"skiros:{label}-{label.lower()}" in fault.text for label in labels[1:])


def test_compound_outside_of_a_cycle_is_not_reported(wmi):
    user = compound("User", lambda self, skill: skill(self.skill("One")))
    assert [f.skill for f in faults_of(wmi, user)] == ["skiros:User-user"]  # without the ring its child is unknown
    assert [f for f in Linter([user, *ring("One", "Two")], wmi).lint(user) if f.severity == WARNING] == []


def test_cycle_with_an_alternative_is_accepted(wmi):
    other = plain(describe("Two", []), "other")
    assert faults_of(wmi, *ring("One", "Two"), other) == []


def test_tree_that_depends_on_values_is_skipped(wmi):
    def expand(self, skill):
        for _ in range(self.params["Count"].value):
            skill(self.skill("Nothing", remap={"A": "B"}))

    faults = Linter([], wmi).lint(compound("Many", expand, [("Count", int, REQUIRED)]))
    assert [(f.severity, f.code) for f in faults] == [(NOTE, "not-checked")]


def test_tree_expanded_at_each_start_is_skipped(wmi):
    tried = []
    anew = compound("Anew", lambda self, skill: tried.append(1), _expand_on_start=True)
    assert Linter([], wmi).lint(anew) == []
    assert tried == []


def test_lint_does_not_change_the_world_model(bench):
    def expand(self, skill):
        self.wmi.add_element(Element("skiros:Product", "made by lint"))

    before = bench.wmi.version
    faults = Linter([], bench.wmi).lint(compound("Writes", expand))
    assert [f.code for f in faults] == ["not-checked"]
    assert bench.wmi.version == before


def test_lint_cannot_instantiate_a_template(bench):
    def expand(self, skill):
        self.wmi.instanciate("skiros:LargeBox", False, [])

    (fault,) = Linter([], bench.wmi).lint(compound("Makes", expand))
    assert "wmi.instanciate is not available" in fault.text


def test_checked_code_has_only_the_reading_methods_of_the_port(bench):
    guard = ReadOnlyWorldModel(bench.wmi)
    assert guard.get_element(bench.product.id).label == "product"
    assert guard.version == bench.wmi.version
    calls = {name for name in dir(bench.wmi) if not name.startswith("__")}
    refused = set()
    for name in calls:
        try:
            getattr(guard, name)
        except SkirosError:
            refused.add(name)
    assert {"instanciate", "add_element", "transact", "transport", "set_relation", "add_class"} <= refused
    assert calls - refused == read_only_calls(WorldModelPort) & calls


def test_narrowed_types_and_added_parameters_are_accepted(wmi):
    class narrow(primitive(Work, "narrow")):
        def createDescription(self):
            self.setDescription(describe("Grab", [("Object", Element("sumo:Object"), REQUIRED)])(), "narrow")
            self.addParam("Object", Element("skiros:Product"), REQUIRED)
            self.addParam("Force", 1.0, ParamTypes.Optional)

    assert faults_of(wmi, narrow) == []


@pytest.mark.parametrize("etype", ["", "Unknown"])
def test_parameter_of_any_class_has_no_unknown_class(wmi, etype):
    assert faults_of(wmi, primitive(describe("Hold", [("Object", Element(etype), REQUIRED)]), "hold")) == []


def test_int_and_float_parameters_match(wmi):
    count = describe("Count", [("Number", int, REQUIRED)])
    user = compound(
        "User", lambda self, skill: skill(self.skill("Count", remap={"Number": "Value"})), [("Value", 1.0, REQUIRED)]
    )
    assert faults_of(wmi, primitive(count, "count"), user) == []


def test_required_parameter_set_by_a_sibling_is_accepted(wmi):
    user = compound("User", lambda self, skill: skill(self.skill("Note"), self.skill("Tell")))
    tell = describe("Tell", [("Text", "", ParamTypes.Optional)])
    assert faults_of(wmi, primitive(Note, "note"), primitive(tell, "tell"), user) == []


def test_device_lock_is_no_contradiction(wmi):
    from unit.skiros2_skill.skills import LOCKED_ARM

    assert faults_of(wmi, primitive(describe("Weld", [LOCKED_ARM]), "weld")) == []


# -- loading -----------------------------------------------------------------------------------------------------------


def test_library_with_faults_is_loaded_with_one_warning(faulty_path, wmi, caplog):
    library = SkillLibrary(wmi, log_findings)
    library.import_libraries(["faulty_skills"])
    names = ["wrong_remaps", "say", "unknown_key", "fetch", "right", "unknown_names", "no_such_skill", "contradiction"]
    library.load(names)
    assert {i.label for i in library.implementations()} == set(names)
    (warning,) = [r.getMessage() for r in caplog.records if r.levelname == "WARNING"]
    heading, *lines = warning.splitlines()
    assert heading == f"library faulty_skills has {len(lines)} problems:"
    for line in lines:
        assert re.match(r"  /.*faulty_skills/\w+\.py:\d+: (warning|error): \[[\w-]+\] .* \(loaded; .*\)$", line)
    assert any("trees.py" in line and "[unknown-remap]" in line for line in lines)


def test_undescribable_skill_is_reported_with_its_line_and_skipped(faulty_path, wmi, caplog):
    library = SkillLibrary(wmi, log_findings)
    library.import_libraries(["faulty_skills"])
    library.load(["raises", "fetch"])
    assert [i.label for i in library.implementations()] == ["fetch"]
    with pytest.raises(
        UnknownName, match=r"was not loaded: .*descriptions\.py, line \d+: Mixed: expected a value of type int"
    ):
        library.candidates("skiros:Nothing", "raises")
    (error,) = [r.getMessage() for r in caplog.records if r.levelname == "ERROR"]
    assert re.search(
        r"faulty_skills\.descriptions\.raises .*descriptions\.py, line \d+: Mixed: expected a value of type int", error
    )


def test_unknown_parameter_type_is_reported_with_line_and_known_types(wmi):
    def create(self):
        self.setDescription(Work(), "misspelt")
        self.addParam("Text", "a", ParamTypes.Requird)

    (fault,) = Linter([], wmi).lint(type("misspelt", (PrimitiveBase,), {"createDescription": create}))
    assert (fault.file, fault.line) == (__file__, create.__code__.co_firstlineno + 2)
    assert "Requird; ParamTypes has: Required, Optional, Inferred" in fault.text


LINT = Path(lint_package.__file__).parent


def codes_in_sources():
    """The codes that the sources of lint give faults: their third or second argument, a text or a constant."""
    constants = {"UNKNOWN_SKILL": UNKNOWN_SKILL, "NOT_DESCRIBED": NOT_DESCRIBED}
    for file in LINT.glob("*.py"):
        for node in ast.walk(ast.parse(file.read_text())):
            if isinstance(node, ast.Call) and getattr(node.func, "id", "") in ("Finding", "finding_of"):
                given = node.args[2 if node.func.id == "finding_of" else 1]
                if isinstance(given, ast.JoinedStr):
                    yield from ("unknown-class", "unknown-property", "unknown-relation")
                elif isinstance(given, ast.Constant):
                    yield given.value
                elif given.id in constants:
                    yield constants[given.id]


def test_each_code_is_explained():
    of_files = {UNKNOWN_CLASS, UNKNOWN_RELATION, UNKNOWN_PROPERTY, WRONG_LITERAL, WRONG_ENDS, UNUSED_PREFIX}
    assert {*codes_in_sources(), *of_files, "syntax", "scene"} == set(MEANINGS)


def explained(capsys, *arguments):
    with pytest.raises(SystemExit) as ended:
        lint_command.run(arguments)
    return ended.value.code, *capsys.readouterr()


def test_explanation_of_a_code_has_an_example(capsys):
    status, out, _ = explained(capsys, "--explain", "unknown-skill")
    assert status == 0
    assert out.splitlines()[0].startswith("unknown-skill: No library has a skill of that type")
    assert out.splitlines()[-2:] == ['  wrong  self.skill("Driv", "")', '  right  self.skill("Drive", "")']


def test_all_codes_are_explained_as_json(capsys):
    assert set(json.loads(explained(capsys, "--explain", "--json")[1])) == set(MEANINGS)


def test_unknown_code_is_refused_with_the_nearest(capsys):
    assert explained(capsys, "--explain", "unknwn-skill") == (
        2, "", "lint: there is no code 'unknwn-skill'; did you mean 'unknown-skill'?\n",
    )  # fmt: skip


def test_lint_without_packages_is_a_usage_error(capsys):
    assert explained(capsys) == (2, "", "lint: expected a PACKAGE, or --explain; see lint --help\n")
