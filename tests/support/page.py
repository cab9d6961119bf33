"""The page's own code, run by node."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

from support.source import ROOT

SOURCES = ROOT / "skiros2_std_lib/skiros2_gateway/web/src"
#: Installed with the gateway's packages.
NODE = Path(sys.executable).parent / "node"

_CALLS = """
import * as module from %s;
import { createInterface } from "node:readline";
for await (const line of createInterface({ input: process.stdin })) {
  const [name, ...given] = JSON.parse(line);
  process.stdout.write(JSON.stringify(module[name](...given, (text) => text)) + "\\n");
}
"""


class PageModule:
    """A module of the page in a process of its own.

    A context manager that ends the process.

    :param name: of its file.
    """

    def __init__(self, name: str) -> None:
        program = _CALLS % json.dumps((SOURCES / name).as_uri())
        command = [str(NODE), "--input-type=module", "--eval", program]
        self._node = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)

    def __enter__(self) -> PageModule:
        return self

    def __exit__(self, *error: object) -> None:
        self._node.communicate()

    def call(self, function: str, *arguments: Any) -> Any:
        """Calls a function with JSON data, and last a function that returns its text as it is.

        :returns: JSON data.
        """
        assert self._node.stdin and self._node.stdout
        self._node.stdin.write(json.dumps([function, *arguments]) + "\n")
        self._node.stdin.flush()
        return json.loads(self._node.stdout.readline())
