"""`rosrun skiros2_skill new` makes a package that builds, starts, plans and passes its tests as it is."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from support.ros import ROOT, Ros, RosMaster, install_environment

pytestmark = pytest.mark.timeout(120)
PYTHON = ROOT / ".venv/bin/python3"


def run(*command: object, env: dict[str, str], cwd: Path, status: int = 0) -> str:
    """Returns all that a command prints; its exit status is asserted."""
    words = [str(part) for part in command]
    done = subprocess.run(words, env=env, cwd=cwd, capture_output=True, text=True, check=False)
    assert done.returncode == status, done.stdout + done.stderr
    return done.stdout + done.stderr


@pytest.fixture(scope="module")
def package(ros_master: RosMaster, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("workspace")
    run("rosrun", "skiros2_skill", "new", "lab_skills", env=ros_master.env, cwd=folder)
    for what, name in (("skill", "weigh"), ("reasoner", "mass"), ("scene", "lab")):
        run("rosrun", "skiros2_skill", "new", what, name, env=ros_master.env, cwd=folder / "lab_skills")
    return folder / "lab_skills"


@pytest.mark.long
def test_package_passes_its_tests_and_has_no_faults(ros_master: RosMaster, package: Path) -> None:
    env = {**ros_master.env, "PYTHONPATH": f"src:{ros_master.env['PYTHONPATH']}"}
    tested = run(PYTHON, "-m", "pytest", "-p", "no:cacheprovider", "tests", env=env, cwd=package)
    assert "8 passed" in tested
    assert run("rosrun", "skiros2_skill", "lint", "lab_skills", env=env, cwd=package) == "0 errors, 0 warnings\n"


@pytest.mark.long
def test_package_is_built_started_and_reaches_a_goal(ros_master: RosMaster, package: Path, tmp_path: Path) -> None:
    install = tmp_path / "install"
    options = (f"-DPYTHON_EXECUTABLE={PYTHON}", f"-DCMAKE_INSTALL_PREFIX={install}", "-DCATKIN_ENABLE_TESTING=OFF")
    run("cmake", "-S", package, "-B", tmp_path / "build", *options, env=ros_master.env, cwd=tmp_path)
    run("cmake", "--build", tmp_path / "build", "--target", "install", env=ros_master.env, cwd=tmp_path)
    own = ("ROS_MASTER_URI", "ROS_HOME", "ROS_LOG_DIR")
    kept = {key: ros_master.env[key] for key in own if key in ros_master.env}
    env = install_environment(install / "setup.bash") | kept
    ros = Ros(ros_master)
    try:
        ros.launch("lab_skills", "lab_skills.launch", gui=False, env=env)
        ros.wait_for_node("/tm")
        ros.wait_for_node("/my_robot")
        goal = "(lab_skills:Inspected skiros:Product-5)"
        achieved = run("rosrun", "skiros2_task", "achieve", goal, env=env, cwd=tmp_path)
        assert "inspect" in achieved
        inspected = ("skiros:Product-5", "lab_skills:Inspected")
        assert "rue" in run("rosrun", "skiros2_world_model", "get", *inspected, env=env, cwd=tmp_path)
    finally:
        ros.stop()


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (("Lab",), "'Lab' is not a name of a Python module; expected lower case, digits and underscores"),
        (("skiros2_skill",), "there is a Python module skiros2_skill already; choose another name"),
        (("skill", "weigh"), "is not a package of skills: expected one src/NAME/__init__.py"),
    ],
)
def test_wrong_names_are_refused(
    ros_master: RosMaster, tmp_path: Path, arguments: tuple[str, ...], reason: str
) -> None:
    said = run("rosrun", "skiros2_skill", "new", *arguments, env=ros_master.env, cwd=tmp_path, status=2)
    assert reason in said
    assert not list(tmp_path.iterdir())


def test_existing_files_are_kept(ros_master: RosMaster, package: Path) -> None:
    before = (package / "src/lab_skills/weigh.py").read_text()
    said = run("rosrun", "skiros2_skill", "new", "skill", "weigh", env=ros_master.env, cwd=package, status=2)
    assert "these exist already: src/lab_skills/weigh.py, tests/test_weigh.py" in said
    assert (package / "src/lab_skills/weigh.py").read_text() == before
