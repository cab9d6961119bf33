"""The view of a drawn tree: scrolling, zoom, folding and selection by mouse and keys."""

from __future__ import annotations

from python_qt_binding.QtCore import QEvent, QPoint, QPointF, Qt, Signal
from python_qt_binding.QtGui import QContextMenuEvent, QKeyEvent, QMouseEvent, QPainter, QWheelEvent
from python_qt_binding.QtWidgets import QGraphicsScene, QGraphicsView, QMenu, QToolTip, QWidget

from skiros2_gui.run.node import CHOSEN_LATER, duration_text, processor_text
from skiros2_gui.run.presenter import RunPresenter
from skiros2_gui.run.widgets.bars import FOLDS
from skiros2_gui.run.widgets.graph import TreeItem
from skiros2_runs.core.states import style_of
from skiros2_skill.core.breakpoint import AT_END, BEFORE_START

#: The range of scales.
_SMALLEST, _LARGEST = 0.005, 4.0

#: The minimum scale chosen automatically; names are readable.
_READABLE = 0.55

_STEP = 1.2

_ARROWS = {Qt.Key_Left: "left", Qt.Key_Right: "right", Qt.Key_Up: "up", Qt.Key_Down: "down"}


class TreeView(QGraphicsView):
    """Shows the tree of a presenter."""

    #: The user has scrolled the view.
    moved = Signal()

    def __init__(self, presenter: RunPresenter, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setObjectName("treeGraph")
        self._presenter = presenter
        self._item = TreeItem(self)
        scene = QGraphicsScene(self)
        scene.setItemIndexMethod(QGraphicsScene.NoIndex)
        scene.addItem(self._item)
        self.setScene(scene)
        self.setDragMode(QGraphicsView.ScrollHandDrag)
        self.viewport().setCursor(Qt.ArrowCursor)
        self.setRenderHint(QPainter.TextAntialiasing)
        self.setViewportUpdateMode(QGraphicsView.MinimalViewportUpdate)
        self.setOptimizationFlag(QGraphicsView.DontSavePainterState)
        self.setTransformationAnchor(QGraphicsView.AnchorUnderMouse)
        self.setAccessibleName("tree of the task")
        self._pressed: QPoint | None = None
        self._is_fitted = True
        self._least = _READABLE

    @property
    def item(self) -> TreeItem:
        return self._item

    # -- what is shown -----------------------------------------------------------------------------------------------

    def show_tree(self) -> None:
        """Draws the tree after its task, shape or folding has changed."""
        frame, tree = self._presenter.frame, self._presenter.tree
        self._item.setVisible(frame is not None)
        if frame is None:
            return
        tree.show(frame.shape)
        if tree.drawing is not None:
            self._item.draw(tree.drawing)
            self.setSceneRect(self._item.boundingRect())
        self.show_states()
        if self._is_fitted:
            self.fit(self._least)

    def is_up_to_date(self) -> bool:
        """Whether the drawing matches the presenter's tree."""
        frame, drawing = self._presenter.frame, self._presenter.tree.drawing
        return frame is None or (drawing is not None and drawing is self._item.drawing and drawing.shape is frame.shape)

    def _catch_up(self) -> None:
        """Draws pending changes before a user action."""
        if not self.is_up_to_date():
            self.show_tree()

    def show_states(self) -> None:
        """Shows states, search results, breakpoints and the selection."""
        presenter = self._presenter
        frame, tree = presenter.frame, presenter.tree
        if frame is None or not self.is_up_to_date():
            return
        self._item.show_states(frame)
        robot = presenter.robot if presenter.run is not None and presenter.bag is None else ""
        breakpoints = presenter.breakpoints.by_node(robot, frame.shape)
        self._item.highlight(presenter.selected_index(), tree.found(), breakpoints)

    def reveal(self, index: int) -> None:
        """Scrolls to a node."""
        self._catch_up()
        drawing = self._presenter.tree.drawing
        if drawing is not None:
            rect = self._item.rect_of(drawing.visible_node(index))
            if not self.viewport().rect().contains(self.mapFromScene(rect).boundingRect()):
                self.centerOn(rect.center())

    def fit(self, least: float = _SMALLEST) -> None:
        """Fits the tree into the view, at most at 100 %, also after later changes until the user scrolls.

        :param least: the minimum scale; if the tree is larger, the view is centred on the running node.
        """
        self._is_fitted, self._least = True, least
        bounds, room = self._item.boundingRect(), self.viewport().rect()
        if bounds.isEmpty() or room.isEmpty():
            return
        whole = min(1.0, room.width() / bounds.width(), room.height() / bounds.height())
        self._set_scale(max(whole, least))
        drawing = self._presenter.tree.drawing
        if whole >= least or drawing is None:
            self.centerOn(bounds.center())
        else:
            running = self._presenter.running()
            self.centerOn(self._item.rect_of(drawing.visible_node(running[-1] if running else 0)).center())

    def zoom(self, factor: float) -> None:
        """Scales the view."""
        self._is_fitted = False
        self._set_scale(min(max(self.scale_now * factor, _SMALLEST), _LARGEST))

    def full_size(self) -> None:
        """Sets the scale to 100 %, centred on the selected node."""
        index = self._presenter.selected_index()
        self.zoom(1.0 / self.scale_now)
        if index is not None:
            self.reveal(index)

    @property
    def scale_now(self) -> float:
        return float(self.transform().m11())

    def _set_scale(self, scale: float) -> None:
        factor = scale / self.scale_now
        self.scale(factor, factor)

    # -- mouse -------------------------------------------------------------------------------------------------------

    def wheelEvent(self, event: QWheelEvent) -> None:
        if event.modifiers() & (Qt.ShiftModifier | Qt.AltModifier):
            super().wheelEvent(event)
        elif event.angleDelta().y():
            self.zoom(_STEP ** (event.angleDelta().y() / 120.0))
            event.accept()

    def mousePressEvent(self, event: QMouseEvent) -> None:
        self._pressed = event.pos()
        super().mousePressEvent(event)

    def mouseMoveEvent(self, event: QMouseEvent) -> None:
        super().mouseMoveEvent(event)
        if event.buttons() & Qt.LeftButton and self._is_moved(event.pos()):
            self._is_fitted = False
            self.moved.emit()

    def mouseReleaseEvent(self, event: QMouseEvent) -> None:
        super().mouseReleaseEvent(event)
        self.viewport().setCursor(Qt.ArrowCursor)
        if event.button() == Qt.LeftButton and self._pressed is not None and not self._is_moved(event.pos()):
            self._click(self.mapToScene(event.pos()))
        self._pressed = None

    def mouseDoubleClickEvent(self, event: QMouseEvent) -> None:
        self._catch_up()
        index = self._item.index_at(self.mapToScene(event.pos()))
        if index is not None and not self._item.is_fold_mark(index, self.mapToScene(event.pos())):
            self._presenter.fold(index)

    def _click(self, point: QPointF) -> None:
        self._catch_up()
        index = self._item.index_at(point)
        if index is not None and self._item.is_fold_mark(index, point):
            self._presenter.fold(index)
        else:
            self._presenter.select(index)

    def _is_moved(self, to: QPoint) -> bool:
        return self._pressed is not None and (to - self._pressed).manhattanLength() > 4

    def viewportEvent(self, event: QEvent) -> bool:
        if event.type() == QEvent.ToolTip:
            self._catch_up()
            index = self._item.index_at(self.mapToScene(event.pos()))
            QToolTip.showText(event.globalPos(), self._tool_tip(index) if index is not None else "", self)
            return True
        return bool(super().viewportEvent(event))

    def _tool_tip(self, index: int) -> str:
        frame = self._presenter.frame
        if frame is None or index >= len(frame.shape):
            return ""
        lines = [f"{frame.shape.name(index)}: {style_of(frame.state(index)).word}"]
        duration = frame.duration(index)
        if duration is not None:
            lines[0] += f", {duration_text(duration)}"
        if frame.shape.is_skill(index):
            later = "" if frame.shape.label(index) else f"; the implementation is {CHOSEN_LATER}"
            lines.append(f"{frame.shape.type(index)}{later}")
        if frame.shape.processor(index):
            lines.append(f"its children: {processor_text(frame.shape.processor(index))}")
        if message := frame.message(index):
            lines.append(message if len(message) < 300 else f"{message[:299]}…")
        return "\n".join(lines)

    def contextMenuEvent(self, event: QContextMenuEvent) -> None:
        self._catch_up()
        menu = self.menu_for(self._item.index_at(self.mapToScene(event.pos())))
        menu.exec_(event.globalPos())
        menu.deleteLater()

    def menu_for(self, index: int | None) -> QMenu:
        """Returns the context menu of a node, or of the tree."""
        self._catch_up()
        presenter, menu = self._presenter, QMenu(self)
        frame, drawing, run = presenter.frame, presenter.tree.drawing, presenter.run
        if index is not None and frame is not None and drawing is not None and run is not None:
            presenter.select(index)
            if frame.shape.children[index]:
                is_folded = index in drawing.hidden
                menu.addAction("Unfold" if is_folded else "Fold", lambda: presenter.fold(index))
            robot = presenter.robot_at(index)
            if robot and index:
                there = {k.breakpoint.when for k in presenter.breakpoints.at(robot, frame.shape, index)}
                for when, text in ((BEFORE_START, "before it starts"), (AT_END, "when it ends")):
                    action = menu.addAction(f"Pause {text}")
                    action.setCheckable(True)
                    action.setChecked(when in there)
                    action.triggered.connect(
                        lambda _, when=when: presenter.breakpoints.toggle(robot, frame.shape, index, when)
                    )
            menu.addSeparator()
        for text, change in FOLDS:
            menu.addAction(text, lambda change=change: presenter.change_folds(change))
        menu.addAction("Fit in the window", self.fit)
        return menu

    # -- keys --------------------------------------------------------------------------------------------------------

    def keyPressEvent(self, event: QKeyEvent) -> None:
        self._catch_up()
        key, tree = event.key(), self._presenter.tree
        if key in _ARROWS and not event.modifiers() & ~Qt.KeypadModifier:
            index = tree.neighbour(_ARROWS[key])
            if index is not None:
                self._presenter.select(index)
                self.reveal(index)
        elif key in (Qt.Key_Return, Qt.Key_Enter):
            index = self._presenter.selected_index()
            if index is not None:
                self._presenter.fold(index)
        elif key in (Qt.Key_Plus, Qt.Key_Equal):
            self.zoom(_STEP)
        elif key == Qt.Key_Minus:
            self.zoom(1 / _STEP)
        elif key == Qt.Key_0:
            self.full_size()
        elif key == Qt.Key_F:
            self.fit()
        else:
            super().keyPressEvent(event)

    def changeEvent(self, event: QEvent) -> None:
        if event.type() in (QEvent.PaletteChange, QEvent.FontChange, QEvent.StyleChange):
            self._item.set_style(self)
            self.show_states()
        super().changeEvent(event)

    def resizeEvent(self, event: QEvent) -> None:
        super().resizeEvent(event)
        if self._is_fitted and self.is_up_to_date():  # otherwise it is fitted when it is drawn
            self.fit(self._least)
