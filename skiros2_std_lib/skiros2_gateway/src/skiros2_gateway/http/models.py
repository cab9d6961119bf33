"""Models of the answers, for the OpenAPI document. Answers may have further fields."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, FiniteFloat

from skiros2_gateway.core import job, received_responses

#: A number of the store: SQLite's integers have 64 bits.
Number = Annotated[int, Field(ge=0, lt=2**63)]


class Empty(BaseModel):
    """Done."""


class Health(BaseModel):
    """The gateway answers."""

    status: Literal["running"]
    stream: str = Field(description="differs after each start of the gateway")


class LoggedIn(BaseModel):
    """The user of a login, and their role."""

    user: str
    role: str


class Session(BaseModel):
    """A session of the page. Times in s since the epoch."""

    id: str
    user: str
    address: str
    created: float
    ends: float
    is_own: bool


class Sessions(BaseModel):
    """The sessions that the caller may end."""

    sessions: list[Session]


class Robot(BaseModel):
    """A robot with its tasks."""

    name: str
    state: str
    reason: str
    since: float = Field(description="s since the epoch")
    tasks: list[dict[str, Any]]
    counters: dict[str, float]


class JobData(BaseModel):
    """A job with its response. Times in s since the epoch, those of the order in ISO 8601."""

    id: str
    order: job.Order
    goal: str
    sequence: int
    created: float
    changed: float
    state: job.State
    substate: job.Substate
    wanted: str
    cleared: bool
    author: str
    robots: list[str]
    rank: list[float] = Field([], description="the place in the queue: the smallest starts first")
    is_moved: bool = False
    response: job.Response
    received: list[received_responses.Kept] = []


class Jobs(BaseModel):
    """A page of jobs, the newest first."""

    jobs: list[JobData]
    next: int | None = Field(description="the `after` of the page that follows; null: there is none")


class JobQuery(BaseModel):
    """Which jobs are wanted. `begin` and `end` in s since the epoch."""

    model_config = ConfigDict(extra="forbid")

    state: list[job.State] = []
    outcome: list[str] = Field([], max_length=20)
    text: str = Field("", max_length=200, description="in the id, the description or the goal")
    begin: FiniteFloat | None = Field(None, description="made at this time or later")
    end: FiniteFloat | None = Field(None, description="made before this time")
    cleared: bool = Field(False, description="also those removed from the list")
    since: Number = Field(0, description="only jobs with a higher number")
    after: Number | None = Field(None, description="only jobs after this one in the list: `next` of a page")
    limit: int = Field(1000, ge=1, le=10_000)


class CellState(BaseModel):
    """The state of the cell: robots, queue, counters."""

    event: str = Field(description="the id of the last event that is included")
    jobs: list[JobData] = Field(description="the first 100 that have not ended, in the order of the queue")
    counts: dict[str, int]
    viewers: int
    role: str
    user: str
    robots: list[Robot]
    ready: bool
    capacity: int


class ElementData(BaseModel):
    """An element of the world model: values by property, relations as pairs of name and id."""

    id: str
    type: str
    label: str
    properties: dict[str, list[Any]]
    relations: list[tuple[str, str]]


class World(BaseModel):
    """Elements of the world model at a revision."""

    revision: int
    elements: list[ElementData]


class JobEvent(BaseModel):
    """A change of a job's state. `time` in s since the epoch; `method` is the interface it came by."""

    number: int
    time: float
    author: str
    method: str
    state: str
    substate: str
    comment: str


class History(BaseModel):
    """The changes of a job's state, in order."""

    history: list[JobEvent]


class WorkMasterData(BaseModel):
    """A work master: a goal with parameters."""

    id: str
    description: str
    goal: str
    parameters: list[dict[str, Any]]
    quality: list[dict[str, str]]
    robots: list[str]
    schema_: dict[str, Any] = Field(alias="schema", description="JSON Schema of the parameters")


class WorkMasters(BaseModel):
    """All work masters."""

    work_masters: list[WorkMasterData]


class TasksByRobot(BaseModel):
    """The number of tasks by robot."""

    __pydantic_extra__: dict[str, int]
    model_config = {"extra": "allow"}


class SkillData(BaseModel):
    """A skill of a robot with its parameters."""

    type: str
    label: str
    parameters: list[dict[str, Any]]


class Skills(BaseModel):
    """Skills by robot."""

    robots: dict[str, list[SkillData]]


class Plan(BaseModel):
    """A plan, or why there is none. `makespan` in s."""

    state: str
    message: str
    plan: list[dict[str, Any]]
    makespan: float = 0.0
    why: Any = None
    preview: Any = None
    notes: list[str] = []


class GoalForm(BaseModel):
    """See `skiros2_gateway.core.goal_form`."""

    goal: str
    sentence: str
    problem: str
    lines: list[dict[str, Any]] | None
    choices: dict[str, list[dict[str, Any]]]


class Table(BaseModel):
    """The answer to a query."""

    columns: list[str]
    rows: list[list[str]]


class AuditEntry(BaseModel):
    """A request in the audit log. `time` in s since the epoch; `way` is the interface."""

    number: int
    time: float
    user: str
    way: str
    action: str
    object: str
    outcome: str


class Audit(BaseModel):
    """Entries of the audit log, the oldest first."""

    audit: list[AuditEntry]


class Approval(BaseModel):
    """An action of an agent that waits for a person. Times in s since the epoch."""

    id: str
    digest: str
    user: str
    what: dict[str, Any]
    robots: list[str]
    reason: str
    created: float
    expires: float


class Approvals(BaseModel):
    """The actions that wait for a person."""

    approvals: list[Approval]


class Acknowledgement(BaseModel):
    """Who has acknowledged an alarm, and when (s since the epoch)."""

    user: str
    time: float


class Alarm(BaseModel):
    """An alarm, see `skiros2_gateway.core.alarms`. `since` in s since the epoch."""

    id: str
    kind: Literal["job", "connection", "robot", "approval"]
    source: str
    text: str
    since: float
    acknowledged: Acknowledgement | None = None
    cleared: float | None = Field(None, description="when its cause went away (s since the epoch)")


class Alarms(BaseModel):
    """The alarms of the cell."""

    alarms: list[Alarm]


class CellSummary(BaseModel):
    """Another cell: how many robots it has by state, and how many alarms that nobody has acknowledged."""

    name: str
    address: str
    is_up: bool
    text: str = Field(description="why it is not up")
    robots: dict[str, int]
    alarms: int


class Cells(BaseModel):
    """The other cells that the gateway knows."""

    cells: list[CellSummary]


class RobotFigures(BaseModel):
    """A robot in a period: times (s), ended tasks, and ratios; see `Totals.counters`."""

    robot: str
    total_s: float
    busy_s: float
    down_s: float
    succeeded: int
    failed: int
    availability: float
    utilisation: float
    quality: float
    oee: float
    unknown_s: float = Field(description="in which the gateway did not run: in no other figure, nor in the ratios")


class SkillFigures(BaseModel):
    """A robot's tasks with a skill in a period. `mean_s`: the mean duration (s)."""

    robot: str
    skill: str
    runs: int
    failures: int
    mean_s: float


class JobFigures(BaseModel):
    """The number of jobs that have ended with an outcome."""

    outcome: str
    jobs: int


class FailureFigures(BaseModel):
    """The number of jobs that have failed with a message."""

    message: str
    jobs: int


class ThroughputFigures(BaseModel):
    """How many jobs have ended within `step` from `begin` (s since the epoch)."""

    begin: float
    succeeded: int
    failed: int


class DurationFigures(BaseModel):
    """The tasks with a skill that have ended within `step` from `begin` (s since the epoch). `mean_s`: s."""

    begin: float
    skill: str
    runs: int
    mean_s: float


class Figures(BaseModel):
    """The figures of a period (s since the epoch). `step`: of those over time (s)."""

    begin: float
    end: float
    robots: list[RobotFigures]
    skills: list[SkillFigures]
    jobs: list[JobFigures]
    failures: list[FailureFigures]
    step: float
    throughput: list[ThroughputFigures]
    durations: list[DurationFigures]


# -- the live view -----------------------------------------------------------------------------------------------------


class Document(BaseModel):
    """The document that the page shows; patches change it."""

    document: dict[str, dict[str, Any]]
    event: str = Field(description="the id of the last patch that is included")
    time: float
    clock: float = Field(description="of the gateway's machine (s, monotonic)")
    styles: dict[str, dict[str, dict[str, str]]]
    role: str
    user: str
    person: bool
    stop_port: int


class Bag(BaseModel):
    """A recorded file. `size` in bytes, `time` in s since the epoch."""

    name: str
    size: int
    time: float
    progress: float = Field(1.0, description="while it is read: the part that is done; missing otherwise")


class Bags(BaseModel):
    """The recorded files, the newest first."""

    bags: list[Bag]


class BagContent(BaseModel):
    """The runs, goals and signals of a bag."""

    runs: dict[str, dict[str, Any]]
    goals: Any
    signals: Any
    damage: str


class Why(BaseModel):
    """Why a task failed, as text and as data."""

    text: str
    explanations: list[dict[str, Any]]


class NodeValues(BaseModel):
    """The parameters and conditions of a node."""

    node: int
    type: str
    label: str
    params: list[dict[str, Any]]
    conditions: list[dict[str, Any]]
    time: float


class Scene(BaseModel):
    """Elements and robots at a time."""

    elements: dict[str, Any]
    frames: dict[str, Any]
    bodies: dict[str, Any]


class RunAt(BaseModel):
    """A recorded run at a time. Times in s since the epoch."""

    summary: dict[str, Any]
    tree: dict[str, Any]
    state: str
    time: float
    first: float
    last: float
    ticks: int
    dropped: int
    log: list[dict[str, Any]]
