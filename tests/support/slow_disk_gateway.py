"""The gateway's node on a slow disk: `slow_disk_gateway.py SECONDS __name:=gateway`, the time of each commit."""

from __future__ import annotations

import sqlite3
import sys
import time
from typing import Any

SECONDS = float(sys.argv.pop(1))


class SlowConnection(sqlite3.Connection):
    def execute(self, sql: str, *arguments: Any) -> sqlite3.Cursor:
        if sql == "COMMIT":
            time.sleep(SECONDS)
        return super().execute(sql, *arguments)


def connect(*arguments: Any, **options: Any) -> sqlite3.Connection:
    return SlowConnection(*arguments, **options)


sqlite3.connect = connect  # type: ignore[assignment]

from skiros2_common.ros.node import run_node  # noqa: E402
from skiros2_gateway.ros.gateway import main  # noqa: E402

run_node("gateway", main)
