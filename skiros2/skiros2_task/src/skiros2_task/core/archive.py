"""Archives the files of each planning request for debugging."""

from __future__ import annotations

import logging
import os
import re
import shutil
import tempfile
import threading
import time
from collections.abc import Mapping
from pathlib import Path

log = logging.getLogger(__name__)

_FOLDER_NAME = re.compile(r"\d{8}-\d{6}-\w+$")


class Archive:
    """A folder with the PDDL of the latest request, and a subfolder for each of the last requests."""

    def __init__(self, folder: Path, count: int = 50) -> None:
        """
        :param folder: created on first use.
        :param count: the number of requests to keep.
        """
        self._folder = folder
        self._count = count
        self._lock = threading.Lock()

    def keep(self, texts: Mapping[str, str]) -> None:
        """Stores the texts of a request, by file name. A folder that cannot be written is logged and ignored."""
        try:
            with self._lock:
                self._keep(texts)
        except OSError as error:
            log.warning("the files of this plan are not archived: %s", error)

    def _keep(self, texts: Mapping[str, str]) -> None:
        self._folder.mkdir(parents=True, exist_ok=True)
        request = Path(tempfile.mkdtemp(prefix=time.strftime("%Y%m%d-%H%M%S-"), dir=self._folder))
        for name, text in texts.items():
            (request / name).write_text(text, encoding="utf-8")
            if name.endswith(".pddl"):
                # Atomic: other processes may read and write the same folder.
                latest = request / f"{name}.latest"
                latest.write_text(text, encoding="utf-8")
                os.replace(latest, self._folder / name)
        requests = [p for p in self._folder.iterdir() if p.is_dir() and _FOLDER_NAME.match(p.name)]
        requests.sort(key=lambda p: (p.name[:15], p.stat().st_mtime_ns))  # names resolve only seconds
        for old in requests[: -self._count]:
            shutil.rmtree(old, ignore_errors=True)
