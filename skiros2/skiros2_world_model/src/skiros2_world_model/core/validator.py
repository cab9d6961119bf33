"""Validation in a subprocess, which does not block the world model."""

from __future__ import annotations

import json
import logging
import os
import subprocess
import sys
import threading
from collections.abc import Callable, Iterable
from concurrent.futures import CancelledError, Future, ThreadPoolExecutor
from dataclasses import astuple
from pathlib import Path
from typing import Any, TypeVar

import pyoxigraph as ox

from skiros2_common.core.errors import Refused, SkirosError, WrongValue
from skiros2_common.core.operations import SCENE
from skiros2_world_model.core.knowledge_base import KnowledgeBase
from skiros2_world_model.core.rdf import parse_n_triples
from skiros2_world_model.core.report import Finding, Report
from skiros2_world_model.core.validation import validate, validate_file
from skiros2_world_model.core.world_model import WorldModel

log = logging.getLogger(__name__)


_Result = TypeVar("_Result")

_PROGRAM = "skiros2_world_model.core.validator"

_ENDED = "the validation has ended"

#: The maximum number of logged findings of a file.
_MAX_LOGGED = 10


class Validator:
    """Validates files and contexts of a world model, one at a time, in a subprocess. Thread-safe."""

    def __init__(self, model: WorldModel) -> None:
        self._model = model
        self._pool = ThreadPoolExecutor(1, "validation")
        self._process: subprocess.Popen[bytes] | None = None
        self._stopped = False
        self._lock = threading.Lock()

    def file_loaded(self, context: str) -> None:
        """Starts the validation of the file that was loaded into a context. The findings are logged.

        :raises Refused: the validation was stopped.
        """
        self._submit(self._log_findings, context)

    def validate_context(self, context: str = SCENE) -> Report:
        """Validates the current state of a context and returns the report. Blocks.

        :raises WrongValue: the name of the context, or a shape file, is invalid.
        :raises Refused: the validation failed.
        """
        triples = self._model.triples(context)
        try:
            return self._submit(self._validate, f"context {context}", context, triples).result()
        except CancelledError:
            raise Refused(_ENDED) from None

    def stop(self) -> None:
        """Kills a running validation and refuses further ones. Does not block."""
        with self._lock:
            self._stopped = True
            if self._process is not None:
                self._process.kill()
        self._pool.shutdown(wait=False, cancel_futures=True)

    def _submit(self, task: Callable[..., _Result], *arguments: object) -> Future[_Result]:
        with self._lock:
            self._check_running()
            return self._pool.submit(task, *arguments)

    def _check_running(self) -> None:
        if self._stopped:
            raise Refused(_ENDED)

    def _log_findings(self, context: str) -> None:
        """Logs the findings in the last loaded file of a context, except the findings that loading has logged."""
        path = self._model.loaded[context]
        try:
            report = self._validate(str(path), context, None)
        except SkirosError as error:
            if not self._stopped:
                log.warning("%s", error)
            return
        new = [f for f in report.findings if f not in self._model.findings.get(context, ())]
        if new:
            lines = Report(report.origin, new).lines(_MAX_LOGGED)
            log.warning("\n    ".join([f"{path}: {report.summary}", *lines]))

    def _validate(self, origin: str, context: str, triples: Iterable[ox.Triple] | None) -> Report:
        knowledge_base = self._model.knowledge_base
        request = {
            "origin": origin,
            "context": context,
            "strict": self._model.strict,
            "triples": None if triples is None else list(map(str, triples)),
            "namespaces": list(knowledge_base.prefixes.namespaces().values()),
            "ontologies": list(map(str, knowledge_base.triples())),
            "shapes": list(map(str, knowledge_base.shapes)),
        }
        answer = json.loads(self._ask(json.dumps(request).encode()))
        if "error" in answer:
            raise WrongValue(answer["error"])
        return Report(origin, (Finding(*finding) for finding in answer["findings"]))

    def _ask(self, request: bytes) -> bytes:
        """Runs the subprocess with a request and returns its output."""
        with self._lock:
            self._check_running()
            process = self._process = subprocess.Popen(
                [sys.executable, "-m", _PROGRAM],
                env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
            )
        out, err = process.communicate(request)
        if process.returncode != 0:
            last = err.decode(errors="replace").strip().rpartition("\n")[2]
            raise Refused(f"the validation ended with status {process.returncode}: {last}")
        return out


#: A low priority, so that robots are not slowed down.
_NICENESS = 10


def answer(request: dict[str, Any]) -> dict[str, Any]:
    """Answers a request with the findings or an error."""
    knowledge_base = KnowledgeBase()
    for namespace in request["namespaces"]:
        knowledge_base.prefixes.add_namespace(namespace)
    knowledge_base.update((), parse_n_triples(request["ontologies"]))
    knowledge_base.shapes = [Path(file) for file in request["shapes"]]
    try:
        return {"findings": [astuple(finding) for finding in _report(request, knowledge_base).findings]}
    except SkirosError as error:
        return {"error": str(error)}


def _report(request: dict[str, Any], knowledge_base: KnowledgeBase) -> Report:
    origin, context, strict = request["origin"], request["context"], request["strict"]
    if request["triples"] is None:
        return validate_file(Path(origin), knowledge_base, context, strict)
    return validate(parse_n_triples(request["triples"]), origin, knowledge_base, context, strict)


if __name__ == "__main__":
    os.nice(_NICENESS)
    logging.disable()  # the report has everything
    json.dump(answer(json.load(sys.stdin)), sys.stdout)
