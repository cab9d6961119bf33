"""Tables and trees as plain text."""

from __future__ import annotations

import functools
import os
import textwrap
import unicodedata
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TextIO

from skiros2_common.core.wording import visible

#: The minimum width of a column when a table is shrunk.
_MIN_WIDTH = 8


@dataclass(frozen=True)
class Screen:
    """The output medium of text.

    :param width: number of columns; None: unlimited, as in files and pipes.
    :param fancy: whether it supports non-ASCII characters.
    """

    width: int | None = None
    fancy: bool = True

    def fitted(self, line: str) -> str:
        """The text on one line, cut to the width."""
        line = plain(line)
        return line if self.width is None else cut(line, self.width)

    def wrapped(self, text: str, indent: str = "") -> list[str]:
        """The text on as many lines of the width as it needs.

        :param indent: of all lines but the first.
        """
        text = plain(text)
        if self.width is None or columns_of(text) <= self.width:
            return [text]
        start = text[: len(text) - len(text.lstrip())]
        return textwrap.wrap(
            text.strip(), self.width, initial_indent=start, subsequent_indent=indent, break_on_hyphens=False
        )


def can_redraw(out: TextIO) -> bool:
    """Whether lines of a stream can be rewritten: it is a terminal, and `TERM` is not dumb."""
    return out.isatty() and os.environ.get("TERM") != "dumb"


def has_colours(out: TextIO) -> bool:
    """Whether a stream shows colours; the variable `NO_COLOR` turns them off (no-color.org)."""
    return can_redraw(out) and not os.environ.get("NO_COLOR")


def styled(text: str, style: str, out: TextIO) -> str:
    """The text with a style where the stream shows colours.

    :param style: ANSI SGR parameters: "1" bold, "31" red; "" for none.
    """
    return f"\033[{style}m{text}\033[0m" if style and has_colours(out) else text


def next_commands(commands: Mapping[str, str]) -> str:
    """What to type next, at the end of an output: each command with what it does."""
    width = max(map(len, commands))
    return "\n".join(["", "next:", *(f"  {command:<{width}}  # {what}" for command, what in commands.items()), ""])


@dataclass
class Branch:
    """A node of a tree.

    :param cells: its texts: the first in the tree, the others in columns beside it.
    """

    cells: Sequence[str]
    branches: list[Branch] = field(default_factory=list)


def table(screen: Screen, rows: Iterable[Sequence[str]], headers: Sequence[str] = ()) -> list[str]:
    """Formats rows as columns; cells that exceed the screen are cut, those of the first column last."""
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
    """Formats trees with their other cells in columns."""
    return table(screen, [[text, *branch.cells[1:]] for branch, text in drawn(screen, roots)])


def drawn(screen: Screen, roots: Iterable[Branch]) -> Iterator[tuple[Branch, str]]:
    """The branches in order of lines, each with its first cell including the tree lines."""
    lines = ("├── ", "└── ", "│   ") if screen.fancy else ("|-- ", "`-- ", "|   ")
    # (a branch, the prefix of its own line, the prefix of its branches)
    stack = [(root, "", "") for root in roots][::-1]
    while stack:
        branch, prefix, indent = stack.pop()
        yield branch, prefix + plain(branch.cells[0])
        steps = [(lines[0], lines[2])] * (len(branch.branches) - 1) + [(lines[1], "    ")]
        children = zip(branch.branches, steps, strict=False)
        stack += [(child, indent + line, indent + bar) for child, (line, bar) in children][::-1]


def plain(text: str) -> str:
    """The text on one line, with control characters escaped."""
    return visible(text)


def columns_of(text: str) -> int:
    """The number of columns of a text."""
    if text.isascii():
        return len(text)
    return sum(map(_columns_of_letter, text))


@functools.lru_cache(maxsize=4096)
def _columns_of_letter(letter: str) -> int:
    return 0 if unicodedata.combining(letter) else 2 if unicodedata.east_asian_width(letter) in "WF" else 1


def cut(text: str, width: int) -> str:
    """The text cut to `width` columns, with two dots at a cut."""
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
    """The column widths shrunk to fit: the widest column first, but the first one last."""
    if room is None:
        return widths
    room -= 2 * (len(widths) - 1)
    while sum(widths) > room and max(widths) > _MIN_WIDTH:
        widest = max(widths[1:], default=0)
        widths[widths.index(widest, 1) if widest > _MIN_WIDTH else 0] -= 1
    return widths
