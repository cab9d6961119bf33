"""What was read of bags, in files: the second time a bag is open at once, also after a restart of the gateway."""

from __future__ import annotations

import hashlib
import logging
import os
import tempfile
from collections.abc import Callable, Iterable
from pathlib import Path

log = logging.getLogger(__name__)

#: The most bytes of all files.
_MAX_BYTES = 2**30


class BagCache:
    """Any thread; a bag is read by one at a time.

    The files are pickles: they are in the gateway's own folder, as others may write to that of the bags.

    :param folder: made if it is missing; None: nothing is kept.
    :param sources: files of the code that reads bags: what older code has read is read again.
    """

    def __init__(self, folder: Path | None, sources: Iterable[Path] = ()) -> None:
        self._folder = folder
        self._code = [source.stat().st_mtime_ns for source in sources]

    def get(self, part: str, bag: Path, read: Callable[[], bytes]) -> bytes:
        """Returns a part of a bag; reads it if it is not known, or the bag has changed since.

        :raises SkirosError: what `read` raises.
        """
        if self._folder is None or not bag.is_file():
            return read()
        file = self._folder / self._name(part, bag)
        try:
            data = file.read_bytes()
            os.utime(file)
            return data
        except OSError as error:
            log.debug("%s is read: %s", bag, error)
        data = read()
        try:
            self._write(file, data)
        except OSError as error:
            log.warning("what was read of %s is not kept: %s", bag, error)
        return data

    def _name(self, part: str, bag: Path) -> str:
        stat = bag.stat()
        key = part, str(bag.resolve()), stat.st_size, stat.st_mtime_ns, self._code
        return hashlib.sha256(repr(key).encode("utf-8", "surrogatepass")).hexdigest()

    def _write(self, file: Path, data: bytes) -> None:
        file.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        if file.parent.stat().st_uid != os.getuid():
            raise PermissionError(f"{file.parent} belongs to another user")
        with tempfile.NamedTemporaryFile(dir=file.parent, delete=False) as made:
            made.write(data)
        os.replace(made.name, file)
        total = 0
        for each in sorted(file.parent.iterdir(), key=lambda each: each.stat().st_mtime, reverse=True):
            total += each.stat().st_size
            if total > _MAX_BYTES and each != file:
                each.unlink()
