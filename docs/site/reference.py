"""The pages of the reference that are read from the platform: calls and hooks of skill authors, skills, vocabulary, ROS
interface, commands, errors.

Each function returns a page of Markdown, and adds to `problems` what is missing.
"""

from __future__ import annotations

import ast
import contextlib
import functools
import inspect
import io
import os
import pydoc
import runpy
import sys
import xml.etree.ElementTree as xml
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from rdflib import OWL, RDF, RDFS, Graph, URIRef

from skiros2_common.core.errors import SkirosError
from skiros2_common.core.params import Param, ParamTypes
from skiros2_common.core.primitive import PrimitiveBase
from skiros2_common.tools.plugin_loader import PluginLoader
from skiros2_skill.core.library.description import Described, Descriptions, Undescribed
from skiros2_skill.core.lint.codes import MEANINGS, Meaning
from skiros2_skill.core.tree.compound import SkillBase
from skiros2_skill.ros.registration import purpose_of

ROOT = Path(__file__).resolve().parents[2]
#: The sources of all packages, by package.
SOURCES = {
    path.name: path
    for pattern in ("skiros2/*/src/*", "skiros2_std_lib/**/src/*", "skiros2_gui/src/*")
    for path in sorted(ROOT.glob(pattern))
    if (path / "__init__.py").is_file()
}
SKILLS = (
    *("skiros2_std_skills", "skiros2_demo_skills", "skiros2_sim_skills", "skiros2_contact_skills"),
    *("skiros2_teaching", "skiros2_perception"),
)


def package_of(file: Path) -> str:
    """The name of the package with a launch file or a program."""
    return str(xml.parse(file.parent.parent / "package.xml").findtext("name"))


@functools.cache
def parsed(file: Path) -> ast.Module:
    """The syntax tree of a source file."""
    return ast.parse(file.read_text())


def table(headers: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """A table, without columns that are empty in all rows; "" without rows."""
    cells = [[_cell(cell) for cell in row] for row in rows]
    if not cells:
        return ""
    used = [number for number in range(len(headers)) if any(row[number] for row in cells)]
    lines = ["| " + " | ".join(row[number] for number in used) + " |" for row in [list(headers), *cells]]
    return "\n".join(["", lines[0], "|" + "---|" * len(used), *lines[1:], ""])


def _cell(value: object) -> str:
    text = " ".join(str(value).split()).replace("|", "\\|")
    parts = text.split("`")  # every second one is code, where Markdown itself replaces "<"
    return "`".join(part if number % 2 else part.replace("<", "&lt;") for number, part in enumerate(parts))


def code(value: object) -> str:
    """A text as code; "" stays."""
    return f"`{value}`" if str(value) else ""


# -- skills ------------------------------------------------------------------------------------------------------------


def skills(problems: list[str]) -> str:
    """The skills of the standard libraries, by their descriptions."""
    page = ["# Standard skills", "Read from the descriptions themselves. Types have the prefix `skiros:`."]
    for package in SKILLS:
        loader = PluginLoader()
        loader.load(package, (PrimitiveBase, SkillBase))
        problems += [f"{package}: {module}: {failure}" for module, failure in loader.failures.items()]
        descriptions = Descriptions(None, loader)
        described = sorted(descriptions.all(), key=lambda each: (each.skill.type, each.skill.label))
        unknown = [found for cls in loader if isinstance(found := descriptions.of(cls), Undescribed)]
        unknown = [each for each in unknown if each.cls.__name__[0].islower()]  # others are base classes
        problems += [f"{package}: {each.cls.__name__}: {each.reason}" for each in unknown]
        if described:
            page += [f"## {package}", *(_skill(each, problems) for each in described)]
    return "\n\n".join(page) + "\n"


def _skill(described: Described, problems: list[str]) -> str:
    skill, cls = described.skill, described.cls
    text = purpose_of(cls) or inspect.getdoc(cls) or ""
    if not text:
        problems.append(f"{cls.__module__}.{cls.__name__}: no docstring")
    kind = "compound" if isinstance(skill, SkillBase) else "primitive"
    lines = [f"### {skill.label}", text, f"{kind} `{cls.__module__}.{cls.__name__}`, type `{skill.type}`"]
    rows = [
        (code(key), _kind(param), code(_type(param)), _default(param), _meaning(param))
        for key, param in skill.params.items()
    ]
    lines.append(table(("parameter", "kind", "type", "default", "meaning"), rows))
    stages = {"pre": skill.pre_conditions, "hold": skill.hold_conditions, "post": skill.post_conditions}
    conditions = [(stage, code(each.label), each.getDescription()) for stage, some in stages.items() for each in some]
    lines.append(table(("condition", "name", "meaning"), conditions))
    return "\n\n".join(line for line in lines if line)


def _kind(param: Param) -> str:
    return next(kind.name.lower() for kind in ParamTypes if param.paramTypeIs(kind))


def _type(param: Param) -> str:
    return param.element_type if param.is_element else param.dataType().__name__


def _meaning(param: Param) -> str:
    return ", ".join(filter(None, (param.description, param.limits.text)))


def _default(param: Param) -> str:
    values = [] if param.is_element else param.getDefaultValues()
    return code(", ".join(str(value) for value in values if value is not None))


# -- for authors -------------------------------------------------------------------------------------------------------

_COMMON, _SKILL, _WORLD = "skiros2_common.core", "skiros2_skill.core", "skiros2_world_model.core"
_STD = "skiros2_std_skills"
#: What authors of skills override and call: title, introduction, and the members by class.
_FOR_AUTHORS: tuple[tuple[str, str, dict[str, str]], ...] = (
    (
        "A description declares",
        "`class Pick(SkillDescription)` with `createDescription`. An implementation that passes it to `setDescription` "
        "may add to it.",
        {
            f"{_COMMON}.skill_description.SkillDescription": "createDescription addParam addPreCondition "
            "addHoldCondition addPostCondition getRelationCond getPropCond getHasPropCond getOnTypeCond "
            "getIsSpecifiedCond getGenerateCond getSignalCond getOrCond "
            "setAvailableForPlanning set_duration",
            f"{_COMMON}.preempt_handler.Preemptible": "set_on_preempt",
        },
    ),
    (
        "A primitive overrides",
        "`class pick(PrimitiveBase)`. The thread that ticks the task calls the hooks, one at a time; each must return "
        "quickly.",
        {
            f"{_COMMON}.skill_description.SkillDescription": "createDescription",
            f"{_COMMON}.abstract_skill.SkillCore": "onStart execute onPreempt onEnd",
            f"{_COMMON}.primitive.PrimitiveBase": "onInit",
            f"{_COMMON}.primitive_thread.PrimitiveThreadBase": "run",
            f"{_STD}.action_client_primitive.PrimitiveActionClient": "buildClient buildGoal onFeedback onDone",
            f"{_STD}.service_client_primitive.PrimitiveServiceClient": "buildClient buildRequest onDone",
        },
    ),
    (
        "A compound overrides and calls",
        "`class transport(SkillBase)`. It has the hooks of a primitive too.",
        {
            f"{_SKILL}.tree.compound.SkillBase": "createDescription expand skill",
            f"{_SKILL}.tree.node.SkillInterface": "setProcessor",
            f"{_SKILL}.processors": "Serial SerialStar Selector ParallelFf ParallelFs NoFail RetryOnFail Loop",
        },
    ),
    (
        "A skill calls",
        "On `self`.",
        {
            f"{_COMMON}.abstract_skill.SkillCore": "setDescription step success fail startError wake",
            f"{_COMMON}.failure_kind": "FailureKind",
            f"{_COMMON}.skill_description.SkillDescription": "params wmi",
        },
    ),
    (
        "Parameters",
        '`self.params["Object"]`. An assigned element is written to the world model after `execute`.',
        {
            f"{_COMMON}.property.Property": "value values isSpecified unset",
            f"{_COMMON}.params.ParamHandler": "hasParam",
        },
    ),
    (
        "Elements",
        '`self.params["Object"].value`, and what `self.wmi` returns. `Element("skiros:Product")` is a new one.',
        {
            f"{_COMMON}.world_element.Element": "id type label value_of setProperty removeProperty "
            "hasProperty addRelation setRelation getRelations getData setData",
        },
    ),
    (
        "The world model",
        "`self.wmi`. A change is applied as a whole, or refused with the reason.",
        {
            f"{_WORLD}.scene_queries.SceneQueries": "get_element resolve_elements resolve_element get_branch "
            "get_relations",
            f"{_WORLD}.world_model_client.WorldModelClient": "add_element update_element "
            "remove_element instanciate set_relation",
            f"{_WORLD}.ontology_client.OntologyClient": "is_subclass query_ontology",
        },
    ),
    (
        "Tests",
        "The fixture `skill_bench`, without ROS; see [Testing skills](../skills.md#testing-skills).",
        {
            "skiros2_skill.testing.bench.SkillBench": "load add stand_in command element inject",
            "skiros2_skill.testing.bench_task.BenchTask": "tick run preempt state why node explanations",
        },
    ),
)
_START = """# For skill authors

What a skill calls and what it overrides; each name leads to its full description. The guide is [Skills](../skills.md),
the first one is made in [a tutorial](../tutorials/02_first_skill.md).

```python
from skiros2_common.core.params import ParamTypes
from skiros2_common.core.primitive import Element, PrimitiveBase, SkillDescription
from skiros2_skill.core.skill import ParallelFs, SerialStar, SkillBase  # compounds, processors
```
"""


def authors(problems: list[str]) -> str:
    """The calls and the hooks of skill authors, on one page, with links to their entries in the reference."""
    page = [_START]
    for title, about, classes in _FOR_AUTHORS:
        rows = [
            (f"[{code(_signature(name, member))}][{_defined(member)}]", _first(member), code(owner.rpartition(".")[2]))
            for owner, names in classes.items() for name, member in _members(owner, names, problems)
        ]  # fmt: skip
        page += [f"## {title}", about, table(("name", "meaning", "of"), rows)]
    return "\n\n".join(page) + "\n"


def _members(owner: str, names: str, problems: list[str]) -> Iterator[tuple[str, object]]:
    """The members of a class or a module."""
    found = pydoc.locate(owner)
    for name in names.split():
        member = inspect.getattr_static(found, name, None)
        if member is None or not inspect.getdoc(member):
            problems.append(f"{owner}.{name}: {'not there' if member is None else 'no docstring'}")
        else:
            yield name, member


def _defined(member: object) -> str:
    """The full name of a member where it is defined."""
    function = member.fget if isinstance(member, property) else member
    return f"{function.__module__}.{function.__qualname__}"


def _signature(name: str, member: object) -> str:
    """The call without types: `addParam(key, value, param_type, ...)`; of a property its name."""
    if not callable(member):
        return name
    parameters = [each for each in inspect.signature(member).parameters.values() if each.name != "self"]
    needed = [each.name for each in parameters if each.default is each.empty and each.kind is not each.VAR_KEYWORD]
    return f"{name}({', '.join([*needed, *(['...'] if len(needed) < len(parameters) else [])])})"


def _first(member: object) -> str:
    """The first paragraph of a docstring, without what only says that the method is to be overridden."""
    text = (inspect.getdoc(member) or "").partition("\n\n")[0].removeprefix("To override: ")
    return text[:1].upper() + text[1:]


# -- vocabulary --------------------------------------------------------------------------------------------------------

_KINDS = (
    ("Classes", OWL.Class, RDFS.subClassOf), ("Relations", OWL.ObjectProperty, RDFS.subPropertyOf),
    ("Properties", OWL.DatatypeProperty, RDFS.subPropertyOf),
)  # fmt: skip
#: What is under these is written by the platform: skills, their parameters and conditions.
_OF_SKILLS = (
    *("Skill", "Condition", "Parameter", "ParameterSet", "skillProperty"),
    *("SkillProperty", "ConditionProperty", "ParameterProperty", "ParameterSetProperty"),
)


def vocabulary(problems: list[str]) -> str:
    """Classes, relations and properties of the platform's ontologies: those for scenes, those of skills, and names of
    CORA and SUMO that the platform itself does not use."""
    graph = Graph()
    for file in sorted((ROOT / "ontologies").glob("*.ttl")):
        graph.parse(file)
    names = {term: graph.qname(term) for term in graph.subjects(RDF.type) if isinstance(term, URIRef)}
    scene, skill, rest = [], [], []
    for title, kind, above in _KINDS:
        terms = set(graph.subjects(RDF.type, kind)) & set(names)
        commented = {term for term in terms if graph.value(term, RDFS.comment)}
        lacking = sorted(names[term] for term in terms - commented if names[term].startswith("skiros:"))
        problems += [f"ontologies: {name} has no rdfs:comment" for name in lacking]
        of_skills = {
            term for term in commented
            if {names.get(each) for each in graph.transitive_objects(term, above)} & {f"skiros:{n}" for n in _OF_SKILLS}
        }  # fmt: skip
        scene += [f"## {title}", _terms_table(graph, names, commented - of_skills, kind, above)]
        skill += [f"### {title} of skills", _terms_table(graph, names, of_skills, kind, above)]
        if others := sorted(code(names[term]) for term in terms - commented):
            rest.append(f"{title}: {', '.join(others)}.")
    page = [
        "# Vocabulary",
        "The platform's ontologies, in `ontologies/`. A workspace [adds its own](../tutorials/05_ontology.md).",
        *scene,
        "## Skills, parameters, conditions",
        "Skill managers and studies write these into the world model.",
        *skill,
        "## More from CORA and SUMO",
        "Names of the standards that `skiros:` builds on; scenes may use them.",
        *rest,
    ]
    return "\n\n".join(page) + "\n"


def _terms_table(graph: Graph, names: dict[URIRef, str], terms: set[URIRef], kind: URIRef, above: URIRef) -> str:
    """A table of terms, those of the platform's own ontology first."""
    rows = []
    for term in sorted(terms, key=lambda term: (not names[term].startswith("skiros:"), names[term].lower())):
        row = [code(names[term]), str(graph.value(term, RDFS.comment)), _terms(graph, names, term, above)]
        if kind != OWL.Class:
            row += [_terms(graph, names, term, RDFS.domain), _terms(graph, names, term, RDFS.range)]
        rows.append(row)
    headers = ("name", "meaning", "under") if kind == OWL.Class else ("name", "meaning", "under", "of", "value")
    return table(headers, rows)


def _terms(graph: Graph, names: dict[URIRef, str], term: object, relation: URIRef) -> str:
    found = [names.get(each) or graph.qname(each) for each in graph.objects(term, relation) if isinstance(each, URIRef)]
    return ", ".join(code(name) for name in sorted(found))


# -- ROS ---------------------------------------------------------------------------------------------------------------

_CALLS = {
    "Publisher": "publishes",
    "Subscriber": "subscribes",
    "Service": "service",
    "ActionServer": "action",
    "get_param": "parameter",
}


@dataclass(frozen=True, order=True)
class _Interface:
    package: str
    module: str
    what: str
    name: str
    type: str


def ros_interface(problems: list[str]) -> str:
    """Launch arguments; topics, services, actions and parameters of the nodes; message definitions."""
    page = ["# ROS interface", "## Launch files"]
    for file in sorted([*ROOT.glob("launch/*.launch"), *ROOT.glob("skiros2_std_lib/**/launch/*.launch")]):
        tree = xml.parse(file)
        package = package_of(file)
        arguments = [each for each in tree.getroot() if each.tag == "arg" and "value" not in each.attrib]
        problems += [f"{file.name}: argument {a.get('name')} has no doc" for a in arguments if not a.get("doc")]
        page += [f"### {package} {file.name}", f"`roslaunch {package} {file.name}`"]
        rows = [(code(a.get("name")), code(a.get("default", "(required)")), a.get("doc", "")) for a in arguments]
        page.append(table(("argument", "default", "meaning"), rows))
    page += [
        "## Topics, services, actions, parameters",
        "Read from the sources, for all names that are written there as a text. `~` is the name of the node; `{...}` "
        "is known when the node runs.",
    ]
    found = sorted(set(_interfaces()))
    for package in dict.fromkeys(each.package for each in found):
        mine = [each for each in found if each.package == package]
        rows = [(each.what, code(each.name), code(each.type), code(each.module)) for each in mine]
        page += [f"### {package}", table(("kind", "name", "type or default", "module"), rows)]
    page.append("## Messages, services, actions")
    for folder in sorted(ROOT.glob("**/*_msgs/package.xml")):
        if "build" not in folder.parts and "install" not in folder.parts:
            page += list(_messages(folder.parent))
    return "\n\n".join(page) + "\n"


def _interfaces() -> Iterator[_Interface]:
    for package, source in SOURCES.items():
        for file in sorted(source.rglob("*.py")):
            for node in ast.walk(parsed(file)):
                if isinstance(node, ast.Call) and node.args and (what := _CALLS.get(_name(node.func))):
                    name = _text(node.args[0])
                    kind = ast.unparse(node.args[1]).rpartition(".")[2] if len(node.args) > 1 else ""
                    if name:
                        yield _Interface(package, file.relative_to(source).as_posix(), what, name, kind)


def _name(function: ast.expr) -> str:
    """The name of a called function of rospy or actionlib; "" for others."""
    if isinstance(function, ast.Attribute) and isinstance(function.value, ast.Name):
        return function.attr if function.value.id in ("rospy", "actionlib") else ""
    return ""


def _text(node: ast.expr) -> str:
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return node.value
    if isinstance(node, ast.JoinedStr):
        return "".join(
            str(part.value) if isinstance(part, ast.Constant) else "{" + ast.unparse(part.value) + "}"
            for part in node.values
            if isinstance(part, ast.Constant | ast.FormattedValue)
        )
    return ""


def _messages(package: Path) -> Iterator[str]:
    for folder in ("msg", "srv", "action"):
        for file in sorted((package / folder).glob(f"*.{folder}")):
            yield f"### {package.name}/{file.stem} ({folder})\n\n```\n{file.read_text().strip()}\n```"


# -- commands ----------------------------------------------------------------------------------------------------------


def commands(problems: list[str]) -> str:
    """The help of each command."""
    page = ["# Commands", "`rosrun PACKAGE COMMAND`; without ROS, `skiros2 COMMAND`."]
    os.environ["COLUMNS"] = "110"
    files = sorted([*ROOT.glob("skiros2/*/nodes/*"), *ROOT.glob("skiros2_std_lib/**/nodes/*")])
    for package in dict.fromkeys(map(package_of, files)):
        mine = [f for f in files if package_of(f) == package and not f.name.endswith("_node") and f.is_file()]
        page += [f"## {package}"] if mine else []
        for file in mine:
            shown = help_of(file)
            if not shown.startswith("usage: "):
                problems.append(f"{package} {file.name}: --help shows no usage")
            page.append(f"### {package} {file.name}\n\n```\n{shown.rstrip()}\n```")
    return "\n\n".join(page) + "\n"


def help_of(program: Path) -> str:
    """What `--help` prints."""
    before, out = sys.argv, io.StringIO()
    sys.argv = [str(program), "--help"]
    try:
        with contextlib.redirect_stdout(out), contextlib.suppress(SystemExit):
            runpy.run_path(str(program), run_name="__main__")
    finally:
        sys.argv = before
    return out.getvalue()


# -- errors ------------------------------------------------------------------------------------------------------------


def errors(problems: list[str]) -> str:
    """The classes of errors with their codes, and the codes of lint."""
    page = [
        "# Error codes",
        "## Errors",
        "Each derives from `SkirosError`. `code` is the kind of error where only texts are transmitted; services carry "
        "it in their replies.",
    ]
    classes: list[_Class] = []
    for package, source in SOURCES.items():
        for file in sorted(source.rglob("*.py")):
            tree = parsed(file)
            module = ".".join([package, *file.relative_to(source).with_suffix("").parts]).removesuffix(".__init__")
            classes += [_class(node, module) for node in ast.walk(tree) if isinstance(node, ast.ClassDef)]
    derived = _derived(classes)
    problems += [f"{each.module}.{each.name}: an error without docstring" for each in derived if not each.doc]
    rows = [(code(each.code), code(each.name), code(each.module), each.doc) for each in derived]
    page.append(table(("code", "class", "module", "meaning"), sorted(rows)))
    page += ["## Codes of lint", "Printed by `rosrun skiros2_skill lint`, and by a manager that loads skills."]
    page += [text for name, meaning in MEANINGS.items() for text in _fault(name, meaning)]
    return "\n\n".join(page) + "\n"


def _fault(name: str, meaning: Meaning) -> Iterator[str]:
    yield f"### {name}\n\n{meaning.text} {meaning.advice}"
    if meaning.wrong:
        right = f"\n# right\n{meaning.right}" if meaning.right else ""
        yield f"```python\n# wrong\n{meaning.wrong}{right}\n```"


@dataclass(frozen=True)
class _Class:
    name: str
    module: str
    bases: tuple[str, ...]
    code: str
    doc: str


def _class(node: ast.ClassDef, module: str) -> _Class:
    bases = tuple(ast.unparse(base).rpartition(".")[2] for base in node.bases)
    codes = [
        str(each.value.value) for each in node.body
        if isinstance(each, ast.Assign) and isinstance(each.value, ast.Constant)
        and [ast.unparse(target) for target in each.targets] == ["code"]
    ]  # fmt: skip
    return _Class(node.name, module, bases, "".join(codes), (ast.get_docstring(node) or "").partition("\n\n")[0])


def _derived(classes: Sequence[_Class]) -> list[_Class]:
    """`SkirosError` and the classes that derive from it, each with the code that it inherits."""
    result = {each.name: each for each in classes if each.name == SkirosError.__name__}
    size = 0
    while size < len(result):
        size = len(result)
        for each in classes:
            above = next((result[base] for base in each.bases if base in result), None)
            if above is not None and each.name not in result:
                result[each.name] = replace(each, code=each.code or above.code)
    return list(result.values())
