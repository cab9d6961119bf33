"""Colours and redrawing only where a stream can show them; lines fit the width."""

import io

import pytest

from skiros2_common.command_line.layout import Branch, Screen, can_redraw, columns_of, has_colours, styled, table, tree
from support.terminal import Terminal


@pytest.fixture(autouse=True)
def _xterm(monkeypatch):
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.delenv("NO_COLOR", raising=False)


def test_terminal_has_colours_and_can_redraw():
    assert can_redraw(Terminal())
    assert styled("failed", "31", Terminal()) == "\033[31mfailed\033[0m"
    assert styled("failed", "", Terminal()) == "failed"


def test_pipe_has_neither():
    assert not can_redraw(io.StringIO())
    assert styled("failed", "31", io.StringIO()) == "failed"


def test_dumb_terminal_has_neither(monkeypatch):
    monkeypatch.setenv("TERM", "dumb")
    assert not can_redraw(Terminal())
    assert not has_colours(Terminal())


@pytest.mark.parametrize(("value", "coloured"), [("1", False), ("0", False), ("", True)])
def test_no_color_turns_off_colours_but_not_redrawing(monkeypatch, value, coloured):
    monkeypatch.setenv("NO_COLOR", value)
    assert can_redraw(Terminal())
    assert has_colours(Terminal()) is coloured


ROWS = [("drive", "skiros:Drive", "StartLocation TargetLocation " * 4), ("größe", "skiros:漢字", "x")]


@pytest.mark.parametrize("width", [40, 80])
def test_table_fits_the_width(width):
    assert max(map(columns_of, table(Screen(width), ROWS, ("skill", "type", "parameters")))) <= width


def test_table_in_a_pipe_is_not_cut():
    assert table(Screen(), ROWS)[0].endswith("StartLocation TargetLocation")


def test_tree_without_unicode_is_ascii():
    drawn = tree(Screen(fancy=False), [Branch(["task"], [Branch(["drive"]), Branch(["pick"])])])
    assert drawn == ["task", "|-- drive", "`-- pick"]
