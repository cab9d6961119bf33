"""The command new: makes a package with skills, or a skill, a reasoner or a scene in a package."""

from __future__ import annotations

import argparse
import importlib.util
import keyword
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NoReturn

from skiros2_common.command_line.command import USAGE, CommandResult, Parser, command_arguments, end, run_command
from skiros2_common.core.errors import Refused

#: The templates. `my_skills`, `my_skill`, `MySkill` and so on in paths and texts are replaced by the wanted names.
TEMPLATES = Path(__file__).parents[1] / "templates"

#: A package is made of its common files, and of those for systems with or without ROS.
_PACKAGE, _WITH_ROS, _WITHOUT_ROS = "my_skills", "with_ros", "without_ros"

#: The template of each file, by its path in the package.
_FILES = {
    "ros": {"launch/my_ros.launch": f"{_WITH_ROS}/launch/my_skills.launch"}
    | {name: f"{_WITH_ROS}/{name}" for name in (
        "CMakeLists.txt", "package.xml", "setup.py", "src/my_skills/action_primitives.py",
        "tests/test_action_primitives.py",
    )},
    "skill": {"src/my_skills/my_skill.py": "my_skill.py", "tests/test_my_skill.py": "test_my_skill.py"},
    "reasoner": {"src/my_skills/my_reasoner.py": "my_reasoner.py", "tests/test_my_reasoner.py": "test_my_reasoner.py"},
    "scene": {"owl/my_scene.ttl": "my_scene.ttl"},
}  # fmt: skip
_NEXT = {
    "ros": "next: name your skills in launch/my_ros.launch, and build the package with catkin_make",
    "skill": "next: add my_skill to primitive_list in the launch file",
    "reasoner": "next: name MyReasoner in skiros:DiscreteReasoner of elements, and my_skills in wm/reasoners_pkgs",
    "scene": "next: start with init_scene:=my_scene.ttl",
}

_NEXT_WITHOUT_ROS = {
    "skill": "next: skiros2 test",
    "reasoner": "next: skiros2 test",
    "scene": "next: use it by --scene owl/my_scene.ttl",
}

_NAME = re.compile(r"[a-z][a-z0-9_]*")


def run(arguments: Sequence[str] | None = None) -> NoReturn:
    """Runs the command and ends the process with its status.

    :param arguments: of the command line; None: those of this process.
    """
    parser = Parser(
        prog="new",
        description="Makes a package with skills, a scene and tests, or a skill, a reasoner or a scene in a package.",
        epilog="new my_skills; cd my_skills; new skill weigh. `new ros NAME` adds a launch file of that name, and what "
        "catkin needs, to a package that was made without ROS. Exit status: 0 made, 2 wrong usage, or it exists.",
    )
    parser.add_argument("what", nargs="?", choices=("package", *_FILES), default="package", help="(package)")
    parser.add_argument("name", help="lower case with underscores: the name of the package, module or file")
    parser.add_argument(
        "--ros",
        action=argparse.BooleanOptionalAction,
        default=importlib.util.find_spec("rospy") is not None,
        help="of a package: with a launch file, and what catkin needs (default: where ROS is installed)",
    )
    parser.add_argument(
        "--in", dest="folder", type=Path, default=Path(), metavar="DIR", help="the folder, or that of the package (.)"
    )
    parser.add_argument("--json", action="store_true", help="print JSON")
    given = parser.parse_args(command_arguments(arguments))
    end(run_command("new", lambda: _new(given), given.json, refused=USAGE))


def _new(given: argparse.Namespace) -> CommandResult:
    name, folder = given.name, given.folder
    if not _NAME.fullmatch(name) or keyword.iskeyword(name):
        raise Refused(f"{name!r} is not a name of a Python module; expected lower case, digits and underscores")
    if given.what == "package":
        spec = importlib.util.find_spec(name)
        if spec is not None and spec.origin is not None:
            raise Refused(f"there is a Python module {name} already; choose another name")
        templates = {
            f"{_PACKAGE}/{path.relative_to(TEMPLATES / part)}": path
            for part in (_PACKAGE, _WITH_ROS if given.ros else _WITHOUT_ROS)
            for path in (TEMPLATES / part).rglob("*")
            if path.is_file() and path.suffix != ".pyc"
        }
        names = {"my_skills": name}
        step = "next: see my_skills/README.md"
    else:
        templates = {path: TEMPLATES / file for path, file in _FILES[given.what].items()}
        names = {"my_skills": _package_of(folder), f"my_{given.what}": name}
        has_ros = (folder / "package.xml").is_file() or given.what == "ros"
        step = (_NEXT if has_ros else _NEXT_WITHOUT_ROS)[given.what]
    files = {folder / _renamed(path, names): _renamed(file.read_text(), names) for path, file in templates.items()}
    existing = [str(path) for path in files if path.exists()]
    if existing:
        raise Refused(f"these exist already: {', '.join(sorted(existing))}")
    for path, text in files.items():
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    made = sorted(map(str, files))
    return CommandResult([*(f"made {path}" for path in made), _renamed(step, names)], {"files": made})


def _package_of(folder: Path) -> str:
    """The name of the Python package in a package of skills.

    :raises Refused: the folder is not a package of skills.
    """
    modules = sorted(path.parent.name for path in folder.glob("src/*/__init__.py"))
    if len(modules) != 1:
        raise Refused(f"{folder.absolute()} is not a package of skills: expected one src/NAME/__init__.py")
    return modules[0]


def _renamed(text: str, names: Mapping[str, str]) -> str:
    """Replaces names in snake case, and the same names in camel case."""
    for old, new in names.items():
        text = re.sub(rf"\b(test_)?{old}\b", lambda match, new=new: (match[1] or "") + new, text)
        text = re.sub(rf"\b{_camel(old)}\b", _camel(new), text)
    return text


def _camel(name: str) -> str:
    return "".join(part.capitalize() for part in name.split("_"))
