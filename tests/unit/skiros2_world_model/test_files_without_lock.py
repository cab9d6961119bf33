"""Requests are answered while files are read, checked and written."""

import threading
from contextlib import contextmanager

import pytest

from skiros2_common.core.world_element import Element
from skiros2_world_model.core import file_content, world_model
from skiros2_world_model.core.local_world_model import LocalWorldModel, source_ontologies
from skiros2_world_model.core.world_model import WorldModel


@contextmanager
def held_in(monkeypatch, module, name, work):
    """Runs `work` in a thread and holds it within a function of a module, until the end of the block."""
    reached, released = threading.Event(), threading.Event()
    function = getattr(module, name)

    def hold(*arguments):
        reached.set()
        assert released.wait(30.0)
        return function(*arguments)

    monkeypatch.setattr(module, name, hold)
    thread = threading.Thread(target=work)
    thread.start()
    try:
        assert reached.wait(30.0)
        yield
    finally:
        released.set()
        thread.join(30.0)
        assert not thread.is_alive()


def add(wm, label):
    """Adds an element in another thread, which must not have to wait."""
    thread = threading.Thread(target=wm.add_element, args=(Element("skiros:Part", label),), daemon=True)
    thread.start()
    thread.join(10.0)
    assert not thread.is_alive(), "a request waits for a file"


def labels(wm):
    return {element.label for element in wm.resolve_elements(Element("skiros:Part"))}


def test_request_during_a_save_is_carried_out_and_not_saved(wm, monkeypatch):
    add(wm, "before")
    with held_in(monkeypatch, world_model, "write_file", lambda: wm.save("scene.ttl")):
        add(wm, "meanwhile")
    assert labels(wm) == {"before", "meanwhile"}
    wm.load("scene.ttl")
    assert labels(wm) == {"before"}


def test_request_during_a_load_is_carried_out_and_replaced(wm, monkeypatch):
    add(wm, "saved")
    wm.save("scene.ttl")
    number = wm.model.number
    with held_in(monkeypatch, file_content, "scene_file_triples", lambda: wm.load("scene.ttl")):
        add(wm, "meanwhile")
        assert labels(wm) == {"saved", "meanwhile"}
    assert labels(wm) == {"saved"}
    (element,) = wm.resolve_elements(Element("skiros:Part"))
    assert wm.model.number == number + 2
    assert wm.model.scene().record(element.id).version == number + 2


def test_request_during_strict_validation_of_a_load_is_carried_out(workspace, monkeypatch):
    wm = LocalWorldModel("tester", WorldModel(source_ontologies(), workspace, strict=True))
    wm.save("scene.ttl")
    with held_in(monkeypatch, file_content, "shape_findings", lambda: wm.load("scene.ttl")):
        add(wm, "meanwhile")
    assert labels(wm) == set()


def test_load_uses_ontologies_that_change_meanwhile(wm, workspace, monkeypatch):
    wm.add_class("skiros:Widget", "skiros:Part")
    wm.add_element(Element("skiros:Widget", "widget"))
    wm.save("scene.ttl")
    read = []
    function = file_content.scene_file_triples
    monkeypatch.setattr(file_content, "scene_file_triples", lambda path: read.append(path) or function(path))
    with held_in(monkeypatch, file_content, "FileChecks", lambda: wm.load("scene.ttl")):
        wm.add_class("skiros:Gadget", "skiros:Part")
    assert len(read) == 2
    assert [element.label for element in wm.resolve_elements(Element("skiros:Widget"))] == ["widget"]


@pytest.mark.parametrize("action", ["load", "save"])
def test_loads_and_saves_take_turns(wm, monkeypatch, action):
    wm.save("scene.ttl")
    done = threading.Event()

    def other():
        (wm.load if action == "load" else wm.save)("scene.ttl")
        done.set()

    with held_in(monkeypatch, world_model, "write_file", lambda: wm.save("scene.ttl")):
        monkeypatch.undo()
        thread = threading.Thread(target=other)
        thread.start()
        assert not done.wait(0.2)
    thread.join(30.0)
    assert done.is_set()
