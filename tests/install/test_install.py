"""A clean clone builds and is found in each of the ways that users build it, and others build on it."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import pytest

from support.ros import INSTALL, ROOT, install_environment

PYTHON = ROOT / ".venv/bin/python3"
PACKAGES = (
    "skiros2",
    "skiros2_common",
    "skiros2_runs",
    "skiros2_msgs",
    "skiros2_world_model",
    "skiros2_skill",
    "skiros2_task",
    "skiros2_gui",
    "skiros2_std_skills",
    "skiros2_std_reasoners",
)
LAUNCH_FILES = {
    "skiros.launch": {"/wm", "/test_robot", "/tm", "/skiros_gui", "/map_to_world"},
    "world_model_server.launch": {"/wm", "/skiros_gui"},
    "skill_mgr.launch": {"/test_robot"},
    "task_mgr.launch": {"/tm"},
}
PROGRAMS = {
    "skiros2_world_model": {"check_world", "world_model_server_node", "ontology_server_node"},
    "skiros2_skill": {"check_skills", "skill_manager_node"},
    "skiros2_task": {"task_manager_node"},
    "skiros2_gui": {"skiros_gui", "markers_node"},
    "skiros2_demo": {"pick_place_demo"},
    "skiros2_sim_skills": {"pick_place_demo"},
    "skiros2_piston_demo": {"piston_demo"},
    "skiros2_contact_skills": {"piston_demo"},
}
#: Those of demos, by their packages and by the former ones.
DEMOS = (
    *(("skiros2_demo", "demo.launch"), ("skiros2_sim_skills", "demo.launch")),
    *(("skiros2_piston_demo", "piston.launch"), ("skiros2_contact_skills", "piston.launch")),
    *(("skiros2_learning_demo", "push.launch"), ("skiros2_learning", "push.launch")),
)
pytestmark = pytest.mark.timeout(600)


def run(*command: object, env: dict[str, str] | None = None, cwd: Path | None = None) -> str:
    """What the command prints; the test fails, with all of it, when its exit status is not 0."""
    done = subprocess.run(
        [str(part) for part in command],
        env={**(env or outside()), "PWD": str(cwd or Path.cwd())},  # catkin_make goes by PWD
        cwd=cwd,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        check=False,
    )
    assert done.returncode == 0, f"{' '.join(map(str, command))}\n{done.stdout[-5000:]}"
    return done.stdout


def outside() -> dict[str, str]:
    """The environment of a shell that knows nothing of this build. Of messages, only those for Python are wanted."""
    ours = ("CMAKE_PREFIX_PATH", "PYTHONPATH", "ROS_PACKAGE_PATH", "PKG_CONFIG_PATH", "VIRTUAL_ENV")
    path = ":".join(part for part in os.environ["PATH"].split(":") if part != str(PYTHON.parent))
    kept = {key: value for key, value in os.environ.items() if key not in ours}
    return kept | {"PATH": path, "ROS_LANG_DISABLE": "genlisp:gencpp"}


def clone(folder: Path) -> Path:
    run("git", "clone", "--quiet", ROOT, folder)
    return folder


def cmake(source: Path, folder: Path, env: dict[str, str] | None = None) -> Path:
    """Builds with plain CMake and installs; returns the set-up file of the install space."""
    build, install = folder / "build", folder / "install"
    options = (f"-DPYTHON_EXECUTABLE={PYTHON}", f"-DCMAKE_INSTALL_PREFIX={install}", "-DCATKIN_ENABLE_TESTING=OFF")
    run("cmake", "-S", source, "-B", build, *options, env=env)
    run("cmake", "--build", build, "-j2", "--target", "install", env=env)
    return install / "setup.bash"


def assert_all_is_found(setup: Path, messages: str = ", skiros2_msgs.srv") -> None:
    env = install_environment(setup)
    found = {package: Path(run("rospack", "find", package, env=env).strip()) for package in PACKAGES}
    assert all((path / "package.xml").is_file() for path in found.values())
    for file, nodes in LAUNCH_FILES.items():
        listed = run("roslaunch", "--nodes", "skiros2", file, env=env)
        assert {line for line in listed.splitlines() if line.startswith("/")} == nodes
    for package, file in DEMOS:
        assert Path(run("catkin_find", "--first-only", package, f"launch/{file}", env=env).strip()).is_file()
    for package, programs in PROGRAMS.items():
        for program in programs:
            text = Path(run("catkin_find", "--first-only", package, program, env=env).strip()).read_text()
            assert text.startswith(f"#!{PYTHON}\n")
    modules = ", ".join(f"skiros2_{name}.core" for name in ("common", "world_model", "skill", "task"))
    run(PYTHON, "-c", f"import {modules}{messages}", env=env)


def assert_owl_is_another_name_of_the_ontologies(setup: Path, tmp_path: Path) -> None:
    file = tmp_path / "owl.launch"
    file.write_text('<launch><param name="workspace" value="$(find skiros2)/owl"/></launch>')
    dump = run("roslaunch", "--dump-params", file, env=install_environment(setup))
    workspace = Path(dump.partition("/workspace: ")[2].strip())
    assert {path.name for path in workspace.iterdir()} == {path.name for path in (ROOT / "ontologies").iterdir()}


@pytest.fixture(scope="session")
def installed() -> Path:
    """The set-up file of this folder, which was built with plain CMake and installed before the tests."""
    return INSTALL / "setup.bash"


def test_plain_cmake_installs_all(installed: Path, tmp_path: Path) -> None:
    assert_all_is_found(installed)
    assert_owl_is_another_name_of_the_ontologies(installed, tmp_path)


def test_every_python_file_is_installed(installed: Path) -> None:
    there = installed.parent / "lib/python3/dist-packages"
    listed = run("git", "ls-files", "*/src/*.py", cwd=ROOT, env=outside()).split()
    modules = [name.partition("/src/")[2] for name in listed if not name.startswith("tests/")]
    assert modules
    assert not [name for name in modules if not (there / name).is_file()]


def test_a_package_of_somebody_else_builds_on_the_installed_tree(installed: Path, tmp_path: Path) -> None:
    source = Path(__file__).with_name("aaa_robot_skills")
    overlay = install_environment(cmake(source, tmp_path, install_environment(installed)))
    assert run("rospack", "find", "aaa_robot_skills", env=overlay).startswith(str(tmp_path))
    assert run("rospack", "find", "skiros2_skill", env=overlay).startswith(str(installed.parent))
    run("rosrun", "skiros2_skill", "check_skills", "[aaa_robot_skills]", "[wave]", env=overlay)
    run(PYTHON, "-c", "import aaa_robot_skills.wave", env=overlay)


IMPORTS = "import rdflib, rospy, pytest, skiros2_common, skiros2_world_model, skiros2_skill, skiros2_task, skiros2_gui"


@pytest.mark.parametrize("shell", ["bash", "sh"])
def test_sourced_shell_runs_python_and_pytest_of_the_environment_until_deactivate(installed: Path, shell: str) -> None:
    setup = installed.with_suffix(f".{shell}")
    script = (
        f". {setup}; . {setup}; command -v python3; command -v pytest; python3 -c '{IMPORTS}'; echo $PATH; deactivate; "
        "command -v python3; echo $PATH; echo ${VIRTUAL_ENV:-none}"
    )
    before = outside()["PATH"]
    python, pytest_found, path, python_after, path_after, environment = run(shell, "-ec", script).splitlines()
    assert (python, pytest_found) == (str(PYTHON), str(PYTHON.with_name("pytest")))
    assert path.split(":").count(str(PYTHON.parent)) == 1
    assert python_after == run(shell, "-c", "command -v python3").strip()
    assert path_after.endswith(before)
    assert str(PYTHON.parent) not in path_after.split(":")
    assert environment == "none"


def test_environment_that_is_active_already_is_left_by_its_own_deactivate(installed: Path) -> None:
    script = f"source {PYTHON.with_name('activate')}; source {installed}; command -v python3; deactivate; echo $PATH"
    python, path = run("bash", "-ec", script).splitlines()
    assert python == str(PYTHON)
    assert str(PYTHON.parent) not in path.split(":")


def test_overlay_workspace_is_built_and_runs_with_the_environments_python(installed: Path, tmp_path: Path) -> None:
    shutil.copytree(Path(__file__).with_name("aaa_robot_skills"), tmp_path / "src/aaa_robot_skills")
    built = run("bash", "-ec", f"source {installed}; cd {tmp_path}; catkin_make")
    assert f"Using PYTHON_EXECUTABLE: {PYTHON}" in built
    script = f"source {tmp_path}/devel/setup.bash; python3 -c '{IMPORTS}, aaa_robot_skills.wave'; command -v python3"
    assert run("bash", "-ec", script).strip() == str(PYTHON)


def test_catkin_make_builds_a_workspace_with_a_clone(tmp_path: Path) -> None:
    clone(tmp_path / "src/skiros2")
    run("catkin_make", f"-DPYTHON_EXECUTABLE={PYTHON}", "-DCATKIN_ENABLE_TESTING=OFF", cwd=tmp_path)
    assert_all_is_found(tmp_path / "devel/setup.bash")
    assert_owl_is_another_name_of_the_ontologies(tmp_path / "devel/setup.bash", tmp_path)


def test_catkin_make_isolated_builds_a_workspace_with_a_clone(tmp_path: Path) -> None:
    clone(tmp_path / "src/skiros2")
    env = outside() | {"ROS_LANG_DISABLE": "genlisp:gencpp:genpy"}  # messages are built by the other tests
    run("catkin_make_isolated", f"-DPYTHON_EXECUTABLE={PYTHON}", "-DCATKIN_ENABLE_TESTING=OFF", env=env, cwd=tmp_path)
    assert_all_is_found(tmp_path / "devel_isolated/setup.bash", messages="")
