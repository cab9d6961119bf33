"""The tool bar above the tree, and the slider below it."""

from __future__ import annotations

from collections.abc import Callable

from python_qt_binding.QtCore import Qt, Signal
from python_qt_binding.QtWidgets import (
    QCheckBox,
    QHBoxLayout,
    QLineEdit,
    QMenu,
    QSlider,
    QToolBar,
    QWidget,
)

from skiros2_gui.app.widgets.controls import PlainLabel, plain_tip, tool_button
from skiros2_gui.run.node import clock_text, duration_text
from skiros2_gui.run.presenter import RunPresenter
from skiros2_gui.run.tree import RunTree

#: The folding commands of the tree's menus.
FOLDS: tuple[tuple[str, Callable[..., None]], ...] = (
    ("Fold idle and succeeded", RunTree.fold_quiet),
    ("Fold all skills", lambda tree, _: tree.fold_to(1)),
    ("Unfold all", lambda tree, _: tree.unfold_all()),
)


class TreeBar(QToolBar):
    """Search, running node, folding and zoom. Buttons that do not fit move to the extension menu."""

    #: Emitted with the index of a node to scroll to.
    reveal_requested = Signal(int)

    #: Emitted to show the whole tree.
    fit_requested = Signal()

    def __init__(self, presenter: RunPresenter) -> None:
        super().__init__()
        self._presenter = presenter
        self.search = QLineEdit()
        self.search.setObjectName("nodeSearch")
        self.search.setPlaceholderText("Find nodes by label or type (Ctrl+F)")
        self.search.setClearButtonEnabled(True)
        self.search.setMinimumWidth(self.fontMetrics().averageCharWidth() * 10)
        self.search.textChanged.connect(self._on_search)
        self.search.returnPressed.connect(self._go_next)
        self.count = PlainLabel()
        self.count.setObjectName("nodeCount")
        self.count.setContentsMargins(6, 0, 6, 0)
        self.follow = QCheckBox("Follow")
        self.follow.setObjectName("follow")
        self.follow.setToolTip("keep the running node in view")
        self.follow.setChecked(presenter.follows)
        self.follow.toggled.connect(lambda is_on: setattr(presenter, "follows", is_on))
        self._jump = tool_button(
            "Running node",
            "jumpToRunning",
            lambda: self._request(presenter.select_next(presenter.running()[::-1])),
            "select the running node; again: the next one",
        )
        fold = tool_button("Fold", "foldMenu", tip="fold and unfold; a double click folds one node")
        menu = QMenu(self)
        for text, change in FOLDS:
            menu.addAction(text, lambda change=change: presenter.change_folds(change))
        fold.setMenu(menu)
        fit = tool_button(
            "Fit",
            "fitTree",
            lambda: self.fit_requested.emit(),
            "show the whole tree (F); 0 shows it at 100 %, + and − zoom",
        )
        for widget in (self.search, self.count, self.follow, self._jump, fold, fit):
            self.addWidget(widget)

    def focus(self) -> None:
        """Gives the focus to the search."""
        self.search.setFocus(Qt.ShortcutFocusReason)
        self.search.selectAll()

    def show_tree(self) -> None:
        """Shows the search text and the number of nodes."""
        tree, frame = self._presenter.tree, self._presenter.frame
        if tree.text != self.search.text():
            self.search.blockSignals(True)
            self.search.setText(tree.text)
            self.search.blockSignals(False)
        nodes = f"{len(frame.shape)} nodes" if frame is not None else ""
        self.count.setText(f"{len(self._presenter.found())} found" if tree.text.strip() else nodes)

    def show_running(self) -> None:
        """Enables the button if a node is running."""
        self._jump.setEnabled(bool(self._presenter.running()))

    def _on_search(self, text: str) -> None:
        found = self._presenter.search(text)
        self.show_tree()
        if found:
            self._go_next()

    def _go_next(self) -> None:
        self._request(self._presenter.select_next(self._presenter.found()))

    def _request(self, index: int | None) -> None:
        if index is not None:
            self.reveal_requested.emit(index)


class HistoryBar(QWidget):
    """A slider over the ticks, buttons for single steps, and a button for live."""

    def __init__(self, presenter: RunPresenter) -> None:
        super().__init__()
        self._presenter = presenter
        self._slider = QSlider(Qt.Horizontal)
        self._slider.setObjectName("historySlider")
        self._slider.setAccessibleName("tick of the task")
        self._slider.setToolTip("the ticks of the task; the arrow keys go one back or forward")
        self._slider.setPageStep(25)
        self._slider.valueChanged.connect(self._go)
        self._back = tool_button("", "historyBack", lambda: presenter.step(-1), "one tick back")
        self._on = tool_button("", "historyOn", lambda: presenter.step(1), "one tick forward")
        for button, arrow in ((self._back, Qt.LeftArrow), (self._on, Qt.RightArrow)):
            button.setArrowType(arrow)
            button.setAutoRaise(True)
            button.setAutoRepeat(True)
        self._live = tool_button("Live", "historyLive", lambda: presenter.go_to(None), "show the task live")
        self._label = PlainLabel()
        self._label.setObjectName("historyLabel")
        self._label.setTextInteractionFlags(Qt.TextSelectableByMouse)
        row = QHBoxLayout(self)
        row.setContentsMargins(6, 2, 6, 2)
        for widget in (self._back, self._slider, self._on, self._live, self._label):
            row.addWidget(widget, 1 if widget is self._slider else 0)
        self.show_history()

    def show_history(self) -> None:
        """Shows the index of the tick and the number of ticks."""
        presenter, run = self._presenter, self._presenter.run
        count = len(run) if run is not None else 0
        tick = count - 1 if presenter.tick is None else presenter.tick
        self.setEnabled(count > 0)
        self._slider.blockSignals(True)
        self._slider.setRange(0, max(0, count - 1))
        self._slider.setValue(max(0, tick))
        self._slider.blockSignals(False)
        self._back.setEnabled(tick > 0)
        self._on.setEnabled(presenter.tick is not None and tick < count - 1)
        self._live.setEnabled(presenter.tick is not None and presenter.bag is None)
        if run is None:
            self._label.setText("")
            return
        moment = run.times[tick] if presenter.tick is not None else run.latest.time
        live = "live: " if presenter.is_live else ""
        text = f"{live}tick {run.dropped + tick + 1} of {run.dropped + count}, {clock_text(moment)}, "
        self._label.setText(text + duration_text(max(0.0, moment - run.start)))
        tip = f"{run.dropped} older ticks were discarded to limit memory" if run.dropped else "since the task began"
        self._label.setToolTip(plain_tip(tip))

    def _go(self, tick: int) -> None:
        is_last = self._presenter.run is not None and tick >= len(self._presenter.run) - 1
        self._presenter.go_to(None if is_last and self._presenter.bag is None else tick)
