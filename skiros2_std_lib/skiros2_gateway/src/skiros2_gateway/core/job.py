"""Jobs as in ISA-95 Job Control (OPC 10031-4): states, sub-states, methods and the transitions between them."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import Annotated, Any, Literal

from pydantic import (
    AwareDatetime,
    BaseModel,
    ConfigDict,
    Field,
    StringConstraints,
    ValidationError,
)

from skiros2_common.core.errors import Refused
from skiros2_gateway.core.cell import Ending
from skiros2_gateway.core.problems import Rejected, problems_of
from skiros2_gateway.core.resources import Resource
from skiros2_gateway.core.values import STORED, Value
from skiros2_task.core.goal_text import MAX_GOAL

JobId = Annotated[str, StringConstraints(pattern=r"^[A-Za-z0-9][A-Za-z0-9._:\-]{0,127}$")]


class State(StrEnum):
    """The state of a job order."""

    NOT_ALLOWED_TO_START = "NotAllowedToStart"
    ALLOWED_TO_START = "AllowedToStart"
    RUNNING = "Running"
    INTERRUPTED = "Interrupted"
    ENDED = "Ended"
    ABORTED = "Aborted"

    @property
    def number(self) -> int:
        """The state's number in OPC 10031-4."""
        return list(State).index(self) + 1


class Substate(StrEnum):
    """The sub-state of a job order; NONE in states without sub-states.

    Before the start: WAITING for the earliest start, READY to start, LOADED when its goal was sent to the cell and is
    not accepted yet. Interrupted: HELD by the method Pause, SUSPENDED by a stop of a robot. Ended: COMPLETED while the
    response is collected, then CLOSED.
    """

    NONE = ""
    WAITING = "Waiting"
    READY = "Ready"
    LOADED = "Loaded"
    HELD = "Held"
    SUSPENDED = "Suspended"
    COMPLETED = "Completed"
    CLOSED = "Closed"

    @property
    def number(self) -> int:
        """The sub-state's number within its state machine in OPC 10031-4; 0 for NONE."""
        groups = ((Substate.WAITING, Substate.READY, Substate.LOADED), (Substate.HELD, Substate.SUSPENDED))
        for group in (*groups, (Substate.COMPLETED, Substate.CLOSED)):
            if self in group:
                return group.index(self) + 1
        return 0


class Method(StrEnum):
    """The methods of Job Control for one job order."""

    STORE = "Store"
    STORE_AND_START = "StoreAndStart"
    START = "Start"
    REVOKE_START = "RevokeStart"
    PAUSE = "Pause"
    RESUME = "Resume"
    UPDATE = "Update"
    STOP = "Stop"
    ABORT = "Abort"
    CANCEL = "Cancel"
    CLEAR = "Clear"


#: The names of the methods that end a job's motion, in lower case.
STOPS = (Method.STOP.name.lower(), Method.ABORT.name.lower())

#: The states in which a job has not started.
BEFORE = (State.NOT_ALLOWED_TO_START, State.ALLOWED_TO_START)
_STARTED = (State.RUNNING, State.INTERRUPTED)

#: The states in which a method is allowed. `Store` and `StoreAndStart` need an unknown job id instead.
ALLOWED: dict[Method, tuple[State, ...]] = {
    Method.START: (State.NOT_ALLOWED_TO_START,),
    Method.REVOKE_START: (State.ALLOWED_TO_START,),
    Method.PAUSE: (State.RUNNING,),
    Method.RESUME: (State.INTERRUPTED,),
    Method.UPDATE: BEFORE,
    Method.STOP: _STARTED,
    Method.ABORT: (*BEFORE, *_STARTED),
    Method.CANCEL: BEFORE,
    Method.CLEAR: (State.ENDED, State.ABORTED),
}

#: The states that follow a state, by methods or by what happens in the cell.
FOLLOWING: dict[State, tuple[State, ...]] = {
    State.NOT_ALLOWED_TO_START: (State.ALLOWED_TO_START, State.ABORTED),
    State.ALLOWED_TO_START: (State.NOT_ALLOWED_TO_START, State.RUNNING, State.ABORTED),
    State.RUNNING: (State.INTERRUPTED, State.ENDED, State.ABORTED),
    State.INTERRUPTED: (State.RUNNING, State.ENDED, State.ABORTED),
    State.ENDED: (),
    State.ABORTED: (),
}

#: The states in which a job has a goal in the cell, or has had one.
FINAL = (State.ENDED, State.ABORTED)


class Order(BaseModel):
    """An order of a client: a goal, or a work master with parameters."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=False)

    id: JobId = Field(description="unique for ever: a second order with the same id and content is the same job")
    description: str = Field("", max_length=1000)
    goal: str = Field("", max_length=MAX_GOAL, description="goal text, as of the task manager; or name a work master")
    work_master: str = Field("", max_length=200, description="id of a named goal with typed parameters")
    parameters: dict[str, Value] = Field({}, max_length=100, description="values of the work master's parameters")
    priority: int = Field(0, ge=-32768, le=32767, description="the highest priority starts first")
    earliest_start: AwareDatetime | None = None
    due: AwareDatetime | None = Field(None, description="of jobs with one priority, the earliest due time starts first")
    robots: tuple[str, ...] = Field((), max_length=100, description="node names of the allowed robots; empty: all")
    resources: tuple[Resource, ...] = Field((), max_length=100, description="which the cell does not plan with")
    quality: Literal["", "first", "best", "optimal"] = Field("", description="wanted plan quality")
    on_restart: Literal["", "continue", "ask", "abort"] = Field(
        "", description="after a restart of the cell; empty: ask if a robot of the job holds something, else continue"
    )

    @property
    def digest(self) -> str:
        """Identifies the content."""
        return hashlib.sha256(self.model_dump_json().encode()).hexdigest()


def read_order(data: Any) -> Order:
    """Returns the order in JSON data.

    :raises Rejected: with all problems of its fields.
    """
    try:
        return Order.model_validate(data)
    except ValidationError as error:
        raise Rejected(problems_of(error)) from None


#: A place in the queue: of two places, the smaller one starts first.
Rank = tuple[float, ...]
#: The due time of a job without one (s since the epoch).
_NEVER = 1e12


@dataclass
class Response:
    """The result of a job.

    :param outcome: "" before the end; then as `state` of the result of the action Achieve, or `lost`.
    :param plan, steps: as in the feedback of Achieve; `steps` has the robot, state and message of each started step.
    :param changes: what changed in the world model, see `skiros2_gateway.core.cell.Collected`.
    :param quality: values of the properties that the work master names, by `parameter.property`.
    :param explanations: why steps failed, the last failure at the end.
    :param first_change, last_change: between which numbers of changes of the world model it has run; 0: unknown.
    :param collected: whether `changes` and `quality` are complete.
    """

    started: float | None = None
    ended: float | None = None
    outcome: str = ""
    message: str = ""
    phase: str = ""
    plan: list[dict[str, Any]] = field(default_factory=list)
    steps: list[dict[str, Any]] = field(default_factory=list)
    robots: list[str] = field(default_factory=list)
    changes: list[dict[str, Any]] = field(default_factory=list)
    quality: dict[str, Any] = field(default_factory=dict)
    explanations: list[dict[str, Any]] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    first_change: int = 0
    last_change: int = 0
    collected: bool = False

    def end(self, ending: Ending, now: float, last_change: int) -> None:
        """Takes over the end of the job's goal.

        :param last_change: the number of the world model's last change.
        """
        self.ended, self.last_change = now, last_change
        self.outcome, self.message = ending.outcome, ending.message
        self.steps = ending.steps or self.steps
        self.explanations = ending.explanations
        self.robots = sorted({*self.robots, *(step["robot"] for step in ending.steps)})


@dataclass
class Job:
    """A job order with its state.

    :param goal: the goal text with the parameters' values.
    :param robots: node names of the allowed robots; empty: all.
    :param sequence: the number of the job; of equal jobs, the lowest starts first.
    :param created, changed: s since the epoch.
    :param approved: of an agent's job: the `goal`; `plan`, the steps that are executed instead of a new plan; the
        `digest`, and `by`, who has approved them; None for others.
    :param place: its place in the queue, if a person has moved it; see `rank`.
    :param wanted: the method that the cell is carrying out: Pause, Stop or Abort; "" for none.
    :param cleared: whether it was removed from the list by Cancel or Clear. Its response is kept.
    :param received: responses of others; see `skiros2_gateway.core.received_responses`.
    """

    order: Order
    goal: str
    sequence: int
    created: float
    changed: float
    state: State = State.NOT_ALLOWED_TO_START
    substate: Substate = Substate.READY
    wanted: str = ""
    cleared: bool = False
    author: str = ""
    robots: tuple[str, ...] = ()
    approved: dict[str, Any] | None = None
    place: Rank | None = None
    response: Response = field(default_factory=Response)
    received: list[dict[str, Any]] = field(default_factory=list)

    @property
    def id(self) -> str:
        return self.order.id

    @property
    def is_in_cell(self) -> bool:
        """Whether its goal was sent to the cell and has not ended, as far as known."""
        return self.state in _STARTED or self.substate is Substate.LOADED

    @property
    def earliest(self) -> float:
        """The earliest start (s since the epoch)."""
        return self.order.earliest_start.timestamp() if self.order.earliest_start else 0.0

    @property
    def rank(self) -> Rank:
        """The place in the queue: the smallest starts first."""
        due = self.order.due.timestamp() if self.order.due else _NEVER
        return self.place or (-self.order.priority, due, self.sequence)

    def check(self, method: Method) -> None:
        """
        :raises Refused: the method is not allowed in the state of the job.
        """
        reason = ""
        if self.cleared:
            reason = "it was removed from the list"
        elif self.state not in ALLOWED[method]:
            reason = f"it is {self.state}, expected {' or '.join(ALLOWED[method])}"
        elif self.substate is Substate.LOADED and method is not Method.ABORT:
            reason = "its goal was just sent to the cell; Abort it, or Stop it when it runs"
        elif self.wanted in (Method.STOP, Method.ABORT):
            reason = f"{self.wanted} is being carried out"
        if reason:
            raise Refused(f"{method} of job {self.id}: {reason}")

    def change(self, state: State, substate: Substate, now: float) -> None:
        """Changes the state.

        :raises Refused: the state does not follow.
        """
        if state is not self.state and state not in FOLLOWING[self.state]:
            raise Refused(f"job {self.id} is {self.state}; {state} does not follow")
        self.state, self.substate, self.changed = state, substate, now

    def apply(self, method: Method, author: str, now: float) -> None:
        """Changes the state as an allowed method does; `wanted` has a method that the cell has to carry out first.

        :param author: who has called it.
        :param now: s since the epoch.
        """
        if method in (Method.START, Method.REVOKE_START):
            is_start = method is Method.START
            state = State.ALLOWED_TO_START if is_start else State.NOT_ALLOWED_TO_START
            self.change(state, self.substate_before_start(now), now)
        elif method is Method.PAUSE:
            self.change(State.INTERRUPTED, Substate.HELD, now)
        elif method is Method.RESUME:
            self.change(State.RUNNING, Substate.NONE, now)
        elif method in (Method.STOP, Method.ABORT) and self.is_in_cell:
            self.wanted, self.changed = method, now
        elif method is Method.CLEAR:
            self.cleared, self.changed = True, now
        else:  # Abort and Cancel of a job that has not started
            self.cleared = method is Method.CANCEL
            self.response = Response(ended=now, outcome="cancelled", message=f"{method} by {author}", collected=True)
            self.change(State.ABORTED, Substate.NONE, now)

    def substate_before_start(self, now: float) -> Substate:
        """Returns the sub-state of a job that has not started (now in s since the epoch)."""
        return Substate.WAITING if self.earliest > now else Substate.READY

    def copy(self) -> Job:
        """Returns a copy whose fields, and those of its response, can be replaced."""
        return replace(self, response=replace(self.response))

    def to_dict(self) -> dict[str, Any]:
        """Returns the job as JSON data; times in s since the epoch, those of the order in ISO 8601."""
        return {
            "id": self.id,
            "order": self.order.model_dump(mode="json"),
            "goal": self.goal,
            "sequence": self.sequence,
            "created": self.created,
            "changed": self.changed,
            "state": self.state.value,
            "substate": self.substate.value,
            "wanted": self.wanted,
            "cleared": self.cleared,
            "author": self.author,
            "robots": list(self.robots),
            "approved": self.approved,
            "rank": list(self.rank),
            "is_moved": self.place is not None,
            "response": dict(vars(self.response)),  # its values are replaced, not changed
            "received": self.received,
        }

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> Job:
        """Reverses `to_dict`."""
        return cls(
            order=Order.model_validate(data["order"], context=STORED),
            goal=data["goal"],
            sequence=data["sequence"],
            created=data["created"],
            changed=data["changed"],
            state=State(data["state"]),
            substate=Substate(data["substate"]),
            wanted=data["wanted"],
            cleared=data["cleared"],
            author=data["author"],
            robots=tuple(data["robots"]),
            approved=data.get("approved"),
            place=tuple(data["rank"]) if data.get("is_moved") else None,
            response=Response(**data["response"]),
            received=data.get("received", []),
        )
