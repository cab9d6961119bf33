"""Rules of style that no linter of ours holds."""

from __future__ import annotations

import ast
import re
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import pytest

from support.ros import ROOT
from support.source import SourceFile, source_files

FILES = source_files()
PUBLIC_API = ROOT / "tests/contract/public_api.txt"

#: A file or class longer than this holds two concepts.
FILE_LINES = 450
CLASS_LINES = 300
#: Longer ones, each with the reason why it is one concept after all.
LONG: dict[str, str] = {
    "skiros2/skiros2_world_model/src/skiros2_world_model/core/world_model.py:WorldModel": (
        "one lock for requests and reads"
    ),
    "skiros2/skiros2_task/src/skiros2_task/core/execution.py:ExecutionStateMachine": (
        "one state machine: each event depends on the phase and on all steps"
    ),
    "skiros2/skiros2_task/src/skiros2_task/core/executor.py:GoalExecutor": (
        "one thread owns the state of all goals: each event may change what others are granted"
    ),
}


#: Private names that the contract fixes for libraries, and those of other projects that have no public name.
CONTRACT_NAMES = {
    "_getReasoner", "_id", "_label", "_param_type", "_params", "_progress_code", "_properties", "_relations",
    "_setProgress", "_setState", "_type", "_wmi",
}  # fmt: skip
FOREIGN_NAMES = {
    "_actions", "_chain", "_clock_sub", "_connection_header", "_exit", "_generate_id", "_get_service_uri", "_getframe",
    "_option_string_actions", "_replace", "_request_class", "_set_caller_id", "_set_rostime", "_SubParsersAction",
    "_tcpros_server", "_TopicImpl",
}  # fmt: skip
#: Folders in which modules still access private names of others.
PRIVATE_ACCESS_REMAINS = ("skiros2_std_lib/skiros2_bags/",)


def test_no_wildcard_import() -> None:
    assert not list(_wildcard_imports(FILES))


def test_no_except_catches_exits_and_interrupts() -> None:
    assert not list(_broad_excepts(FILES))


def test_only_programs_print() -> None:
    assert not list(_prints(FILES)), "log it instead"


def test_yaml_is_parsed_with_limits() -> None:
    assert not list(_yaml_parsers(FILES)), "use skiros2_common.core.yaml_text"


def test_only_contract_functions_have_mutable_defaults() -> None:
    assert not list(_mutable_defaults(FILES))


def test_no_file_is_too_long() -> None:
    lengths = {str(file): file.text.count("\n") for file in FILES}
    assert not {name: lines for name, lines in lengths.items() if lines > FILE_LINES and name not in LONG}


def test_no_class_is_too_long() -> None:
    lengths = {name: lines for file in FILES for name, lines in _class_lengths(file).items()}
    assert not {name: lines for name, lines in lengths.items() if lines > CLASS_LINES and name not in LONG}


def test_each_exception_from_the_length_rules_is_needed() -> None:
    long = {str(file) for file in FILES if file.text.count("\n") > FILE_LINES}
    for file in FILES:
        long |= {name for name, lines in _class_lengths(file).items() if lines > CLASS_LINES}
    assert not set(LONG) - long


def test_no_module_accesses_private_names_of_another() -> None:
    files = [file for file in FILES if not str(file).startswith(PRIVATE_ACCESS_REMAINS)]
    assert not list(_private_accesses(files)), "make what another module needs public"


def test_each_folder_with_private_access_has_some() -> None:
    accesses = list(_private_accesses(FILES))
    assert not [name for name in PRIVATE_ACCESS_REMAINS if not any(access.startswith(name) for access in accesses)]


def _private_accesses(files: Iterable[SourceFile]) -> Iterator[str]:
    """The accesses to private attributes that no class of the file defines or uses as its own."""
    for file in files:
        names = [node for node in file.nodes if isinstance(node, ast.Attribute)]
        own = {node.attr for node in names if _is_own(node.value)}
        own |= {getattr(node, "name", "") for node in file.nodes}
        own |= {node.id for node in file.nodes if isinstance(node, ast.Name)}
        for node in names:
            is_private = node.attr.startswith("_") and not node.attr.startswith("__")
            if is_private and node.attr not in own | CONTRACT_NAMES | FOREIGN_NAMES:
                yield f"{file}:{node.lineno}: {ast.unparse(node)}"


def _is_own(node: ast.expr) -> bool:
    """Whether it is `self`, `cls` or `super()`."""
    return (isinstance(node, ast.Name) and node.id in ("self", "cls")) or (
        isinstance(node, ast.Call) and "super" in _names(node.func)
    )


def _wildcard_imports(files: Iterable[SourceFile]) -> Iterator[str]:
    for file in files:
        yield from (f"{file}:{line}" for line, name in file.imports() if name.endswith(".*"))


def _broad_excepts(files: Iterable[SourceFile]) -> Iterator[str]:
    for file in files:
        for node in file.nodes:
            if isinstance(node, ast.ExceptHandler) and (node.type is None or "BaseException" in _names(node.type)):
                yield f"{file}:{node.lineno}"


def _prints(files: Iterable[SourceFile]) -> Iterator[str]:
    for file in files:
        for node in file.nodes:
            if isinstance(node, ast.Call) and ast.unparse(node.func) == "print" and not file.is_program:
                yield f"{file}:{node.lineno}"


def _yaml_parsers(files: Iterable[SourceFile]) -> Iterator[str]:
    for file in files:
        for node in file.nodes:
            if isinstance(node, ast.Attribute) and re.fullmatch(r"yaml\.\w*load\w*", ast.unparse(node)):
                yield f"{file}:{node.lineno}"


def _mutable_defaults(files: Iterable[SourceFile]) -> Iterator[str]:
    fixed = set(_contract_defaults())
    for file in files:
        for function, argument, default in _defaults(file.tree):
            if (
                isinstance(default, ast.List | ast.Dict | ast.Set | ast.ListComp | ast.Call)
                and not _is_immutable_call(default)
                and (function, argument) not in fixed
            ):
                yield f"{file}:{default.lineno}: {function}({argument}=...)"


def _class_lengths(file: SourceFile) -> dict[str, int]:
    classes = [node for node in file.nodes if isinstance(node, ast.ClassDef)]
    return {f"{file}:{node.name}": node.end_lineno - node.lineno for node in classes}


def _names(node: ast.expr) -> set[str]:
    return {part.id for part in ast.walk(node) if isinstance(part, ast.Name)}


def _defaults(tree: ast.Module) -> Iterator[tuple[str, str, ast.expr]]:
    """The functions' names, arguments and defaults."""
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda):
            name = getattr(node, "name", "lambda")
            positional = [*node.args.posonlyargs, *node.args.args]
            pairs = list(zip(reversed(positional), reversed(node.args.defaults), strict=False))
            pairs += zip(node.args.kwonlyargs, node.args.kw_defaults, strict=True)
            for argument, default in pairs:
                if default is not None:
                    yield name, argument.arg, default


def _is_immutable_call(default: ast.expr) -> bool:
    """Calls that make values which cannot be changed."""
    return isinstance(default, ast.Call) and ast.unparse(default.func) in {"frozenset", "tuple", "rospy.Duration"}


def _contract_defaults() -> Iterator[tuple[str, str]]:
    """(function, argument) of the defaults in the public surface that are lists, sets, dicts or instances."""
    for line in PUBLIC_API.read_text().splitlines():
        if match := re.match(r"\s+(?:method|function) ((\w+)\(.*\))$", line):
            signature = ast.parse(f"def {match.group(1)}: ...")
            for function, argument, default in _defaults(signature):
                if not isinstance(default, ast.Constant):
                    yield function, argument


RULES = [_wildcard_imports, _broad_excepts, _prints, _yaml_parsers, _mutable_defaults, _private_accesses]


@pytest.mark.parametrize("rule", RULES)
def test_each_rule_finds_a_file_that_breaks_it(rule: Callable[..., Iterator[str]], tmp_path: Path) -> None:
    bad = SourceFile(tmp_path / "src" / "bad.py", "skiros2_common", "core")
    bad.path.parent.mkdir()
    bad.path.write_text(
        "from os import *\ntry:\n    print()\nexcept(BaseException):\n    pass\ndef f(a=[]): a._x\nyaml.safe_load(f)\n"
    )
    assert list(rule([bad]))
