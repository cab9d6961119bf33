"""Scenarios from skills, and from HyperMapper's JSON."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import pytest
import yaml

from skiros2_common.core.errors import ConfigurationError, Refused, UnknownName, WrongValue
from skiros2_common.core.limits import Limits
from skiros2_common.core.params import Param, ParamTypes
from skiros2_common.core.world_element import Element
from skiros2_learning.core.evaluation import evaluate
from skiros2_learning.core.hypermapper import import_hypermapper
from skiros2_learning.core.scenario import Budget, load_scenario, parse_scenario
from skiros2_learning.core.variables import Gaussian
from skiros2_learning.local.episode import check_scenario
from skiros2_learning.local.identification import identify, identify_goal, variable_of

PUSH = load_scenario(Path(__file__).parents[3] / "skiros2_std_lib/demos/learning/scenarios/push.yaml")


def required(value: object, **limits: object) -> Param:
    return Param("Key", "", value, ParamTypes.Required, Limits(**limits))  # type: ignore[arg-type]


def test_missing_parameters_of_a_skill_become_the_variables_of_a_valid_scenario() -> None:
    text = identify(PUSH.scene, PUSH.libraries, "Push", ["Object=Block", "Goal=Goal", "StartX=0.0"])
    found = parse_scenario(text, Path("/"))
    assert [variable.name for variable in found.variables] == ["Push.StartY", "Push.GoalX", "Push.GoalY"]
    assert (found.variables[0].low, found.variables[0].high, found.variables[0].unit) == (-0.2, 0.2, "m")
    assert found.task[0].parameters == {"Object": "Block", "Goal": "Goal", "StartX": 0.0}


def test_mistakes_are_reported() -> None:
    with pytest.raises(UnknownName, match="Push has no parameter 'Objekt'; near: Object"):
        identify(PUSH.scene, PUSH.libraries, "Push", ["Objekt=Block"])
    with pytest.raises(Refused, match="nothing is to be learned"):
        identify(PUSH.scene, PUSH.libraries, "LiftTool", [])


def test_the_task_of_a_goal_is_its_plan_and_what_the_plan_lacks_is_learned() -> None:
    found = parse_scenario(identify_goal(PUSH.scene, PUSH.libraries, "(skiros:at Block Goal)"), Path("/"))
    assert found.goal == "(skiros:at Block Goal)"
    (step,) = found.task
    assert (step.skill, step.label, step.parameters) == ("Push", "push", {"Object": "Block", "Goal": "Goal"})
    names = ["Push.StartX", "Push.StartY", "Push.GoalX", "Push.GoalY"]
    assert [variable.name for variable in found.variables] == names
    check_scenario(found)
    once = dataclasses.replace(found, repetitions=1)
    result = evaluate(once, dict(zip(names, (-0.005, -0.07, 0.01, -0.045), strict=True)), 1)
    assert (result.error, result.success_rate) == ("", 1.0)


@pytest.mark.parametrize(
    ("goal", "text"),
    [
        ("(skiros:at Goal Block)", "no sequence of the robots' skills reaches the goal"),
        ("(skiros:at Blok Goal)", "unknown element 'Blok'; did you mean Block"),
        ("(skiros:at Block", "goal '(skiros:at Block'"),
        ("(skiros:hasA Arm Gripper)", "holds already: nothing is to be learned"),
    ],
)
def test_a_goal_without_a_plan_is_refused_in_one_line(goal: str, text: str) -> None:
    with pytest.raises(Refused) as found:
        identify_goal(PUSH.scene, PUSH.libraries, goal)
    assert text in str(found.value)
    assert "\n" not in str(found.value)


def test_the_type_follows_from_the_declaration() -> None:
    assert variable_of(required(float, minimum=0, maximum=2, unit="m")) == {
        "type": "real", "range": [0, 2], "unit": "m",
    }  # fmt: skip
    assert variable_of(required(int, minimum=1, maximum=3)) == {"type": "integer", "range": [1, 3]}
    assert variable_of(required(bool)) == {"type": "categorical", "values": [False, True]}
    assert variable_of(required(int, choices=(4, 2))) == {"type": "ordinal", "values": [2, 4]}
    assert variable_of(required(str, choices=("a", "b"))) == {"type": "categorical", "values": ["a", "b"]}
    with pytest.raises(WrongValue, match="'Key' has no minimum and maximum and no choices"):
        variable_of(required(float, minimum=0))


def test_the_individual_in_the_world_model_takes_precedence_and_has_the_prior() -> None:
    individual = Element("skiros:Parameter", "Key")
    for key, value in (("LowerBound", -1.0), ("UpperBound", 1.0), ("Mean", 0.5), ("Std", 0.1)):
        individual.setProperty(f"skiros:{key}", value)
    found = variable_of(required(float, minimum=-9, maximum=9), individual)
    assert found == {"type": "real", "range": [-1.0, 1.0], "prior": {"mean": 0.5, "std": 0.1}}


def test_hypermapper_scenarios_are_imported(tmp_path: Path) -> None:
    file = tmp_path / "peg.json"
    file.write_text(
        json.dumps(
            {
                "application_name": "peg",
                "optimization_objectives": ["insertion", "force"],
                "optimization_iterations": 340,
                "design_of_experiment": {"doe_type": "random sampling", "number_of_samples": 60},
                "input_parameters": {
                    "force": {"parameter_type": "real", "values": [-10, 0], "prior": "gaussian"},
                    "turns": {"parameter_type": "integer", "values": [1, 5]},
                    "step": {"parameter_type": "ordinal", "values": [1, 2, 4], "prior": [0.2, 0.5, 0.3]},
                    "search": {"parameter_type": "categorical", "values": ["spiral", "line"]},
                },
            }
        )
    )
    text = import_hypermapper(file).replace("scene: SCENE.ttl", f"scene: {PUSH.scene}").replace("SKILL", "Peg")
    data = yaml.safe_load(text.replace("reward: REWARD", "reward: success"))
    data["variables"] = {f"Peg.{name}": variable for name, variable in data["variables"].items()}
    found = parse_scenario(yaml.safe_dump(data, sort_keys=False), tmp_path)
    assert [variable.kind for variable in found.variables] == ["real", "integer", "ordinal", "categorical"]
    assert found.variables[0].prior == Gaussian(-5.0, 2.5)
    assert found.budget == Budget(400, 60)
    assert [objective.name for objective in found.objectives] == ["insertion", "force"]


def test_mistakes_in_a_hypermapper_scenario_are_reported_at_once(tmp_path: Path) -> None:
    file = tmp_path / "bad.json"
    variables = {"x": {"parameter_type": "rael", "values": [1]}}
    file.write_text(json.dumps({"optimization_objectives": ["a"], "input_parameters": variables}))
    with pytest.raises(ConfigurationError) as found:
        import_hypermapper(file)
    assert "input_parameters.x.parameter_type: unknown: 'rael'; near: real" in str(found.value)
    assert "input_parameters.x.values: expected a lower and an upper bound, got [1]" in str(found.value)
    with pytest.raises(ConfigurationError, match=r"nothing\.json"):
        import_hypermapper(tmp_path / "nothing.json")
