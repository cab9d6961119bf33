"""Validation in a subprocess, one request at a time."""

import logging
import os
import threading

import pytest

from skiros2_common.core.errors import Refused, WrongValue
from skiros2_common.core.world_element import Element
from skiros2_world_model.core.report import VIOLATION, WARNING
from skiros2_world_model.core.validator import Validator
from support.ros import wait_until

SCENE = """@prefix skiros: <http://rvmi.aau.dk/ontologies/skiros.owl#> .
skiros:Scene-0 a skiros:Scene ; skiros:contain skiros:LargeBox-1 .
skiros:LargeBox-1 a skiros:LargeBox ; skiros:SizeX {size} ; skiros:colour "red" .
"""


@pytest.fixture
def validator(model):
    validator = Validator(model)
    yield validator
    validator.stop()


@pytest.fixture
def load(model, workspace):
    def load(size, context="scene"):
        path = workspace / f"{context}.ttl"
        path.write_text(SCENE.format(size=size))
        model.load(path.name, "test", context)

    return load


def told(report):
    return {(f.severity, f.element, f.property) for f in report.findings}


def test_findings_of_a_loaded_file_are_logged(validator, load, caplog):
    load("-1")
    with caplog.at_level(logging.WARNING):
        validator.file_loaded("scene")
        wait_until(lambda: any("skiros:SizeX: a size is" in m for m in caplog.messages))
    logged = [m for m in caplog.messages if "skiros:SizeX: a size is" in m]
    assert len(logged) == 1 and "scene.ttl: 1 violation, 1 warning" in logged[0] and "colour" not in logged[0]


def test_a_file_of_another_context_is_validated_too(validator, load, caplog):
    load("-1", "memory")
    validator.file_loaded("memory")
    wait_until(lambda: any("memory.ttl: 1 violation" in m for m in caplog.messages))


def test_current_scene_is_validated_with_classes_declared_at_run_time(validator, model, wm):
    model.modify([("skiros:Crate", "rdfs:subClassOf", "skiros:LargeBox", True)], "test")
    crate = Element("skiros:Crate", "one")
    crate.setProperty("skiros:Weight", -1.0)
    eid = wm.add_element(crate).id
    assert told(validator.validate_context()) == {(VIOLATION, eid, "skiros:Weight"), (WARNING, eid, "")}
    assert told(validator.validate_context()) == told(wm.validate())
    assert told(validator.validate_context("other")) == set()


def test_missing_file_is_reported(validator, load, workspace, caplog):
    load("1")
    (workspace / "scene.ttl").unlink()
    validator.file_loaded("scene")
    wait_until(lambda: any("scene.ttl: cannot be read" in m for m in caplog.messages))


def test_invalid_shapes_are_reported(validator, model, load, workspace):
    load("1")
    broken = workspace / "cell.shapes.ttl"
    broken.write_text("@prefix sh: <http://www.w3.org/ns/shacl#> . <urn:S> a sh:PropertyShape ; "
                      "sh:targetNode <urn:x> ; sh:minCount 1 .")  # fmt: skip
    model.knowledge_base.shapes = [broken]
    with pytest.raises(WrongValue, match=r"cell\.shapes\.ttl"):
        validator.validate_context()


def test_stop_kills_a_running_validation(validator, model, load, workspace):
    pipe = workspace / "cell.shapes.ttl"
    os.mkfifo(pipe)  # nobody writes to it: who reads it waits for ever
    load("1")
    model.knowledge_base.shapes = [pipe]
    validator.file_loaded("scene")
    wait_until(lambda: validator._process is not None)
    validator.stop()
    for refused in (validator.validate_context, lambda: validator.file_loaded("scene")):
        with pytest.raises(Refused, match="has ended"):
            refused()


def test_stop_cancels_waiting_validations(validator, model, load, workspace):
    pipe = workspace / "cell.shapes.ttl"
    os.mkfifo(pipe)
    load("1")
    model.knowledge_base.shapes = [pipe]
    validator.file_loaded("scene")
    validator.file_loaded("memory")  # waits for the first
    errors = []

    def ask():
        try:
            validator.validate_context()
        except Refused as error:
            errors.append(error)

    waiting = threading.Thread(target=ask)
    waiting.start()
    wait_until(lambda: validator._process is not None)
    validator.stop()
    waiting.join()
    assert len(errors) == 1
