"""The page's patches, in node: the same results as the gateway's, and nothing outside the document changes."""

from __future__ import annotations

import json
import subprocess
from typing import Any

import pytest

from skiros2_common.core.wording import visible
from skiros2_gateway.core.patch import apply_patch
from support.page import NODE, SOURCES

PATCH_JS = SOURCES / "patch.js"
PROGRAM = """
import { applyPatch, withoutPrototypes } from %s;
const [document, patch] = JSON.parse(process.argv[1]);
if (document.goals) withoutPrototypes(document);
applyPatch(document, patch);
const inherited = ["constructor", "toString"].filter((name) => document.goals?.[name]);
process.stdout.write(JSON.stringify({ inherited, document, polluted: ({}).admin ?? ({}).a ?? null }));
"""

pytestmark = pytest.mark.skipif(not NODE.exists(), reason="needs node: .ci/setup run gateway page")


def run_in_node(program: str, *arguments: str) -> Any:
    command = [str(NODE), "--input-type=module", "-e", program, *arguments]
    return json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout)


def patched(document: Any, patch: Any) -> Any:
    program = PROGRAM % json.dumps(PATCH_JS.as_uri())
    return run_in_node(program, json.dumps([document, patch]))


@pytest.mark.parametrize(
    "patch",
    [
        {"__proto__": {"admin": True}},
        {"constructor": {"prototype": {"admin": True}}},
        {"elements": {"__proto__": {"a": 1}, "toString": {"a": {"b": 2}}}},
        {"__proto__": "text", "elements": {"hasOwnProperty": 1}},
        {"elements": {"x": None, "y": {"z": [1, None]}}},
    ],
)
def test_patch_changes_the_document_only(patch: dict[str, Any]) -> None:
    document: dict[str, Any] = {"elements": {"x": {"y": 1}}}
    found = patched(document, patch)
    apply_patch(document, patch)
    assert (found["document"], found["polluted"]) == (document, None)


def test_table_has_no_entry_that_the_gateway_has_not_sent() -> None:
    """A job may be named `constructor`, and its goal be missing."""
    found = patched({"goals": {"a": {}}}, {"goals": {"b": {}}})
    assert found["inherited"] == []


def test_elements_with_the_same_label_are_named_with_their_ids() -> None:
    """A person who approves something sees which of them it is."""
    program = f"""
        import {{ Cell }} from {json.dumps(PATCH_JS.with_name("cell.js").as_uri())};
        const cell = Object.create(Cell.prototype, {{ document: {{ value: JSON.parse(process.argv[1]) }} }});
        const names = ["x:Cup-1", "x:Cup-2", "x:Tray-3", "x:Tray-4", "Cup"].map((id) => cell.name(id));
        process.stdout.write(JSON.stringify([...names, cell.withNames("+ x:Cup-1 x:in x:Tray-3, x:Nothing-9")]));
    """
    labels = {"x:Cup-1": "Cup", "x:Cup-2": "x:Cup", "x:Tray-3": "Tray", "x:Tray-4": ""}
    elements = {eid: {"label": label, "type": "x:Thing"} for eid, label in labels.items()}
    elements["x:Key-5"] = {"label": "Tray", "type": "skiros:Parameter"}
    named = ["Cup (Cup-1)", "Cup (Cup-2)", "Tray", "Tray-4", "Cup"]
    assert run_in_node(program, json.dumps({"elements": elements})) == [
        *named, "+ Cup (Cup-1) in Tray, x:Nothing-9",
    ]  # fmt: skip


def test_page_shows_invisible_characters_as_the_window_does() -> None:
    texts = ["Blue cup", "a\nb", "Tray\u202e7-yarT", "T\u200bray", "\u2066x\u2069", "\x1b[2J", "\xa0", "äöü☃", "\u2028"]
    program = f"""
        import {{ visible }} from {json.dumps(PATCH_JS.with_name("dom.js").as_uri())};
        process.stdout.write(JSON.stringify(JSON.parse(process.argv[1]).map(visible)));
    """
    shown = run_in_node(program, json.dumps(texts))
    assert all(text.replace("\n", "").isprintable() for text in shown)
    assert shown[:5] == [visible(text, keep="\n") for text in texts[:5]]
