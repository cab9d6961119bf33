"""Arbitrary messages are read, or rejected with an error that names the position."""

from __future__ import annotations

import json
import sys

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from skiros2_common.core.errors import SkirosError
from skiros2_common.ros import utils
from skiros2_msgs import msg as msgs

ENDLESS = "[" * 100_000 + "]" * 100_000
TYPES = ["str", "int", "float", "bool", "list", "dict", "skiros_wm::Element", "os.system", ""]

json_values = st.recursive(
    st.none() | st.booleans() | st.integers(-(2**70), 2**70) | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=3), inner, max_size=3),
    max_leaves=6,
)


def objects(**fields):
    """JSON objects with these fields, of which some may be missing or hold anything."""
    return st.fixed_dictionaries({}, optional={key: value | json_values for key, value in fields.items()})


properties = objects(key=st.text(max_size=3), type=st.sampled_from(TYPES), values=st.lists(json_values, max_size=2))
relations = objects(src=st.just("-1"), type=st.just("skiros:at"), dst=st.text(max_size=3))
elements = objects(
    id=st.just("skiros:Part-1"),
    label=st.text(max_size=3),
    type=st.just("skiros:Part"),
    last_update=json_values,
    properties=st.dictionaries(st.text(max_size=2), properties, max_size=2),
    relations=st.lists(relations, max_size=2),
)
params = objects(
    key=st.just("Key"),
    description=st.text(max_size=3),
    specType=st.sampled_from([0, 1, 2, 3]),
    type=st.sampled_from(TYPES),
    values=st.lists(json_values | elements, max_size=2),
)


def read_or_refused(read, *arguments):
    try:
        read(*arguments)
    except SkirosError as error:
        assert str(error)


@given(params | json_values)
def test_random_json_is_a_parameter_or_rejected(value):
    read_or_refused(utils.deserializeParamMap, [msgs.Param(json.dumps(value))])


@given(elements | json_values)
@example({"id": "", "label": "", "type": "", "last_update": "soon", "properties": {}, "relations": []})
@example({"id": "", "label": "", "type": "", "last_update": 10**400, "properties": {}, "relations": []})
def test_random_json_is_an_element_or_rejected(value):
    read_or_refused(utils.decodeElement, json.dumps(value))


@given(st.sampled_from(TYPES), (json_values | elements).map(json.dumps) | st.text(max_size=5))
@example("float", f"[{10**400}]")
@example("float", f"[{'9' * 5000}]")
@example("str", '["\\ud800"]')
def test_random_text_is_a_property_or_rejected(kind, text):
    message = msgs.Property("skiros:anything", text, kind)
    read_or_refused(utils.msg2element, msgs.WmElement("", "skiros:Part", "", [message], []))


@pytest.fixture(params=[1000, 100_000], ids=["as Python sets it", "as for deep trees"])
def recursion_limit(request):
    before = sys.getrecursionlimit()
    sys.setrecursionlimit(request.param)
    yield
    sys.setrecursionlimit(before)


@pytest.mark.parametrize("kind", TYPES)
def test_endless_nesting_is_rejected(kind, recursion_limit):
    message = msgs.WmElement("", "skiros:Part", "", [msgs.Property("skiros:anything", ENDLESS, kind)], [])
    for read, argument in (
        (utils.msg2element, message),
        (utils.decodeElement, ENDLESS),
        (utils.decodeParam, f'{{"key": "K", "specType": 0, "type": "list", "values": {ENDLESS}}}'),
    ):
        with pytest.raises(SkirosError):
            read(argument)


def test_brackets_in_strings_do_not_count_as_nesting():
    text = json.dumps(["[" * 1000, '\\"[{' * 500, [[]] * 600])
    assert utils.json_loads_byteified(text) == json.loads(text)
