"""How the command line shows tasks: as trees, as lines, on a terminal."""

import io
import json
import re

import pytest

from skiros2_common.command_line.layout import Screen
from skiros2_msgs.msg import Param, SkillProgress
from skiros2_runs.core.progress import status_text
from skiros2_runs.core.states import FAILURE, IDLE, RUNNING, SUCCESS, TaskState
from skiros2_skill.command_line import views
from skiros2_skill.command_line.tree import Changes, frame_of, picture
from skiros2_skill.command_line.views import JsonView, LineView, view_of
from support.terminal import Terminal

ROOT = 100


def node(number, label, state, *, under=ROOT, processor="", message="", code=0, seconds=0.0):
    return SkillProgress(
        id=number, parent_id=under, type=f"skiros:{label.capitalize()}", label=label, state=state,
        processor=processor, progress_message=message, progress_code=code, progress_time=seconds,
    )  # fmt: skip


def task(*nodes, state=RUNNING, message="", number=ROOT):
    ended = {SUCCESS: 1, FAILURE: -1}.get(state, 0)
    root = SkillProgress(
        id=number, task_id=number, parent_id=-1, type=":Root", label="root", robot="/arm", state=state,
        progress_code=ended, progress_message=message,
    )  # fmt: skip
    return [root, *nodes]


FETCH = [
    node(1, "fetch", RUNNING, processor="->*"),
    node(2, "drive", SUCCESS, under=1, seconds=2.04, message="arrived"),
    node(3, "grasp", RUNNING, under=1, seconds=0.5, message="closing\nslowly"),
    node(4, "", IDLE, under=1),
]


def lines(nodes, screen=Screen(), most=None):  # noqa: B008
    return [line.text for line in picture(screen, frame_of(nodes), "/arm", most)]


# -- the tree ----------------------------------------------------------------------------------------------------------


def test_tree_shows_states_processors_times_and_messages():
    assert lines(task(*FETCH)) == [
        "task 100 on /arm: running",
        "▶ fetch ->*   running",
        "├── ✓ drive   succeeded  2.0 s  arrived",
        "├── ▶ grasp   running    0.5 s  closing",
        "└── ○ node 4  idle",
    ]


def test_root_shows_why_it_failed_or_is_paused():
    assert lines(task(state=FAILURE, message="too heavy")) == ["task 100 on /arm: failed: too heavy"]
    paused = task(message="paused at breakpoint 1")
    paused[0].params.append(Param(status_text(TaskState.PAUSED)))
    assert lines(paused) == ["task 100 on /arm: paused at breakpoint 1"]
    ending = task(state=FAILURE, message="ending: on_preempt of skiros:Hold-hold (skiros:PutDown)")
    ending[0].progress_code = 0
    ending[0].params.append(Param(status_text(TaskState.ENDING)))
    assert lines(ending) == ["task 100 on /arm: ending: on_preempt of skiros:Hold-hold (skiros:PutDown)"]
    assert lines(task(state=SUCCESS, message="Success")) == ["task 100 on /arm: succeeded"]


def test_failure_shows_its_code():
    assert lines(task(node(1, "grasp", FAILURE, message="too heavy", code=-7)))[1].endswith("too heavy (-7)")


def test_each_state_has_a_colour():
    nodes = [node(i, "x", state) for i, state in enumerate((SUCCESS, FAILURE, RUNNING, IDLE, 9))]
    colours = [line.colour for line in picture(Screen(), frame_of(task(*nodes)), "/arm")[1:]]
    assert len(set(colours)) == 5


def test_screen_without_unicode_gets_ascii():
    assert all(line.isascii() for line in lines(task(*FETCH), Screen(fancy=False)))


def test_lines_fit_the_screen():
    long = [*FETCH, node(5, "x" * 200, RUNNING, under=3, message="y" * 200)]
    assert max(map(len, lines(task(*long, message="z" * 200), Screen(40)))) <= 40


def test_control_characters_do_not_reach_the_terminal():
    shown = "".join(lines(task(node(1, "a\x1b[2J", RUNNING, message="\x07b"), message="c\x1b")))
    assert "\x1b" not in shown
    assert "\x07" not in shown


def test_idle_subtrees_are_folded_on_a_small_screen():
    quiet = [node(10 + i, f"done{i}", SUCCESS, under=1) for i in range(20)]
    later = [node(40 + i, f"later{i}", IDLE, under=1) for i in range(20)]
    nodes = task(FETCH[0], *quiet, node(35, "grasp", RUNNING, under=1), *later, node(70, "last", IDLE))
    assert len(lines(nodes)) == 44
    assert [" ".join(line.split()) for line in lines(nodes, most=10)] == [
        "task 100 on /arm: running",
        "▶ fetch ->* running",
        "├── 20 more: 20 succeeded",
        "├── ▶ grasp running 0.0 s",
        "└── 20 more: 20 idle",
        "○ last idle",
    ]


def test_hidden_lines_are_counted():
    nodes = task(*[node(i, f"arm{i}", RUNNING) for i in range(30)])
    shown = lines(nodes, most=10)
    assert len(shown) == 10
    assert shown[-1] == "22 more lines"


def test_deep_and_wide_trees_are_shown():
    deep = task(*[node(i, f"n{i}", RUNNING, under=i - 1 if i else ROOT) for i in range(99)])
    deep += [node(i, f"n{i}", RUNNING, under=i - 1 if i > 101 else 98) for i in range(101, 1001)]
    assert len(lines(deep)) == 1000
    assert len(lines(deep, Screen(80), most=24)) == 24
    wide = task(node(1, "all", RUNNING), *[node(200 + i, f"n{i}", IDLE, under=1) for i in range(10_000)])
    assert lines(wide, Screen(80), most=24)[-1] == "└── 10000 more: 10000 idle"


# -- lines for changes -------------------------------------------------------------------------------------------------


class Clock:
    now = 0.0

    def __call__(self):
        return self.now


@pytest.fixture
def clock():
    return Clock()


@pytest.fixture
def changes(clock):
    made = Changes(Screen(), clock)
    return lambda *nodes: [line.text for line in made.lines(task(*nodes))]


def test_each_change_has_a_line_in_tree_order(changes, clock):
    assert changes(*FETCH) == [
        "   0.0 s  ▶ fetch ->*",
        "   0.0 s    ✓ drive  arrived",
        "   0.0 s    ▶ grasp  closing",
    ]
    assert changes(*FETCH) == []
    clock.now = 1.5
    lost = node(3, "grasp", FAILURE, under=1, message="lost", code=-2)
    assert changes(node(1, "fetch", FAILURE, processor="->*"), FETCH[1], lost) == [
        "   1.5 s    ✗ grasp  lost (-2)",
        "   1.5 s  ✗ fetch ->*",
    ]


def test_frequently_changing_message_is_printed_once_a_second(changes, clock):
    assert len(changes(node(1, "drive", RUNNING, message="0 %"))) == 1
    clock.now = 0.9
    assert changes(node(1, "drive", RUNNING, message="45 %")) == []
    clock.now = 1.1
    assert changes(node(1, "drive", RUNNING, message="55 %")) == ["   1.1 s  ▶ drive  55 %"]


def test_restarted_node_is_printed_again(changes):
    assert len(changes(node(1, "drive", SUCCESS))) == 1
    assert changes(node(1, "drive", IDLE)) == []
    assert len(changes(node(1, "drive", SUCCESS))) == 1


# -- views -------------------------------------------------------------------------------------------------------------


def test_lines_of_several_tasks_have_the_task_id():
    out = io.StringIO()
    view = LineView(out, Screen())
    view.show(task(node(1, "drive", RUNNING)))
    view.show(task(node(1, "grasp", RUNNING, under=7), number=7))
    view.show(task(node(1, "drive", SUCCESS), state=SUCCESS, message="Success"))
    told = [re.sub(r" +\d+\.\d s +", " ", line) for line in out.getvalue().splitlines()]
    assert told == [
        "task 100 on /arm", " ▶ drive", "task 7 on /arm", "7: ▶ grasp", "100: ✓ drive", "task 100 on /arm: succeeded",
    ]  # fmt: skip


def test_reused_task_id_starts_a_new_tree():
    out = io.StringIO()
    view = LineView(out, Screen())
    for _ in range(2):
        view.show(task(node(1, "drive", SUCCESS), state=SUCCESS))
    assert out.getvalue().count("✓ drive") == 2


def test_json_has_a_line_for_each_message():
    out = io.StringIO()
    view = JsonView(out)
    view.show(task(*FETCH))
    view.show(task(state=SUCCESS))
    first, last = map(json.loads, out.getvalue().splitlines())
    assert (first["task"], first["state"], first["ended"]) == (100, "running", False)
    assert [(n["label"], n["state"], n["parent"]) for n in first["nodes"][1:3]] == [
        ("drive", "success", 1), ("grasp", "running", 1),
    ]  # fmt: skip
    assert (last["state"], last["ended"]) == ("success", True)


@pytest.fixture
def live(monkeypatch):
    """A terminal of 60 x 12 and what stands on it."""
    monkeypatch.setenv("COLUMNS", "60")
    monkeypatch.setenv("LINES", "12")
    monkeypatch.setattr(views, "screen", lambda: Screen(60))
    monkeypatch.setenv("TERM", "xterm")
    out = Terminal()
    view = view_of(out, Screen(60), idle="no task runs on /arm; Ctrl-C ends")

    def shown(*tasks):
        for nodes in tasks:
            view.show(nodes)
        view.draw()
        return _standing(out.getvalue())

    return shown


def _standing(written):
    """The lines on a terminal that was sent this, without colours."""
    standing: list[str] = []
    for part in re.split(r"(\x1b\[\d+A\x1b\[J)", re.sub(r"\x1b\[\d+m", "", written)):
        back = re.match(r"\x1b\[(\d+)A", part)
        if back:
            standing = standing[: len(standing) - int(back[1])]
        else:
            standing += part.splitlines()
    return standing


def test_terminal_is_redrawn_in_place(live):
    assert live() == ["no task runs on /arm; Ctrl-C ends"]
    assert live(task(node(1, "drive", RUNNING))) == ["task 100 on /arm: running", "▶ drive  running  0.0 s"]
    moved = [*task(node(1, "drive", RUNNING, seconds=1.0)), node(2, "grasp", IDLE)]
    assert live(moved) == ["task 100 on /arm: running", "▶ drive  running  1.0 s", "○ grasp  idle"]


def test_ended_task_stays_above(live):
    live(task(node(1, "drive", RUNNING)))
    done = live(task(node(1, "drive", SUCCESS), state=SUCCESS))
    assert done == ["task 100 on /arm: succeeded", "✓ drive  succeeded  0.0 s", "no task runs on /arm; Ctrl-C ends"]
    assert live(task(node(1, "grasp", RUNNING), number=ROOT))[:2] == done[:2]


@pytest.mark.parametrize(("variable", "value", "redrawn"), [("TERM", "dumb", False), ("NO_COLOR", "1", True)])
def test_view_without_colours(monkeypatch, variable, value, redrawn):
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv(variable, value)
    out = Terminal()
    view = view_of(out, Screen(60))
    for seconds in (0.0, 1.0):
        view.show(task(node(1, "drive", RUNNING, seconds=seconds)))
        view.draw()
    assert "\x1b[36m" not in out.getvalue()
    assert ("A\x1b[J" in out.getvalue()) is redrawn


def test_several_tasks_share_the_terminal(live):
    wide = [task(*[node(i, f"n{i}", RUNNING) for i in range(20)], number=n) for n in (100, 100, 7)]
    for nodes in wide:
        for one in nodes[1:]:
            one.parent_id = nodes[0].id
    shown = live(*wide)
    assert len(shown) <= 11
    assert [line.split()[1] for line in shown if line.startswith("task")] == ["7", "100"]
