"""The validation subprocess: `python3 -m skiros2_world_model.core.validation_process`.

Reads a request from stdin and writes the report to stdout, both as JSON; see `Validator`.
"""

from __future__ import annotations

import json
import logging
import os
import sys
from dataclasses import astuple
from pathlib import Path
from typing import Any

from skiros2_common.core.errors import SkirosError
from skiros2_world_model.core.knowledge_base import KnowledgeBase
from skiros2_world_model.core.rdf_files import parse_n_triples
from skiros2_world_model.core.report import Report
from skiros2_world_model.core.validation import validate, validate_file

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
