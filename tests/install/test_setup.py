"""A set-up that cannot get what it needs says in one line what that is, and leaves nothing half-done."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
from pathlib import Path

import pytest

from skiros2_demo.demo import NEXT
from skiros2_learning_demo.demo import INSERTION, PUSH, following
from support.ros import ROOT

#: uv takes the index from pip's settings.
NO_INDEX = {"PIP_CONFIG_FILE": "/dev/null", "PIP_INDEX_URL": "http://127.0.0.1:9/simple", "PIP_EXTRA_INDEX_URL": ""}


@pytest.fixture
def clone(tmp_path: Path) -> Path:
    folder = tmp_path / "clone"
    subprocess.run(["git", "clone", "--quiet", str(ROOT), str(folder)], check=True)
    return folder


@pytest.fixture
def commands(tmp_path: Path) -> Path:
    """A folder in front of PATH, for commands that stand in for the system's."""
    folder = tmp_path / "bin"
    folder.mkdir()
    return folder


def stand_in(folder: Path, name: str, script: str) -> None:
    (folder / name).write_text(f"#!/bin/sh\n{script}\n")
    (folder / name).chmod(0o755)


def environment(clone: Path, *lists: str) -> Path:
    """Makes an environment as if the lists were installed in it; returns the folder where the set-up keeps them."""
    subprocess.run(["/usr/bin/python3", "-m", "venv", "--system-site-packages", clone / ".venv"], check=True)
    (clone / ".venv/bin/uv").symlink_to(ROOT / ".venv/bin/uv")
    folder = clone / ".venv/requirements"
    folder.mkdir()
    for name in lists:
        (folder / name).write_text((clone / f"requirements/{name}.txt").read_text())
    version = subprocess.check_output(["/usr/bin/python3", "--version"], text=True).strip()
    (folder / "place").write_text(f"{clone} {version}\n")
    return folder


def set_up(clone: Path, commands: Path, *lists: str, **env: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [clone / ".ci/setup", *lists],
        env={**os.environ, **env, "PATH": f"{commands}:{os.environ['PATH']}"},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        check=False,
    )


def test_without_debians_archive_the_packages_are_named_and_none_is_installed(clone: Path, commands: Path) -> None:
    calls = clone / "calls"
    stand_in(commands, "dpkg-query", "true")  # nothing is installed
    stand_in(commands, "sudo", '[ "$1 $2" = "-n true" ] || exec "$@"')
    refused = "Err:7 http://deb.debian.org/debian bookworm/main amd64 catkin all 0.8.10-9"
    stand_in(commands, "apt-get", f'echo "$@" >>"{calls}"; case "$*" in *install*) echo "{refused}"; exit 100 ;; esac')
    done = set_up(clone, commands)
    assert done.returncode != 0
    assert len(done.stderr.splitlines()) == 1
    assert "catkin (no network" in done.stderr
    installs = [call for call in calls.read_text().splitlines() if " install " in call]
    assert installs
    assert all("--download-only" in call for call in installs)
    assert not (clone / ".venv").exists()


def test_who_is_neither_root_nor_has_sudo_is_told_what_root_has_to_do(clone: Path, commands: Path) -> None:
    stand_in(commands, "dpkg-query", "true")
    stand_in(commands, "id", "echo 1000")
    stand_in(commands, "sudo", "exit 1")
    done = set_up(clone, commands)
    assert done.returncode != 0
    assert len(done.stderr.splitlines()) == 1
    assert "neither root nor sudo" in done.stderr
    assert "python3-rospy" in done.stderr


def test_without_the_python_index_the_package_is_named_and_no_environment_is_left(clone: Path, commands: Path) -> None:
    done = set_up(clone, commands, **NO_INDEX)
    assert done.returncode != 0
    assert len(done.stderr.splitlines()) == 1
    assert "could not fetch the Python package uv" in done.stderr
    assert not (clone / ".venv").exists()


@pytest.mark.long
def test_an_environment_that_cannot_be_renewed_stays_as_it_was(clone: Path, commands: Path) -> None:
    lists = environment(clone, "uv")
    (lists / "run").write_text("of other requirements")
    done = set_up(clone, commands, "run", **NO_INDEX)
    assert done.returncode != 0
    assert "could not fetch the Python package" in done.stderr
    assert (lists / "run").read_text() == "of other requirements"
    assert not (lists / "incomplete").exists()


@pytest.mark.long
def test_list_that_cannot_be_added_leaves_the_environment_as_it_was(clone: Path, commands: Path) -> None:
    lists = environment(clone, "uv", "run")
    done = set_up(clone, commands, "run", "sim", **NO_INDEX)
    assert done.returncode != 0
    assert re.search(r"could not fetch the Python package [\w-]+ \(no network", done.stderr)
    assert sorted(path.name for path in lists.iterdir()) == ["place", "run", "uv"]


def test_unknown_purpose_is_refused_with_those_that_there_are(clone: Path, commands: Path) -> None:
    done = set_up(clone, commands, "windows")
    assert done.returncode != 0
    assert "nothing for windows" in done.stderr
    assert {"window", "run", "compat"} <= set(done.stderr.split())


def test_demo_needs_no_browser_no_broker_no_window_and_no_compiler(clone: Path, commands: Path) -> None:
    stand_in(commands, "dpkg-query", "true")
    stand_in(commands, "id", "echo 1000")
    stand_in(commands, "sudo", "exit 1")
    wanted = set(set_up(clone, commands, "run", "planner", "sim").stderr.split())
    assert {"python3-rospy", "rosbash", "cmake"} <= wanted
    assert not {"chromium", "mosquitto", "curl", "xterm", "xvfb", "rviz", "python3-pyqt5", "tf-tools"} & wanted
    assert not {"build-essential", "python3-rostest"} & wanted
    assert {"rviz", "python3-pyqt5"} <= set(set_up(clone, commands, "run", "window").stderr.split())


@pytest.mark.long
@pytest.mark.timeout(300)
def test_build_makes_only_python_messages_and_each_step_prints_its_time(clone: Path, commands: Path) -> None:
    lists = ("uv", "run", "planner", "sim")
    environment(clone, *lists)
    first = set_up(clone, commands, *lists[1:])
    assert first.returncode == 0, first.stdout + first.stderr
    assert (clone / "install/lib/python3/dist-packages/skiros2_msgs/msg/_WmElement.py").is_file()
    made = {path.relative_to(clone / "install").parts[0] for path in (clone / "install").rglob("*WmElement*")}
    assert made == {"lib", "share"}  # the modules and the definitions: no C++ headers
    assert not [*clone.glob("install/share/*/ros"), *clone.glob("install/share/gennodejs")]
    again = set_up(clone, commands, *lists[1:])
    for done, built in ((first, "built and installed"), (again, "up to date")):
        steps = re.findall(r"^\[(\d)/3\] .*\n(?:    .*: \d+%\n)*    (.*) \((\d+\.\d) s\)$", done.stdout, re.M)
        assert [number for number, _, _ in steps] == ["1", "2", "3"], done.stdout
        assert [result for _, result, _ in steps] == ["all there", "all there", built]
    assert sum(float(time) for _, _, time in steps) < 10  # a second, on a machine that is not busy


@pytest.mark.long
def test_python_packages_are_fetched_while_dpkg_unpacks(clone: Path, commands: Path) -> None:
    """Each waits until the other has started."""
    environment(clone, "uv")
    wait = 'for i in $(seq 200); do [ -e "{}" ] && break; sleep 0.1; done; [ -e "{}" ] && touch "{}"'
    unpacking, fetching, both = clone / "unpacking", clone / "fetching", clone / "both"
    stand_in(commands, "dpkg-query", "true")  # nothing is installed
    stand_in(commands, "id", "echo 0")
    stand_in(commands, "sync", "true")
    unpack = f'touch "{unpacking}"; {wait.format(fetching, fetching, both)}'
    stand_in(commands, "apt-get", f'case "$*" in *--no-download*rospack-tools*) {unpack} ;; esac')
    (clone / ".venv/bin/uv").unlink()
    stand_in(clone / ".venv/bin", "uv", f'touch "{fetching}"; {wait.format(unpacking, unpacking, both)}')
    stand_in(commands, "cmake", "exit 1")
    done = set_up(clone, commands, "run", "sim")
    assert both.exists(), done.stdout + done.stderr
    assert "set-up: CMake" in done.stderr  # the packages were no obstacle: the build began


@pytest.mark.long
def test_changed_list_is_installed_into_the_environment_that_is_there(clone: Path, commands: Path) -> None:
    lists = environment(clone, "uv", "run", "sim")
    (lists / "run").write_text("dropped==1.0 \\\n" + (lists / "run").read_text())
    (clone / ".venv/made").touch()
    (clone / ".venv/bin/uv").unlink()
    stand_in(clone / ".venv/bin", "uv", f'echo "$@" >>"{clone}/calls"')
    stand_in(commands, "cmake", "exit 1")
    set_up(clone, commands, "run")
    install, uninstall = (call.split() for call in (clone / "calls").read_text().splitlines())
    assert [word for word in install if word.startswith("--requirement=")] == ["--requirement=requirements/run.txt"]
    assert uninstall[:2] == ["pip", "uninstall"]
    assert uninstall[-1] == "dropped"
    assert (clone / ".venv/made").exists()
    assert (lists / "run").read_text() == (clone / "requirements/run.txt").read_text()
    assert not (lists / "incomplete").exists()


def make(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(["make", *arguments], cwd=ROOT, capture_output=True, text=True, check=False)


def test_unknown_demo_is_refused_with_those_that_there_are() -> None:
    done = make("demo", "DEMO=foo")
    assert done.returncode == 2
    assert "there is no demo foo: make demo DEMO=..., one of pick-place piston connector factory push" in done.stderr
    assert "set-up" not in done.stderr + done.stdout


@pytest.mark.parametrize("commands", [NEXT, *(following(demo, Path("study")) for demo in (PUSH, INSERTION))])
def test_what_the_demo_says_to_type_next_is_there(commands: dict[str, str]) -> None:
    assert len(commands) == 3
    for command in commands:
        _, _, typed = command.rpartition("&& ")
        program, *arguments = shlex.split(typed)
        if program == "make":
            steps = make("-n", *arguments)
            assert "exec .ci/in_ros rosrun" in steps.stdout, steps.stderr
        elif program == "rosrun":
            shown = subprocess.check_output([".ci/in_ros", program, *arguments[:3], "--help"], cwd=ROOT, text=True)
            assert arguments[2] == "--help" or f"usage: learn {arguments[2]} " in shown
        else:
            assert b"/tm" in subprocess.check_output([".ci/in_ros", program, "--nodes", *arguments], cwd=ROOT)


def test_each_list_has_the_hashes_of_all_its_packages() -> None:
    for compiled in (ROOT / "requirements").glob("*.txt"):
        packages = re.findall(r"^[^ #\n]+==.*$(?:\n    .*)*", compiled.read_text(), re.MULTILINE)
        assert packages
        assert all("--hash=sha256:" in package for package in packages), compiled


def test_lists_agree_on_versions_and_name_no_package_index() -> None:
    versions: dict[str, set[str]] = {}
    for compiled in (ROOT / "requirements").glob("*.txt"):
        text = compiled.read_text()
        assert "://" not in text
        # without the local part, which names a build of the same version: torch's for CPUs
        for name, version in re.findall(r"^([^ #\n=]+)==([^ \n+]+)", text, re.MULTILINE):
            versions.setdefault(name, set()).add(version)
    assert {name: found for name, found in versions.items() if len(found) > 1} == {}


def test_direct_packages_are_pinned_in_their_compiled_list() -> None:
    for source in (ROOT / "requirements").glob("*.in"):
        pins = set(re.findall(r"^([^ #\n]+==[^ \n]+)", source.with_suffix(".txt").read_text(), re.MULTILINE))
        without_extras = re.sub(r"\[\w+\]", "", source.read_text())
        direct = re.findall(r"^([^ #\n-][^ #\n]*)", without_extras, re.MULTILINE)
        assert {name.replace("_", "-").lower() for name in direct} <= pins, source


def code_blocks(text: str) -> list[list[str]]:
    """The lines of the indented or fenced commands of a text, without their comments."""
    blocks = re.findall(r"^```\w*\n(.*?)^```$", text, re.M | re.S)
    return [[line.partition("  #")[0].rstrip() for line in block.splitlines() if line.strip()] for block in blocks]


def test_readmes_first_commands_lead_to_the_demo_and_the_distribution(tmp_path: Path) -> None:
    get, enter, demo, pip, test = code_blocks((ROOT / "README.md").read_text())[0]
    assert (demo, pip, test) == ("make demo", "pip install . && skiros2 try", "make test")
    get = get.replace("URL", f"--quiet {ROOT}")
    script = f"{get} && {enter} && {demo} --dry-run && {test} --dry-run && ls pyproject.toml"
    shown = subprocess.run(["bash", "-ec", script], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert shown.returncode == 0, shown.stderr
    assert "rosrun skiros2_demo pick_place_demo" in shown.stdout
    assert "pytest" in shown.stdout


def test_readmes_container_is_that_of_the_dockerfile_with_the_page_and_its_stops() -> None:
    ((container,),) = [block for block in code_blocks((ROOT / "README.md").read_text()) if "docker" in block[0]]
    build, run = (command.strip() for command in container.split("&&"))
    dockerfile = (ROOT / "Dockerfile").read_text()
    assert [build, run] == re.findall(r"^#     (docker .*)$", dockerfile, re.M)
    published = re.findall(r"-p 127\.0\.0\.1:(\d+):\1\b", run)
    assert re.findall(r"^EXPOSE (.*)$", dockerfile, re.M) == [" ".join(published)]
    assert f"PORT:-{published[0]}" in (ROOT / ".ci/container").read_text()
    assert int(published[1]) == int(published[0]) + 1
