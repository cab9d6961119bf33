"""How a goal is carried out: a state machine. What happens goes in, what is to be done comes out.

    PLANNING ──plan──► WAITING ──robots are free──► RUNNING ──all done──► CHECKING ──the goal holds──► ENDED
       ▲  ▲ no plan yet   │ the world is another by then │ something breaks   │ it does not
       │  └── BLOCKED     │                              │                    │
       └──────────────────┴──────────────────────────────┴────────────────────┘
    Any of them, when it is cancelled or hopeless: STOPPING until nothing runs, then ENDED.

A plan is broken when a step fails, when a robot that it needs disappears, or when the world has become such that what
is left of it does not work any more. Then nothing new is started; what runs goes on, and the rest is planned anew from
the world as it will be when that has ended well. What runs and is not needed by the new plan is stopped. Where there is
no such plan, all is stopped, and it is planned from the world as it is.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace

from skiros2_common.core.explanation import Explanation
from skiros2_task.core.commands import Claim, Command, End, JobState, Look, Phase, Plan, Record, Start, Stop, Wake
from skiros2_task.core.jobs import Facts, Job, carried_out, in_scene, to_be_made, unmet
from skiros2_task.core.task import PlanningTask
from skiros2_task.core.task_planner import Verdict

#: How long what breaks a plan has to be so (s): what belongs together may come to the world model in several changes.
SETTLE = 0.3

#: How long a robot that has disappeared is waited for, where there is no plan without it (s).
PATIENCE = 10.0

#: A skill that has failed so often on a robot is planned with on others, where that is possible.
MOST_FAILURES = 2


@dataclass
class Executive:
    """Carries out one goal. One thread at a time.

    :param clock: gives the time (s).
    :param max_replans: how often a broken plan is replaced at most.
    """

    clock: Callable[[], float]
    max_replans: int = 5
    phase: Phase = Phase.PLANNING
    replans: int = 0
    records: dict[int, Record] = field(default_factory=dict)  # of the plan, and of all that was started, by number
    plan_begins: int = 1  # the number of the first step of the plan
    message: str = ""  # what happened last
    _task: PlanningTask | None = None
    _facts: Facts = frozenset()
    _made: frozenset[str] = frozenset()
    _gone: set[str] = field(default_factory=set)
    _failures: Counter[tuple[str, str]] = field(default_factory=Counter)
    _assumed: tuple[Job, ...] = ()  # what the plan that is being made takes as done
    _suspect_since: float | None = None
    _stopped: set[int] = field(default_factory=set)
    _outcome: End | None = None  # how it will end when nothing runs any more
    _hopeless: End | None = None  # how it ends unless something changes
    _gives_up_at: float | None = None

    def begin(self) -> list[Command]:
        """The first commands."""
        return self._plan()

    @property
    def first_number(self) -> int:
        """The number for the first job of the next plan."""
        return max(self.records, default=0) + 1

    @property
    def running(self) -> tuple[Job, ...]:
        return tuple(r.job for r in self.records.values() if r.state is JobState.RUNNING)

    @property
    def waiting(self) -> tuple[Job, ...]:
        return tuple(r.job for r in self.records.values() if r.state is JobState.WAITING)

    # -- what happens ------------------------------------------------------------------------------------------

    def planned(self, task: PlanningTask, jobs: Sequence[Job]) -> list[Command]:
        """There is a plan.

        :param task: it was planned with, as the world was, without what was taken as done.
        :param jobs: in an order that works.
        """
        if self.phase is not Phase.PLANNING:
            return []
        lost = [job for job in self._assumed if self.records[job.number].state is not JobState.SUCCEEDED]
        lost = [job for job in lost if job not in self.running or job.number in self._stopped]
        if lost:
            return self._broken(f"{lost[0]} did not end as planned")
        missing = self._gone & {job.call.manager for job in jobs}
        if missing:
            return self._broken(f"{min(missing)} has disappeared")
        running, self.plan_begins = self.running, self.first_number
        for job in jobs:
            others = {other.number for other in running if job.disturbs(other)}
            self.records[job.number] = Record(replace(job, after=job.after | others))
        self._task, self._facts, self._made = task, task.init, to_be_made(task)
        for job in self._assumed:
            if job not in running:  # it has ended while the plan was made
                self._facts = carried_out(self._facts, job)
        self._suspect_since = None
        self.phase = Phase.WAITING
        self.message = f"a plan of {len(jobs)} steps" if jobs else "nothing is left to do but what runs"
        return [*self._stop_useless(), self._claim()]

    def no_plan(self, verdict: Verdict, message: str, others: bool) -> list[Command]:
        """There is no plan.

        :param others: other goals are being carried out, so that there may be one later.
        """
        if self.phase is not Phase.PLANNING:
            return []
        running = self.running
        if running or self._assumed:  # what ran may have been in the way, or is not to be counted on
            self.message = "no plan goes on from what runs; it is stopped"
            if running:
                self.phase = Phase.BLOCKED
                return self._stop(running)
            return self._plan()
        self._hopeless = End(verdict, message)
        if verdict is Verdict.IMPOSSIBLE and (others or self._gone):
            self.phase = Phase.BLOCKED
            self.message = "no plan for now: " + ("others use what it takes" if others else "a robot is gone")
            self._gives_up_at = None if others else self.clock() + PATIENCE
            return [] if others else [Wake(PATIENCE)]
        return self._finish(self._hopeless)

    def granted(self) -> list[Command]:
        """What was claimed is there."""
        if self.phase is not Phase.WAITING:
            return []
        flaw = self.flaw()
        if flaw:  # others have changed the world meanwhile
            self.message = flaw
            self._drop_waiting()
            return self._plan()
        self.phase = Phase.RUNNING
        return self._go_on()

    def ended(
        self, number: int, succeeded: bool, message: str = "", explanations: Iterable[Explanation] = ()
    ) -> list[Command]:
        """A step that was started has ended."""
        record = self.records[number]
        if record.state is not JobState.RUNNING:
            return []
        record.ended, record.message, record.explanations = self.clock(), message, tuple(explanations)
        if succeeded:
            record.state = JobState.SUCCEEDED
            self._facts = carried_out(self._facts, record.job)
            self.message = f"{record.job} has succeeded"
        elif number in self._stopped:
            record.state = JobState.STOPPED
        else:
            record.state = JobState.FAILED
            self._failures[record.job.call.manager, record.job.call.label] += 1
            self.message = f"{record.job} has failed: {message}"
        if self._outcome is not None:
            return self._finish(self._outcome)
        if self.phase is Phase.BLOCKED and not self.running:
            return self._plan()
        if self.phase not in (Phase.WAITING, Phase.RUNNING):
            return []
        if record.state is JobState.FAILED:
            return self._broken(self.message)
        return self._go_on() if self.phase is Phase.RUNNING else [self._claim()]

    def robot_gone(self, manager: str) -> list[Command]:
        """A manager is not there any more, and what it ran has ended."""
        self._gone.add(manager)
        commands: list[Command] = []
        for job in self.running:
            if job.call.manager == manager:
                commands += self.ended(job.number, False, f"{manager} has disappeared")
        if self.phase in (Phase.WAITING, Phase.RUNNING) and any(j.call.manager == manager for j in self.waiting):
            commands += self._broken(f"{manager} has disappeared")
        return commands

    def robot_back(self, manager: str) -> list[Command]:
        """A manager is there, again or for the first time."""
        if manager not in self._gone:
            return []
        self._gone.discard(manager)
        return self.freed()

    def freed(self) -> list[Command]:
        """Something has changed that may make a plan possible: other goals have ended, robots have come."""
        return self._plan() if self.phase is Phase.BLOCKED and not self.running else []

    def wake(self) -> list[Command]:
        """Some time has passed."""
        if self.phase is not Phase.BLOCKED or self._gives_up_at is None or self.clock() < self._gives_up_at:
            return []
        assert self._hopeless is not None
        return self._finish(self._hopeless)

    def world(self, task: PlanningTask) -> list[Command]:
        """What the world is like now.

        :param task: for the goal, made from the world.
        """
        if self.phase not in (Phase.WAITING, Phase.RUNNING, Phase.CHECKING):
            return []
        self._see(task)
        if self.phase is Phase.WAITING:
            return []
        if self.phase is Phase.CHECKING and task.satisfied:
            done = any(record.began is not None for record in self.records.values())
            return self._finish(
                End(Verdict.PLANNED, "the goal is reached")
                if done
                else End(Verdict.NOTHING_TO_DO, "the goal holds already")
            )
        flaw = self.flaw()
        if not flaw:
            self._suspect_since = None
            return []
        if self._suspect_since is None:
            self._suspect_since = self.clock()
        left = self._suspect_since + SETTLE - self.clock()
        return [Look(left)] if left > 0 else self._broken(flaw)

    def unreadable(self, message: str) -> list[Command]:
        """The goal means nothing in the world as it is now."""
        return self._finish(End(Verdict.FAILED, message))

    def cancel(self) -> list[Command]:
        """It is not wanted any more."""
        return self._finish(End(Verdict.CANCELLED, "cancelled"))

    # -- what follows ------------------------------------------------------------------------------------------

    def flaw(self, without: Iterable[Job] = ()) -> str:
        """Why what runs and what waits does not lead to the goal; "" when it does.

        :param without: of what runs, what is not to be counted on.
        """
        assert self._task is not None
        facts = self._facts
        for job in self.running:
            if job not in without and job.number not in self._stopped:
                facts = carried_out(facts, job)
        for job in self.waiting:
            missing = unmet(job.needs, facts)
            if missing:
                return f"{job} needs {missing}"
            facts = carried_out(facts, job)
        missing = unmet(self._task.goal, facts)
        return f"the goal's {missing} would not hold" if missing else ""

    def _see(self, task: PlanningTask) -> None:
        """Takes in what the world is like. Of what the plan makes nobody else knows by which name it goes."""
        made = self._made & in_scene(self._facts)
        if not made:
            self._task, self._facts, self._made = task, task.init, to_be_made(task)
            return
        own = frozenset(atom for atom in self._facts if made & set(atom.terms))
        self._facts = own | frozenset(atom for atom in task.init if not made & set(atom.terms))

    def _plan(self) -> list[Command]:
        self.phase = Phase.PLANNING
        self._assumed = tuple(job for job in self.running if job.number not in self._stopped)
        avoided = frozenset(key for key, times in self._failures.items() if times >= MOST_FAILURES)
        return [Plan(self._assumed, frozenset(self._gone), avoided)]

    def _broken(self, reason: str) -> list[Command]:
        """What is left of the plan is dropped; another one is made, unless there were too many."""
        self.message = reason
        self._suspect_since = None
        self._drop_waiting()
        if self.replans >= self.max_replans:
            again = f" after it was planned anew {self.replans} times" if self.replans else ""
            return self._finish(End(Verdict.FAILED, f"{reason}{again}"))
        self.replans += 1
        return self._plan()

    def _drop_waiting(self) -> None:
        for record in self.records.values():
            if record.state is JobState.WAITING:
                record.state = JobState.DROPPED

    def _finish(self, outcome: End) -> list[Command]:
        """Ends, when nothing runs any more."""
        if self.phase is Phase.ENDED:
            return []
        self._outcome = self._outcome or outcome
        self._drop_waiting()
        running = self.running
        if running:
            self.phase = Phase.STOPPING
            return self._stop(running)
        self.phase, self.message = Phase.ENDED, self._outcome.message
        return [self._outcome]

    def _stop(self, jobs: Iterable[Job]) -> list[Command]:
        numbers = [job.number for job in jobs if job.number not in self._stopped]
        self._stopped.update(numbers)
        return [Stop(number) for number in numbers]

    def _stop_useless(self) -> list[Command]:
        """Stops what the plan reaches the goal without."""
        useless: list[Job] = []
        for job in self.running:
            if not self.flaw([*useless, job]):
                useless.append(job)
        return self._stop(useless)

    def _claim(self) -> Claim:
        in_use = frozenset(name for job in self.running for name in job.uses)
        return Claim(in_use | frozenset(name for job in self.waiting for name in job.uses), in_use)

    def _go_on(self) -> list[Command]:
        """Starts what may start; at the end, has the world looked at."""
        commands: list[Command] = []
        open_jobs = {job.number for job in (*self.running, *self.waiting)}
        for job in self.waiting:
            if not job.after & open_jobs:
                record = self.records[job.number]
                record.state, record.began = JobState.RUNNING, self.clock()
                self.message = f"{job} is started"
                commands.append(Start(job))
        if not self.running and not self.waiting:
            self.phase = Phase.CHECKING
            commands.append(Look())
        return [*commands, self._claim()]
