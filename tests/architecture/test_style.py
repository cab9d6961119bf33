"""Rules of style that no linter of ours holds."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
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
    "skiros2/skiros2_world_model/src/skiros2_world_model/core/world_model_client.py:WorldModelAbstractInterface": (
        "the contract's calls, which both adapters share"
    ),
}


@pytest.fixture(params=FILES, ids=str)
def file(request: pytest.FixtureRequest) -> SourceFile:
    return request.param


def test_no_wildcard_import(file: SourceFile) -> None:
    assert not [f"{file}:{line}" for line, name in file.imports() if name.endswith(".*")]


def test_no_except_that_also_takes_exits_and_interrupts(file: SourceFile) -> None:
    handlers = [node for node in ast.walk(file.tree) if isinstance(node, ast.ExceptHandler)]
    assert not [
        f"{file}:{handler.lineno}"
        for handler in handlers
        if handler.type is None or "BaseException" in _names(handler.type)
    ]


def test_only_programs_print(file: SourceFile) -> None:
    calls = [node for node in ast.walk(file.tree) if isinstance(node, ast.Call)]
    printing = [f"{file}:{call.lineno}" for call in calls if ast.unparse(call.func) == "print"]
    assert not printing or file.is_program, "log it instead"


def test_no_mutable_default_but_those_of_the_contract(file: SourceFile) -> None:
    fixed = set(_contract_defaults())
    assert not [
        f"{file}:{default.lineno}: {function}({argument}=...)"
        for function, argument, default in _defaults(file.tree)
        if isinstance(default, ast.List | ast.Dict | ast.Set | ast.ListComp | ast.Call)
        and not _is_immutable_call(default)
        and (function, argument) not in fixed
    ]


def test_a_file_holds_one_concept(file: SourceFile) -> None:
    lines = file.text.count("\n")
    assert lines <= FILE_LINES or str(file) in LONG, f"{lines} lines"


def test_a_class_holds_one_concept(file: SourceFile) -> None:
    assert not [
        f"{name}: {lines} lines"
        for name, lines in _class_lengths(file).items()
        if lines > CLASS_LINES and name not in LONG
    ]


def test_every_exception_from_the_length_rule_is_still_needed() -> None:
    long = {str(file) for file in FILES if file.text.count("\n") > FILE_LINES}
    for file in FILES:
        long |= {name for name, lines in _class_lengths(file).items() if lines > CLASS_LINES}
    assert not set(LONG) - long


def _class_lengths(file: SourceFile) -> dict[str, int]:
    classes = [node for node in ast.walk(file.tree) if isinstance(node, ast.ClassDef)]
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


def test_the_test_knows_what_it_looks_for(tmp_path: Path) -> None:
    """Each rule above fails on a file that breaks it."""
    bad = SourceFile(tmp_path / "src" / "bad.py", "skiros2_common", "core")
    bad.path.parent.mkdir()
    bad.path.write_text("from os import *\ntry:\n    print()\nexcept(BaseException):\n    pass\ndef f(a=[]): ...\n")
    for rule in (
        test_no_wildcard_import,
        test_no_except_that_also_takes_exits_and_interrupts,
        test_only_programs_print,
        test_no_mutable_default_but_those_of_the_contract,
    ):
        with pytest.raises(AssertionError):
            rule(bad)
