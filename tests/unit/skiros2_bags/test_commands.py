"""Output and exit status of the bag commands."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from PIL import Image

from skiros2_bags.command_line.program import _COMMANDS, run
from support.recorded_run import FAILURE, PRODUCT, TRAY_A, good_run, tree, write_bag

BAG = Path(__file__).parents[2] / "bags/pick_place.bag"

Call = Callable[..., tuple[int, str, str]]


@pytest.fixture
def call(capsys: pytest.CaptureFixture[str]) -> Call:
    def called(name: str, *arguments: Any) -> tuple[int, str, str]:
        with pytest.raises(SystemExit) as ended:
            run(name, [str(a) for a in arguments])
        printed = capsys.readouterr()
        return int(ended.value.code or 0), printed.out, printed.err

    return called


def test_show_prints_a_summary(call: Call) -> None:
    status, out, _ = call("show", BAG, "--topics")
    assert status == 0
    for text in ("goals:", "/tm/achieve", "succeeded", "tasks:", "drive", "world model:", "44 changes", "WmMonitor"):
        assert text in out


def test_tasks_and_skills_are_filtered(call: Call) -> None:
    _, out, _ = call("tasks", BAG, "--robot", "mobile_manipulator", "--task", 1)
    assert "└── pick" in out and "drive" not in out
    _, out, _ = call("skills", BAG, "--depth", 1)
    assert [line.split()[0] for line in out.splitlines()[2:]] == ["drive", "pick", "drive", "place"]
    _, out, _ = call("skills", BAG, "--total")
    assert out.splitlines()[2].split()[:2] == ["drive", "2"]
    assert call("skills", BAG, "--robot", "nobody")[1] == "no skills\n"


def test_world_prints_scene_and_element_at_a_time(call: Call) -> None:
    _, out, _ = call("world", BAG, "--at", 5)
    lines = out.splitlines()
    assert "Tray A" in lines[next(n for n, line in enumerate(lines) if PRODUCT in line) - 1]
    _, out, _ = call("world", BAG, PRODUCT, "--at=-0.01")
    assert "demo:Tray-12" in out
    status, _, err = call("world", BAG, "no:Thing-1")
    assert (status, err.count("\n")) == (2, 1)
    assert "there was no element 'no:Thing-1' at 12." in err


def test_changes_print_added_and_removed_relations(call: Call) -> None:
    _, out, _ = call("changes", BAG, PRODUCT, "--since", 5, "--until", 5.65)
    assert f"    - {TRAY_A} skiros:contain {PRODUCT}\n" in out
    assert f"    + rparts:GripperEffector-4 skiros:contain {PRODUCT}\n" in out
    assert call("changes", BAG, "--author", "nobody")[1] == "no changes\n"


def test_diff_prints_the_first_divergence(call: Call, tmp_path: Path) -> None:
    good = write_bag(tmp_path / "good.bag", good_run())
    bad = write_bag(tmp_path / "bad.bag", [*good_run()[:4], ("progress", tree("pick", FAILURE))])
    status, out, _ = call("diff", good, good)
    assert (status, out.splitlines()[0]) == (0, "the runs are alike")
    status, out, _ = call("diff", good, bad)
    assert status == 1
    assert out.splitlines()[:4] == [
        "first divergence:",
        "  at 0.00 s, node: /robot, task 1: root / pick",
        "  expected: succeeded: pick says so",
        "  got:      failed: pick says so",
    ]
    assert call("diff", good, bad, "--tolerance", "nan")[0] == 2


def test_plot_writes_a_picture_with_bars(call: Call, tmp_path: Path) -> None:
    assert call("plot", BAG, "-o", tmp_path / "run.png")[0] == 0
    with Image.open(tmp_path / "run.png") as image:
        assert image.width > 1000
        colours = {colour for count, colour in image.convert("RGB").getcolors(1 << 24) if count > 500}
    assert {(0, 158, 115), (255, 255, 255)} <= colours
    assert call("plot", BAG, "-o", tmp_path / "no" / "folder.png")[0] == 2


def test_check_fails_on_a_lost_goal(call: Call, tmp_path: Path) -> None:
    assert call("check", BAG)[0] == 0
    lost = write_bag(tmp_path / "lost.bag", [entry for entry in good_run() if entry[0] != "goal"])
    status, out, _ = call("check", lost)
    assert status == 1 and "was sent before the recorder subscribed" in out


@pytest.mark.parametrize("name", [name for name in _COMMANDS if name not in ("restore", "plot", "diff")])
def test_json_output_is_valid(call: Call, name: str, tmp_path: Path) -> None:
    bag = shutil.copy(BAG, tmp_path)  # an export is written beside it
    assert json.loads(call(name, bag, "--json")[1])


@pytest.mark.parametrize("name", list(_COMMANDS))
def test_invalid_bag_is_a_one_line_error(call: Call, name: str, tmp_path: Path) -> None:
    (tmp_path / "x.bag").write_text("x")
    more = [tmp_path / "x.bag"] if name == "diff" else []
    status, out, err = call(name, tmp_path / "x.bag", *more)
    assert (status, out, err.count("\n")) == (2, "", 1)
    assert "x.bag: the bag cannot be read" in err


def test_tables_fit_on_100_columns(call: Call, monkeypatch: pytest.MonkeyPatch) -> None:
    from skiros2_bags.command_line import program
    from skiros2_common.command_line.layout import Screen

    monkeypatch.setattr(program, "screen", lambda: Screen(100))
    for name in ("show", "tasks", "skills", "world", "changes", "check"):
        _, out, _ = call(name, BAG)
        assert max(map(len, out.splitlines())) <= 100, name


def test_invalid_time_is_a_usage_error(call: Call) -> None:
    status, _, err = call("world", BAG, "--at", "tomorrow")
    assert status == 2 and "'tomorrow' is not a time" in err
