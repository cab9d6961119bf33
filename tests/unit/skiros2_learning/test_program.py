"""The program `learn`, on a small study."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from skiros2_learning.command_line.program import main
from support.learning_scenarios import scenario_text

TEXT = scenario_text("parabola", "parabola", evaluations=12, initial=3).replace(
    "range: [0, 1]", "range: [0, 1], prior: {mean: 0.3, std: 0.1}"
)


@pytest.fixture
def file(tmp_path: Path) -> str:
    (tmp_path / "parabola.yaml").write_text(TEXT)
    return str(tmp_path / "parabola.yaml")


def test_a_study_is_run_shown_reported_replayed_and_resumed(
    file: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    study = str(tmp_path / "study")
    assert main(["run", file, "--study", study, "--workers", "1"]) == 0
    output = capsys.readouterr().out
    assert "[12/12]" in output
    assert "s left, best success 100%" in output
    assert main(["status", study, "--json"]) == 0
    shown = json.loads(capsys.readouterr().out)
    assert len(shown["results"]) == 12
    number = shown["validation"]["learned"]["number"]
    assert f"evaluation {number}: success 30 of 30, 95 % interval 89 to 100 %; cost" in output
    assert f"chosen: evaluation {number}; the skill has no defaults to compare with" in output
    assert main(["report", study]) == 0
    report = (tmp_path / "study/report.html").read_text()
    for part in ("Validation", "Pareto-optimal", "Progress", "Importance", "image/png"):
        assert part in report
    capsys.readouterr()
    assert main(["replay", study, "4"]) == 0
    assert "the result is the same" in capsys.readouterr().out
    assert main(["resume", study, "--workers", "1", "--evaluations", "14"]) == 0
    output = capsys.readouterr().out
    assert "[14/14]" in output
    assert "\nvalidating: up to 10 executions of each of the best 4 configurations" in output
    assert main(["resume", study, "--workers", "1", "--evaluations", "14"]) == 0
    output = capsys.readouterr().out
    assert "validating: " not in output
    assert "of 30, 95 % interval" in output


def test_a_study_is_validated_later_and_applied_only_then(
    file: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    study = str(tmp_path / "study")
    assert main(["run", file, "--study", study, "--workers", "1", "--evaluations", "3", "--no-validation"]) == 0
    assert f"not validated: the rates below are optimistic; run: learn validate {study}\n" in capsys.readouterr().out
    assert main(["apply", study, "1"]) == 1
    error = capsys.readouterr().err
    assert error.startswith(f"learn: study 'parabola' is not validated; run: learn validate {study}; or --unvalidated ")
    assert error.count("\n") == 1
    assert main(["validate", study, "--workers", "1"]) == 0
    assert "of 30, 95 % interval" in capsys.readouterr().out
    assert main(["status", study]) == 0
    assert "validated with draws that the search has not seen:" in capsys.readouterr().out


def test_check_says_how_long_the_study_will_take(file: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", file]) == 0
    assert re.search(
        r"x: 0 to 1\nat most 24 executions in the search and 100 in the validation, "
        r"\S+ s each: about \d+ s with \d+ processes\n"
        rf"no mistakes; start the study with: learn run {file}\n$",
        capsys.readouterr().out,
    )


def test_check_names_a_better_optimiser_only_where_it_was_measured(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = scenario_text("limited", "parabola", evaluations=2, initial=1)
    limited = text + "constraints: [{reward: signal, series: value, at_most: 1}]\n"
    file = tmp_path / "limited.yaml"
    for changed, is_named in (
        (limited, True),
        (text, False),
        (limited.replace("range: [0, 1]", "range: [0, 1], prior: {mean: 0.3, std: 0.1}"), False),
        (f"{limited}optimiser: tpe\n", False),
    ):
        file.write_text(changed)
        assert main(["check", str(file)]) == 0
        assert ("optimiser optuna-gp found better values with constraints" in capsys.readouterr().out) is is_named


def test_check_fails_if_an_execution_breaks(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "breaks.yaml"
    file.write_text(scenario_text("breaks", "not_a_number", evaluations=2, initial=1))
    assert main(["check", str(file)]) == 1
    assert "an execution of a typical configuration breaks: " in capsys.readouterr().out


def test_check_imports_plugins_only_if_asked_to(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "scenario_plugin.py").write_text("print('code runs')")
    (tmp_path / "plugin.yaml").write_text(f"{TEXT}plugins: [scenario_plugin]\n")
    assert main(["check", str(tmp_path / "plugin.yaml")]) == 1
    seen = capsys.readouterr()
    assert "names plug-ins, whose code would run: scenario_plugin; read them, then: learn check --plugins" in seen.err
    assert seen.out == ""
    assert main(["check", "--plugins", str(tmp_path / "plugin.yaml")]) == 0
    assert "code runs" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("optimiser", "module"), [("cmaes", "cmaes"), ("optuna-gp", "torch"), ("botorch", "botorch"), ("smac", "smac")]
)
def test_an_optimiser_that_is_not_installed_names_the_command_that_installs_it(
    optimiser: str,
    module: str,
    file: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setitem(sys.modules, module, None)  # as if it were not installed
    assert main(["run", file, "--optimiser", optimiser, "--study", str(tmp_path / "s")]) == 1
    assert capsys.readouterr().err == (
        f'learn: optimiser {optimiser} needs {module}; in the folder of SkiROS2: make setup FOR="learning optimisers"\n'
    )


def test_each_mistake_is_one_line_on_stderr(file: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "bad.yaml").write_text(TEXT.replace("range: [0, 1]", "range: [1, 0]"))
    for arguments, text in (
        (["run", str(tmp_path / "bad.yaml")], "variables.x.range: expected the lower bound first"),
        (["run", str(tmp_path / "none.yaml")], "No such file or directory"),
        (["status", str(tmp_path / "none")], "has no study"),
    ):
        assert main(arguments) == 1
        error = capsys.readouterr().err
        assert text in error
        assert error.count("\n") == 1


NODE = Path(__file__).parents[3] / "skiros2_std_lib/skiros2_learning/nodes/learn"
PUSH = Path(__file__).parents[3] / "skiros2_std_lib/demos/learning/scenarios/push.yaml"


@pytest.mark.parametrize(
    ("path", "value", "text"),
    [
        (["variables", "Push.Strength"], {"range": [0, 1]}, "Push has no parameter 'Strength'"),
        (["variables", "Push.StartX", "range"], [0.2, -0.2], "StartX.range: expected the lower bound first"),
        (["variables", "Push.StartX", "prior", "mean"], 0.5, "prior.mean: expected -0.2 to 0.2, the range"),
        (["objectives", "force", "rewards", 0, "reward"], "applied_farce", "'applied_farce'; near: applied_force"),
        (["objectives", "force", "rewards", 0, "arm"], "Amr", "there is no series 'Amr.force'; near: Arm.force"),
        (["task", 0, "skill"], "Puhs", "no skill of type skiros:Puhs; near: skiros:Push"),
    ],
)  # fmt: skip
def test_a_scenario_with_a_mistake_is_refused_with_its_line_and_leaves_no_study(
    path: list[str | int], value: object, text: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data = yaml.safe_load(PUSH.read_text())
    data["scene"] = str(PUSH.parent / data["scene"])
    part = data
    for key in path[:-1]:
        part = part[key]
    part[path[-1]] = value
    (tmp_path / "bad.yaml").write_text(yaml.safe_dump(data))
    assert main(["run", str(tmp_path / "bad.yaml"), "--study", str(tmp_path / "study")]) == 1
    error = capsys.readouterr().err
    assert text in error
    assert all(each.startswith(f"learn: {tmp_path}/bad.yaml: line ") for each in error.splitlines())
    assert error.count("\n") == 1
    assert not (tmp_path / "study").exists()


MANY = {
    PUSH: {
        "seed: 1": "sede: 1\nrepetitions: 4",
        "max_failures: 1": "max_failures: 9",
        "Push.StartX": "Push.StartZ",
        "Push.StartY:\n    {type: real, range: [-0.2, 0.2]": "Push.StartY:\n    {type: real, range: [0.2, -0.2]",
        "Push.GoalX:\n    {type: real, range: [-0.2,": "Push.GoalX:\n    {type: real, range: [-0.7,",
        "Object: Block,": "Object: Blok,",
        "arm: Arm": "arm: Amr",
        "    Block: {p": "    Blcok: {p",
    },
    PUSH.with_name("insertion.yaml"): {
        "max_failures: 1": "max_failures: 9",
        "SearchTime:": "SearchTim:",
        "SpiralSearch.Radius": "Spiral.Radius",
        "series: depth": "series: dept",
        " angle_error: 1.0": " angel_error: 1.0",
        "optimiser: p": "optimiser: b",
    },
}
FOUND = {
    PUSH: (
        "10: Push.Object: no element is labelled 'Blok'; near: Block",
        "12: Push.StartX: missing; the skill requires a value: fix it in the task, or make it a variable",
        "13: Push has no parameter 'StartZ'; near: StartY, StartX",
        "16: variables.Push.StartY.range: expected the lower bound first, got [0.2, -0.2]",
        "18: Push.GoalX: the skill allows other values: expected -0.2 to 0.2 m, got -0.7",
        "31: there is no series 'Amr.force'; near: Arm.force, Arm.torque",
        "46: no body is labelled 'Blcok'; near: Block",
        "53: max_failures: expected at most 4, the repetitions, got 9",
        "54: sede: unknown key; near: seed, scene",
        "55: repetitions: the key occurs twice",
    ),
    PUSH.with_name("insertion.yaml"): (
        "7: settings.angel_error: unknown key; near: angle_error, least_angle_error",
        "10: SpiralSearch has no parameter 'SearchTim'; near: SearchTime, Searched",
        "15: Spiral.Radius: no step is called 'Spiral'; near: SpiralSearch",
        "33: no series 'dept' is recorded; near: depth",
        "42: max_failures: expected at most 4, the repetitions, got 9",
        "44: optimiser: unknown: 'brior'; near: prior",
    ),
}


@pytest.mark.parametrize("scenario", MANY, ids=lambda each: each.stem)
def test_check_reports_mistakes_in_file_scene_and_skills_at_once_with_their_lines(
    scenario: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = scenario.read_text().replace("../scene", str(PUSH.parent / "../scene"))
    for old, new in MANY[scenario].items():
        assert text.count(old) == 1
        text = text.replace(old, new)
    file = tmp_path / "bad.yaml"
    file.write_text(text)
    assert main(["check", str(file)]) == 1
    assert capsys.readouterr().err.splitlines() == [f"learn: {file}: line {each}" for each in FOUND[scenario]]


def test_a_goal_without_a_plan_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    data = yaml.safe_load(PUSH.read_text())
    scene = str(PUSH.parent / data["scene"])
    arguments = ["--scene", scene, "--libraries", ",".join(data["libraries"])]
    assert main(["scenario", "--goal", "(skiros:at Goal Block)", *arguments]) == 1
    error = capsys.readouterr().err
    assert error.startswith("learn: goal '(skiros:at Goal Block)': No plan: drive needs an agent for Robot, but ")
    assert "; verdict: proven impossible" in error
    assert error.count("\n") == 1
    assert main(["scenario", *arguments]) == 1
    assert capsys.readouterr().err == "learn: expected a skill or --goal\n"


@pytest.mark.parametrize("command", [["status", "study"], ["--help"], ["validate", "study"]])
def test_without_the_libraries_each_command_names_what_installs_them_in_one_line(
    command: list[str], tmp_path: Path
) -> None:
    (tmp_path / "optuna.py").write_text("raise ModuleNotFoundError(\"No module named 'optuna'\", name='optuna')\n")
    env = {**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), *sys.path])}
    done = subprocess.run([sys.executable, str(NODE), *command], env=env, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert done.stderr == (
        "learn: No module named 'optuna'; `make demo DEMO=push` in the folder of SkiROS2 "
        "installs the libraries for learning\n"
    )


def push_text(**changes: str) -> str:
    text = PUSH.read_text().replace("../scene", str(PUSH.parent / "../scene"))
    for old, new in changes.items():
        assert text.count(old) == 1
        text = text.replace(old, new)
    return text


#: Changes of a part on which others depend, with further mistakes.
PARTS = {
    "skill": (
        {"- skill: Push": "- skill: Pusch", "arm: Arm": "arm: Amr", "seed: 1": "sede: 1"},
        "9: no skill of type skiros:Pusch; near: skiros:Push",
        "31: there is no series 'Amr.force'; near: Arm.force",
        "54: sede: unknown key; near: seed",
    ),
    "skill of a step with a name": (
        {"- skill: Push": "- skill: Pusch\n    name: Push", "Push.GoalY:": "Pul.GoalY:"},
        "9: no skill of type skiros:Pusch",
        "20: variables.Pul.GoalY: expected STEP.PARAMETER with a step of the task: Push",
    ),
    "missing skill": (
        {"- skill: Push": "- label: push", "arm: Arm": "arm: Amr"},
        "9: task[0].skill: missing",
        "31: there is no series 'Amr.force'",
    ),
    "key of the skill": (
        {"- skill: Push": "- skll: Push", "Object: Block,": "Object: Blok,"},
        "9: task[0].skll: unknown key; near: skill",
        "10: Push.Object: no element is labelled 'Blok'; near: Block",
    ),
    "label of an implementation": (
        {"- skill: Push": "- skill: Push\n    label: pusch", "arm: Arm": "arm: Amr"},
        "10: skill skiros:Push has no implementation 'pusch'; it has: 'push'",
        "32: there is no series 'Amr.force'",
    ),
    "missing task": (
        {"task:\n  - skill: Push\n    parameters: {Object: Block, Goal: Goal}": "", "arm: Arm": "arm: Amr"},
        "task: no steps; name at least one skill",
        "29: there is no series 'Amr.force'",
    ),
    "scene": (
        {"push_scene.ttl": "psh_scene.ttl", "Push.StartX:": "Push.StartZ:", "Object: Block,": "Objekt: Block,"},
        "5: scene: no such file: ",
        "10: Push has no parameter 'Objekt'; near: Object",
        "12: Push.StartX: missing; the skill requires a value",
        "13: Push has no parameter 'StartZ'",
    ),
    "missing scene and a library": (
        {"scene: ": "#", "sim_skills": "sm_skills", "Push.StartX:": "Push.StartZ:"},
        "scene: missing",
        "6: library 'skiros2_sm_skills': there is no Python package of that name; near: skiros2_sim_skills",
        "12: Push.StartX: missing; the skill requires a value",
        "13: Push has no parameter 'StartZ'",
    ),
    "library of the skill": (
        {"learning.demo_skills": "learning.demo_skils", "arm: Arm": "arm: Amr", "max_failures: 1": "max_failures: 9"},
        "6: library 'skiros2_learning.demo_skils': there is no Python package of that name; near: skiros2_learning",
        "31: there is no series 'Amr.force'",
        "53: max_failures: expected at most 4",
    ),
    "missing libraries": (
        {"libraries: ": "#", "arm: Arm": "arm: Amr"},
        "libraries: missing; name the Python packages with the skills",
        "31: there is no series 'Amr.force'",
    ),
    "keys of scene and libraries": (
        {"scene: ": "scen: ", "libraries: ": "librarys: ", "    Block: {p": "    Blok: {p", "scenario: push": ""},
        "scenario: missing",
        "5: scen: unknown key; near: scene",
        "6: librarys: unknown key; near: libraries",
        "46: no body is labelled 'Blok'; near: Block",
    ),
    "names in the world model": (
        {
            "success:": "success:\n  - {reward: relation, subject: Blok, relation: 'skiros:att', object: Goal,"
            " at_least: 1}\n  - {reward: property, element: Gaol, property: 'skiros:PositonX', value: 1, at_least: 1}",
            "starts: [home": "starts: [hme",
            "element: Goal": "element: Gaol",
        },
        "38: no element is labelled 'Blok'; near: Block",
        "38: no ontology declares the relation 'skiros:att'; near: skiros:at",
        "39: no element is labelled 'Gaol'; near: Goal",
        "39: no ontology declares the property 'skiros:PositonX'; near: skiros:PositionX",
        "44: no element is labelled 'Gaol'; near: Goal",
        "49: rparts:ArmDevice-3-Arm has no posture 'hme'; it has: home, left, right",
    ),
}  # fmt: skip


@pytest.mark.parametrize("part", PARTS)
def test_mistakes_beside_a_wrong_part_are_reported_with_it_without_its_consequences(
    part: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    changes, *expected = PARTS[part]
    assert isinstance(changes, dict)
    file = tmp_path / "bad.yaml"
    file.write_text(push_text(**changes))
    assert main(["check", str(file)]) == 1
    found = capsys.readouterr().err.splitlines()
    assert len(found) == len(expected), found
    for line, text in zip(found, expected, strict=True):
        assert line.removeprefix(f"learn: {file}: ").removeprefix("line ").startswith(str(text))
