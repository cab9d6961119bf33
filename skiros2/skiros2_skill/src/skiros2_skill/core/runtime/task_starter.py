"""Creates tasks from requests, and previews their start."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from skiros2_common.core.abstract_skill import State
from skiros2_common.core.errors import Refused, SkirosError
from skiros2_common.core.explanation import START, Explanation
from skiros2_common.core.params import ParamTypes
from skiros2_common.core.world_element import Element
from skiros2_common.core.world_model_port import WorldModelPort
from skiros2_skill.core.engine.executor import Executor, preview_start
from skiros2_skill.core.library.library import SkillLibrary
from skiros2_skill.core.runtime.history import REFUSED, History, Record, one_line
from skiros2_skill.core.runtime.request import SkillRequest, explain_refusal, make_nodes
from skiros2_skill.core.runtime.scheduler import Scheduler
from skiros2_skill.core.runtime.task import Task
from skiros2_skill.core.tree.groups import Root
from skiros2_skill.core.tree.skill_node import SkillWrapper

log = logging.getLogger(__name__)

#: The progress code of a refused task.
REFUSED_CODE = -1


class TaskRefused(Refused):
    """A task was refused; `record` has the reason."""

    def __init__(self, record: Record) -> None:
        super().__init__(record.message)
        self.record = record


@dataclass(frozen=True)
class StartPreview:
    """What a start would do.

    :param label: of the implementation that would run the first skill; "" if none would.
    :param elements: the inferred elements and the robot, by key; without their properties.
    :param refusal: why the skills would not start; None if they would.
    """

    label: str = ""
    elements: Mapping[str, Element] = field(default_factory=dict)
    refusal: Explanation | None = None


class TaskStarter:
    """Creates the tasks of a manager. Any thread.

    :param library: the skill library; may be replaced later.
    :param robot: returns the robot's element, the value of `Robot` for skills without one.
    """

    def __init__(
        self,
        library: SkillLibrary,
        wmi: WorldModelPort,
        scheduler: Scheduler,
        history: History,
        robot: Callable[[], Element],
    ) -> None:
        self.library = library
        self._wmi = wmi
        self._scheduler = scheduler
        self._history = history
        self._robot = robot

    def make(self, author: str, requests: Sequence[SkillRequest]) -> Task:
        """Creates a task that runs skills in sequence. The scheduler has it, not started.

        :raises TaskRefused: the request is wrong; the history has the record.
        """
        explanation = None
        try:
            self._wmi.catch_up()  # the client may have changed the world model just before
            try:
                return self._make(author, requests)
            except SkirosError:
                explanation = explain_refusal(requests, self.library, self._wmi, REFUSED_CODE)
                raise
        except SkirosError as error:
            text = str(error)
        except Exception as error:  # report internal errors to the client too
            log.exception("creating a task for %s", author or "unknown")
            text = f"internal error: {type(error).__name__}: {error}"
        text = one_line(text)
        if explanation is None:
            explanation = _explanation(requests, text)
        record = Record(REFUSED, author, State.Idle, REFUSED_CODE, text, [explanation])
        self._history.refuse(record)
        raise TaskRefused(record)

    def _make(self, author: str, requests: Sequence[SkillRequest]) -> Task:
        nodes = make_nodes(requests, self.library, self._wmi)
        robot = self._robot()
        task = self._scheduler.new_task(self._wmi, author)
        _fill(task.root, robot, nodes)
        self._history.begin(task)
        return task

    def preview(self, requests: Sequence[SkillRequest], partial: bool = False) -> StartPreview:
        """Previews a start with the code that starts tasks. Starts, locks and changes nothing.

        :param partial: whether required parameters may have no value yet.
        :raises WmException: the world model does not answer.
        """
        self._wmi.catch_up()
        assumed = {key for i in self.library.implementations() for key in i.declared.params} if partial else ()
        try:
            nodes = make_nodes(requests, self.library, self._wmi, assumed)
        except SkirosError as error:
            refusal = explain_refusal(requests, self.library, self._wmi, REFUSED_CODE, assumed)
            return StartPreview(refusal=refusal or _explanation(requests, str(error)))
        root, first = Root("preview", self._wmi), nodes[0]
        _fill(root, self._robot(), nodes)
        refusal = preview_start(Executor(self._wmi), root, first)
        if refusal is not None:
            return StartPreview(refusal=refusal)
        found = {
            slot.key: Element(slot.param.value.type, slot.param.value.label, slot.param.value.id)
            for slot in first.slots
            if slot.is_element and slot.param.is_bound() and (slot.inferred or slot.shared is not None)
        }
        return StartPreview(first.implementation.label, found)


def _fill(root: Root, robot: Element, nodes: Sequence[SkillWrapper]) -> None:
    root.params.addParam("Robot", robot, ParamTypes.Inferred, "The manager's robot")
    root(*nodes)


def _explanation(requests: Sequence[SkillRequest], text: str) -> Explanation:
    if len(requests) == 1:
        return Explanation(START, requests[0].type, requests[0].label, -1, REFUSED_CODE, text)
    return Explanation(START, ":Root", "", -1, REFUSED_CODE, text)
