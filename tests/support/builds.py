"""Builds of clones in the ways that users build them, and checks of what others find then."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

from support.ros import ROOT, install_environment

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
    "skiros.launch": {"/wm", "/test_robot", "/tm", "/skiros_gui"},
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
