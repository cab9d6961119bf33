"""A cell for tests of the gateway: it records the goals that are sent, and does what the test tells it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from skiros2_common.core.errors import UnknownName
from skiros2_common.core.explanation import Explanation
from skiros2_gateway.core.cell import Collected, Ending, Goal, GoalListener, Progress
from skiros2_gateway.core.edits import EditPreview, Edits
from skiros2_gateway.core.goal_form import GoalEdit, GoalForms
from skiros2_gateway.core.problems import Problem, Rejected
from skiros2_live.core.cell import CellDocument
from skiros2_live.core.patch import EntriesChanged
from skiros2_world_model.core.local_world_model import LocalWorldModel

ROBOT = "/robot"
STEP = {"number": 1, "skill": "skiros:Place", "label": "place", "robot": ROBOT, "arguments": {}, "start": 0.0}


class StandInCell:
    """Implements `Cell`. Goals run until the test ends them.

    :param listener: receives what the test does.
    """

    def __init__(self, listener: GoalListener, capacity: int = 1) -> None:
        self.listener = listener
        self.capacity = capacity
        self.is_ready = True
        self.revision = 0
        self.interrupt_priority = 100
        self.sent: list[Goal] = []
        self.followed: list[str] = []
        self.stopped: list[str] = []
        self.paused: set[str] = set()
        self.elements = {"Tray-1": "demo:Tray", "Product-2": "skiros:Product"}
        self.document = CellDocument()
        self.document.apply(EntriesChanged("elements", {each["id"]: each for each in self._elements_data()}))
        self.commands: list[tuple[str, list[str]]] = []
        self.properties: dict[tuple[str, str], Any] = {}
        self.skill_runs: dict[tuple[str, int], dict[str, Any]] = {}
        self.edits: list[Edits] = []
        #: The users who have sent queries.
        self.asked: list[str] = []
        #: The elements with which skills would start.
        self.inferred: dict[str, str] = {}
        self.place = ROBOT
        self.started: list[dict[str, Any]] = []
        self.forms: GoalForms | None = None

    def accept(self, goal_id: str) -> None:
        self.listener.goal_accepted(goal_id)

    def run(self, goal_id: str, robot: str = ROBOT) -> None:
        step = {**STEP, "robot": robot}
        self.listener.goal_progress(goal_id, Progress("running", "placing", [step], [{**step, "state": "running"}]))

    def end(self, goal_id: str, outcome: str = "succeeded", message: str = "") -> None:
        self.listener.goal_ended(goal_id, Ending(outcome, message, [{**STEP, "state": outcome, "message": ""}]))

    async def problems(
        self, goal: str, elements: Mapping[str, tuple[str, str]], robots: Sequence[str]
    ) -> list[Problem]:
        problems = [Problem("unknown_name", f"robots.{i}", r) for i, r in enumerate(robots) if r != ROBOT]
        problems += [Problem("unknown_name", f, n) for f, (n, _) in elements.items() if n not in self.elements]
        return problems + ([Problem("goal", "goal", "no goal")] if not goal.startswith("(") else [])

    def start(self, goal: Goal) -> None:
        self.sent.append(goal)

    def follow(self, goal: Goal) -> None:
        self.followed.append(goal.id)

    def stop(self, goal_id: str) -> None:
        self.stopped.append(goal_id)

    def pause(self, goal_id: str) -> None:
        self.paused.add(goal_id)

    def resume(self, goal_id: str) -> None:
        self.paused.discard(goal_id)

    async def collect(
        self, robots: Sequence[str], start: float, end: float, quality: Mapping[str, tuple[str, str]]
    ) -> Collected:
        changes = [{"author": robot, "time": end, "elements": ["Product-2"], "lines": ["~"]} for robot in robots]
        return Collected(changes, {key: self.properties.get(source) for key, source in quality.items()})

    def state(self) -> dict[str, Any]:
        robot = {"name": ROBOT, "state": "idle", "reason": "", "since": 0.0, "tasks": [], "counters": {}}
        return {"robots": [robot], "ready": self.is_ready, "capacity": self.capacity}

    async def world(self) -> dict[str, Any]:
        return {"revision": 1, "elements": self._elements_data()}

    def _elements_data(self) -> list[dict[str, Any]]:
        content = {"label": "", "properties": {}, "relations": []}
        return [{"id": eid, "type": kind, **content} for eid, kind in self.elements.items()]

    def change(self, **elements: Any) -> None:
        """Changes elements of the document, by id; None removes one."""
        self.document.apply(EntriesChanged("elements", elements))

    async def query(self, text: str, user: str) -> dict[str, Any]:
        self.asked.append(user)
        return {"columns": ["x"], "rows": [[eid] for eid in self.elements]}

    async def skills(self) -> dict[str, list[dict[str, Any]]]:
        return {ROBOT: [{"type": "skiros:Place", "label": "place", "parameters": []}]}

    async def check_start(self, robot: str, skill: str, parameters: Mapping[str, Any]) -> dict[str, Any]:
        if unknown := sorted(set(parameters) - {"Tray"}):
            raise UnknownName(f"{skill} has no parameter {', '.join(unknown)}")
        is_ok = skill == "place" or parameters.get("Tray") == "Tray-1"
        why = None if is_ok else Explanation("pre", skill, skill, 1, -1, "the tray is unknown").to_dict()
        values = {"Speed": 1.0, **self.inferred, **parameters}
        changes = [f"+ {value} skiros:at {self.place}" for value in self.inferred.values()]
        found = {"ok": is_ok, "implementation": skill, "elements": dict(self.inferred), "why": why}
        return {**found, "values": values, "changes": changes}

    async def run_skill(self, robot: str, skill: str, parameters: Mapping[str, Any], values: Mapping[str, Any]) -> int:
        self.started.append(dict(values))
        found = {"skill": skill, "parameters": dict(parameters), "state": "running", "message": "", "explanations": []}
        self.skill_runs[robot, len(self.skill_runs)] = found
        return len(self.skill_runs) - 1

    async def skill_run(self, robot: str, task: int) -> dict[str, Any]:
        if (robot, task) not in self.skill_runs:
            raise UnknownName(f"no task {task} of {robot}")
        return self.skill_runs[robot, task]

    async def stop_task(self, robot: str, task: int) -> None:
        self.commands.append(("stop", [robot, str(task)]))

    async def preview_edits(self, edits: Edits) -> EditPreview:
        problems = [
            Problem("unknown_name", f"properties.{i}.element", edit.element)
            for i, edit in enumerate(edits.properties)
            if edit.element not in self.elements
        ]
        if problems:
            raise Rejected(problems)
        return EditPreview(tuple(f"~ {edit.element} {edit.property}" for edit in edits.properties))

    async def apply_edits(self, edits: Edits, preview: EditPreview) -> None:
        self.edits.append(edits)

    async def goal_form(self, edit: GoalEdit) -> dict[str, Any]:
        if self.forms is None:
            wm = LocalWorldModel()
            self.forms = GoalForms(lambda: wm)
        return self.forms.form(edit)

    async def plan(self, goal: str, quality: str = "") -> dict[str, Any]:
        if "nowhere" in goal:
            return {"state": "impossible", "message": "nobody goes there", "plan": [], "preview": None}
        return {"state": "planned", "message": "", "plan": [STEP], "makespan": 1.0, "why": None, "preview": None}

    async def command_robots(self, action: str, robots: Sequence[str], user: str = "") -> dict[str, Any]:
        if unknown := [robot for robot in robots if robot != ROBOT]:
            raise UnknownName(f"no robot {unknown[0]}")
        self.commands.append((action, list(robots)))
        return {ROBOT: 1}
