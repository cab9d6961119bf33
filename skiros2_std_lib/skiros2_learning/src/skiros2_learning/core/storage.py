"""Where a study is stored: a journal file in its folder, or a database that several machines share."""

from __future__ import annotations

import json
import logging
import os
import shutil
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import optuna
from optuna.exceptions import ExperimentalWarning, StorageInternalError
from optuna.storages import BaseStorage, JournalStorage, RDBStorage
from optuna.storages.journal import JournalFileBackend, JournalFileSymlinkLock
from optuna.study import Study
from optuna.trial import FrozenTrial
from sqlalchemy.engine import make_url
from sqlalchemy.exc import ArgumentError, DBAPIError, IntegrityError, ProgrammingError, SQLAlchemyError

from skiros2_common.core.errors import ConfigurationError, MissingPackage, Refused

log = logging.getLogger(__name__)

JOURNAL_FILE = "journal.log"

#: How often a process reports that its evaluations are running (s), and how long after its last report they count as
#: interrupted.
HEARTBEAT, GRACE_PERIOD = 20, 180


#: How long another process may take to create the tables of a new database (s).
_SETTLE_TIME = 3.0


class StorageFailed(Refused):
    """A study cannot be read or written: a full disk, a database that does not answer."""

    code = "storage_failed"


def open_storage(folder: Path, url: str, on_stale: Callable[[Study, FrozenTrial], None]) -> BaseStorage:
    """Opens the storage of a study.

    :param url: of a database, such as `postgresql://user@host/name`; "" for the journal in the folder.
    :param on_stale: called with an evaluation whose process on another machine has died.
    :raises ConfigurationError: the URL is wrong.
    :raises MissingPackage: the driver of the database is not installed.
    :raises StorageFailed: it cannot be opened.
    """
    with storing(folder, url):
        if not url:
            journal = (folder / JOURNAL_FILE).absolute()  # its lock is a link to it, in its folder
            _keep_readable(journal)
            return JournalStorage(JournalFileBackend(str(journal)))
        try:
            try:
                return _connect(url, on_stale)
            except (ProgrammingError, IntegrityError):
                time.sleep(_SETTLE_TIME)  # another process creates the tables at the same time
                return _connect(url, on_stale)
        except ArgumentError as error:
            raise ConfigurationError(f"{public_name(url)}: {_reason(error)}") from None
        except ImportError as error:
            missing = error.__cause__ or error
            raise MissingPackage(f"{public_name(url)}: its driver is not installed: {missing}") from None


def _connect(url: str, on_stale: Callable[[Study, FrozenTrial], None]) -> RDBStorage:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ExperimentalWarning)
        return RDBStorage(
            url,
            {"pool_pre_ping": True},  # reconnects after a restart of the database
            heartbeat_interval=HEARTBEAT,
            grace_period=GRACE_PERIOD,
            heartbeat_stale_trial_callback=on_stale,
        )


def repeat_stale(study: Study) -> None:
    """Lets evaluations be repeated whose process on another machine has died."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ExperimentalWarning)
        optuna.storages.fail_stale_trials(study)


@contextmanager
def storing(folder: Path, url: str) -> Iterator[None]:
    """Inside the `with` block, failures of the storage are raised as one error.

    :raises StorageFailed: with the place and the reason, in one line.
    """
    try:
        yield
    except (SQLAlchemyError, StorageInternalError, OSError) as error:
        if isinstance(error, ArgumentError):
            raise
        raise StorageFailed(f"{public_name(url) if url else folder / JOURNAL_FILE}: {_reason(error)}") from error


def public_name(url: str) -> str:
    """Returns a database URL without its password."""
    try:
        return make_url(url).render_as_string(hide_password=True)
    except ArgumentError:
        return "database URL"


def _keep_readable(journal: Path) -> None:
    """Removes the end of an entry that was written while the disk was full: the next one would be appended to it. Of a
    journal that is damaged elsewhere, the entries before that are kept, as later ones depend on all before them; the
    whole file is kept beside it."""
    if not journal.exists():
        return
    lock = JournalFileSymlinkLock(str(journal))
    lock.acquire()
    try:
        data = journal.read_bytes()
        size = data.rfind(b"\n") + 1
        read = 0
        for number, line in enumerate(data[:size].splitlines(keepends=True), 1):
            if not _is_entry(line):
                size = read
                copy = journal.with_suffix(".damaged")
                shutil.copyfile(journal, copy)
                log.warning(
                    "%s: line %d is damaged: the study continues from there; whole file: %s", journal, number, copy
                )
                break
            read += len(line)
        if size < len(data):
            os.truncate(journal, size)
    finally:
        lock.release()


def _is_entry(line: bytes) -> bool:
    try:
        return "op_code" in json.loads(line)
    except (ValueError, TypeError):
        return False


def _reason(error: BaseException) -> str:
    """Returns the first line of the innermost cause."""
    while error.__cause__ is not None:
        error = error.__cause__
    inner = error.orig if isinstance(error, DBAPIError) and error.orig is not None else error
    text = inner.strerror if isinstance(inner, OSError) and inner.strerror else str(inner)
    return next((line.strip() for line in text.splitlines() if line.strip()), type(inner).__name__)
