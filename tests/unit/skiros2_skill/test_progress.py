"""Publishing the progress of tasks."""

import io
import json

import pytest
import rospy

from skiros2_common.core.abstract_skill import State
from skiros2_msgs import msg as msgs
from skiros2_skill.ros.messages import ProgressPublisher
from unit.skiros2_skill.skills import Note, primitive


class Publisher:
    """Replaces rospy's publisher: serializes messages into one buffer, as rospy does."""

    def __init__(self, *args, **options):
        self.connections = 1
        self.buffer = io.BytesIO()
        self.sent = []

    def get_num_connections(self):
        return self.connections

    def publish(self, message):
        start = self.buffer.tell()
        message.serialize(self.buffer)
        self.sent.append(self.buffer.getvalue()[start:])


@pytest.fixture
def progress(monkeypatch):
    monkeypatch.setattr(rospy, "Publisher", Publisher)
    return ProgressPublisher()


@pytest.fixture
def task(bench):
    bench.load(primitive(Note, "note", execute=lambda skill: skill.step("on")))
    task = bench.task(bench.node("note", Text="äöü"))
    tick(task)
    return task


def tick(task):
    task.tick()
    task.update_revision()


def read(sent):
    return msgs.TreeProgress().deserialize(sent).progress


def test_message_has_every_node(progress, task):
    progress.publish(task)
    root, note = read(progress._publisher.sent[0])
    assert (root.type, root.id, root.state) == (":Root", task.id, msgs.SkillProgress.RUNNING)
    assert (note.type, note.label, note.parent_id) == ("skiros:Note", "note", root.id)
    assert (note.state, note.progress_code, note.progress_message) == (msgs.SkillProgress.RUNNING, 1, "on")
    assert note.params == []


def test_no_message_is_created_without_subscriber(progress, task, monkeypatch):
    progress._publisher.connections = 0
    asked = []
    monkeypatch.setattr(task, "progress", lambda: asked.append(1) or [])
    assert progress.publish(task) == []
    assert (asked, progress._publisher.sent) == ([], [])
    progress.publish(task, needed=True)
    assert (asked, progress._publisher.sent) == ([1], [])


def test_message_with_parameters_is_always_current(progress, task):
    progress.with_params = True
    progress.publish(task)
    task.root.children[0].params["Text"].value = "new"
    progress.publish(task)
    texts = []
    for sent in progress._publisher.sent:
        params = [json.loads(param.param) for param in read(sent)[1].params]
        texts += [param["values"] for param in params if param["key"] == "Text"]
    assert texts == [["äöü"], ["new"]]


def test_last_message_of_a_task_tells_of_its_end(progress, task):
    progress.publish(task)
    task.preempt()
    tick(task)
    progress.publish(task)
    assert read(progress._publisher.sent[-1])[0].progress_code == -1
    assert task.state is State.Failure


def test_message_is_made_again_only_when_something_has_changed(progress, bench, monkeypatch):
    states = iter([State.Running, State.Running, State.Success])
    bench.load(primitive(Note, "note", execute=lambda skill: next(states)))
    task = bench.task(bench.node("note", Text=""))
    tick(task)
    made = []
    of_task = task.progress
    monkeypatch.setattr(task, "progress", lambda: made.append(1) or of_task())
    progress.publish(task)
    for _ in range(2):
        tick(task)
        progress.publish(task)
    first, second, third = progress._publisher.sent
    assert first == second != third and len(made) == 2
    assert [node.state for node in read(third)] == [msgs.SkillProgress.SUCCESS] * 2


def test_paused_task_is_published_as_such_though_nothing_else_changes(progress, task):
    progress.publish(task)
    task.pause()
    progress.publish(task)
    before, paused = map(read, progress._publisher.sent)
    assert before[0].progress_message == "" and paused[0].progress_message == "paused"
