"""The window shows texts from elsewhere as they are: Qt would take those with tags for HTML."""

from __future__ import annotations

import ast

from support.source import source_files

GUI = "skiros2_gui/src/"
CONTROLS = "app/widgets/controls.py"


def _calls() -> list[tuple[str, ast.Call]]:
    files = [file for file in source_files() if GUI in str(file.path) and not str(file.path).endswith(CONTROLS)]
    assert len(files) > 50
    return [(f"{file.path}:{node.lineno}", node) for file in files for node in file.nodes if isinstance(node, ast.Call)]


def _is_constant(node: ast.expr) -> bool:
    if isinstance(node, ast.IfExp):
        return _is_constant(node.body) and _is_constant(node.orelse)
    return isinstance(node, ast.Constant) or (isinstance(node, ast.Name) and node.id.isupper())


def test_labels_of_the_window_are_plain() -> None:
    rich = [place for place, call in _calls() if isinstance(call.func, ast.Name) and call.func.id == "QLabel"]
    assert not rich, "use PlainLabel or text_label"


def test_tool_tips_of_the_window_are_plain() -> None:
    def is_plain(text: ast.expr) -> bool:
        is_made = isinstance(text, ast.Call) and isinstance(text.func, ast.Name) and text.func.id == "plain_tip"
        return is_made or _is_constant(text)

    tips = [(p, c) for p, c in _calls() if isinstance(c.func, ast.Attribute) and c.func.attr == "setToolTip"]
    assert len(tips) > 20
    assert not [place for place, call in tips if not is_plain(call.args[-1])], "use plain_tip"
