"""Keeps figures with their commit, and draws how they have changed: `make bench KEEP=1`.

`tests/benchmarks/history.json` has the figures, oldest commit first; `docs/bench.md` and `docs/bench.png` are made from
it.
"""

from __future__ import annotations

import json
import os
import platform
import subprocess
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from benchmarks.measurement import Measurement

#: A ratio that has changed by more than this factor since it was first kept has a line with its name.
CHANGED = 1.1
#: The size of the names in the picture (points), and the distance of their centres as a factor of it.
_LABEL_SIZE, _LABEL_GAP = 7, 1.4

_PAGE = """# Speed over commits

`make bench` measures the platform beside a peer, or beside the least that the physics or the middleware needs, in the
same run. The ratio is what counts: a slower machine slows both. `make bench KEEP=1` writes this page, on a quiet
machine and a commit without changes; `make bench COMPARE=REV` measures another commit in turn with this one.

![Ratios over commits](bench.png)

Ratios divided by those that were kept first. Lines with a name have changed by more than {percent:.0f} %.

| what | figure | peer | ratio | target | before | commit |
|---|---|---|---|---|---|---|
{rows}

| commit | date | machine | load |
|---|---|---|---|
{commits}
"""


@dataclass(frozen=True)
class Kept:
    """Figures of a commit.

    :param load: of the machine before the first measurement: running processes, mean of a minute.
    """

    commit: str
    date: str
    machine: str
    load: float
    figures: dict[str, Measurement]


def clean_commit(root: Path) -> str:
    """Returns the short id of the commit that is checked out.

    :raises ValueError: something is not committed: the figures would be those of no commit.
    """
    git = ["git", "-C", str(root)]
    changed = subprocess.check_output(
        [*git, "status", "--porcelain", "--", ".", ":!docs", ":!tests/benchmarks/history.json"], text=True
    )
    if changed:
        raise ValueError(f"figures are kept of a commit, but there are changes:\n{changed}")
    return subprocess.check_output([*git, "rev-parse", "--short=8", "HEAD"], text=True).strip()


def keep(file: Path, docs: Path, commit: str, load: float, measured: Sequence[Measurement]) -> None:
    """Adds figures to those that are kept, and writes the page and the picture. Further parts of a commit are added.
    Of figures with the same name, but different peers, the last one has the name alone.

    :param file: the history.
    :param docs: the folder of the page.
    """
    history = _read(file)
    known = history.pop().figures if history and history[-1].commit == commit else {}
    last = {m.name: m for m in measured}
    figures = known | {m.name if m is last[m.name] else f"{m.name}, beside {m.peer}": m for m in measured}
    history.append(Kept(commit, time.strftime("%Y-%m-%d"), _machine(), round(load, 1), figures))
    file.write_text(json.dumps([asdict(kept) for kept in history], indent=1) + "\n")
    (docs / "bench.md").write_text(page(history))
    draw(history, docs / "bench.png")


def page(history: Sequence[Kept]) -> str:
    """Returns the page: the last figure of each name, with the ratio before it."""
    rows = []
    for name in dict.fromkeys(name for kept in history for name in kept.figures):
        having = [kept for kept in history if name in kept.figures]
        m = having[-1].figures[name]
        before = f"{having[-2].figures[name].ratio:.2f}" if len(having) > 1 else ""
        target = "" if m.target is None else f"{m.target:g}"
        rows.append(
            f"| {name} | {m.median:.3g} {m.unit} | {m.peer}: {m.peer_median:.3g} {m.unit} | {m.ratio:.2f} | {target} "
            f"| {before} | {having[-1].commit} |"
        )
    commits = [f"| {kept.commit} | {kept.date} | {kept.machine} | {kept.load:g} |" for kept in history]
    return _PAGE.format(percent=100 * (CHANGED - 1), rows="\n".join(rows), commits="\n".join(commits))


def draw(history: Sequence[Kept], target: Path) -> None:
    """Draws the ratios over commits, divided by the first of each name."""
    import matplotlib

    matplotlib.use("agg")
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(figsize=(10, 6), layout="constrained")
    axes.axhline(1.0, color="0.6", linewidth=0.8)
    labels = []
    for name in dict.fromkeys(name for kept in history for name in kept.figures):
        points = [(i, kept.figures[name].ratio) for i, kept in enumerate(history) if name in kept.figures]
        points = [(i, ratio) for i, ratio in points if ratio > 0.0]  # no failures: nothing to divide by
        if not points:
            continue
        first = points[0][1]
        places, values = [i for i, _ in points], [ratio / first for _, ratio in points]
        has_changed = not 1 / CHANGED <= values[-1] <= CHANGED
        [line] = axes.plot(
            places, values, marker="o", markersize=3, color=None if has_changed else "0.8", zorder=2 + has_changed
        )
        if has_changed:
            labels.append((values[-1], places[-1], name, line.get_color()))
    axes.set_yscale("log")
    axes.yaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_minor_formatter("{x:.1g}")
    axes.set_xticks(range(len(history)), [kept.commit for kept in history], rotation=45, ha="right")
    axes.set_xlim(-0.2, len(history) - 1 + max(0.6, 0.6 * len(history)))  # the names stand on the right
    axes.set_ylabel("ratio to the peer, divided by the first")
    labels.sort()
    gap = _LABEL_GAP * _LABEL_SIZE * figure.dpi / 72
    figure.set_figheight(max(6.0, 2.0 + len(labels) * gap / figure.dpi))  # there is room for all names
    figure.canvas.draw()  # lays it out
    figure.set_layout_engine("none")
    low, high = axes.get_window_extent().intervaly
    wanted = [axes.transData.transform((0.0, value))[1] for value, *_ in labels]
    heights = _spread(wanted, low + gap, high - gap, gap)
    column = axes.transData.transform((len(history) - 0.8, 1.0))[0]
    for (value, place, name, color), height in zip(labels, heights, strict=True):
        axes.annotate(
            name,
            (place, value),
            xytext=(column, height),
            textcoords="figure pixels",
            fontsize=_LABEL_SIZE,
            va="center",
            arrowprops={"arrowstyle": "-", "color": color, "linewidth": 0.5, "shrinkA": 0.0, "relpos": (0.0, 0.5)},
        )
    figure.savefig(target, dpi=figure.dpi, bbox_inches="tight")  # as wide as the longest name
    plt.close(figure)


def _spread(wanted: Sequence[float], low: float, high: float, gap: float) -> list[float]:
    """Returns heights from `low` to `high`, at least a gap from each other, near the wanted ones, which ascend."""
    heights: list[float] = []
    for height in wanted:
        low = max(height, low)
        heights.append(low)
        low += gap
    for index in reversed(range(len(heights))):
        heights[index] = min(heights[index], high)
        high = heights[index] - gap
    return heights


def _read(file: Path) -> list[Kept]:
    if not file.is_file():
        return []
    return [
        Kept(**{**kept, "figures": {name: Measurement(**m) for name, m in kept["figures"].items()}})
        for kept in json.loads(file.read_text())
    ]


def _machine() -> str:
    models = [
        line.partition(": ")[2] for line in Path("/proc/cpuinfo").read_text().splitlines() if "model name" in line
    ]
    return f"{models[0] if models else platform.machine()}, {os.cpu_count()} cores"
