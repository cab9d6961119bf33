"""The execution of one goal as a state machine: events go in, commands come out.

    PLANNING ──plan──► WAITING ──resources granted──► RUNNING ──all done──► CHECKING ──goal holds──► ENDED
       ▲  ▲ no plan yet   │ world has changed            │ plan broken         │ goal does not hold
       │  └── BLOCKED     │                              │                     │
       └──────────────────┴──────────────────────────────┴─────────────────────┘
    From any state, on cancellation or final failure: STOPPING until no step runs, then ENDED.
    A goal of an earlier process starts in PLANNING, or in ASKING until somebody decides, and continues in WAITING if
    the restored plan still leads to the goal.

A plan is broken when a step fails, when a robot of it is lost, or when the remaining steps no longer lead from the
current world to the goal. Then no further step starts. Running steps continue, and a new plan is made for the world as
it will be when they have succeeded, in advance while the world may still settle (`next_planning`); running steps that
the new plan does not need are stopped. If there is no such plan, all steps are stopped and a plan is made for the
current world. After a final failure of a step (`FailureKind`), also while it is being stopped, no new plan is made: the
goal ends.

A goal that is interrupted by one with a higher priority stops the steps that use the same robots, which may take a
while: a manager runs the `on_preempt` of the preempted skills. Then a plan is made for the world as it is by then.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace

from skiros2_common.core.explanation import Explanation
from skiros2_task.core.commands import Claim, Command, End, MakePlan, ReadWorld, Start, Stop, Wake
from skiros2_task.core.plan import Step, plan_problem
from skiros2_task.core.planning import Verdict
from skiros2_task.core.semantics import Facts
from skiros2_task.core.step_record import (
    Phase,
    RestoredState,
    StepRecord,
    StepState,
    final_end,
    given_up_text,
    with_labels,
)
from skiros2_task.core.task import PlanningTask, objects_in_scene

#: How long a plan must be broken by changes of the world before it is replaced (s): related changes may arrive in
#: several requests.
SETTLE_TIME = 0.3

#: How long a goal without a plan waits for a lost robot (s).
ROBOT_TIMEOUT = 30.0

#: After this number of failures on a robot, a skill is planned with on other robots, if possible.
MAX_FAILURES = 2


@dataclass
class ExecutionStateMachine:
    """Executes one goal. Not thread-safe.

    :param clock: returns the time (s).
    :param max_replans: how often a broken plan is replaced at most.
    :param replans_after_limit: whether a plan is made even after a step that exceeded a limit.
    """

    clock: Callable[[], float]
    max_replans: int = 5
    replans_after_limit: bool = False
    phase: Phase = Phase.PLANNING
    replans: int = 0
    records: dict[int, StepRecord] = field(default_factory=dict)  # of the plan and all started steps, by number
    plan_start: int = 1  # the number of the plan's first step
    message: str = ""  # the last event
    _task: PlanningTask | None = None
    _facts: Facts = frozenset()
    _to_create: frozenset[str] = frozenset()
    _lost: set[str] = field(default_factory=set)
    _failures: Counter[tuple[str, str]] = field(default_factory=Counter)
    _assumed: tuple[Step, ...] = ()  # steps whose success the plan in preparation assumes
    _broken_since: float | None = None
    _stopped: set[int] = field(default_factory=set)
    _outcome: End | None = None  # the end, once no step runs
    _failure: End | None = None  # the end, unless the goal is unblocked
    _blocked_until: float | None = None
    _interrupted: bool = False  # unused resources are released, until there is a new plan
    _outdated: bool = False  # the plan in preparation was interrupted
    _improved: bool = False  # since then, a robot has appeared, or another goal has ended
    _restored: bool = False  # from an earlier process, and not resumed yet

    def begin(self) -> list[Command]:
        """Returns the first commands."""
        return self._plan()

    def restore(self, state: RestoredState) -> list[Command]:
        """Continues the execution of an earlier process; `resume`, `ask` or `abort` follow."""
        self.records = {record.step.number: record for record in state.records}
        self.replans, self.plan_start = state.replans, state.plan_start
        self._failures.update(state.failures)
        self.message, self._restored = "the task manager was restarted", True
        for record in state.records:
            self._outcome = self._outcome or final_end(record, state.records, self.replans_after_limit)
        return [self._claim_in_use()]

    @property
    def failures(self) -> Counter[tuple[str, str]]:
        """How often each skill has failed, by (manager, skill label)."""
        return self._failures

    @property
    def next_planning(self) -> MakePlan | None:
        """The planning that follows if the plan stays broken for `SETTLE_TIME`; None if the plan is not broken."""
        return self._make_plan() if self.phase is Phase.RUNNING and self._broken_since is not None else None

    @property
    def first_number(self) -> int:
        """The number of the next plan's first step."""
        return max(self.records, default=0) + 1

    @property
    def facts(self) -> Facts:
        """The facts that are expected of the world now."""
        return self._facts

    @property
    def running(self) -> tuple[Step, ...]:
        return tuple(r.step for r in self.records.values() if r.state is StepState.RUNNING)

    @property
    def waiting(self) -> tuple[Step, ...]:
        return tuple(r.step for r in self.records.values() if r.state is StepState.WAITING)

    # -- events ------------------------------------------------------------------------------------------------

    def resume(self, task: PlanningTask) -> list[Command]:
        """The world was read after a restart. The plan continues if it still leads to the goal.

        :param task: the goal's task for the current world.
        """
        if not self._restored or self.phase not in (Phase.PLANNING, Phase.ASKING):
            return []
        self._restored = False
        if self._outcome is not None:
            return self._finish(self._outcome)
        if self._outdated:
            return self._plan_when_stopped()
        self._task, self._facts, self._to_create = task, task.init, task.objects_to_create
        if task.satisfied and not self.running:
            self._drop_waiting()
            self.phase = Phase.CHECKING
            return self.world(task)
        is_complete = all(element.id for step in self.waiting for _, element in step.call.arguments)
        missing = self._lost & {step.call.manager for step in self.waiting}
        if is_complete and not missing and (self.running or self.waiting) and not self._why_invalid():
            self.phase, self.message = Phase.WAITING, "the plan continues after a restart"
            return [self._claim()]
        self._drop_waiting()
        return self._plan()

    def ask(self, question: str) -> list[Command]:
        """No further step starts until `resume`, `abort` or `cancel`. Running steps continue."""
        if not self._restored or self.phase is not Phase.PLANNING:
            return []
        self.phase, self.message, self._outdated = Phase.ASKING, question, False
        return [self._claim_in_use()]

    def abort(self, reason: str) -> list[Command]:
        """The goal does not continue after a restart."""
        if not self._restored:
            return []
        return self._finish(End(Verdict.FAILED, reason))

    def interrupted(self, number: int, message: str) -> list[Command]:
        """A step of an earlier process no longer runs, and its result is unknown: the world shows it."""
        commands = self.ended(number, False, message)
        call = self.records[number].step.call
        self._failures[call.manager, call.label] -= 1  # the skill has not failed
        return commands

    def planned(self, task: PlanningTask, steps: Sequence[Step]) -> list[Command]:
        """A plan was found.

        :param task: the world that was planned for, without the effects of assumed steps.
        :param steps: in an executable order.
        """
        if self.phase is not Phase.PLANNING:
            return []
        if self._outdated:
            return self._plan_when_stopped()
        failed = [step for step in self._assumed if self.records[step.number].state is not StepState.SUCCEEDED]
        failed = [step for step in failed if step not in self.running or step.number in self._stopped]
        if failed:
            return self._replan(f"{failed[0]} did not end as planned")
        missing = self._lost & {step.call.manager for step in steps}
        if missing:
            return self._replan(f"{min(missing)} has disappeared")
        running, self.plan_start = self.running, self.first_number
        for step in steps:
            others = {other.number for other in running if step.interferes(other)}
            self.records[step.number] = StepRecord(replace(step, after=step.after | others))
        self._task, self._facts, self._to_create = task, task.init, task.objects_to_create
        for step in self._assumed:
            if step not in running:  # ended during planning
                self._facts = step.apply(self._facts)
        self._broken_since, self._interrupted = None, False
        self.phase = Phase.WAITING
        self.message = f"a plan of {len(steps)} steps" if steps else "no further steps; waiting for the running ones"
        return [*self._stop_unneeded(), self._claim()]

    def no_plan(
        self, verdict: Verdict, message: str, others: bool, missing: tuple[str, ...] = (), restarting: bool = False
    ) -> list[Command]:
        """No plan was found.

        :param others: other goals are being executed, so that there may be a plan later.
        :param missing: parameters that lack a value.
        :param restarting: a robot that was running had no skills in the world model: its manager has been killed, or
            registers them.
        """
        if self.phase is not Phase.PLANNING:
            return []
        if self._outdated:
            return self._plan_when_stopped()
        running = self.running
        if running or self._assumed:  # running steps may have been in the way, or may fail
            self.message = "no plan continues the running steps; they are stopped"
            if running:
                self.phase = Phase.BLOCKED
                return self._stop(running)
            return self._plan()
        if self._improved:
            return self._plan()
        self._failure = End(verdict, message, missing)
        if verdict is Verdict.IMPOSSIBLE and (others or self._lost or restarting):
            self.phase = Phase.BLOCKED
            self.message = "no plan for now: " + ("other goals use the resources" if others else "a robot is lost")
            self._blocked_until = None if others else self.clock() + ROBOT_TIMEOUT
            return [] if others else [Wake(ROBOT_TIMEOUT)]
        return self._finish(self._failure)

    def granted(self) -> list[Command]:
        """The requested resources were granted."""
        if self.phase is not Phase.WAITING:
            return []
        reason = self._why_invalid()
        if reason:  # the world has changed while the goal waited
            self.message = reason
            self._drop_waiting()
            return self._plan()
        self.phase = Phase.RUNNING
        return self._start_ready()

    def ended(
        self, number: int, succeeded: bool, message: str = "", explanations: Iterable[Explanation] = ()
    ) -> list[Command]:
        """A started step has ended."""
        record = self.records[number]
        if record.state is not StepState.RUNNING:
            return []
        record.ended, record.message, record.explanations = self.clock(), message, tuple(explanations)
        if succeeded:
            record.state = StepState.SUCCEEDED
            self._facts = record.step.apply(self._facts)
            self.message = f"{record.step} has succeeded"
        elif number in self._stopped:
            record.state = StepState.STOPPED
        else:
            record.state = StepState.FAILED
            self._failures[record.step.call.manager, record.step.call.label] += 1
            self.message = message if record.explanations else f"{record.step} has failed: {message}"
        self._outcome = self._outcome or final_end(record, self.records.values(), self.replans_after_limit)
        if self._outcome is not None:
            return self._finish(self._outcome)
        released = [self._claim()] if self._interrupted else []
        if self.phase is Phase.BLOCKED:
            return [*released, *self._plan_when_stopped()]
        if self.phase not in (Phase.WAITING, Phase.RUNNING):
            return [*released]
        if record.state is StepState.FAILED:
            return self._replan(self.message)
        return self._start_ready() if self.phase is Phase.RUNNING else [self._claim()]

    def interrupt(self, names: frozenset[str]) -> list[Command]:
        """A goal with a higher priority needs these robots and devices."""
        if self.phase not in (Phase.PLANNING, Phase.WAITING, Phase.RUNNING):
            return []
        self.message = "interrupted by a goal with a higher priority"
        self._drop_waiting()
        self._broken_since, self._blocked_until, self._interrupted = None, None, True
        self._outdated = self.phase is Phase.PLANNING
        commands = [*self._stop(step for step in self.running if names & step.uses), self._claim()]
        return commands if self._outdated else [*commands, *self._plan_when_stopped()]

    def robot_lost(self, manager: str) -> list[Command]:
        """A manager has disappeared; its steps have ended."""
        self._lost.add(manager)
        commands: list[Command] = []
        for step in self.running:
            if step.call.manager == manager:
                commands += self.ended(step.number, False, f"{manager} has disappeared")
        if self.phase in (Phase.WAITING, Phase.RUNNING) and any(s.call.manager == manager for s in self.waiting):
            commands += self._replan(f"{manager} has disappeared")
        return commands

    def robot_found(self, manager: str) -> list[Command]:
        """A manager has appeared, again or for the first time."""
        self._lost.discard(manager)
        return self.retry()

    def retry(self) -> list[Command]:
        """A plan may have become possible: another goal has ended, or a robot has appeared."""
        self._improved = True
        return self._plan() if self.phase is Phase.BLOCKED and not self.running else []

    def wake(self) -> list[Command]:
        """The delay of a `Wake` has passed."""
        if self.phase is not Phase.BLOCKED or self._blocked_until is None or self.clock() < self._blocked_until:
            return []
        assert self._failure is not None
        return self._finish(self._failure)

    def world(self, task: PlanningTask) -> list[Command]:
        """The world model was read.

        :param task: the goal's task for the current world.
        """
        if self.phase not in (Phase.WAITING, Phase.RUNNING, Phase.CHECKING):
            return []
        self._update_facts(task)
        if self.phase is Phase.WAITING:
            return []
        if self.phase is Phase.CHECKING and task.satisfied:
            if all(record.started is None for record in self.records.values()):
                return self._finish(End(Verdict.NOTHING_TO_DO, "the goal holds already"))
            return self._finish(End(Verdict.PLANNED, "the goal is reached"))
        reason = self._why_invalid()
        if not reason:
            held, self._broken_since = self._broken_since is not None, None
            return self._start_ready() if held and self.phase is Phase.RUNNING else []
        if self._broken_since is None:
            self._broken_since = self.clock()
        remaining = self._broken_since + SETTLE_TIME - self.clock()
        return [ReadWorld(remaining)] if remaining > 0 else self._replan(reason)

    def unreadable(self, message: str) -> list[Command]:
        """The goal cannot be read in the current world."""
        return self._finish(End(Verdict.FAILED, message))

    def cancel(self) -> list[Command]:
        """The goal was cancelled."""
        return self._finish(End(Verdict.CANCELLED, "cancelled"))

    # -- transitions -------------------------------------------------------------------------------------------

    def _why_invalid(self, without: Iterable[Step] = ()) -> str:
        """Returns why the running and waiting steps do not lead to the goal; "" if they do.

        :param without: running steps that are left out.
        """
        assert self._task is not None
        running = [s for s in self.running if s not in without and s.number not in self._stopped]
        return plan_problem(running, self.waiting, self._facts, self._task.goal)

    def _update_facts(self, task: PlanningTask) -> None:
        """Adopts the facts of the world. Facts about objects that the plan has created are kept: the names that the
        plan gives them are not in the world model.
        """
        created = self._to_create & objects_in_scene(self._facts)
        if not created:
            self._task, self._facts, self._to_create = task, task.init, task.objects_to_create
            return
        own = frozenset(atom for atom in self._facts if created & set(atom.terms))
        self._facts = own | frozenset(atom for atom in task.init if not created & set(atom.terms))

    def _plan(self) -> list[Command]:
        self.phase, self._improved = Phase.PLANNING, False
        command = self._make_plan()
        self._assumed = command.running
        return [command]

    def _make_plan(self) -> MakePlan:
        assumed = tuple(step for step in self.running if step.number not in self._stopped)
        avoided = frozenset(key for key, times in self._failures.items() if times >= MAX_FAILURES)
        return MakePlan(assumed, frozenset(self._lost), avoided)

    def _plan_when_stopped(self) -> list[Command]:
        """Plans once the stopped steps have ended."""
        self._outdated = False
        self.phase = Phase.BLOCKED
        return [] if any(step.number in self._stopped for step in self.running) else self._plan()

    def _replan(self, reason: str) -> list[Command]:
        """Drops the waiting steps and plans again, at most `max_replans` times."""
        self.message = with_labels(reason, self.records.values())
        self._broken_since = None
        self._drop_waiting()
        if self.replans >= self.max_replans:
            return self._finish(End(Verdict.FAILED, given_up_text(self.message, self.replans)))
        self.replans += 1
        return self._plan()

    def _drop_waiting(self) -> None:
        for record in self.records.values():
            if record.state is StepState.WAITING:
                record.state = StepState.DROPPED

    def _finish(self, outcome: End) -> list[Command]:
        """Ends once no step runs."""
        if self.phase is Phase.ENDED:
            return []
        self._outcome = self._outcome or outcome
        self._drop_waiting()
        if self.running:
            self.phase = Phase.STOPPING
            return self._stop(self.running)
        self.phase, self.message = Phase.ENDED, self._outcome.message
        return [self._outcome]

    def _stop(self, steps: Iterable[Step]) -> list[Command]:
        numbers = [step.number for step in steps if step.number not in self._stopped]
        self._stopped.update(numbers)
        return [Stop(number) for number in numbers]

    def _stop_unneeded(self) -> list[Command]:
        """Stops the running steps without which the plan still reaches the goal."""
        unneeded: list[Step] = []
        for step in self.running:
            if not self._why_invalid([*unneeded, step]):
                unneeded.append(step)
        return self._stop(unneeded)

    def _claim(self) -> Claim:
        in_use = frozenset(name for step in self.running for name in step.uses)
        return Claim(in_use | frozenset(name for step in self.waiting for name in step.uses), in_use)

    def _claim_in_use(self) -> Claim:
        in_use = frozenset(name for step in self.running for name in step.uses)
        return Claim(in_use, in_use)

    def _start_ready(self) -> list[Command]:
        """Starts the steps whose predecessors have ended, unless the plan is broken; then reads the world."""
        commands: list[Command] = []
        unfinished = {step.number for step in (*self.running, *self.waiting)}
        for step in self.waiting:
            if not step.after & unfinished and self._broken_since is None:
                record = self.records[step.number]
                record.state, record.started = StepState.RUNNING, self.clock()
                self.message = f"{step.name}, is started"
                commands.append(Start(step))
        if not self.running and not self.waiting:
            self.phase = Phase.CHECKING
            commands.append(ReadWorld())
        return [*commands, self._claim()]
