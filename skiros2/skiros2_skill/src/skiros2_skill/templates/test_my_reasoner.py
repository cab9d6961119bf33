"""The reasoner MyReasoner in one process, without nodes."""

import pytest

from my_skills.my_reasoner import HEAVIER, MyReasoner
from skiros2_common.core.discrete_reasoner import reasoners, set_reasoners
from skiros2_common.core.world_element import Element


@pytest.fixture
def make():
    reasoners.add(MyReasoner())

    def make(label, weight):
        element = Element("skiros:Product", label)
        set_reasoners(element, ["MyReasoner"])
        element.setData(":Weight", weight)
        return element

    return make


def test_element_has_the_weight(make):
    assert make("bolt", 0.2).getData(":Weight") == 0.2


def test_heavier_element(make):
    bolt, nut = make("bolt", 0.2), make("nut", 0.05)
    reasoner = reasoners.get("MyReasoner")
    assert reasoner.computeRelations(bolt, nut) == [HEAVIER]
    assert reasoner.computeRelations(nut, bolt) == []
