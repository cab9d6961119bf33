"""The fast deserialisation of progress equals rospy's."""

from __future__ import annotations

import io

import pytest
from genpy import DeserializationError
from hypothesis import given, settings
from hypothesis import strategies as st

from skiros2_live.ros.tree_progress import QuickTreeProgress
from skiros2_msgs import msg as msgs
from support.fuzz import examples

texts = st.text(max_size=5)
shorts = st.integers(-5, 5)
nodes = st.builds(
    msgs.SkillProgress,
    robot=st.just("/r"),
    task_id=st.integers(0, 1),
    id=shorts,
    parent_label=texts,
    parent_id=shorts,
    type=texts,
    label=texts,
    params=st.lists(st.builds(msgs.Param, texts), max_size=2),
    processor=texts,
    state=shorts,
    progress_code=shorts,
    progress_period=st.just(0.5),
    progress_time=st.sampled_from([0.0, 1.0]),
    progress_message=texts,
)


def written(progress: list[msgs.SkillProgress]) -> bytes:
    buffer = io.BytesIO()
    msgs.TreeProgress(progress).serialize(buffer)
    return buffer.getvalue()


@settings(max_examples=examples(40))
@given(st.lists(st.lists(nodes, max_size=6), min_size=1, max_size=4))
def test_deserialised_progress_equals_serialised_progress(trees: list[list[msgs.SkillProgress]]) -> None:
    for tree in trees:
        assert QuickTreeProgress().deserialize(written(tree)).progress == tree


def test_unchanged_node_is_the_same_object() -> None:
    tree = [msgs.SkillProgress(robot="/same", id=0, state=3), msgs.SkillProgress(robot="/same", id=1, state=3)]
    first = QuickTreeProgress().deserialize(written(tree)).progress
    tree[1].state = 1
    second = QuickTreeProgress().deserialize(written(tree)).progress
    assert second[0] is first[0]
    assert second[1].state == 1


@pytest.mark.parametrize("cut", [0, 3, 4, 9, 30])
def test_truncated_message_raises_deserialization_error(cut: int) -> None:
    data = written([msgs.SkillProgress(robot="/r", type="skiros:Pick", label="pick")])
    with pytest.raises(DeserializationError):
        QuickTreeProgress().deserialize(data[:cut])
