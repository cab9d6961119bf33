"""Writes the tables of docs/compatibility.md from the tests: `python3 tests/compatibility/table.py`."""

from __future__ import annotations

import ast
import sys
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

FOLDER = Path(__file__).parent
ROOT = FOLDER.parents[1]
PAGE = ROOT / "docs" / "compatibility.md"
BEGIN = "<!-- The tables below are made from tests/compatibility by tests/compatibility/table.py. -->"

sys.path.insert(0, str(FOLDER.parent))

from compatibility.rules import TOPICS  # noqa: E402 - after the path


def rules() -> Iterator[tuple[str, str, str, str, str]]:
    """(topic, rule, improvement, difference, file) of each test, in the order of the files."""
    for file in sorted(FOLDER.glob("test_*.py")):
        for node in ast.parse(file.read_text()).body:
            if not isinstance(node, ast.FunctionDef) or not node.name.startswith("test_"):
                continue
            for mark in node.decorator_list:
                if isinstance(mark, ast.Call) and isinstance(mark.func, ast.Name) and mark.func.id == "rule":
                    topic, text = (ast.literal_eval(argument) for argument in mark.args)
                    more = {k.arg: ast.literal_eval(k.value) for k in mark.keywords}
                    yield topic, text, more.get("better", ""), more.get("differs", ""), file.name


def tables() -> str:
    """The page's tables, a section for each topic."""
    by_topic = defaultdict(list)
    for topic, text, better, differs, file in rules():
        here = f"**differs**: {differs}" if differs else f"better: {better}" if better else "same"
        by_topic[topic].append((text, here, file))
    lines = []
    for topic, title in TOPICS.items():
        if topic not in by_topic:
            continue
        files = sorted({file for _, _, file in by_topic[topic]})
        tested = ", ".join(f"[{file}](../tests/compatibility/{file})" for file in files)
        lines += ["", f"## {title}", "", f"Tested by {tested}.", "", "| SkiROS2 | here |", "|---|---|"]
        lines += [f"| {_cell(text)} | {_cell(here)} |" for text, here, _ in by_topic[topic]]
    return "\n".join(lines) + "\n"


def page() -> str:
    """The whole page: the text that is written by hand, and the tables."""
    by_hand, _, _ = PAGE.read_text().partition(BEGIN)
    return f"{by_hand}{BEGIN}\n{tables()}"


def _cell(text: str) -> str:
    return text.replace("|", "\\|")


if __name__ == "__main__":
    PAGE.write_text(page())
