"""Publishes the progress of tasks."""

from __future__ import annotations

import json
import logging
from collections.abc import Mapping
from typing import Any

import rospy

from skiros2_common.core.abstract_skill import State
from skiros2_common.core.errors import SkirosError
from skiros2_common.core.params import Param
from skiros2_common.ros import utils
from skiros2_msgs import msg as msgs
from skiros2_skill.core.runtime.task import NodeProgress, Task

log = logging.getLogger(__name__)

WIRE_STATES = {
    State.Success: msgs.SkillProgress.SUCCESS,
    State.Failure: msgs.SkillProgress.FAILURE,
    State.Running: msgs.SkillProgress.RUNNING,
    State.Idle: msgs.SkillProgress.IDLE,
    State.Uninitialized: msgs.SkillProgress.IDLE,
}


class _SerializedOnce(msgs.TreeProgress):  # type: ignore[misc]
    """A message that is serialized once, however often it is published."""

    def __init__(self, progress: list[Any]) -> None:
        super().__init__(progress)
        self._bytes = b""

    def serialize(self, buff: Any) -> None:
        if not self._bytes:
            start = buff.tell()
            super().serialize(buff)
            self._bytes = buff.getvalue()[start:]
        else:
            buff.write(self._bytes)


class ProgressPublisher:
    """Publishes progress on `~monitor`. One thread at a time per task.

    Messages are only created for subscribers; an unchanged message is not serialized again.
    """

    def __init__(self) -> None:
        self._robot = rospy.get_name()
        self._publisher = rospy.Publisher("~monitor", msgs.TreeProgress, queue_size=1000)  # many tasks may end at once
        self._messages: dict[int, tuple[int, Any]] = {}  # revision and message by task id
        #: Whether messages include the parameters.
        self.with_params = False

    def publish(self, task: Task, needed: bool = False) -> list[Any]:
        """Publishes the progress of a task.

        :param needed: whether the caller needs the result even without subscribers.
        :returns: the `SkillProgress` of each node, parents before children; [] when nobody needs it.
        """
        has_subscribers = self._publisher.get_num_connections() > 0
        message = self._message(task) if has_subscribers or needed else None
        if task.ended.is_set():
            self._messages.pop(task.id, None)
        if message is None:
            return []
        if has_subscribers:
            self._publisher.publish(message)
        progress: list[Any] = message.progress
        return progress

    def close(self) -> None:
        self._publisher.unregister()

    def _message(self, task: Task) -> Any:
        revision, message = self._messages.get(task.id, (-1, None))
        if revision != task.revision or self.with_params:
            message = _SerializedOnce(self.nodes(task))
            self._messages[task.id] = (task.revision, message)
        return message

    def nodes(self, task: Task) -> list[Any]:
        """The present `SkillProgress` of each node, parents before children. Any thread."""
        return [self._node(task.id, node) for node in task.progress()]

    def _node(self, task_id: int, node: NodeProgress) -> Any:
        return msgs.SkillProgress(
            self._robot,
            task_id,
            node.id,
            wire_text(node.parent_label),
            node.parent_id,
            wire_text(node.type),
            wire_text(node.label),
            param_messages(node.params) if self.with_params else [],
            node.processor,
            WIRE_STATES[node.state],
            wire_code(node.progress_code),
            node.progress_period,
            node.progress_time,
            wire_text(node.progress_message),
        )


def wire_text(text: str) -> str:
    """Replaces characters that messages cannot hold."""
    return text if text.isascii() else text.encode("utf-8", "replace").decode("utf-8")


def wire_code(code: int) -> int:
    """Clips a progress code to int16."""
    return max(-32768, min(code, 32767))


def param_messages(params: Mapping[str, Param]) -> list[Any]:
    """Converts parameters to messages; those with values that have no JSON form are left out."""
    messages = []
    for param in params.values():
        try:
            messages.append(msgs.Param(json.dumps(param, cls=utils.ParamsEncoder)))
        except (SkirosError, TypeError, ValueError, RecursionError) as error:
            log.debug("parameter %r has no JSON form: %s", param.key, error)
    return messages
