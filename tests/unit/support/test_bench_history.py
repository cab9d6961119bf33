"""Figures of the benchmarks are kept with their commit."""

from __future__ import annotations

import itertools
import subprocess
from pathlib import Path

import pytest
from matplotlib.figure import Figure
from matplotlib.image import imread
from matplotlib.text import Text
from PIL import Image

from benchmarks.history import clean_commit, keep
from benchmarks.measurement import Measurement


def figure(name: str, ratio: float) -> Measurement:
    return Measurement(name, 2.0 * ratio, "ms", 5, "the peer", 2.0, ratio, 0.5)


def rows(docs: Path) -> list[list[str]]:
    lines = (docs / "bench.md").read_text().splitlines()
    return [[cell.strip() for cell in line.split("|")[1:-1]] for line in lines if line.startswith("| a ")]


def test_page_has_the_last_ratio_beside_the_one_before(tmp_path: Path) -> None:
    keep(tmp_path / "h", tmp_path, "aaaa", 0.1, [figure("a tick", 0.4)])
    keep(tmp_path / "h", tmp_path, "bbbb", 0.2, [figure("a tick", 0.1)])
    assert rows(tmp_path) == [["a tick", "0.2 ms", "the peer: 2 ms", "0.10", "0.5", "0.40", "bbbb"]]
    assert len(Image.open(tmp_path / "bench.png").getcolors(1 << 20) or ()) > 5


def test_figure_that_was_zero_has_a_row_but_no_line(tmp_path: Path) -> None:
    keep(tmp_path / "h", tmp_path, "aaaa", 0.1, [figure("a failure", 0.0), figure("a tick", 0.4)])
    assert [(row[0], row[3]) for row in rows(tmp_path)] == [("a failure", "0.00"), ("a tick", "0.40")]
    assert (tmp_path / "bench.png").is_file()


def test_figures_with_the_same_name_and_different_peers_have_a_row_each(tmp_path: Path) -> None:
    slower = Measurement("a save", 3.0, "s", 2, "the other peer", 1.0, 3.0)
    keep(tmp_path / "h", tmp_path, "aaaa", 0.1, [slower, figure("a save", 0.4)])
    assert [(row[0], row[3]) for row in rows(tmp_path)] == [
        ("a save, beside the other peer", "3.00"),
        ("a save", "0.40"),
    ]


@pytest.mark.parametrize("ratios", [[0.5] * 60, [0.001, 0.5, 0.5], [2.0, 2.01, 9.0, 9.0]])
def test_names_in_the_picture_do_not_overlap(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, ratios: list[float]
) -> None:
    names = [f"figure {number} of a part with a long name, {'beside a peer, ' * 5}" for number in range(len(ratios))]
    drawn: list[Figure] = []
    monkeypatch.setattr("matplotlib.pyplot.close", drawn.append)
    keep(tmp_path / "h", tmp_path, "aaaa", 0.1, [figure(name, 1.0) for name in names])
    ended, last = zip(names[::2], ratios[::2], strict=True), zip(names[1::2], ratios[1::2], strict=True)
    keep(tmp_path / "h", tmp_path, "bbbb", 0.1, [figure(*each) for each in ended])
    keep(tmp_path / "h", tmp_path, "cccc", 0.1, [figure(*each) for each in last])
    [axes] = drawn[-1].axes
    boxes = [Text.get_window_extent(text) for text in axes.texts]
    assert len(boxes) == len(names)
    assert all(axes.get_window_extent().y0 < box.y0 and box.y1 < axes.get_window_extent().y1 for box in boxes)
    assert not [1 for one, other in itertools.combinations(boxes, 2) if one.overlaps(other)]
    [picture] = tmp_path.glob("**/*.png")
    assert imread(picture).shape[1] > max(box.x1 for box in boxes) - axes.get_tightbbox().x0  # no name is cut


def test_parts_that_are_measured_later_are_added_to_their_commit(tmp_path: Path) -> None:
    keep(tmp_path / "h", tmp_path, "aaaa", 0.1, [figure("a tick", 0.4), figure("a plan", 1.0)])
    keep(tmp_path / "h", tmp_path, "bbbb", 0.1, [figure("a tick", 0.3)])
    keep(tmp_path / "h", tmp_path, "bbbb", 0.1, [figure("a tick", 0.2), figure("a start", 2.0)])
    assert [(row[0], row[3], row[5], row[6]) for row in rows(tmp_path)] == [
        ("a tick", "0.20", "0.40", "bbbb"), ("a plan", "1.00", "", "aaaa"), ("a start", "2.00", "", "bbbb"),
    ]  # fmt: skip


def test_figures_of_changes_that_are_not_committed_are_refused(tmp_path: Path) -> None:
    git = ["git", "-C", str(tmp_path), "-c", "user.name=a", "-c", "user.email=a@b"]
    subprocess.run([*git, "init", "-q"], check=True)
    subprocess.run([*git, "commit", "-q", "--allow-empty", "-m", "first"], check=True)
    assert len(clean_commit(tmp_path)) == 8
    (tmp_path / "new.py").touch()
    with pytest.raises(ValueError, match=r"new\.py"):
        clean_commit(tmp_path)
