"""Large requests and scenes take time proportional to their size, whatever their shape. `FUZZ=1`: 80 000 elements."""

from itertools import pairwise

import pytest

from skiros2_common.core.element_content import relation_dict
from skiros2_common.core.errors import WrongValue
from skiros2_common.core.operations import Add, Relate
from skiros2_common.core.world_element import Element
from support.fuzz import examples

MANY = examples(80_000)


def chain_of(number):
    """Elements each of which is in the one before it, the first in the scene."""
    for index in range(number):
        element = Element("skiros:Product")
        holder = f"#{index - 1}" if index else "skiros:Scene-0"
        element._relations = [relation_dict(holder, "skiros:contain", "-1")]
        yield Add(element, str(index))


def test_elements_each_in_the_one_before_are_added_in_one_request(model):
    outcome = model.transact(chain_of(MANY), "test")
    assert len(outcome.elements) == MANY
    assert len(model.reader.branch("skiros:Scene-0", "skiros:contain", "", "scene")) == MANY + 1


def test_so_many_relations_are_added_in_one_request_and_a_cycle_of_them_all_is_refused(model):
    ids = model.transact((Add(Element("skiros:Product")) for _ in range(MANY)), "test").ids
    before = model.snapshot_id
    line = [Relate(src, "skiros:contain", dst) for src, dst in pairwise(ids)]
    with pytest.raises(WrongValue, match="cannot be in itself") as refused:
        model.transact([*line, Relate(ids[-1], "skiros:contain", ids[0])], "test")
    assert len(str(refused.value)) < 300
    assert model.snapshot_id == before
    assert next(model.scene().relations(ids[0], None, ""), None) is None
    model.transact(line, "test")
    assert len(model.reader.branch(ids[0], "skiros:contain", "", "scene")) == MANY
