"""The demo without physics: a verified pick-and-place that leaves no process behind."""

from __future__ import annotations

import re
import signal
import socket
from collections.abc import Iterator
from pathlib import Path

import pytest

from skiros2_common.command_line.layout import next_commands
from skiros2_demo.demo import NEXT
from skiros2_demo.run_check import check, read_run
from support.demo_run import DemoRun
from support.programs import Program, descendants
from support.ros import wait_until


@pytest.fixture
def run(tmp_path: Path) -> Iterator[DemoRun]:
    run = DemoRun(tmp_path, "--timed")
    yield run
    if run.program is not None:
        run.program.stop()


def test_bag_proves_that_product_a_is_in_tray_b(run: DemoRun) -> None:
    program = run.start()
    program.wait_for_line("The tree as it runs")
    run.family = descendants(program.pid)
    assert program.wait(60) == 0, program.output
    shown = program.output

    plan = re.findall(r"^  \d\. (\w+)", shown, re.MULTILINE)
    assert plan == ["drive", "pick", "drive", "place"]
    assert re.search(r"▶ pick ->\*", shown)
    assert re.search(r"   ✓ move_arm_timed .*Reaching for Product A: done", shown)
    assert "  + Tray B skiros:contain Product A\n" in shown
    assert "  + mobile_manipulator skiros:at Workstation 2\n" in shown
    assert "  ✓ at the end: Product A is in Tray B" in shown
    assert "✗" not in shown
    assert shown.endswith(next_commands(NEXT).rstrip())
    assert run.nothing_left()

    assert run.check_run(run.bag) == (0, "\n".join(line[2:] for line in shown.splitlines() if line.startswith("  ✓")))
    recorded = read_run(run.bag)
    assert len(recorded.before.things) == len(recorded.after.things) > 17  # the recorder has missed nothing
    assert all(finding.holds for finding in check(recorded))


@pytest.mark.long
def test_satisfied_goal_runs_nothing(run: DemoRun) -> None:
    status, shown = run.end("--product", "Product A", "--tray", "Tray A")
    assert status == 0, shown
    assert "  nothing to do" in shown
    assert "The tree as it runs" not in shown


@pytest.mark.long
def test_ctrl_c_ends_all_processes(run: DemoRun) -> None:
    program = run.start()
    program.wait_for_line("▶ move_base_timed")
    run.family = descendants(program.pid)
    assert len(run.family) > 5
    program.interrupt()
    program.interrupt()  # impatience changes nothing
    assert program.wait() == 128 + signal.SIGINT
    assert "pick_place_demo: stopped" in program.output
    wait_until(run.nothing_left)


def test_sigterm_ends_the_demo_while_it_starts(run: DemoRun) -> None:
    program = run.start()
    program.wait_for_line("Starting a system")
    run.family = descendants(program.pid)
    program.signal(signal.SIGTERM)
    assert program.wait() == 128 + signal.SIGTERM
    wait_until(run.nothing_left)


@pytest.mark.parametrize(
    ("package", "name"),
    [
        ("skiros2_sim_skills", "pick_place_demo"),
        ("skiros2_contact_skills", "piston_demo"),
        ("skiros2_gateway", "factory_demo"),
    ],
)
def test_a_port_in_use_is_named(run: DemoRun, package: str, name: str) -> None:
    with socket.create_server(("localhost", 0)) as taken:
        port = taken.getsockname()[1]
        run.program = Program(["rosrun", package, name, "--port", str(port)], run.env, cwd=run.folder)
        status = run.program.wait()
    assert status == 1
    assert run.program.output == f"{name}: port {port} is in use; pass a free one, or none"


@pytest.mark.long
@pytest.mark.parametrize(
    ("arguments", "culprit"),
    [
        (["--product", "Product X"], "no element is labelled 'Product X'"),
        (["--scene", "missing.ttl"], "missing.ttl"),
    ],
)
def test_missing_element_is_named(run: DemoRun, arguments: list[str], culprit: str) -> None:
    status, shown = run.end(*arguments)
    assert status == 1
    (line,) = [line for line in shown.splitlines() if line.startswith("pick_place_demo: ")]
    assert culprit in line
    assert run.nothing_left()


@pytest.mark.long
def test_unreachable_goal_is_reported(run: DemoRun) -> None:
    status, shown = run.end("--product", "Workstation 1", "--tray", "Tray B")
    assert status == 1
    text = r"pick_place_demo: the goal was not reached \(impossible after .* s\): .* but Workstation 1 is a workstation"
    assert re.search(text, shown)


def test_checker_names_a_missing_bag(run: DemoRun) -> None:
    status, shown = run.check_run(run.folder / "none.bag")
    assert (status, shown) == (2, f"check_run: {run.folder / 'none.bag'}: there is no such file")
