"""The widgets of the tab "Running"."""

from __future__ import annotations

import math
import random
import time
from collections.abc import Iterator
from functools import partial

import pytest
from pytestqt.qtbot import QtBot
from python_qt_binding.QtCore import QPointF, Qt, QTimer, QUrl
from python_qt_binding.QtGui import QPalette
from python_qt_binding.QtWidgets import (
    QAbstractButton,
    QAction,
    QCheckBox,
    QLabel,
    QLineEdit,
    QListWidget,
    QSlider,
    QTabWidget,
    QTreeWidget,
)

from skiros2_common.core.params import ParamTypes
from skiros2_common.core.primitive import PrimitiveBase
from skiros2_common.core.world_element import Element
from skiros2_gui.app.events import ElementSelected, TaskStarted
from skiros2_gui.app.names import Names
from skiros2_gui.app.window import Window
from skiros2_gui.run.node import ConditionText, NodeText
from skiros2_gui.run.widgets.side_tabs import BreakpointPanel, MessageList, NodeDetails
from skiros2_gui.run.widgets.tab import RunTab
from skiros2_live.core.patch import TaskProgress
from skiros2_skill.client.description import Step
from support.progress import FAILURE, RUNNING, SUCCESS, ProgressNode, pick_and_place, random_tree
from support.recorded_run import ROOT
from support.window.local_system import LocalManager
from unit.skiros2_skill.skills import describe


@pytest.fixture
def tab(window: Window, qtbot: QtBot) -> RunTab:
    made = RunTab(window)
    qtbot.addWidget(made, before_close_func=RunTab.close_tab)
    made.resize(1200, 700)
    made.show()
    return made


def tell(window: Window, nodes: list[ProgressNode], at: float = 1000.0, robot: str = "/robot") -> None:
    window.publish(TaskProgress(robot, nodes, at))


def drawn(tab: RunTab, qtbot: QtBot) -> None:
    """Waits until all that was told is drawn."""
    qtbot.waitUntil(lambda: tab.is_drawn)


def details_of(tab: RunTab) -> NodeDetails:
    return tab.findChild(NodeDetails, "nodeDetails")


def search_of(tab: RunTab) -> QLineEdit:
    return tab.findChild(QLineEdit, "nodeSearch")


def count_of(tab: RunTab) -> str:
    return tab.findChild(QLabel, "nodeCount").text()


def follow_of(tab: RunTab) -> QCheckBox:
    return tab.findChild(QCheckBox, "follow")


def side_tabs(tab: RunTab) -> QTabWidget:
    return tab.findChild(QTabWidget, "runBeside")


def messages_of(tab: RunTab) -> MessageList:
    """The list of messages, brought to the front."""
    messages = tab.findChild(MessageList, "messages")
    side_tabs(tab).setCurrentWidget(messages)
    return messages


def click(tab: RunTab, qtbot: QtBot, place: int, offset: QPointF | None = None, double: bool = False) -> None:
    rect = tab.view.item.rect_of(place)
    point = tab.view.mapFromScene(rect.center() if offset is None else offset)
    (qtbot.mouseDClick if double else qtbot.mouseClick)(tab.view.viewport(), Qt.LeftButton, pos=point)


def test_tab_without_task_shows_a_hint(tab: RunTab) -> None:
    assert tab.findChild(QLabel, "noTask").isVisible() and not tab.view.isVisible()


def test_task_is_drawn_in_the_colours_of_its_states(tab: RunTab, window: Window, qtbot: QtBot) -> None:
    tell(window, pick_and_place(SUCCESS, RUNNING))
    drawn(tab, qtbot)
    tab.view.full_size()
    tints = set()
    for place in (1, 3, 4):  # success, idle, running
        tab.view.centerOn(tab.view.item.rect_of(place).center())
        inside = tab.view.item.rect_of(place).topLeft() + QPointF(6, 6)
        image = tab.view.viewport().grab().toImage()
        tints.add(image.pixelColor(tab.view.mapFromScene(inside)).name())
    assert len(tints) == 3
    assert tab.view.palette().color(QPalette.Base).name() not in tints
    assert tab.findChild(QTreeWidget, "taskChoice").topLevelItem(0).text(0) == "pick, place"


def test_click_selects_a_node_and_shows_its_details(tab: RunTab, window: Window, qtbot: QtBot) -> None:
    nodes = pick_and_place(FAILURE)
    nodes[2].progress_message = "<b>no</b> way & stop"
    tell(window, nodes)
    drawn(tab, qtbot)
    click(tab, qtbot, 2)
    drawn(tab, qtbot)
    text = details_of(tab).toPlainText()
    assert "move_arm" in text and "✗ failed" in text and "<b>no</b> way & stop" in text
    assert "MoveArm" in text and "pick" in text


def test_nodes_are_folded_by_mark_double_click_and_return(tab: RunTab, window: Window, qtbot: QtBot) -> None:
    tell(window, pick_and_place())
    drawn(tab, qtbot)
    rect = tab.view.item.rect_of(1)
    click(tab, qtbot, 1, QPointF(rect.right() - 6, rect.center().y()))
    drawn(tab, qtbot)
    assert tab.presenter.tree.drawing.hidden == {1: 2}
    click(tab, qtbot, 1, double=True)
    drawn(tab, qtbot)
    assert tab.presenter.tree.drawing.hidden == {}
    tab.presenter.select(1)
    qtbot.keyClick(tab.view, Qt.Key_Return)
    assert tab.presenter.tree.drawing.hidden == {1: 2}


def test_arrow_keys_navigate_the_tree(tab: RunTab, window: Window, qtbot: QtBot) -> None:
    tell(window, pick_and_place())
    drawn(tab, qtbot)
    seen = []
    for key in (Qt.Key_Right, Qt.Key_Right, Qt.Key_Up, Qt.Key_Right, Qt.Key_Up, Qt.Key_Left):
        qtbot.keyClick(tab.view, key)
        place = tab.presenter.tree.selected_index()
        seen.append(tab.presenter.frame.shape.name(place))
    assert seen == ["task 5", "place", "pick", "close_gripper", "move_arm", "pick"]


def test_search_unfolds_and_cycles_through_results(tab: RunTab, window: Window, qtbot: QtBot) -> None:
    tell(window, random_tree(1000))
    drawn(tab, qtbot)
    tab.presenter.change_folds(lambda tree, _: tree.fold_to(1))
    tab.find()
    assert search_of(tab).hasFocus()
    qtbot.keyClicks(search_of(tab), "skill_77")
    drawn(tab, qtbot)
    assert count_of(tab) == "11 found"
    shape, first = tab.presenter.frame.shape, tab.presenter.tree.selected_index()
    qtbot.keyClick(search_of(tab), Qt.Key_Return)
    second = tab.presenter.tree.selected_index()
    assert first != second
    assert all(shape.label(place).startswith("skill_77") for place in (first, second))
    assert tab.presenter.tree.drawing.is_drawn(second)
    visible = tab.view.mapToScene(tab.view.viewport().rect()).boundingRect()
    assert visible.contains(tab.view.item.rect_of(second).center())


def test_slider_selects_ticks_and_button_returns_to_live(tab: RunTab, window: Window, qtbot: QtBot) -> None:
    for second, (pick, place) in enumerate([(RUNNING, 4), (SUCCESS, RUNNING), (SUCCESS, SUCCESS)]):
        tell(window, pick_and_place(pick, place), 1000.0 + second)
    drawn(tab, qtbot)
    slider = tab.findChild(QSlider, "historySlider")
    assert (slider.maximum(), slider.value()) == (2, 2)
    slider.setValue(0)
    drawn(tab, qtbot)
    assert tab.presenter.frame.state(1) == RUNNING
    assert tab.findChild(QLabel, "historyLabel").text().startswith("tick 1 of 3, ")
    tell(window, pick_and_place(SUCCESS, FAILURE), 1003.0)  # it goes on meanwhile
    drawn(tab, qtbot)
    assert (slider.maximum(), slider.value()) == (3, 0)
    assert tab.presenter.frame.state(1) == RUNNING
    qtbot.mouseClick(button(tab, "historyLive"), Qt.LeftButton)
    drawn(tab, qtbot)
    assert tab.presenter.frame.state(4) == FAILURE


def test_message_selects_its_node_and_tick(tab: RunTab, window: Window, qtbot: QtBot) -> None:
    tell(window, pick_and_place(RUNNING), 1000.0)
    tell(window, pick_and_place(SUCCESS, RUNNING), 1002.0)
    messages = messages_of(tab)
    rows = messages.rows.rows
    line = next(row.item for row in rows if "pick running" in row.cells[0])
    messages.picked.emit(line)
    assert tab.presenter.tick == 0
    assert tab.presenter.tree.selected == 100


def test_messages_have_labels_instead_of_ids(tab: RunTab, window: Window, qtbot: QtBot) -> None:
    tray = Element("skiros:LargeBox", "Tray B")
    tray.addRelation("skiros:Scene-0", "skiros:contain", "-1")
    eid = window.system.world.add_element(tray).id
    nodes = pick_and_place(FAILURE)
    nodes[1].progress_message = f"expected {eid}-Tray B skiros:at Dock"
    tell(window, nodes)
    row = next(row for row in messages_of(tab).rows.rows if row.item.name == "pick")
    assert row.cells[0].endswith("pick: expected Tray B is at Dock")
    assert row.tip == f"expected {eid}-Tray B skiros:at Dock"


def test_picked_or_started_task_is_shown(tab: RunTab, window: Window, qtbot: QtBot) -> None:
    tell(window, pick_and_place(task_id=1))
    tell(window, pick_and_place(task_id=2))
    drawn(tab, qtbot)
    assert tab.presenter.run.task_id == 1
    tasks = tab.findChild(QTreeWidget, "taskChoice")
    tasks.setCurrentItem(tasks.topLevelItem(1))
    assert tab.presenter.run.task_id == 2
    window.publish(TaskStarted("/robot", 3))
    tell(window, pick_and_place(task_id=3))
    assert tab.presenter.run.task_id == 3


def test_bag_is_opened_and_closed(tab: RunTab, window: Window, qtbot: QtBot) -> None:
    tell(window, pick_and_place())
    tab.presenter.open_bag(str(ROOT / "tests/bags/timed_pick_place.bag"))
    drawn(tab, qtbot)
    presenter = tab.presenter
    assert presenter.tick == 0 and len(presenter.run) > 3
    slider = tab.findChild(QSlider, "historySlider")
    slider.setValue(slider.maximum())
    drawn(tab, qtbot)
    assert presenter.run.latest.has_ended
    assert {presenter.frame.state(place) for place in range(len(presenter.frame.shape))} == {SUCCESS}
    presenter.close_bag()
    drawn(tab, qtbot)
    assert presenter.run.robot == "/robot"


@pytest.mark.parametrize("name", ["none.bag", "text.bag"])
def test_invalid_bag_is_reported(tab: RunTab, window: Window, tmp_path, name: str) -> None:
    (tmp_path / "text.bag").write_text("hello")
    tell(window, pick_and_place())
    tab.presenter.open_bag(str(tmp_path / name))
    assert name in window.problems.newest.line
    assert tab.presenter.bag is None and tab.presenter.run is not None


def test_large_tree_is_folded_at_first(tab: RunTab, window: Window, qtbot: QtBot) -> None:
    nodes = random_tree(10_000)
    tell(window, nodes)
    drawn(tab, qtbot)
    assert 1 < len(tab.presenter.tree.drawing.drawn) <= 1500
    tab.presenter.select(9_999)
    drawn(tab, qtbot)
    assert tab.presenter.tree.drawing.is_drawn(9_999)
    tab.view.fit()
    assert not tab.view.grab().isNull()


def test_hidden_tab_is_not_drawn(tab: RunTab, window: Window, qtbot: QtBot) -> None:
    tab.hide()
    tell(window, pick_and_place())
    assert not tab.is_drawn and not tab.view.isVisible()
    tab.show()
    assert tab.is_drawn and tab.view.isVisible()


def test_settings_are_restored_and_invalid_ones_skipped(tab: RunTab) -> None:
    follow_of(tab).setChecked(False)
    side_tabs(tab).setCurrentIndex(2)
    kept = tab.settings()
    follow_of(tab).setChecked(True)
    tab.restore({"sizes": 7, "follow": "no", "beside": None, "folder": []})
    assert follow_of(tab).isChecked()
    tab.restore(kept)
    assert not follow_of(tab).isChecked() and side_tabs(tab).currentIndex() == 2


def test_context_menu_folds_a_node(tab: RunTab, window: Window, qtbot: QtBot) -> None:
    tell(window, pick_and_place())
    drawn(tab, qtbot)
    menu = tab.view.menu_for(1)
    actions: dict[str, QAction] = {action.text(): action for action in menu.actions()}
    assert {"Fold", "Pause before it starts", "Pause when it ends", "Unfold all"} <= actions.keys()
    actions["Fold"].trigger()
    assert tab.presenter.tree.drawing.hidden == {1: 2}


def test_zoom_is_limited(tab: RunTab, window: Window, qtbot: QtBot) -> None:
    tell(window, pick_and_place(), time.time())
    drawn(tab, qtbot)
    for key in [Qt.Key_Minus] * 60 + [Qt.Key_Plus] * 90:
        qtbot.keyClick(tab.view, key)
    assert tab.view.scale_now == pytest.approx(4.0)
    qtbot.keyClick(tab.view, Qt.Key_0)
    assert tab.view.scale_now == pytest.approx(1.0)


def test_tab_fits_a_small_screen(tab: RunTab) -> None:
    assert tab.minimumSizeHint().width() < 700
    assert tab.minimumSizeHint().height() < 500


class Waiting(PrimitiveBase):
    """Runs until it is ended from outside."""

    def createDescription(self) -> None:
        wait = describe("Wait", [("Place", Element("skiros:Container"), ParamTypes.Inferred)])
        self.setDescription(wait(), "waiting")

    def execute(self) -> object:
        return self.step("waiting")


@pytest.fixture
def waiting(tab: RunTab, window: Window, qtbot: QtBot) -> Iterator[LocalManager]:
    """A robot that runs a skill, which is selected."""
    box = Element("skiros:Container", "box")
    box.addRelation("skiros:Scene-0", "skiros:contain", "-1")
    window.system.world.add_element(box)
    robot = window.system.add_manager("/robot", [Waiting])
    news = QTimer()
    news.timeout.connect(window.process_events)
    news.start(10)
    robot.command("start", -1, [Step("skiros:Wait", "waiting")])
    qtbot.waitUntil(lambda: tab.presenter.frame is not None and bool(tab.presenter.running()))
    tab.presenter.select(1)
    drawn(tab, qtbot)
    yield robot
    news.stop()


def button(tab: RunTab, name: str) -> QAbstractButton:
    return tab.findChild(QAbstractButton, name)


def test_task_is_paused_stepped_and_stopped_by_clicks(tab: RunTab, waiting: LocalManager, qtbot: QtBot) -> None:
    qtbot.mouseClick(button(tab, "pauseButton"), Qt.LeftButton)
    qtbot.waitUntil(lambda: button(tab, "pauseButton").text().endswith("Resume"))
    code = tab.presenter.frame.code(1)
    qtbot.mouseClick(button(tab, "stepButton"), Qt.LeftButton)
    qtbot.waitUntil(lambda: tab.presenter.frame.code(1) == code + 1)
    tab.toggle()
    qtbot.waitUntil(lambda: button(tab, "pauseButton").text().endswith("Pause"))
    qtbot.mouseClick(button(tab, "stopButton"), Qt.LeftButton)
    qtbot.waitUntil(lambda: not button(tab, "stopButton").isEnabled())
    assert tab.presenter.run.latest.has_ended


def test_click_on_an_element_selects_it_in_other_tabs(
    tab: RunTab, waiting: LocalManager, window: Window, qtbot: QtBot
) -> None:
    chosen: list[str] = []
    window.subscribe(ElementSelected, lambda event: chosen.append(event.eid))
    qtbot.waitUntil(lambda: "box" in details_of(tab).toPlainText())
    details_of(tab).anchorClicked.emit(QUrl("#skirOS:Container-1"))
    assert chosen == ["skirOS:Container-1"]
    assert 'href="#skiros:Container-' in details_of(tab).toHtml()


def test_breakpoints_are_added_shown_and_removed(tab: RunTab, waiting: LocalManager, qtbot: QtBot) -> None:
    panel = tab.findChild(BreakpointPanel)
    side_tabs(tab).setCurrentWidget(panel)
    pattern, listed = panel.findChild(QLineEdit, "breakpointPattern"), panel.findChild(QListWidget, "breakpoints")
    assert not button(tab, "breakpointAdd").isEnabled()
    qtbot.keyClicks(pattern, "wait*")
    qtbot.mouseClick(button(tab, "breakpointAdd"), Qt.LeftButton)
    qtbot.waitUntil(lambda: listed.count() == 1)
    assert listed.item(0).text() == "before the start of node wait*"
    assert pattern.text() == ""
    assert [b.pattern for b in waiting.breakpoints().values()] == ["wait*"]
    listed.setCurrentRow(0)
    qtbot.mouseClick(button(tab, "breakpointRemove"), Qt.LeftButton)
    qtbot.waitUntil(lambda: listed.count() == 0)
    assert waiting.breakpoints() == {}


def test_banner_shows_why_a_task_is_paused_or_failed(tab: RunTab, window: Window, qtbot: QtBot) -> None:
    note = tab.findChild(QLabel, "taskNote")
    tell(window, pick_and_place())
    drawn(tab, qtbot)
    assert not note.isVisible()
    tell(window, pick_and_place(message="paused at breakpoint 1: before the start of skiros:Place-place"), 1001.0)
    drawn(tab, qtbot)
    assert note.isVisible() and note.text().startswith("paused at breakpoint 1")
    waits = note.palette().color(QPalette.Window)
    tell(window, pick_and_place(FAILURE, state=FAILURE, code=-1, message="move_arm: no <b>way</b>"), 1002.0)
    drawn(tab, qtbot)
    assert note.text() == "move_arm: no <b>way</b>"
    assert note.palette().color(QPalette.Window) != waits
    tab.presenter.go_to(0)
    drawn(tab, qtbot)
    assert not note.isVisible()


def test_each_task_has_its_own_search(tab: RunTab, window: Window, qtbot: QtBot) -> None:
    tell(window, pick_and_place(task_id=1))
    tell(window, pick_and_place(task_id=2))
    drawn(tab, qtbot)
    qtbot.keyClicks(search_of(tab), "arm")
    first, second = list(tab.presenter.runs)
    tab.presenter.pick(second)
    drawn(tab, qtbot)
    assert (search_of(tab).text(), count_of(tab)) == ("", "5 nodes")
    tab.presenter.pick(first)
    drawn(tab, qtbot)
    assert (search_of(tab).text(), count_of(tab)) == ("arm", "1 found")


@pytest.fixture
def details(window: Window, qtbot: QtBot) -> NodeDetails:
    """The page of a node in a scene with two elements "arm"."""
    for _ in range(2):
        arm = Element("rparts:ArmDevice", "arm")
        arm.addRelation("skiros:Scene-0", "skiros:contain", "-1")
        window.system.world.add_element(arm)
    shown = NodeDetails(Names(window.system))
    qtbot.addWidget(shown)
    return shown


def test_conditions_are_shown_in_words(details: NodeDetails) -> None:
    robot, place = "cora:Robot-1-demo:arm <1>", "demo:Workstation-6-Workstation 1"
    told = [
        ConditionText("while it runs", "✗", f"{robot} skiros:at {place}", f"{robot} skiros:at nothing", [robot, place]),
        ConditionText("at the end", "✓", "skiros:Box-3 skiros:ContainerState = 'Empty'", "", []),
    ]
    details.show_node(NodeText("place", RUNNING, [], told))
    text = details.toPlainText()
    assert "arm <1> is at Workstation 1" in text and "but arm <1> is at nothing" in text
    assert "demo:" not in text
    assert "skiros:Box-3 container state = 'Empty'" in text


def test_parameters_show_ids_only_of_labels_that_are_not_unique(details: NodeDetails) -> None:
    params = [("Arm", "rparts:ArmDevice-3-arm", "given"), ("Object", "skiros:Product-14-Product A", "inferred")]
    details.show_node(NodeText("pick", RUNNING, params=params))
    text = details.toPlainText()
    assert "arm ArmDevice-3" in text
    assert "Product A" in text and "Product-14" not in text


def test_tab_accepts_any_messages_and_user_actions(tab: RunTab, window: Window, qtbot: QtBot) -> None:
    """Trees change shape between any two steps of the user; ids, states, times and texts make no sense."""
    chance, texts = random.Random(1), ["", "<b>x</b>", "a\nb", "x" * 3000, "skiros:Pick", ":Skill", "%s{}"]

    def node(number: int) -> ProgressNode:
        return ProgressNode(
            chance.choice([0, 5, -1, 32767, number]), chance.randrange(-1, number + 2), chance.choice(texts),
            chance.choice(texts), chance.choice(["", "->*", "odd"]), chance.choice([0, 1, 2, 3, 4, 99, -7]),
            chance.choice([0, 0, 0, -1, 1, -404]), chance.choice([0.0, -1.0, math.nan, math.inf, 1e30]),
            chance.choice(texts), task_id=chance.choice([5, 5, 6, -1]),
        )  # fmt: skip

    presenter = tab.presenter
    for _ in range(150):
        nodes = [node(number) for number in range(chance.randrange(1, 20))]
        tell(window, nodes, chance.choice([time.time(), 0.0, 1.0]))
        place = chance.randrange(len(presenter.frame.shape))
        action = chance.choice([
            lambda: presenter.step(chance.choice([-1, 1, -50])),
            lambda: presenter.go_to(None),
            partial(presenter.select, place),
            partial(presenter.fold, place),
            lambda: presenter.pick(chance.choice(list(presenter.runs))),
            lambda: search_of(tab).setText(chance.choice(["a", "x s", ""])),
            lambda: side_tabs(tab).setCurrentIndex(chance.randrange(4)),
            lambda: qtbot.keyClick(tab.view, chance.choice([Qt.Key_Left, Qt.Key_Down, Qt.Key_Return, Qt.Key_F])),
            lambda: (tab.hide(), tab.show()),
        ])  # fmt: skip
        action()
    drawn(tab, qtbot)
    assert presenter.frame is not None
    assert window.problems.history == []
