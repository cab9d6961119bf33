"""docs/compatibility.md matches the tests of this folder."""

from __future__ import annotations

import ast

from compatibility.table import FOLDER, PAGE, page


def test_every_compatibility_test_names_its_rule():
    missing = [
        f"{file.name}: {node.name}"
        for file in sorted(FOLDER.glob("test_*.py"))
        if file.name != "test_table.py"
        for node in ast.parse(file.read_text()).body
        if isinstance(node, ast.FunctionDef)
        and node.name.startswith("test_")
        and not any(isinstance(m, ast.Call) and getattr(m.func, "id", "") == "rule" for m in node.decorator_list)
    ]
    assert not missing


def test_page_is_generated_from_the_tests():
    assert PAGE.read_text() == page(), "run: .venv/bin/python3 tests/compatibility/table.py"
