"""Completion of command lines: options, choices, files, and names that functions return."""

import argparse
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from skiros2_common.command_line.command import Parser
from skiros2_common.command_line.completion import Line, complete_by, completions
from support.source import ROOT

HOOKS = ROOT / "env-hooks"


def make_parser() -> argparse.ArgumentParser:
    parser = Parser(prog="run")
    words = parser.add_argument("words", nargs="+")
    complete_by(words, lambda *_: ["Object=Product A", "Object=Product B", "Object=skiros:Product-5", "pick"])
    parser.add_argument("--quality", choices=("first", "best", "optimal"))
    parser.add_argument("--file", type=Path)
    robot = parser.add_argument("--robot")
    complete_by(robot, lambda typed, current: [f"robot_{len(typed.words)}"])
    parser.add_argument("--json", action="store_true")
    return parser


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["pi"], ["pick"]),
        (["pick", "Object=P"], ["Object=Product A", "Object=Product B"]),
        (["--"], ["--help", "--version", "--quality", "--file", "--robot", "--json"]),
        (["--json", "pick", "--q"], ["--quality"]),
        (["--json", "--j"], []),
        (["--quality", ""], ["first", "best", "optimal"]),
        (["--quality=b"], ["--quality=best"]),
        (["pick", "place", "--robot", ""], ["robot_2"]),
        (["--robot", "r", "pi"], ["pick"]),
        (["nobody"], []),
    ],
)
def test_completions_of_a_parser(words, expected):
    assert completions(make_parser(), words) == expected


def test_commands_of_a_command():
    parser = Parser(prog="breakpoint")
    actions = parser.add_subparsers(parser_class=Parser)
    actions.add_parser("list")
    actions.add_parser("add").add_argument("kind", choices=("node", "condition"))
    assert completions(parser, [""]) == ["list", "add"]
    assert completions(parser, ["add", "n"]) == ["node"]
    assert completions(parser, ["add", "node", ""]) == []


def test_files_are_completed(tmp_path, monkeypatch):
    (tmp_path / "owl").mkdir()
    (tmp_path / "owl.txt").touch()
    monkeypatch.chdir(tmp_path)
    assert completions(make_parser(), ["--file", "o"]) == ["owl.txt", "owl/"]


@pytest.mark.parametrize(
    ("text", "words", "word", "completed"),
    [
        ("run pi", ["run", "pi"], "pick", "pick"),
        ("run ", ["run", ""], "pick", "pick"),
        ("run Object=Pr", ["run", "Object=Pr"], "Object=Product A", r"Product\ A"),
        (r"run Object=Product\ ", ["run", "Object=Product "], "Object=Product A", r"Product\ A"),
        ('run Object="Pr', ["run", "Object=Pr"], "Object=Product A", "Product A"),
        ('run "Object=Pr', ["run", "Object=Pr"], "Object=Product A", "Object=Product A"),
        ("run Object=skiros:P", ["run", "Object=skiros:P"], "Object=skiros:Product-5", "Product-5"),
        ('plan "(skiros:at ro', ["plan", "(skiros:at ro"], "(skiros:at robot", "(skiros:at robot"),
        ("run 'a b' c", ["run", "a b", "c"], "cd", "cd"),
    ],
)
def test_line_of_bash(text, words, word, completed):
    line = Line.read(text)
    assert line.words == words
    assert line.completed(word) == completed


@pytest.fixture
def shell(tmp_path: Path):
    """Runs a script in a shell with a command `rosrun skiros2_skill run`, and returns its output."""
    program = tmp_path / "lib/skiros2_skill/run"
    program.parent.mkdir(parents=True)
    paths = [str(ROOT / "skiros2/skiros2_common/src"), str(ROOT / "tests")]
    lines = ["from unit.skiros2_common.test_completion import make_parser", "make_parser().parse_args()"]
    program.write_text("\n".join([f"#!{sys.executable}", "import sys", f"sys.path[:0] = {paths}", *lines]))
    program.chmod(0o755)
    env = {"PATH": os.environ["PATH"], "CMAKE_PREFIX_PATH": f"{tmp_path}:/nowhere", "LANG": "C.UTF-8"}

    def run(*command: str) -> str:
        return subprocess.run(command, env=env, capture_output=True, text=True, check=True).stdout

    return run


BASH = """
source {hook}
COMP_LINE='{line}' COMP_POINT={point} COMP_WORDS=({line_words}) COMP_CWORD={cword}
{function} rosrun
printf '%s\\n' "${{COMPREPLY[@]}}"
"""


def in_bash(shell, line: str, words: str) -> list[str]:
    script = BASH.format(
        hook=HOOKS / "91.skiros2_completion.bash", line=line, point=len(line), line_words=words,
        cword=len(words.split()) - 1, function="_skiros2_rosrun",
    )  # fmt: skip
    return shell("bash", "--norc", "--noprofile", "-c", script).splitlines()


def test_bash_completes_a_parameter(shell):
    assert in_bash(shell, "rosrun skiros2_skill run Object=Pr", "rosrun skiros2_skill run Object = Pr") == [
        r"Product\ A", r"Product\ B",
    ]  # fmt: skip


def test_bash_completes_a_command(shell):
    assert in_bash(shell, "rosrun skiros2_skill r", "rosrun skiros2_skill r") == ["run"]


def test_bash_keeps_the_completion_of_other_packages(shell):
    hook = HOOKS / "91.skiros2_completion.bash"
    script = f"""
        set -euo pipefail
        other() {{ COMPREPLY=(tf_echo); }}
        complete -F other rosrun
        source {hook}; source {hook}
        COMP_WORDS=(rosrun tf tf_) COMP_CWORD=2
        _skiros2_rosrun rosrun; echo ${{COMPREPLY[0]}}
    """
    assert shell("bash", "--norc", "-c", script) == "tf_echo\n"


def test_bash_says_nothing_for_a_missing_command(shell):
    assert in_bash(shell, "rosrun skiros2_skill rum x", "rosrun skiros2_skill rum x") == [""]


@pytest.mark.skipif(shutil.which("zsh") is None, reason="zsh is not installed")
def test_zsh_completes_a_parameter(shell):
    script = f"""
        compdef() {{ :; }}; compadd() {{ print -rl -- "$@" }}
        source {HOOKS / "91.skiros2_completion.zsh"}
        words=(rosrun skiros2_skill run Object=Pr) CURRENT=4
        _skiros2_rosrun
    """
    assert shell("zsh", "-f", "-c", script).splitlines()[-2:] == ["Object=Product A", "Object=Product B"]


def test_nothing_is_said_without_a_master(monkeypatch, capsys):
    monkeypatch.setenv("ROS_MASTER_URI", "http://127.0.0.1:1")
    monkeypatch.setenv("_SKIROS2_COMPLETE", "zsh")
    parser = make_parser()
    words = next(action for action in parser._actions if action.dest == "words")
    complete_by(words, lambda typed, current: ask_master())
    with pytest.raises(SystemExit) as ended:
        parser.parse_args(["pi"])
    assert (ended.value.code, *capsys.readouterr()) == (0, "", "")


def ask_master():
    raise ConnectionRefusedError
