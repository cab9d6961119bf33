"""The commands of `rosrun skiros2_task` on scene files: output and exit status."""

from __future__ import annotations

import io
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from skiros2_common.core.world_element import Element
from skiros2_task.command_line import planning, program
from skiros2_task.command_line.planning import goal_text
from skiros2_world_model.core.local_world_model import LocalWorldModel, source_ontologies
from skiros2_world_model.core.world_model import WorldModel
from support.source import ROOT

DEMO = ROOT / "skiros2_std_lib/demos/timed_skills/owl/pick_place_scene.ttl"
OFFLINE = ("--scene", str(DEMO), "--libraries", "skiros2_demo_skills")
GOAL = "(skiros:contain demo:Tray-12 skiros:Product-14)"
#: No tray is a thing that can be grasped.
IMPOSSIBLE = "(skiros:contain demo:Tray-12 demo:Tray-10)"


class Result(NamedTuple):
    status: int
    out: str
    err: str

    @property
    def json(self) -> Any:
        assert self.err == ""
        return json.loads(self.out)


Run = Callable[..., Result]


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Run:
    monkeypatch.setattr(planning, "FOLDER", tmp_path / "planner")

    def run(name: str, *arguments: str) -> Result:
        try:
            status = program.status(name, arguments)
        except SystemExit as ended:
            status = int(str(ended.code))
        return Result(status, *capsys.readouterr())

    return run


def test_plan_prints_schedule(run: Run) -> None:
    result = run("plan", GOAL, *OFFLINE)
    assert (result.status, result.err) == (0, "")
    head, empty, columns, _, *rows = result.out.splitlines()
    assert (head, empty) == ("4 steps of 1 robot, 4.0 s", "")
    assert columns.split() == ["step", "start", "end", "robot", "skill", "after", "step", "parameters"]
    assert [row.split()[:5] for row in rows] == [
        [str(i + 1), f"{i}.0", f"{i + 1}.0", "/mobile_manipulator", skill]
        for i, skill in enumerate(["drive", "pick", "drive", "place"])
    ]
    at = columns.index("after step")
    assert [row[at : at + 10].strip() for row in rows] == ["", "1", "2", "3"]
    assert rows[1][columns.index("parameters") :].startswith('Object="Product A", Container="Tray A"')


def test_plan_prints_json(run: Run) -> None:
    plan = run("plan", GOAL, *OFFLINE, "--json").json
    assert (plan["verdict"], plan["makespan"], plan["why"]) == ("planned", 4.0, None)
    assert [(s["number"], s["type"], s["label"], s["after"]) for s in plan["steps"]] == [
        (1, "skiros:Drive", "drive", []),
        (2, "skiros:Pick", "pick", [1]),
        (3, "skiros:Drive", "drive", [2]),
        (4, "skiros:Place", "place", [3]),
    ]
    product = {"id": "skiros:Product-14", "label": "Product A", "type": "skiros:Product"}
    assert plan["steps"][1]["parameters"]["Object"] == product


def test_plan_archives_files(run: Run, tmp_path: Path) -> None:
    assert run("plan", GOAL, *OFFLINE).status == 0
    (request,) = (p for p in (tmp_path / "planner").iterdir() if p.is_dir())
    assert (request / "goal.txt").read_text() == GOAL
    assert (tmp_path / "planner" / "domain.pddl").exists()


@pytest.mark.parametrize("command", ["plan", "preview", "explain"])
def test_satisfied_goal_needs_no_plan(run: Run, command: str) -> None:
    result = run(command, "(skiros:contain demo:Tray-10 skiros:Product-14)", *OFFLINE)
    assert (result.status, result.out) == (0, "the goal holds already\n")


@pytest.mark.parametrize("command", ["plan", "preview", "explain"])
def test_impossible_goal_is_explained(run: Run, command: str) -> None:
    result = run(command, IMPOSSIBLE, *OFFLINE)
    assert (result.status, result.err) == (1, "")
    assert result.out.startswith("No plan: ")
    assert "needs a manipulatable for Object, but Tray A is a tray" in result.out
    why = run(command, IMPOSSIBLE, *OFFLINE, "--json").json["why"]
    assert why["verdict"] == "proven impossible"
    assert [goal["state"] for goal in why["goals"]] == ["unreachable"]


def test_preview_prints_changes(run: Run) -> None:
    result = run("preview", GOAL, *OFFLINE)
    assert (result.status, result.err) == (0, "")
    lines = result.out.splitlines()
    assert "1. skiros:Drive (drive) by /mobile_manipulator" in lines
    assert '   - demo:Tray-10 "Tray A" skiros:contain skiros:Product-14 "Product A"' in lines
    assert '   + demo:Tray-12 "Tray B" skiros:contain skiros:Product-14 "Product A"' in lines
    assert lines[-1] == "the goal holds at the end"


def test_explain_prints_purpose_of_steps(run: Run) -> None:
    lines = run("explain", GOAL, *OFFLINE).out.splitlines()
    assert f"     makes {GOAL} for the goal" in lines
    assert "     makes (skiros:contain rparts:GripperEffector-4 skiros:Product-14) for step 4" in lines
    data = run("explain", GOAL, *OFFLINE, "--json").json
    assert [step["number"] for step in data["steps"]] == [1, 2, 3, 4]


def test_skills_option_selects_skills(run: Run) -> None:
    result = run("plan", GOAL, *OFFLINE, "--skills", "pick", "place")
    assert result.status == 1
    assert "No plan: mobile_manipulator is at Charging station, not at " in result.out
    unknown = run("plan", GOAL, *OFFLINE, "--skills", "fly")
    assert unknown.status == 1
    assert unknown.err.startswith("plan: skiros2_demo_skills: no skill fly; there are: ")


def test_robot_option_selects_robot(run: Run) -> None:
    assert run("plan", GOAL, *OFFLINE, "--robot", "demo:mobile_manipulator").status == 0
    nobody = run("plan", GOAL, *OFFLINE, "--robot", "demo:nobody")
    assert nobody.status == 1
    assert "demo:nobody" in nobody.err


def test_scene_without_skills_is_reported(run: Run) -> None:
    result = run("plan", GOAL, "--scene", str(DEMO))
    assert result.status == 1
    assert "no robot in the world model offers skills" in result.out


@pytest.mark.parametrize(
    ("arguments", "status", "expected"),
    [
        ((GOAL, "--scene", "/no/such.ttl"), 1, "plan: scene /no/such.ttl: there is no such file\n"),
        ((GOAL, "--libraries", "some"), 2, "are for scene files; name one with --scene\n"),
        ((GOAL, "--seconds", "0", *OFFLINE), 2, "'0' is not a positive number of seconds"),
        ((), 2, "the following arguments are required: GOAL"),
        ((GOAL, "--scene", str(DEMO), "--libraries", "no_such_package"), 1, "no_such_package"),
        (("@/no/such", *OFFLINE), 1, "plan: goal file /no/such: No such file or directory\n"),
    ],
)
def test_invalid_argument_is_reported_in_one_line(
    run: Run, arguments: tuple[str, ...], status: int, expected: str
) -> None:
    result = run("plan", *arguments)
    assert (result.status, result.out) == (status, "")
    assert expected in result.err
    assert result.err.count("\n") == 1


@pytest.mark.parametrize("goal", ["(skiros:contain demo:Tray-12 ", "(skiros:contain demo:Tray-12 skiros:Product-99)"])
@pytest.mark.parametrize("command", ["plan", "preview", "explain"])
def test_invalid_goal_is_refused(run: Run, command: str, goal: str) -> None:
    result = run(command, goal, *OFFLINE)
    assert (result.status, result.err) == (1, "")
    place, text, mark, *notes = result.out.splitlines()
    assert notes[:1] in ([], ["not used for planning:"])
    assert place.startswith("goal, line 1, column ")
    assert text.strip() == goal.strip()
    assert mark.strip() == "^"


def test_unknown_engine_is_reported(run: Run) -> None:
    result = run("plan", GOAL, *OFFLINE, "--planner", "no-such-engine")
    assert result.status == 1
    assert "there is no planner 'no-such-engine'; installed: " in result.out
    assert "fast-downward-opt" in result.out


def test_goal_text_reads_files_and_joins_goals(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "goal.pddl"
    file.write_text("(a b)\n; with a comment\n(c d)")
    assert goal_text([str(file)]) == file.read_text()
    assert goal_text(["(e f)", f"@{file}"]) == f"(e f),\n{file.read_text()}"
    monkeypatch.setattr("sys.stdin", io.StringIO("(g h)"))
    assert goal_text(["-"]) == "(g h)"


@pytest.fixture
def registered(monkeypatch: pytest.MonkeyPatch) -> None:
    """The demo's scene, with a skill of the robot as a manager registers it."""
    wm = LocalWorldModel("test", WorldModel(source_ontologies(), DEMO.parent, initial=[("scene", DEMO.name)]))
    skill, effect = Element("skiros:Skill", "place"), Element("skiros:ConditionRelation", "InTray")
    effect.setProperty("skiros:appliedOnType", "skiros:contain")
    wm.add_element(skill)
    wm.add_element(effect)
    wm.set_relation(skill, "skiros:hasPostCondition", effect)
    monkeypatch.setattr(program, "connect", lambda name, author: wm)
    monkeypatch.setenv("_SKIROS2_COMPLETE", "zsh")


@pytest.mark.parametrize(
    ("begun", "expected"),
    [
        ("(skiros:c", ["(skiros:contain"]),
        ("(and (not (skiros:c", ["(and (not (skiros:contain"]),
        ("(for", ["(forall"]),
        ("(skiros:contain demo:Tray-12 demo:Tray-13", ["(skiros:contain demo:Tray-12 demo:Tray-13"]),
        ("--qu", ["--quality"]),
    ],
)
@pytest.mark.usefixtures("registered")
def test_shell_completes_a_goal(run: Run, begun: str, expected: list[str]) -> None:
    assert run("achieve", begun).out.splitlines() == expected
