"""Loading, checking and reloading libraries with a skill manager node."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from compatibility.rules import rule
from compatibility.test_loading import HEAD, visit
from compatibility.test_preempt_nodes import LIBRARIES, ROBOT
from skiros2_common.core.world_element import Element
from skiros2_msgs import msg as msgs
from skiros2_msgs import srv as srvs
from skiros2_skill.ros.skill_manager_interface import SkillManagerInterface
from skiros2_world_model.ros.world_model_interface import WorldModelInterface
from support.ros import Ros, install_environment, run_command

pytestmark = pytest.mark.timeout(240)


def environment(ros: Ros, folder: Path) -> dict[str, str]:
    return {**ros.master.env, "PYTHONPATH": f"{folder}:{ros.master.env['PYTHONPATH']}"}


@rule(
    "robustness",
    "The manager runs without the listed skills that cannot be loaded; they are neither in `~get_skills` nor "
    "in the world model",
)
def test_the_manager_runs_without_the_skills_that_cannot_be_loaded(ros: Ros) -> None:
    ros.launch("skiros2", "world_model_server.launch", gui=False)
    program = ros.launch(
        "skiros2", "skill_mgr.launch", libraries_list="[stubborn_skills]", skill_list="[declines, creep]",
        primitive_list="[raises_in_constructor, block, raises_in_init]", env=environment(ros, LIBRARIES),
    )  # fmt: skip
    ros.service(f"{ROBOT}/command", srvs.SkillCommand)
    client = SkillManagerInterface(ROBOT, "tests")
    assert set(client.get_skill_list()) == {"block", "creep"}
    listed = WorldModelInterface("tests").resolve_elements(Element("skiros:Block"))
    assert {element.label for element in listed} == {"block", "creep"}
    assert client.run([client.get_skill("block")]).succeeded(timeout=30.0)
    client.shutdown()
    for named in (
        r"motions\.raises_in_constructor cannot be loaded: .*motions\.py, line \d+: RuntimeError: no license",
        r"motions\.raises_in_init cannot be loaded: .*motions\.py, line \d+: RuntimeError: no camera",
        r"motions\.declines cannot be loaded: .*motions\.py, line \d+: its onInit returned False",
    ):
        program.wait_for_line(named)
    assert program.output.count("no license") == 1


@rule(
    "loading",
    "A library with problems is checked as it is loaded",
    better="`lint` reports them as warnings with exit status 0, with `--strict` as errors with exit status 1",
)
def test_lint_fails_for_warnings_when_it_is_strict(tmp_path: Path) -> None:
    (tmp_path / "flawed").mkdir()
    (tmp_path / "flawed/__init__.py").touch()
    (tmp_path / "flawed/skills.py").write_text(HEAD + visit('self.skill("Greet", "", remap={"Txet": "Robot"})'))
    env = install_environment()
    env["PYTHONPATH"] = os.pathsep.join([str(tmp_path), env["PYTHONPATH"]])
    for options, status in (([], 0), (["--strict"], 1)):
        command = ["rosrun", "skiros2_skill", "lint", *options, "flawed"]
        done = run_command(command, env)
        assert done.returncode == status, done.stdout + done.stderr
        assert "0 errors, 1 warning" in done.stdout


@rule(
    "more",
    "`rosrun skiros2_skill reload [LIBRARY...]`, or the service `~reload`, imports libraries again without a "
    "restart: running tasks keep the old code, and so do all when the new code cannot be loaded",
)
def test_a_library_is_reloaded_while_its_manager_runs(ros: Ros, tmp_path: Path) -> None:
    (tmp_path / "changing").mkdir()
    (tmp_path / "changing/__init__.py").touch()
    source = tmp_path / "changing/skills.py"
    source.write_text(HEAD)
    env = environment(ros, tmp_path)
    ros.launch("skiros2", "world_model_server.launch", gui=False)
    ros.launch(
        "skiros2", "skill_mgr.launch", libraries_list="[changing]", primitive_list="[greet_loudly]", skill_list="[]",
        env=env,
    )  # fmt: skip
    ros.service(f"{ROBOT}/command", srvs.SkillCommand)
    client = SkillManagerInterface(ROBOT, "tests")
    progress = ros.messages(f"{ROBOT}/monitor", msgs.TreeProgress).connected()

    def said() -> str:
        task = client.execute(skill_list=[client.get_skill("greet_loudly")])
        last = progress.wait_for(lambda m: m.progress[0].id == task and abs(m.progress[0].progress_code) == 1)
        return str(last.progress[1].progress_message)

    def reload(*libraries: str) -> tuple[int, str]:
        command = ["rosrun", "skiros2_skill", "reload", *libraries]
        done = run_command(command, env)
        return done.returncode, done.stdout + done.stderr

    assert said() == "HELLO"
    source.write_text(HEAD.replace("HELLO", "AHOY!").replace('"Text", "hello"', '"Text", "ahoy!"'))
    assert reload("changing") == (0, f"{ROBOT}: reloaded changing\n")
    assert said() == "AHOY!"
    assert client.get_skill_list(update=True)["greet_loudly"].ph["Text"].value == "ahoy!"
    (skill,) = WorldModelInterface("tests").resolve_elements(Element("skiros:Greet"))
    assert skill.label == "greet_loudly"
    source.write_text("def")
    status, text = reload()
    assert status == 1
    assert "nothing is reloaded" in text
    assert "skills.py, line 1: invalid syntax" in text
    assert said() == "AHOY!"
    client.shutdown()
