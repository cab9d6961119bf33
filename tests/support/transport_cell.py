"""A cell of robots that carry products, without a world model: facts, a clock, and robots that take time and fail.

It executes the commands of an execution state machine, and reports the results.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

from skiros2_common.core.explanation import Explanation
from skiros2_common.core.failure_kind import FailureKind
from skiros2_common.core.world_element import Element
from skiros2_task.core.commands import Claim, Command, End, MakePlan, ReadWorld, Start, Stop, Wake
from skiros2_task.core.execution import ExecutionStateMachine
from skiros2_task.core.formula import And, Atom, holds
from skiros2_task.core.partial_order import deorder
from skiros2_task.core.plan import Step, plan_of
from skiros2_task.core.planning import Verdict
from skiros2_task.core.schedule import schedule
from skiros2_task.core.semantics import Facts
from skiros2_task.core.store import Durations
from skiros2_task.core.task import PlanningTask, PlanStep
from support.transport_task import CONTAIN, GRIPPER, PLACE, ROBOT, contain, transport_task

PLANNING_TIME, STEP_TIME = 0.5, 2.0


@dataclass
class RunningStep:
    """A running step.

    :param until: when it ends (s).
    :param fails: whether it fails without effects.
    """

    step: Step
    until: float
    fails: bool = False


class TransportCell:
    """Executes one goal: each product at the place after its own.

    :param fails: returns whether a started step will fail.
    :param kind: of these failures, and of those of steps that are stopped.
    """

    def __init__(
        self,
        robots: int,
        places: int,
        products: int,
        max_replans: int = 5,
        fails: Callable[[Step], bool] = lambda step: False,
        kind: FailureKind = FailureKind.RETRYABLE,
        replans_after_limit: bool = False,
    ) -> None:
        task = transport_task(robots, places, products)
        self.robots = task.members[ROBOT]
        managers = tuple((robot, robot) for robot in self.robots)
        self._task = replace(task, actions=tuple(replace(action, managers=managers) for action in task.actions))
        self.facts = task.init
        self.now = 0.0
        self.gone: set[str] = set()
        self.running: dict[int, RunningStep] = {}
        self.started: list[tuple[Step, bool]] = []  # with whether what it needs held
        self.end: End | None = None
        self.plans = 0  # that were asked for
        self._fails = fails
        self._why = (
            () if kind is FailureKind.RETRYABLE else (Explanation("execute", "", "", -1, -1, "", kind=kind.value),)
        )
        self._due: list[tuple[float, Callable[[], Sequence[Command]]]] = []
        self.machine = ExecutionStateMachine(lambda: self.now, max_replans, replans_after_limit)
        self.tell(self.machine.begin())

    @property
    def task(self) -> PlanningTask:
        """As the world is now."""
        return replace(self._task, init=self.facts)

    @property
    def reached(self) -> bool:
        return holds(self._task.goal, self.facts)

    # -- commands of the state machine ---------------------------------------------------------------------------

    def tell(self, commands: Sequence[Command]) -> None:
        """Executes commands."""
        for command in commands:
            assert self.end is None, f"{command} after the end"
            if isinstance(command, MakePlan):
                self.plans += 1
                self._later(PLANNING_TIME, self._plan(command))
            elif isinstance(command, Claim):
                self._later(0.0, self.machine.granted)
            elif isinstance(command, Start):
                self._start(command.step)
            elif isinstance(command, Stop):
                self._later(0.1, lambda number=command.number: self._stopped(number))
            elif isinstance(command, ReadWorld):
                self._later(command.delay, lambda: self.machine.world(self.task))
            elif isinstance(command, Wake):
                self._later(command.delay, self.machine.wake)
            else:
                assert not self.running, "steps run after the end"
                self.end = command

    def _later(self, seconds: float, event: Callable[[], Sequence[Command]]) -> None:
        self._due.append((self.now + seconds, event))

    def _plan(self, command: MakePlan) -> Callable[[], Sequence[Command]]:
        """Plans with the world as it is now; the answer comes later."""
        seen, first = self.task, self.machine.first_number
        gone = frozenset((manager, "") for manager in command.lost)
        for avoided in (gone | command.avoided, gone):
            task = seen.after(_facts_after(seen, command.running)).without_skills(avoided)
            steps = transport_plan(task, [r for r in self.robots if (r, "") not in avoided])
            if steps is not None:
                objects = {name: Element("", eid=name) for name in task.objects}
                plan = plan_of(task, schedule(task, deorder(task, steps), Durations()), objects)
                return lambda: self.machine.planned(seen, plan.numbered_from(first))
        return lambda: self.machine.no_plan(Verdict.IMPOSSIBLE, "impossible", False)

    def _start(self, step: Step) -> None:
        robot = step.call.manager
        assert robot not in self.gone, f"{step}: the robot is gone"
        assert not any(d.step.call.manager == robot for d in self.running.values()), f"{step}: the robot is busy"
        self.started.append((step, holds(step.precondition, self.facts)))
        fails = self._fails(step) or not holds(step.precondition, self.facts)
        self.running[step.number] = RunningStep(step, self.now + STEP_TIME, fails)

    def _stopped(self, number: int) -> Sequence[Command]:
        running = self.running.pop(number, None)
        return self.machine.ended(number, False, "stopped", self._why) if running is not None else []

    # -- events ------------------------------------------------------------------------------------------

    def run(self, until: float = float("inf"), most: int = 10_000) -> None:
        """Runs until a time (s), or the end.

        :raises AssertionError: there are too many events.
        """
        for _ in range(most):
            times = [time for time, _ in self._due] + [running.until for running in self.running.values()]
            if self.end is not None or not times or min(times) > until:
                self.now = max(self.now, until) if until != float("inf") else self.now
                return
            self.now = max(self.now, min(times))
            self._next()
        raise AssertionError("the execution does not end")

    def _next(self) -> None:
        for index, (time, event) in enumerate(self._due):
            if time <= self.now:
                del self._due[index]
                self.tell(event())
                return
        number, running = next((n, d) for n, d in self.running.items() if d.until <= self.now)
        del self.running[number]
        if not running.fails:
            self.facts = running.step.apply(self.facts)
        message, why = ("broken", self._why) if running.fails else ("", ())
        self.tell(self.machine.ended(number, not running.fails, message, why))
        self.change(self.facts)

    def change(self, facts: frozenset[Atom]) -> None:
        """Changes the world."""
        self.facts = facts
        if self.end is None:
            self.tell(self.machine.world(self.task))

    def move(self, product: str, place: str) -> None:
        """Moves a product."""
        there = {a for a in self.facts if a.predicate == CONTAIN and a.terms[1] == product}
        self.change((self.facts - there) | {contain(place, product)})

    def lose(self, robot: str) -> None:
        """Removes a robot with its running steps."""
        self.gone.add(robot)
        for number in [n for n, d in self.running.items() if d.step.call.manager == robot]:
            del self.running[number]
        if self.end is None:
            self.tell(self.machine.robot_lost(robot))

    def find(self, robot: str) -> None:
        """Adds a lost robot again."""
        self.gone.discard(robot)
        if self.end is None:
            self.tell(self.machine.robot_found(robot))


def _facts_after(task: PlanningTask, steps: Iterable[Step]) -> Facts:
    facts = task.init
    for step in steps:
        facts = step.apply(facts)
    return facts


def transport_plan(task: PlanningTask, robots: Sequence[str]) -> list[PlanStep] | None:
    """Returns a plan that brings products to places with the robots in turn; None if a product has no robot."""
    facts = set(task.init)
    place_of = {a.terms[0]: a.terms[1] for a in facts if a.predicate.name == "skiros:at"}
    inside = {a.terms[1]: a.terms[0] for a in facts if a.predicate == CONTAIN}
    gripper_of = {robot: robot.replace(ROBOT, GRIPPER) for robot in place_of}
    holder = {gripper: robot for robot, gripper in gripper_of.items()}
    steps: list[PlanStep] = []

    def drive(robot: str, place: str) -> None:
        if place_of[robot] != place:
            steps.append(PlanStep("drive", (robot, place_of[robot], place)))
            place_of[robot] = place

    def put(robot: str, product: str, place: str) -> None:
        drive(robot, place)
        steps.append(PlanStep("place", (robot, gripper_of[robot], place, product)))

    goals = [
        (atom.terms[1], atom.terms[0]) for atom in (task.goal.parts if isinstance(task.goal, And) else (task.goal,))
    ]
    # What is held comes first: hands have to be empty.
    for turn, (product, place) in enumerate(sorted(goals, key=lambda goal: inside[goal[0]].startswith(PLACE))):
        if inside[product] == place:
            continue
        able = [r for r in robots if all(_can(task, name, r) for name in ("drive", "pick", "place"))]
        if not inside[product].startswith(PLACE):
            if holder[inside[product]] not in able:
                return None
            robot = holder[inside[product]]
        elif not able:
            return None
        else:
            robot = able[turn % len(able)]
            drive(robot, inside[product])
            steps.append(PlanStep("pick", (robot, gripper_of[robot], inside[product], product)))
        put(robot, product, place)
    return steps


def _can(task: PlanningTask, action: str, robot: str) -> bool:
    return any(
        a.predicate.kind.value == "can" and str(a.predicate.name) == action and a.terms == (robot,) for a in task.init
    )
