"""Templates in goals and abstract relations, and the names of managers."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from compatibility.rules import rule
from skiros2_common.core.abstract_skill import State
from skiros2_common.core.params import ParamHandler, ParamTypes
from skiros2_common.core.primitive import PrimitiveBase
from skiros2_common.core.world_element import Element
from skiros2_skill.core.skill import SkillDescription
from skiros2_skill.testing import SkillBench
from skiros2_task.core.engines import EngineProcesses, Limits
from skiros2_task.core.planners import engine_planner
from skiros2_task.core.planning import PlanningResult, TaskPlanner

LIBRARIES = Path(__file__).parents[1] / "libraries"
BOLT_BIN, GEAR_BIN, TABLE, STATION = "plant:Bin-4", "plant:Bin-5", "skiros:Location-6", "skiros:Location-7"


@pytest.fixture(scope="module")
def processes() -> Iterator[EngineProcesses]:
    processes = EngineProcesses()
    yield processes
    processes.close()


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch) -> Iterator[SkillBench]:
    """A third-party scene, and the skills of a third-party library, as its manager enters them."""
    monkeypatch.syspath_prepend(LIBRARIES)
    with SkillBench(LIBRARIES / "plant_skills" / "owl" / "plant_scene.turtle") as bench:
        bench.import_libraries("plant_skills")
        bench.load("drive_fake", "locate_fake", "pick_fake", "place_fake")
        for implementation in bench.library.implementations():
            element = implementation.declared.toElement()
            element.addRelation(bench.robot.id, "skiros:hasSkill", "-1")
            bench.wmi.add_element(element)
        yield bench


def plan(bench: SkillBench, processes: EngineProcesses, goal: str, author: str = "") -> PlanningResult:
    return TaskPlanner(bench.wmi, engine_planner(processes), Limits(seconds=30.0)).plan(goal, asked_by=author)


def steps(result: PlanningResult) -> list[tuple[str, dict[str, str]]]:
    return [(call.label, {key: e.id or e.label for key, e in call.arguments}) for call in result.calls]


def abstract_relation(relation: str = "skiros:partReference") -> Any:
    return SkillDescription().getAbstractRelationCond("C", relation, "Container", "Object", True)


def holding(container: Element, thing: Element) -> ParamHandler:
    params = ParamHandler()
    params.addParam("Container", container, ParamTypes.Required)
    params.addParam("Object", thing, ParamTypes.Required)
    return params


@rule("conditions", "`check_relation(..., abstract=True)` compares templates: the property `skiros:Template` of an "
      "element, else its id; not labels")  # fmt: skip
def test_an_abstract_relation_is_checked_by_templates(bench: SkillBench) -> None:
    gears, bolts = (bench.wmi.get_element(eid) for eid in (GEAR_BIN, BOLT_BIN))
    gear = bench.wmi.instanciate("plant:gear")
    gear.label = "number 5"
    bench.wmi.update_element(gear)
    misnamed = bench.wmi.get_element(bench.add("plant:Bin", "plant:gear_bin").id)
    related = bench.wmi.check_relation
    assert related(gears, "skiros:partReference", gear, True, True)
    assert related(gears.id, "skiros:partReference", gear.id, True, True)
    assert not related(gears, "skiros:partReference", gear, False, True)
    for other in (bolts, misnamed):
        assert not related(other, "skiros:partReference", gear, True, True)
    bench.wmi.set_relation(misnamed.id, "skiros:partReference", "plant:gear")
    assert related(misnamed, "skiros:partReference", gear, True, True)


@rule("conditions", "An abstract relation, evaluated as a condition, asks the class restrictions only")
def test_an_abstract_relation_is_evaluated_by_class_restrictions(bench: SkillBench) -> None:
    gear = bench.wmi.instanciate("plant:gear")
    for eid, fact in ((GEAR_BIN, True), (BOLT_BIN, True), ("rparts:GripperEffector-3", False)):
        params = holding(bench.wmi.get_element(eid), gear)
        assert bool(abstract_relation().evaluate(params, bench.wmi)) is fact


@rule("conditions", "The inference of a parameter goes by the templates of abstract relations")
def test_a_parameter_is_inferred_by_templates(bench: SkillBench) -> None:
    class EmptyBin(SkillDescription):
        def createDescription(self) -> None:
            self.addParam("Container", Element("skiros:Location"), ParamTypes.Inferred)
            self.addParam("Object", Element("skiros:Product"), ParamTypes.Required)
            self.addPreCondition(
                self.getAbstractRelationCond("ForIt", "skiros:partReference", "Container", "Object", True)
            )

    found = []

    class empty_bin(PrimitiveBase):
        def createDescription(self) -> None:
            self.setDescription(EmptyBin(), "empty_bin")

        def execute(self) -> Any:
            found.append(self.params["Container"].value.id)
            return self.success()

    bench.load(empty_bin)
    for template in ("plant:gear", "plant:bolt"):
        task = bench.command("EmptyBin", Object=bench.wmi.instanciate(template)).run(10)
        assert task.state == State.Success
    assert found == [GEAR_BIN, BOLT_BIN]


@rule("conditions", "Planning goes by the templates of abstract relations: scenes give elements free labels")
def test_planned_templates_are_found(bench: SkillBench, processes: EngineProcesses) -> None:
    result = plan(bench, processes, f"(skiros:contain {TABLE} plant:gear)")
    found = steps(result)
    assert [label for label, _ in found] == ["drive_fake", "locate_fake", "pick_fake", "drive_fake", "place_fake"]
    assert found[1][1]["Container"] == GEAR_BIN, result.message
    assert found[1][1]["Object"] == "plant:gear"


@rule("client", "A goal that names an individual without an instance in the scene stands for that template")
def test_a_goal_names_a_template(bench: SkillBench, processes: EngineProcesses) -> None:
    found = plan(bench, processes, f"(skiros:contain {TABLE} plant:gear)")
    (thing,) = {dict(call.arguments)["Object"] for call in found.calls if call.label == "pick_fake"}
    assert (thing.id, thing.label, thing.type) == ("", "plant:gear", "plant:Gear")
    gear = bench.wmi.instanciate("plant:gear", relations=[{"src": BOLT_BIN, "type": "skiros:contain", "dst": "-1"}])
    gear.label = "number 5"
    bench.wmi.update_element(gear)
    found = plan(bench, processes, f"(skiros:contain {TABLE} plant:gear)")
    assert [label for label, _ in steps(found)] == ["drive_fake", "pick_fake", "drive_fake", "place_fake"]
    assert steps(found)[1][1]["Object"] == gear.id


@rule("robots", "`skiros:SkillMgr` of a robot is the manager's name with slash or without; plans name it with slash")
def test_a_robot_names_its_manager_with_slash_or_without(bench: SkillBench, processes: EngineProcesses) -> None:
    for written in ("carrier", "/carrier"):
        robot = bench.wmi.get_element(bench.robot.id)
        robot.setProperty("skiros:SkillMgr", written)
        bench.wmi.update_element_properties(robot)
        for author in ("carrier", "/carrier", "somebody else", ""):
            result = plan(bench, processes, f"(skiros:at {robot.id} {TABLE})", author)
            assert [(call.label, call.manager) for call in result.calls] == [("drive_fake", "/carrier")]


@rule("robots", "Of several robots, a manager that asks gets a plan for its own")
def test_a_manager_gets_a_plan_for_its_own_robot(bench: SkillBench, processes: EngineProcesses) -> None:
    second = bench.add("cora:Robot", "plant:other", SkillMgr="other")
    bench.wmi.set_relation(second.id, "skiros:at", STATION)
    for implementation in bench.library.implementations():
        element = implementation.declared.toElement()
        element.addRelation(second.id, "skiros:hasSkill", "-1")
        bench.wmi.add_element(element)
    goal = f"(exists (?r - cora:Robot) (skiros:at ?r {TABLE}))"
    for author, manager in (("other", "/other"), ("/carrier", "/carrier"), ("/cell/other", "/other")):
        assert {call.manager for call in plan(bench, processes, goal, author).calls} == {manager}
