"""A clean clone builds and is found in each of the ways that users build it, and others build on it.

`tests/long/test_isolated_build.py` builds it with `catkin_make_isolated`.
"""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from support.builds import PYTHON, assert_all_is_found, clone, outside, run
from support.ros import INSTALL, ROOT, install_environment

pytestmark = pytest.mark.timeout(600)


def cmake(source: Path, folder: Path, env: dict[str, str] | None = None) -> Path:
    """Builds with plain CMake and installs; returns the set-up file of the install space."""
    build, install = folder / "build", folder / "install"
    options = (f"-DPYTHON_EXECUTABLE={PYTHON}", f"-DCMAKE_INSTALL_PREFIX={install}", "-DCATKIN_ENABLE_TESTING=OFF")
    run("cmake", "-S", source, "-B", build, *options, env=env)
    run("cmake", "--build", build, "-j2", "--target", "install", env=env)
    return install / "setup.bash"


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


@pytest.mark.long
def test_catkin_make_builds_a_workspace_with_a_clone(tmp_path: Path) -> None:
    clone(tmp_path / "src/skiros2")
    run("catkin_make", f"-DPYTHON_EXECUTABLE={PYTHON}", "-DCATKIN_ENABLE_TESTING=OFF", cwd=tmp_path)
    assert_all_is_found(tmp_path / "devel/setup.bash")
    assert_owl_is_another_name_of_the_ontologies(tmp_path / "devel/setup.bash", tmp_path)
