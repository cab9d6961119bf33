"""The tool bar of the tree: search, running node, folding, zoom."""

from __future__ import annotations

from collections.abc import Callable

from python_qt_binding.QtCore import Qt, Signal
from python_qt_binding.QtWidgets import QCheckBox, QLabel, QLineEdit, QMenu, QToolBar, QToolButton, QWidget

from skiros2_gui.run.presenter import RunPresenter
from skiros2_gui.run.tree import RunTree


class TreeBar(QToolBar):
    """Buttons that do not fit move to the extension menu."""

    #: Emitted with the index of a node to scroll to.
    reveal_requested = Signal(int)

    #: Emitted to show the whole tree.
    fit_requested = Signal()

    def __init__(self, presenter: RunPresenter, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._presenter = presenter
        self.search = QLineEdit()
        self.search.setObjectName("nodeSearch")
        self.search.setPlaceholderText("Find nodes by label or type (Ctrl+F)")
        self.search.setClearButtonEnabled(True)
        self.search.setMinimumWidth(self.fontMetrics().averageCharWidth() * 10)
        self.search.textChanged.connect(self._on_search)
        self.search.returnPressed.connect(self._go_next)
        self.count = QLabel()
        self.count.setObjectName("nodeCount")
        self.count.setContentsMargins(6, 0, 6, 0)
        self.follow = QCheckBox("Follow")
        self.follow.setObjectName("follow")
        self.follow.setToolTip("keep the running node in sight")
        self.follow.setChecked(presenter.follows)
        self.follow.toggled.connect(self._on_follow)
        self._jump = _button("Running node", "jumpToRunning", "select the running node; again: the next one")
        self._jump.clicked.connect(self._go_to_running)
        fold = _button("Fold", "foldMenu", "fold and unfold; a double click folds one node")
        fold.setPopupMode(QToolButton.InstantPopup)
        fold.setMenu(self._menu())
        fit = _button("Fit", "fitTree", "show the whole tree (F); 0 shows it at 100 %, + and − zoom")
        fit.clicked.connect(lambda: self.fit_requested.emit())
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

    def _menu(self) -> QMenu:
        menu = QMenu(self)
        changes: tuple[tuple[str, Callable[..., None]], ...] = (
            ("Fold idle and succeeded", RunTree.fold_quiet),
            ("Fold all skills", lambda tree, _: tree.fold_to(1)),
            ("Unfold all", lambda tree, _: tree.unfold_all()),
        )
        for text, change in changes:
            menu.addAction(text, lambda change=change: self._presenter.change_folds(change))
        return menu

    def _on_search(self, text: str) -> None:
        found = self._presenter.search(text)
        self.show_tree()
        if found:
            self._go_next()

    def _go_next(self) -> None:
        self._request(self._presenter.select_next(self._presenter.found()))

    def _go_to_running(self) -> None:
        self._request(self._presenter.select_next(self._presenter.running()[::-1]))

    def _request(self, index: int | None) -> None:
        if index is not None:
            self.reveal_requested.emit(index)

    def _on_follow(self, is_on: bool) -> None:
        self._presenter.follows = is_on


def _button(text: str, name: str, tip: str) -> QToolButton:
    button = QToolButton()
    button.setText(text)
    button.setObjectName(name)
    button.setToolTip(tip)
    return button
