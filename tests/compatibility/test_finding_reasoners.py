"""Lookup of reasoners by elements and programs. Compatibility, section 9."""

import subprocess
import sys
import threading

import pytest

from compatibility.rules import rule
from skiros2_common.core.discrete_reasoner import DiscreteReasoner, reasoners
from skiros2_common.core.world_element import Element

LIBRARY = """
from skiros2_common.core.discrete_reasoner import DiscreteReasoner


class ColourReasoner(DiscreteReasoner):
    def onAddProperties(self, element):
        element.setProperty("skiros:Paint", "white")

    def onRemoveProperties(self, element):
        element.removeProperty("skiros:Paint")

    def getData(self, element, get_code):
        return element.getProperty("skiros:Paint").value

    def getAssociatedProperties(self):
        return [":Colour"]

    def getAssociatedData(self):
        return ["skiros:Paint"]

    def getAssociatedRelations(self):
        return [":sameColour"]
"""


class Bare(DiscreteReasoner):
    """A reasoner of the field that defines only what it needs."""


@pytest.fixture
def no_reasoners(monkeypatch):
    for name in ("_by_name", "_owners", "_cache"):
        monkeypatch.setattr(reasoners, name, {})
    monkeypatch.setattr(reasoners, "_is_loaded", False)


@pytest.fixture
def library(tmp_path, monkeypatch):
    folder = tmp_path / "colour_reasoners"
    folder.mkdir()
    (folder / "__init__.py").write_text("")
    (folder / "colour_reasoner.py").write_text(LIBRARY)
    monkeypatch.syspath_prepend(str(tmp_path))
    yield tmp_path
    for name in [name for name in sys.modules if name.startswith("colour_reasoners")]:
        del sys.modules[name]


@pytest.fixture
def named_by_ros(library, monkeypatch, no_reasoners):
    """The parameter `wm/reasoners_pkgs` names the library."""
    import rosgraph

    parameters = {"/wm/reasoners_pkgs": ["colour_reasoners"]}
    monkeypatch.setattr(rosgraph.Master, "getParam", lambda master, name: parameters[name])


@rule("reasoners", "Reasoners are found in any process: the packages in `wm/reasoners_pkgs` are imported on first use")
@pytest.mark.parametrize("name", ["ColourReasoner", ":Colour", "skiros:Colour", ":sameColour", "skiros:sameColour"])
def test_they_are_loaded_on_first_use(named_by_ros, name):
    assert repr(Element("skiros:Part")._getReasoner(name)) == "ColourReasoner"


@rule("reasoners", "`getData`, `setReasoner`, `getAssociatedReasonerId` of an element load reasoners on first use")
def test_elements_load_them(named_by_ros):
    element = Element("skiros:Part")
    element.setReasoner("ColourReasoner")
    assert element.getData(":Colour") == "white"
    assert element.getAssociatedReasonerId("skiros:Paint") == "ColourReasoner"
    assert element.getAssociatedReasonerId(":Colour") == ""


@rule("reasoners", "`wmi.get_reasoner` loads reasoners on first use; unknown: None")
def test_the_world_model_loads_them(named_by_ros, skill_bench):
    assert skill_bench.wmi.get_reasoner("Nobody") is None
    assert repr(skill_bench.wmi.get_reasoner("skiros:sameColour")) == "ColourReasoner"


@rule("reasoners", "`wmi.get_reasoner_relations` loads reasoners on first use; unknown: `KeyError`")
def test_computing_relations_loads_them(named_by_ros, skill_bench):
    with pytest.raises(KeyError, match=r"'Nobody'.*ColourReasoner"):
        skill_bench.wmi.get_reasoner_relations("", "Nobody", "")


@rule("reasoners", "A reasoner that is not found is a `KeyError`", better="which names the loaded ones")
def test_an_unknown_reasoner(named_by_ros):
    for call in (Element("skiros:Part").getData, Element("skiros:Part").hasData, Element("skiros:Part")._getReasoner):
        with pytest.raises(KeyError, match=r"':Shape'.*ColourReasoner"):
            call(":Shape")


@rule("reasoners", "Without a master, or without the parameter, there are no reasoners")
def test_no_master(no_reasoners, monkeypatch):
    script = (
        "from skiros2_common.core.world_element import Element\n"
        "try:\n    Element('skiros:Part').getData(':Colour')\nexcept KeyError as error:\n    print('KeyError')\n"
    )
    environment = {"PYTHONPATH": ":".join(sys.path), "PATH": "", "ROS_MASTER_URI": "http://localhost:1"}
    ran = subprocess.run([sys.executable, "-c", script], env=environment, capture_output=True, text=True, timeout=60)
    assert ran.stdout == "KeyError\n", ran.stderr


@rule("reasoners", "`addProperties` names the reasoner on the element once; `removeProperties` takes the name away")
def test_add_and_remove_properties(named_by_ros):
    element = Element("skiros:Part")
    reasoner = element._getReasoner("ColourReasoner")
    reasoner.addProperties(element)
    reasoner.addProperties(element)
    assert element.getProperty("skiros:DiscreteReasoner").values == ["ColourReasoner"]
    assert element.hasProperty("skiros:Paint", "white")
    reasoner.removeProperties(element)
    assert not element.hasProperty("skiros:DiscreteReasoner", "ColourReasoner")
    assert not element.hasProperty("skiros:Paint")


@rule("reasoners", "`repr(reasoner)` is the class name; what a reasoner does not define raises `NotImplementedError`")
def test_the_base_class():
    reasoner = Bare()
    assert repr(reasoner) == "Bare"
    part = Element("skiros:Part")
    for call in (
        lambda: reasoner.parse(part, "add"),
        reasoner.run,
        lambda: reasoner.onAddProperties(part),
        lambda: reasoner.onRemoveProperties(part),
        lambda: reasoner.hasData(part, ":X"),
        lambda: reasoner.getData(part, ":X"),
        lambda: reasoner.setData(part, 1, ":X"),
        reasoner.getAssociatedRelations,
        reasoner.getAssociatedProperties,
        reasoner.getAssociatedData,
        lambda: reasoner.computeRelations(part, part),
    ):
        with pytest.raises(NotImplementedError, match="Bare has to define"):
            call()


@rule("reasoners", "A reasoner that defines only some methods is registered and found by its name")
def test_a_bare_reasoner_is_found(no_reasoners):
    reasoners.add(Bare())
    assert repr(Element("skiros:Part")._getReasoner("Bare")) == "Bare"


class Loop(DiscreteReasoner):
    def __init__(self):
        self.begun = threading.Semaphore(0)
        self.ended = threading.Semaphore(0)

    def run(self):
        self.begun.release()
        while not self.stopRequested:
            threading.Event().wait(0.001)
        self.ended.release()


@rule("reasoners", "`execute()` starts a thread that calls `run()` and returns at once; `stop()` ends it; both again")
def test_execute_and_stop():
    loop = Loop()
    for _ in range(2):
        assert loop.execute() is None
        assert loop.begun.acquire(timeout=5.0)
        loop.stop()
        assert loop.ended.acquire(timeout=5.0)


@rule("reasoners", "`stopRequested` tells that `stop()` was called, and lowers the flag")
def test_stop_requested():
    reasoner = Bare()
    assert not reasoner.stopRequested
    reasoner.stop()
    assert reasoner.stopRequested
    assert not reasoner.stopRequested
