"""Tables and trees as plain text."""

from __future__ import annotations

import functools
import unicodedata
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field

#: No column is made narrower than so many letters.
_NARROW = 8


@dataclass(frozen=True)
class Screen:
    """What text is shown on.

    :param width: its columns; None: lines may be of any length, as in files and pipes.
    :param fancy: it shows more letters than those of ASCII.
    """

    width: int | None = None
    fancy: bool = True

    def fitted(self, line: str) -> str:
        """A text as one line, cut where the screen ends."""
        line = plain(line)
        return line if self.width is None else cut(line, self.width)


@dataclass
class Branch:
    """A node of a tree.

    :param cells: what is shown of it: the first in the tree, the others in columns beside it.
    """

    cells: Sequence[str]
    branches: list[Branch] = field(default_factory=list)


def table(screen: Screen, rows: Iterable[Sequence[str]], headers: Sequence[str] = ()) -> list[str]:
    """The rows in columns; what does not fit on the screen is cut, in the first column last."""
    lines = [[plain(cell) for cell in row] for row in ([headers] if headers else [])] + [
        [plain(cell) for cell in row] for row in rows
    ]
    columns = max(map(len, lines), default=0)
    lines = [[*line, *[""] * (columns - len(line))] for line in lines]
    widths = _fitting([max(columns_of(line[i]) for line in lines) for i in range(columns)], screen.width)
    if headers and lines:
        lines.insert(1, ["-" * width for width in widths])
    return ["  ".join(_padded(cut(c, w), w) for c, w in zip(line, widths, strict=True)).rstrip() for line in lines]


def tree(screen: Screen, roots: Iterable[Branch]) -> list[str]:
    """The trees, with the further cells in columns."""
    return table(screen, [[text, *branch.cells[1:]] for branch, text in drawn(screen, roots)])


def drawn(screen: Screen, roots: Iterable[Branch]) -> Iterator[tuple[Branch, str]]:
    """The branches as they stand one below the other, each with its first cell as it is drawn."""
    marks = ("├── ", "└── ", "│   ") if screen.fancy else ("|-- ", "`-- ", "|   ")
    # (a branch, what stands before its own line, what stands before those of its branches)
    waiting = [(root, "", "") for root in roots][::-1]
    while waiting:
        branch, before, below = waiting.pop()
        yield branch, before + plain(branch.cells[0])
        steps = [(marks[0], marks[2])] * (len(branch.branches) - 1) + [(marks[1], "    ")]
        children = zip(branch.branches, steps, strict=False)
        waiting += [(child, below + mark, below + bar) for child, (mark, bar) in children][::-1]


def plain(text: str) -> str:
    """The text on one line, without what would steer a terminal."""
    return text if text.isprintable() else "".join(c if c.isprintable() else repr(c)[1:-1] for c in text)


def columns_of(text: str) -> int:
    """How many columns a text takes."""
    if text.isascii():
        return len(text)
    return sum(map(_columns_of_letter, text))


@functools.lru_cache(maxsize=4096)
def _columns_of_letter(letter: str) -> int:
    return 0 if unicodedata.combining(letter) else 2 if unicodedata.east_asian_width(letter) in "WF" else 1


def cut(text: str, width: int) -> str:
    """The text in so many columns, with two dots where something is left out."""
    if columns_of(text) <= width:
        return text
    room = width - 2
    for at, letter in enumerate(text):
        room -= columns_of(letter)
        if room < 0:
            return text[:at] + ".."
    return text


def _padded(text: str, width: int) -> str:
    return text + " " * (width - columns_of(text))


def _fitting(widths: list[int], room: int | None) -> list[int]:
    """The widths of columns, made so narrow that all fit: the widest first, but the first one last."""
    if room is None:
        return widths
    room -= 2 * (len(widths) - 1)
    while sum(widths) > room and max(widths) > _NARROW:
        widest = max(widths[1:], default=0)
        widths[widths.index(widest, 1) if widest > _NARROW else 0] -= 1
    return widths
