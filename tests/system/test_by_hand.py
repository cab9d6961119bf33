"""The commands of the section "Run a skill by hand" in docs/skills.md, with their output."""

import doctest
import re
from pathlib import Path

import pytest

from skiros2_msgs import srv as srvs
from skiros2_skill.ros.skill_manager_interface import SkillManagerInterface
from support.programs import Program
from support.ros import Ros, wait_until

pytestmark = pytest.mark.timeout(180)

DOCUMENT = Path(__file__).resolve().parents[2] / "docs/skills.md"
RESULT = "/test_robot/execute/result"
OPTIONS = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE


def section() -> str:
    return re.split(r"^## ", DOCUMENT.read_text().split("## Run a skill by hand\n")[1], flags=re.MULTILINE)[0]


def code(language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", section(), re.MULTILINE | re.DOTALL)


@pytest.fixture
def manager(ros: Ros) -> Program:
    """What the section starts at first."""
    _, package, file, *arguments = code("")[0].split()
    launch = ros.launch(package, file, **dict(argument.split(":=") for argument in arguments))
    ros.service("/test_robot/command", srvs.SkillCommand)
    return launch


@pytest.mark.long
@pytest.mark.usefixtures("manager")
def test_commands_print_the_documented_output(ros: Ros) -> None:
    waiting: list[Program] = []
    for block in code("")[1:]:
        for command, wanted in re.findall(r"^\$ (.*)\n((?:(?!\$ ).*\n)*)", block, re.MULTILINE):
            program = ros.program("bash", "-c", command.removesuffix("&"))
            if command.endswith("&"):
                wait_until(lambda: any("rostopic" in n for n in ros.master.subscribers(RESULT)), what=command)
                waiting.append(program)
                continue
            printed = ""
            for one in [program, *waiting]:
                one.wait(60.0)
                printed += one.output + "\n"
            waiting.clear()
            checker = doctest.OutputChecker()
            assert checker.check_output(wanted, printed, OPTIONS), f"{command}\n\nwanted:\n{wanted}\ngot:\n{printed}"


@pytest.mark.usefixtures("manager")
def test_the_python_code_runs() -> None:
    (text,) = code("python")
    names = {"SkillManagerInterface": SkillManagerInterface}
    exec(compile(text, str(DOCUMENT), "exec"), names)
    assert names["run"].result().message == "End"
    names["robot"].shutdown()
