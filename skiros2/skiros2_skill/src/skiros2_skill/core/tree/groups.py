"""Nodes that only group other nodes: the root of a task, and unnamed nodes with a processor."""

from __future__ import annotations

from skiros2_common.core.abstract_skill import State
from skiros2_common.core.world_model_port import WorldModelPort
from skiros2_skill.core.processors import Processor, Sequential
from skiros2_skill.core.tree.node import SkillInterface


class _Group(SkillInterface):
    def __init__(self, ptype: str, name: str, children_processor: Processor, wmi: WorldModelPort | None) -> None:
        super().__init__(children_processor)
        self._type = ptype
        self._label = name
        if wmi is not None:
            self._wmi = wmi
        self._setState(State.Idle)

    def createDescription(self) -> None:
        """A group has no description."""

    def execute(self) -> State | None:
        return None


class Root(_Group):
    """The root of a task. Its parameters are the task's blackboard.

    :param name: shown to people.
    """

    def __init__(self, name: str, wmi: WorldModelPort | None = None) -> None:
        super().__init__(":Root", name, Sequential(), wmi)


class Skill(_Group):
    """A group: a node with a processor and no skill.

    :param name: shown to people.
    :param children_processor: how the children are ticked.
    """

    def __init__(
        self,
        name: str,
        children_processor: Processor = Sequential(),  # noqa: B008 - the contract's default
        wmi: WorldModelPort | None = None,
    ) -> None:
        super().__init__(":Skill", name, children_processor, wmi)
