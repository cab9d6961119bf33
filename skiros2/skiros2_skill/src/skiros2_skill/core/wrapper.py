"""A node that stands for a skill by name; the implementation is chosen when it starts."""

from __future__ import annotations

from typing import Any

from skiros2_common.core.abstract_skill import State
from skiros2_common.core.errors import FOREIGN_ERRORS
from skiros2_common.core.names import full_name
from skiros2_common.core.params import ParamHandler
from skiros2_common.core.revision import local_revision
from skiros2_common.core.source_location import SourceLocation
from skiros2_skill.core.described_node import DescribedNode
from skiros2_skill.core.ended_params import EndedParams
from skiros2_skill.core.inside import EXECUTE_HOOK, LeftBehind
from skiros2_skill.core.processors import Sequential

_RUNNING: State = State.Running


class SkillWrapper(DescribedNode):
    """A node for a skill of a type and, when given, a label.

    :param ptype: the skill's type: `Pick`, `:Pick` or `skiros:Pick`.
    :param plabel: the implementation's label; "" for any.
    :param instanciator: the library that the implementation is taken from.
    """

    def __init__(self, ptype: str, plabel: str, instanciator: Any = None) -> None:
        super().__init__(Sequential())
        self._type = full_name(ptype)
        self._label = plabel
        self._asked_label = plabel
        self._instanciator = instanciator
        #: Where a compound has put it into its tree; None: not known.
        self.place: SourceLocation | None = None
        # The executor's notes on the node while it runs.
        self.implementation: Any = None
        self.expanded = False
        self.slots: list[Any] = []
        self.element_slots: list[Any] = []
        self.seen_stamp = -1
        self.steady_stamp = -1  # of its last reading, while it is a primitive that goes on and has not to be watched
        self.watch: Any = None
        self.lent: list[Any] = []  # its parameters whose lists of values were handed out
        self.has_started = False
        self.volatile = False
        self.is_compound = False
        self.runs_after_children = False
        self.locked: list[str] = []
        self.verdict: tuple[str, int] | None = None
        self._rests = True
        self.abandoned = False  # its instance is not to be used again
        if instanciator is not None:
            self._wmi = instanciator.wmi
        self._setState(State.Idle)

    @property
    def label(self) -> str:
        """The label of the implementation that was chosen; before, the one that was asked for."""
        return self._label

    @property
    def asked_label(self) -> str:
        """The label that was asked for, "" for any implementation."""
        return self._asked_label

    def getLightCopy(self) -> SkillWrapper:
        copy = SkillWrapper(self._type, self._asked_label, self._instanciator)
        self._copy_to(copy)
        copy._label = self._asked_label
        return copy

    def hasInstance(self) -> bool:
        """Whether an implementation is chosen."""
        return self._instance is not None

    def setInstance(self, instance: Any) -> None:
        """Takes an implementation: its label, parameters and conditions become the node's."""
        self._instance = instance
        self._is_described = True
        self.abandoned = False
        self._label = instance.label
        self._description = instance
        self._processor = Sequential()
        self.adopt_description()

    def adopt_description(self) -> None:
        """Takes the parameters and conditions of the implementation, which may have changed them at the start."""
        instance = self._instance
        self._params: ParamHandler = instance._params
        self._options = instance._options
        self._pre_conditions = [*instance._pre_conditions, *self._own_pre_conditions]
        self._hold_conditions = [*instance._hold_conditions, *self._own_hold_conditions]
        self._post_conditions = [*instance._post_conditions, *self._own_post_conditions]

    def getInstance(self) -> Any:
        """The implementation, None before one is chosen."""
        return self._instance

    def copy_progress(self) -> bool:
        """The node shows the progress of its implementation. Returns whether it is new."""
        instance = self._instance
        if instance is None or instance._progressed_at <= self._progressed_at:
            return False
        self._progress_code = instance._progress_code
        self._progress_msg = instance._progress_msg
        self._progress_period = instance._progress_period
        self._progressed_at = instance._progressed_at
        return True

    def release(self) -> None:
        """Gives the implementation back for others to use; the node keeps its parameters and progress."""
        instance = self._instance
        if instance is None:
            return
        self.rest()
        if not (self.abandoned or instance._is_working):
            self.implementation.release(instance)
        self._instance = None

    def retire(self) -> None:
        """Leaves the implementation behind: one of its hooks has not returned, so nobody may use it any more."""
        self.abandoned = True
        self.release()

    def rise(self) -> None:
        """The implementation is to run."""
        if self._rests:
            self._rests = False
            self.implementation.count(1)

    def rest(self) -> None:
        """The implementation does not run: who chooses one for another node may take it as free."""
        if not self._rests:
            self._rests = True
            self.implementation.count(-1)
            self._instance._params = EndedParams(self._params)

    def wrapper_expand(self) -> None:
        """Makes the subtree that the implementation describes, in the place of an earlier one."""
        for child in self._children:
            child._parent = None
        self._children = []
        self._latched = None
        instance = self._instance
        instance._expands_into = self
        instance.expand(self)

    def visit(self, visitor: Any) -> State:
        """One tick of the node by an executor.

        At most ticks a primitive goes on. All that is done then is done here; whatever else may be, by the executor.
        """
        state: State
        readings = visitor.readings
        if self.steady_stamp != readings.stamp:
            if self.steady_stamp < 0:
                state = visitor.execute_skill(self)
                return state
            failure = readings.renew(self)
            if failure is not None:
                state = visitor.fail_running(self, failure)
                return state
            self.steady_stamp = self.seen_stamp
        notes = visitor.inside.notes
        notes.append((self, EXECUTE_HOOK))
        try:
            try:
                answer: object = self._instance.execute()
            finally:
                try:
                    notes.pop()
                except IndexError:
                    raise LeftBehind from None
        except LeftBehind:
            raise
        except FOREIGN_ERRORS as error:
            state = visitor.go_on(self, visitor.hooks.execute_raised(self, error), readings.version)
            return state
        if answer is not _RUNNING or local_revision.current != readings.mark:
            state = visitor.go_on(self, visitor.hooks.judged(self, answer), readings.version)
            return state
        if self._instance._progressed_at > self._progressed_at:
            visitor.changed = True
        return _RUNNING

    def _setState(self, state: State) -> None:
        self.steady_stamp = -1
        super()._setState(state)

    # While it runs, the implementation has the progress.

    @property
    def progress_code(self) -> int:
        self.copy_progress()
        return self._progress_code

    @property
    def progress_msg(self) -> str:
        self.copy_progress()
        return self._progress_msg

    @property
    def progress_period(self) -> float:
        self.copy_progress()
        return self._progress_period

    @property
    def progress_time(self) -> float:
        self.copy_progress()
        return super().progress_time

    def onReset(self) -> None:
        if self._instance is not None:
            self._instance.onReset()

    def onPreempt(self) -> Any:
        return self._instance.onPreempt() if self._instance is not None else None

    def onStart(self) -> bool | None:
        return self._instance.onStart() if self._instance is not None else False

    def execute(self) -> State | None:
        return self._instance.execute() if self._instance is not None else State.Failure
