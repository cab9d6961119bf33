"""The messages of a manager: requests, parameters, explanations and the progress of tasks."""

from __future__ import annotations

import json
from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from io import BytesIO
from typing import Any

import rospy
from std_msgs.msg import String

from skiros2_common.core.abstract_skill import State
from skiros2_common.core.explanation import Explanation
from skiros2_common.core.json_codec import param_texts
from skiros2_common.core.params import Param
from skiros2_msgs import msg as msgs
from skiros2_runs.core.progress import status_text
from skiros2_runs.core.states import TaskState
from skiros2_skill.core.engine.evidence import evidence_json
from skiros2_skill.core.library.declaration import declarations_json
from skiros2_skill.core.library.library import Implementation
from skiros2_skill.core.runtime.request import SkillRequest
from skiros2_skill.core.runtime.request_json import read_request
from skiros2_skill.core.runtime.task import NodeSnapshot, Task

WIRE_STATES = {
    State.Success: msgs.SkillProgress.SUCCESS,
    State.Failure: msgs.SkillProgress.FAILURE,
    State.Running: msgs.SkillProgress.RUNNING,
    State.Idle: msgs.SkillProgress.IDLE,
    State.Uninitialized: msgs.SkillProgress.IDLE,
}


def skill_request(skill: Any) -> SkillRequest:
    """Converts a `ResourceDescription`. A parameter without `specType` and `type` gets them from the skill."""
    return read_request(skill.type, skill.name, [message.param for message in skill.params])


def wire_text(text: str) -> str:
    """Replaces characters that messages cannot hold."""
    return text if text.isascii() else text.encode("utf-8", "replace").decode("utf-8")


def wire_code(code: int) -> int:
    """Clips a progress code to int16."""
    return max(-32768, min(code, 32767))


def param_messages(params: Mapping[str, Param]) -> list[Any]:
    """Converts parameters to messages; those with values that have no JSON form are left out."""
    return [msgs.Param(text) for text in param_texts(params)]


def explanations_json(explanations: Iterable[Explanation]) -> str:
    """Encodes explanations as a JSON list."""
    return json.dumps([explanation.to_dict() for explanation in explanations])


def declare_on_topic() -> Callable[[Iterable[Implementation]], None]:
    """Returns what publishes the declarations of skills on `~declarations`, latched, as long as this node runs."""
    topic = rospy.Publisher("~declarations", String, queue_size=1, latch=True)
    return lambda implementations: topic.publish(declarations_json(implementations))


#: Reported as a parameter of the root; the others follow from its state and code.
_REPORTED_STATUS = (TaskState.PAUSED, TaskState.ENDING, TaskState.PREEMPTED)


class _Sent(msgs.TreeProgress):  # type: ignore[misc]
    """The bytes of a `TreeProgress`, which are published again while nothing changes.

    :param key: identifies the progress of a task that they have.
    """

    def __init__(self, key: Hashable, nodes: Sequence[Any]) -> None:
        super().__init__([])
        self.key = key
        buffer = BytesIO()
        msgs.TreeProgress(nodes).serialize(buffer)
        self._data = buffer.getvalue()

    def serialize(self, buff: Any) -> None:
        buff.write(self._data)


class ProgressPublisher:
    """Publishes progress on `~monitor` and evidence on `~evidence`; messages are only created for subscribers, and only
    when something has changed. One thread at a time per task.
    """

    def __init__(self) -> None:
        self._robot = rospy.get_name()
        self._publisher = rospy.Publisher("~monitor", msgs.TreeProgress, queue_size=1000)  # many tasks may end at once
        self._evidence = rospy.Publisher("~evidence", String, queue_size=1000)
        #: Whether messages include the parameters.
        self.with_params = False
        self._sent: dict[int, _Sent] = {}  # by task

    def publish(self, task: Task, needed: bool = False) -> list[Any]:
        """Publishes the progress of a task.

        :param needed: whether the caller needs the result even without subscribers.
        :returns: the `SkillProgress` of each node, parents before children; [] when nobody needs it.
        """
        evidence, entries = task.evidence, task.evidence.take()
        has_subscribers = self._publisher.get_num_connections() > 0
        evidence.messages += has_subscribers
        # also of a task that has not started
        if entries or (evidence.is_on and (evidence.readings or task.ended.is_set())):
            self._evidence.publish(evidence_json(task.id, entries, evidence.messages, evidence.readings))
        key = task.revision, task.status, task.paused
        sent = self._sent.get(task.id) if has_subscribers else None
        is_same = sent is not None and sent.key == key and not self.with_params  # parameters change without a revision
        progress = self.nodes(task) if needed or (has_subscribers and not is_same) else []
        if has_subscribers:
            sent = sent if sent is not None and is_same else _Sent(key, progress)
            self._sent[task.id] = sent
            self._publisher.publish(sent)
        if task.ended.is_set():
            self._sent.pop(task.id, None)
        return progress

    def wants_evidence(self) -> bool:
        """Whether somebody subscribes to it."""
        return bool(self._evidence.get_num_connections() > 0)

    def close(self) -> None:
        self._publisher.unregister()
        self._evidence.unregister()

    def nodes(self, task: Task) -> list[Any]:
        """The present `SkillProgress` of each node, parents before children. Any thread."""
        return progress_messages(task, self._robot, self.with_params)


def progress_messages(task: Task, robot: str, with_params: bool = False) -> list[Any]:
    """Returns the present `SkillProgress` of each node of a task, parents before children. Any thread.

    :param robot: the manager's name.
    :param with_params: whether they include the parameters of the nodes.
    """
    nodes = [_node_message(task.id, robot, node, with_params) for node in task.progress()]
    if nodes and task.status in _REPORTED_STATUS:
        nodes[0].params.append(msgs.Param(status_text(task.status)))
    return nodes


def _node_message(task_id: int, robot: str, node: NodeSnapshot, with_params: bool) -> Any:
    return msgs.SkillProgress(
        robot,
        task_id,
        node.id,
        wire_text(node.parent_label),
        node.parent_id,
        wire_text(node.type),
        wire_text(node.label),
        param_messages(node.params) if with_params else [],
        node.processor,
        WIRE_STATES[node.state],
        wire_code(node.progress_code),
        node.progress_period,
        node.progress_time,
        wire_text(node.progress_message),
    )
