"""Plans and running trees can be read in a terminal, and in a log."""

import io

import pytest

from skiros2_common.core.errors import WrongValue
from skiros2_demo.tree_view import TreeView, plan_lines, tree_lines
from support.recorded_run import FAILURE, IDLE, PLAN, PRODUCT, RUNNING, SUCCESS, TRAY_B, tree

NAMES = {PRODUCT: "Product A", TRAY_B: "Tray B"}


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_a_plan_is_a_numbered_line_for_each_step_without_the_robot() -> None:
    assert plan_lines(PLAN, lambda i: NAMES.get(i, i)) == [
        "1. pick     Object: Product A",
        "2. place    Container: Tray B",
    ]


@pytest.mark.parametrize("text", ["", "[]", '{"children": [{}]}'])
def test_a_text_that_is_no_plan_is_refused(text: str) -> None:
    with pytest.raises(WrongValue, match="the plan cannot be read"):
        plan_lines(text, str)


def test_a_node_is_a_line_with_symbol_label_state_and_message() -> None:
    lines = tree_lines(tree(SUCCESS, RUNNING, root=RUNNING, ended=False))
    assert [line.split() for line in lines] == [
        ["✓", "pick", "Success", "pick", "says", "so"],
        ["▶", "place", "Running", "place", "says", "so"],
    ]


def test_a_child_is_indented_below_its_parent() -> None:
    nodes = tree(RUNNING, IDLE, root=RUNNING, ended=False)
    nodes[2].parent_id = nodes[1].id
    pick, place = tree_lines(nodes)
    assert len(place) - len(place.lstrip()) > len(pick) - len(pick.lstrip())


def test_colours_tell_the_states_apart_on_a_terminal_only() -> None:
    nodes = tree(SUCCESS, FAILURE, root=FAILURE)
    assert [line[:5] for line in tree_lines(nodes, coloured=True)] == ["\033[32m", "\033[31m"]
    assert not any("\033" in line for line in tree_lines(nodes))


def test_a_terminal_shows_the_tree_in_place() -> None:
    out = Terminal()
    view = TreeView(out, width=20)
    view.show(tree(RUNNING, IDLE, root=RUNNING, ended=False))
    view.show(tree(SUCCESS, SUCCESS))
    first, second = out.getvalue().split("\033[2A\033[J")
    assert first.count("\n") == second.count("\n") == 2
    assert "\033[36m▶ pick" in first
    assert "\033[32m✓ pick" in second


def test_a_log_gets_a_line_for_each_change_of_a_state() -> None:
    out = io.StringIO()
    view = TreeView(out)
    running = tree(RUNNING, IDLE, root=RUNNING, ended=False)
    for nodes in (running, running, tree(SUCCESS, RUNNING, root=RUNNING, ended=False), tree(SUCCESS, SUCCESS)):
        view.show(nodes)
    symbols = [line.split()[2:4] for line in out.getvalue().splitlines()]
    assert symbols == [["▶", "pick"], ["✓", "pick"], ["▶", "place"], ["✓", "place"]]


def test_in_a_log_a_skill_ends_after_those_below_it() -> None:
    out = io.StringIO()
    view = TreeView(out)
    for states in ((RUNNING, RUNNING), (SUCCESS, SUCCESS)):
        nodes = tree(*states)
        nodes[2].parent_id = nodes[1].id
        view.show(nodes)
    symbols = [line.split()[2:4] for line in out.getvalue().splitlines()]
    assert symbols == [["▶", "pick"], ["▶", "place"], ["✓", "place"], ["✓", "pick"]]
