"""Writes the execution of a goal to the store, and reads it after a restart."""

from __future__ import annotations

import secrets
from collections import Counter

from skiros2_common.core.explanation import Explanation
from skiros2_task.core.execution import ExecutionStateMachine
from skiros2_task.core.goal_store import GoalStore, StoredGoal, StoredStep
from skiros2_task.core.step_codec import decode_step, encode_step
from skiros2_task.core.step_record import RestoredState, StepRecord, StepState

#: The states of steps that have not started.
_NOT_STARTED = (StepState.WAITING, StepState.DROPPED)


class ExecutionLog:
    """The stored state of one goal. To be used by one thread.

    :param goal_id: of a goal in the store.
    """

    def __init__(self, store: GoalStore, goal_id: str) -> None:
        self._store = store
        self.goal_id = goal_id
        self._written: dict[int, StoredStep] = {}

    def run_of(self, number: int) -> str:
        """Returns the id of a started step's run."""
        return self._written[number].run

    def write(self, machine: ExecutionStateMachine) -> None:
        """Writes what has changed, if a step has started or ended.

        :raises StoreFailed: nothing is written.
        """
        changed, is_due = [], False
        for number, record in machine.records.items():
            known = self._written.get(number)
            if known is not None and known.state == record.state.value:
                continue
            is_due = is_due or record.state not in _NOT_STARTED or (known is not None and bool(known.run))
            changed.append(self._row(record, known))
        if not is_due:
            return
        progress = {
            "replans": machine.replans,
            "plan_start": machine.plan_start,
            "failures": [[*key, times] for key, times in machine.failures.items() if times > 0],
        }
        self._store.write(self.goal_id, progress, changed)
        self._written.update((step.number, step) for step in changed)

    def restore(self, goal: StoredGoal, now: float) -> RestoredState:
        """Returns the state of the execution, and continues to write from there.

        :param now: the time of the state machine (s); earlier starts keep their order.
        :raises WrongValue: the stored state cannot be read.
        """
        count = len(goal.steps)
        records = []
        for stored in goal.steps:
            self._written[stored.number] = stored
            state = StepState(stored.state)
            records.append(
                StepRecord(
                    decode_step(stored.step),
                    state,
                    stored.message,
                    tuple(map(Explanation.from_dict, stored.explanations)),
                    None if not stored.run else now - count + stored.turn,
                    None if state in (*_NOT_STARTED, StepState.RUNNING) else now,
                )
            )
        progress = goal.progress
        failures = Counter({(manager, label): times for manager, label, times in progress.get("failures", [])})
        return RestoredState(tuple(records), progress.get("replans", 0), progress.get("plan_start", 1), failures)

    def _row(self, record: StepRecord, known: StoredStep | None) -> StoredStep:
        is_started = record.started is not None
        turn = known.turn if known is not None else 0
        return StoredStep(
            record.step.number,
            known.step if known is not None else encode_step(record.step),
            (known.run if known is not None else "") or (secrets.token_hex(8) if is_started else ""),
            record.state.value,
            turn or (1 + max((s.turn for s in self._written.values()), default=0) if is_started else 0),
            record.message,
            [why.to_dict() for why in record.explanations],
        )
