"""Plans: their content and their use by programs."""

from __future__ import annotations

import json
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from compatibility.rules import rule
from skiros2_common.core.abstract_skill import State
from skiros2_common.core.params import ParamTypes
from skiros2_common.core.world_element import Element
from skiros2_skill.core.skill import SerialStar, SkillBase, SkillDescription
from skiros2_skill.core.tree.node import all_nodes
from skiros2_skill.ros.utils import deserialize_skill
from skiros2_skill.testing import SkillBench
from skiros2_task.core.engines import FoundPlan, Limits, Outcome, PlannerAnswer
from skiros2_task.core.planning import PlanningResult, TaskPlanner, Verdict
from skiros2_task.core.store import Archive
from skiros2_task.core.task import PlanningTask, PlanStep

LIBRARIES = Path(__file__).parents[1] / "libraries"
TABLE, STATION = "skiros:Location-6", "skiros:Location-7"


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch) -> Iterator[SkillBench]:
    """A third-party scene with a third-party library."""
    monkeypatch.syspath_prepend(LIBRARIES)
    with SkillBench(LIBRARIES / "plant_skills" / "owl" / "plant_scene.turtle") as bench:
        bench.import_libraries("plant_skills")
        bench.load("drive_fake", "pick_fake")
        yield bench


def element(eid: str, label: str, etype: str) -> dict[str, Any]:
    return {"id": eid, "label": label, "type": etype, "last_update": 0.0, "properties": {}, "relations": []}


def param(key: str, spec_type: int, *values: Any, of: str = "skiros_wm::Element") -> dict[str, Any]:
    return {"key": key, "description": "", "specType": spec_type, "type": of, "values": list(values)}


def plan_of(*children: dict[str, Any]) -> str:
    root = {"manager": "", "type": "Processor", "name": "Sequential", "ph": {}, "children": list(children)}
    return json.dumps(root)


def step(stype: str, label: str, *params: dict[str, Any]) -> dict[str, Any]:
    ph = {p["key"]: p for p in params}
    return {"manager": "/carrier", "type": stype, "name": label, "ph": ph, "children": []}


class RunPlan(SkillDescription):
    def createDescription(self) -> None:
        self.addParam("Plan", str, ParamTypes.Required)


class run_plan(SkillBase):
    """A library's own skill that takes a plan's skills as its children."""

    def createDescription(self) -> None:
        self.setDescription(RunPlan(), "run_plan")

    def onStart(self) -> bool:
        for child in deserialize_skill(self.params["Plan"].value).children:
            node = self.skill(child.type, child.name)
            node.specifyParamsDefault(child.ph)
            self.addChild(node)
        return True

    def expand(self, skill: Any) -> None:
        skill.setProcessor(SerialStar())


@rule("wire", "Who takes a plan makes a node of each child's type and label and gives it the values of `ph`; keys that "
      "the skill does not have are ignored")  # fmt: skip
def test_the_skills_of_a_plan_become_nodes(bench: SkillBench) -> None:
    robot = element(bench.robot.id, "plant:carrier", "cora:Robot")
    drive = step(
        "skiros:Drive", "drive_fake", param("Robot", 2, robot), param("TargetLocation", 0, element(TABLE, "", "")),
        param("StartLocation", 2, element("", "", "skiros:Location")), param("Colour", 1, "red", of="str"),
    )  # fmt: skip
    bench.load(run_plan)
    task = bench.command("RunPlan", Plan=plan_of(drive)).run(20)
    assert task.state == State.Success, [(n.printState(), n.progress_msg) for n in all_nodes(task.root)]
    assert bench.wmi.get_relations(bench.robot.id, "skiros:at", TABLE)


class GivenPlan:
    """A planner that knows one plan."""

    name = "given plan"

    def __init__(self, *plan: PlanStep) -> None:
        self._plan = plan

    def solve(self, task: PlanningTask, limits: Limits, cancelled: threading.Event | None = None) -> PlannerAnswer:
        return PlannerAnswer(Outcome.SOLVED, (FoundPlan("given", self._plan),))


def offer_skills(bench: SkillBench) -> str:
    """Registers the loaded skills for the robot of the scene; returns its id."""
    robot = bench.wmi.get_element(bench.robot.id)
    robot.setProperty("skiros:SkillMgr", "carrier")
    bench.wmi.update_element_properties(robot)
    for implementation in bench.library.implementations():
        skill = implementation.declared.toElement()
        skill.addRelation(robot.id, "skiros:hasSkill", "-1")
        bench.wmi.add_element(skill)
    return str(robot.id)


class ImpossibleUnlessAssumed(GivenPlan):
    """A planner that has its plan only if the task has the action."""

    def solve(self, task: PlanningTask, limits: Limits, cancelled: threading.Event | None = None) -> PlannerAnswer:
        if any(action.name == "paint" for action in task.actions):
            return super().solve(task, limits, cancelled)
        return PlannerAnswer(Outcome.IMPOSSIBLE)


@rule("wire", "Programs import names of `skiros2_task.core.pddl_interface`, often without using them",
      better="`PddlInterface` reads the PDDL of the last goal; the import warns, once in a process")  # fmt: skip
def test_the_pddl_module_can_be_imported(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture, tmp_path: Path
) -> None:
    monkeypatch.delitem(sys.modules, "skiros2_task.core.pddl_interface", raising=False)
    names: dict[str, Any] = {}
    with pytest.warns(DeprecationWarning, match="TaskManagerInterface"):
        exec("from skiros2_task.core.pddl_interface import *", names)
    exec("import skiros2_task.core.pddl_interface as pddl", names)
    assert caplog.text.count("for existing imports only") == 1
    assert {"PddlInterface", "Predicate", "GroundPredicate", "ForallPredicate", "Action"} <= names.keys()
    Archive(tmp_path).keep({"domain.pddl": "(define (domain d))", "p01.pddl": "(define (problem p))"})
    written = names["PddlInterface"](str(tmp_path))
    assert (written.printDomain(), written.printProblem()) == ("(define (domain d))", "(define (problem p))")


@rule("wire", "A skill with a Required number or text without a value is planned; the client specifies the value",
      better="if there is no other plan, and with a warning that names the values; `achieve`, which runs the plan "
      "itself, names them and does not start")  # fmt: skip
def test_a_required_value_is_left_to_the_client(bench: SkillBench) -> None:
    class Paint(SkillDescription):
        def createDescription(self) -> None:
            self.addParam("Wall", Element("skiros:Location"), ParamTypes.Required)
            self.addParam("Depth", float, ParamTypes.Required)
            self.addPreCondition(self.getRelationCond("At", "skiros:at", "Robot", "Wall", True))
            self.addPostCondition(self.getPropCond("Seen", "skiros:Seen", "Wall", "=", True, True))

    bench.stand_in(Paint, label="paint")
    robot = offer_skills(bench)
    planner = TaskPlanner(bench.wmi, ImpossibleUnlessAssumed(PlanStep("paint", (robot, STATION))), Limits())

    def plan(leave_open: bool) -> PlanningResult:
        return planner.plan(f"(skiros:Seen {STATION})", leave_open=leave_open)

    planned, refused = plan(True), plan(False)
    assert [call.label for call in planned.calls] == ["paint"]
    assert planned.warning.startswith("warning: the plan lacks values")
    assert planned.message.endswith(planned.warning)
    assert planned.plan is not None
    assert planned.plan.missing == refused.missing == ("Paint.Depth",)
    assert refused.verdict is Verdict.IMPOSSIBLE
    assert "a plan needs values for: Paint.Depth" in refused.message


@rule("wire", "A plan is the first that a planner finds", better="steps that it works without are removed from it")
def test_a_plan_has_no_redundant_steps(bench: SkillBench) -> None:
    class Look(SkillDescription):
        def createDescription(self) -> None:
            self.addParam("Place", Element("skiros:Location"), ParamTypes.Required)
            self.addPreCondition(self.getRelationCond("At", "skiros:at", "Robot", "Place", True))
            self.addPostCondition(self.getPropCond("Seen", "skiros:Seen", "Place", "=", True, True))

    bench.stand_in(Look, label="look")
    robot = offer_skills(bench)
    drive = PlanStep("drive_fake", (robot, STATION, TABLE))
    here, there = PlanStep("look", (robot, STATION)), PlanStep("look", (robot, TABLE))
    planner = GivenPlan(here, drive, there, there)
    result = TaskPlanner(bench.wmi, planner, Limits()).plan(f"(skiros:Seen {TABLE})")
    assert [call.label for call in result.calls] == ["drive_fake", "look"]
