"""The extension points of the platform, each used by a package of somebody else: tests/libraries/glueing_plugin.

The table "Where to change what" in docs/architecture.md lists them.
"""

from __future__ import annotations

import importlib
import json
import os
import shutil
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from skiros2_common.core.abstract_skill import SkillDescription, State
from skiros2_common.core.conditions import ConditionBase
from skiros2_common.core.params import ParamTypes
from skiros2_common.core.world_element import Element
from skiros2_common.ros.reasoners import new_reasoners
from skiros2_skill.client.description import Parameter
from skiros2_skill.core.skill import SkillBase
from skiros2_skill.testing import stand_in
from skiros2_task.core.engines import EngineProcesses, Limits, Outcome
from skiros2_task.core.goal_text import GoalError, parse_goals
from skiros2_task.core.planners import planner_named
from skiros2_task.core.task import validate
from skiros2_world_model.core.local_world_model import LocalWorldModel, source_ontologies
from skiros2_world_model.core.wm_errors import WmException
from skiros2_world_model.core.world_model import WorldModel
from support.transport_task import transport_task

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")

LIBRARIES = Path(__file__).parents[1] / "libraries"


@pytest.fixture(autouse=True)
def plugin_path(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(LIBRARIES))


def plugin(module: str) -> Any:
    return importlib.import_module(f"glueing_plugin.{module}")


@pytest.fixture
def workspace(tmp_path: Path) -> Path:
    return Path(shutil.copytree(LIBRARIES / "glueing_plugin" / "ontologies", tmp_path / "workspace"))


# -- a condition -----------------------------------------------------------------------------------------------------


def drying_skill(condition: type[ConditionBase]) -> type:
    class Paint(SkillDescription):
        def createDescription(self) -> None:
            self.addParam("Object", Element("skiros:Part"), ParamTypes.Inferred)
            self.addPreCondition(condition("Dry", "Object", True))

    return stand_in(Paint, label="paint")


def part(bench: Any, label: str, wet: bool) -> Element:
    element = Element("skiros:Part", label)
    element.setProperty("glue:Wet", wet)
    element.addRelation("skiros:Scene-0", "skiros:contain", "-1")
    bench.wmi.add_element(element)
    return element


def test_condition_of_a_plugin_selects_the_inferred_element(skill_bench: Any) -> None:
    skill_bench.load(drying_skill(plugin("conditions").ConditionDry))
    part(skill_bench, "first", wet=True)
    dry = part(skill_bench, "second", wet=False)
    node = skill_bench.node("paint")
    assert skill_bench.run(node).root.state is State.Success
    assert node.params.getParamValue("Object").id == dry.id


def test_unsatisfied_condition_of_a_plugin_is_reported(skill_bench: Any) -> None:
    skill_bench.load(drying_skill(plugin("conditions").ConditionDry))
    node = skill_bench.node("paint", Object=part(skill_bench, "first", wet=True))
    assert skill_bench.run(node).root.state is State.Failure
    assert "is dry" in node.progress_msg


# -- a processor -----------------------------------------------------------------------------------------------------


def test_processor_of_a_plugin_orders_the_children(skill_bench: Any) -> None:
    class Work(SkillDescription):
        pass

    class Pair(SkillDescription):
        pass

    started: list[str] = []

    def child(label: str) -> Any:
        return stand_in(Work, label=label, onStart=lambda _: started.append(label))

    class pair(SkillBase):
        def createDescription(self) -> None:
            self.setDescription(Pair(), "pair")

        def expand(self, skill: Any) -> None:
            skill.setProcessor(plugin("processors").LastFirst())
            skill(self.skill("Work", "one"), self.skill("Work", "two"))

    skill_bench.load(child("one"), child("two"), pair)
    assert skill_bench.run(skill_bench.node("pair")).root.state is State.Success
    assert started == ["two", "one"]


# -- a relation rule -------------------------------------------------------------------------------------------------


def test_relation_rule_of_a_plugin_refuses_wrong_classes(workspace: Path) -> None:
    wm = LocalWorldModel("tester", WorldModel(source_ontologies(), workspace, strict=True))
    glued, box, robot = Element("skiros:Part"), Element("skiros:LargeBox"), Element("cora:Robot")
    wm.add_elements([glued, box, robot])
    wm.set_relation(glued.id, "glue:gluedTo", box.id)
    with pytest.raises(WmException, match="the object of glue:gluedTo is a skiros:Container"):
        wm.set_relation(glued.id, "glue:gluedTo", robot.id)


def test_shape_of_a_plugin_is_validated(workspace: Path) -> None:
    wm = LocalWorldModel("tester", WorldModel(source_ontologies(), workspace))
    glued, one, other = Element("skiros:Part"), Element("skiros:LargeBox"), Element("skiros:LargeBox")
    wm.add_elements([glued, one, other])
    for box in (one, other):
        wm.set_relation(glued.id, "glue:gluedTo", box.id)
    findings = [finding.text for finding in wm.validate().findings if finding.element == glued.id]
    assert any("a part is glued to one container" in text for text in findings)


# -- a reasoner ------------------------------------------------------------------------------------------------------


def test_reasoner_of_a_plugin_completes_added_elements(workspace: Path) -> None:
    model = WorldModel(source_ontologies(), workspace)
    for reasoner in new_reasoners(["glueing_plugin.reasoners"]):
        model.add_reasoner(reasoner)
    wm = LocalWorldModel("tester", model)
    added = Element("skiros:Part")
    wm.add_element(added)
    assert wm.get_element(added.id).value_of("glue:Wet") is True


# -- a goal operator -------------------------------------------------------------------------------------------------


def test_goal_operator_of_a_plugin_stands_for_its_goal() -> None:
    plugin("goal_operators")
    (goal,) = parse_goals("(either (p a) (Q b))")
    (expected,) = parse_goals("(and (or (p a) (Q b)) (not (and (p a) (Q b))))")
    assert without_positions(goal) == without_positions(expected)


def test_error_of_a_goal_operator_names_the_position() -> None:
    plugin("goal_operators")
    with pytest.raises(GoalError, match="either: expected two goals, got 1") as error:
        parse_goals("(and (either (p a)))")
    assert (error.value.line, error.value.column) == (1, 7)


def without_positions(goal: object) -> Any:
    text = getattr(goal, "text", None)
    if text is not None:
        return text
    if isinstance(goal, tuple):
        return [without_positions(part) for part in goal]
    fields = getattr(goal, "__dataclass_fields__", None)
    return goal if fields is None else [type(goal).__name__, *(without_positions(getattr(goal, f)) for f in fields)]


# -- a planning engine -----------------------------------------------------------------------------------------------


@pytest.fixture
def processes(plugin_path: None) -> Iterator[EngineProcesses]:
    processes = EngineProcesses()
    yield processes
    processes.close()


def test_engine_of_a_plugin_makes_a_valid_plan(processes: EngineProcesses) -> None:
    task = transport_task(1, 2, 1)
    answer = planner_named(processes, "glueing_plugin.engines:BreadthFirst").solve(task, Limits(seconds=60.0))
    assert answer.outcome is Outcome.SOLVED, answer.reason
    assert answer.plan
    assert validate(task, answer.plan) == ""


# -- a parameter editor ----------------------------------------------------------------------------------------------


def test_editor_of_a_plugin_edits_the_parameters_of_its_type(qtbot: Any) -> None:
    from skiros2_gui.skills.form import Field
    from skiros2_gui.skills.widgets.editors import editor_of

    plugin("editors")
    field = Field(Parameter("Bead", "required", "glue::Bead", [{"width": 3}]))
    skills: Any = SimpleNamespace(write=lambda key, text: field.write(text))
    editor = editor_of(field, skills)
    qtbot.addWidget(editor)
    assert editor.input.value() == 3
    editor.input.setValue(7)
    assert (field.error, field.values()) == ("", [{"width": 7}])
    assert json.loads(field.text) == {"width": 7}
