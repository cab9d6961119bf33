"""The dialog in which a person answers what agents ask for."""

from __future__ import annotations

from typing import Any

from python_qt_binding.QtCore import Qt
from python_qt_binding.QtWidgets import (
    QDialog,
    QFormLayout,
    QHBoxLayout,
    QLineEdit,
    QListWidget,
    QListWidgetItem,
    QPlainTextEdit,
    QSplitter,
    QToolButton,
    QVBoxLayout,
    QWidget,
)

from skiros2_gui.app.widgets.controls import plain_tip, push_button, text_label, timer
from skiros2_gui.app.window import Window
from skiros2_gui.approvals.presenter import ApprovalsPresenter

#: The periods of reading the requests, and of looking for a gateway (ms).
_PERIOD, _SEARCH_PERIOD = 2000, 5000


class ApprovalsDialog(QDialog):
    """Stays open beside the window. Shows the login until a person has logged in."""

    def __init__(self, presenter: ApprovalsPresenter, parent: QWidget) -> None:
        super().__init__(parent)
        self.setObjectName("approvalsDialog")
        self.setWindowTitle("Agents ask for")
        self._presenter = presenter
        self._login = QWidget()
        self._address, self._user, self._secret = (_field(name) for name in ("gateway", "approvalUser", "secret"))
        self._user.setPlaceholderText("empty: a token instead of a password")
        self._secret.setEchoMode(QLineEdit.Password)
        form = QFormLayout(self._login)
        form.addRow("Gateway", self._address)
        form.addRow("Name", self._user)
        form.addRow("Password or token", self._secret)
        form.addRow("", push_button("Log in", "logIn", self._log_in))
        self._list = QListWidget()
        self._list.setObjectName("approvalList")
        self._list.currentItemChanged.connect(lambda *_: self._show_chosen())
        self._text = QPlainTextEdit()
        self._text.setObjectName("approvalText")
        self._text.setReadOnly(True)
        self._reason = _field("answerReason")
        self._reason.setPlaceholderText("reason, for the agent")
        self._buttons = [
            push_button("Reject", "rejectButton", lambda: self._answer(False)),
            push_button("Approve", "approveButton", lambda: self._answer(True), "Exactly what is shown runs"),
        ]
        self._content, self._note = QWidget(), text_label("approvalNote")
        self._lay_out()
        self.show_changes()

    def _lay_out(self) -> None:
        split = QSplitter(Qt.Vertical)
        split.addWidget(self._list)
        split.addWidget(self._text)
        split.setStretchFactor(1, 3)
        row = QHBoxLayout()
        row.addWidget(push_button("Log out", "logOut", self._presenter.log_out))
        row.addWidget(self._reason, 1)
        for button in self._buttons:
            row.addWidget(button)
        column = QVBoxLayout(self._content)
        column.setContentsMargins(0, 0, 0, 0)
        column.addWidget(split, 1)
        column.addLayout(row)
        outer = QVBoxLayout(self)
        for part in (self._login, self._content, self._note):
            outer.addWidget(part)
        outer.addStretch()
        for button in self.findChildren(type(self._buttons[0])):
            button.setAutoDefault(False)  # Enter in a field answers nothing
        self._secret.returnPressed.connect(self._log_in)
        em = self.fontMetrics().height()
        self.resize(40 * em, 30 * em)

    def set_focus(self) -> None:
        """Gives the focus to the name, or to the list of requests."""
        (self._list if self._presenter.user else self._user).setFocus()

    def show_changes(self) -> None:
        """Shows the state of the presenter. The selection stays at its request."""
        state, chosen, was_empty = self._presenter, self._chosen_id(), not self._list.count()
        self._login.setVisible(not state.user)
        self._content.setVisible(bool(state.user))
        if not self._address.isModified():
            self._address.setText(state.address)
        waiting = {each["id"]: each for each in state.waiting}
        items = {item.data(Qt.UserRole): item for item in map(self._list.item, range(self._list.count()))}
        for approval_id in items.keys() - waiting.keys():
            self._list.takeItem(self._list.row(items[approval_id]))
        if chosen not in waiting:
            self._list.setCurrentRow(-1)  # not at a neighbour: a click may be on its way
        for approval_id, approval in waiting.items():
            if approval_id not in items:
                items[approval_id] = QListWidgetItem(self._list)
                items[approval_id].setData(Qt.UserRole, approval_id)
            items[approval_id].setText(state.row(approval))
        if was_empty and waiting:
            self._list.setCurrentRow(0)
        self._show_chosen()

    def _show_chosen(self) -> None:
        state, approval = self._presenter, self._chosen()
        text = state.text(approval) if approval is not None else ""
        if self._text.toPlainText() != text:
            self._text.setPlainText(text)
            self._text.setToolTip(plain_tip(state.text_with_ids(approval) if approval is not None else ""))
        for button in self._buttons:
            button.setEnabled(approval is not None and state.may_answer)
        self._note.setText(state.problem or self._hint())

    def _hint(self) -> str:
        state = self._presenter
        if not state.user:
            return "A person with the role approve logs in, as on the gateway's page."
        if not state.waiting:
            return f"{state.user}: nothing waits for an approval."
        return "" if state.may_answer else f"{state.user} may read this. A person with the role approve answers."

    def _chosen_id(self) -> str:
        item = self._list.currentItem()
        return str(item.data(Qt.UserRole)) if item is not None else ""

    def _chosen(self) -> dict[str, Any] | None:
        chosen = self._chosen_id()
        return next((each for each in self._presenter.waiting if each["id"] == chosen), None)

    def _log_in(self) -> None:
        secret = self._secret.text()
        self._secret.clear()
        self._presenter.log_in(self._address.text(), self._user.text(), secret)

    def _answer(self, is_approved: bool) -> None:
        for button in self._buttons:
            button.setEnabled(False)  # until the answer is there
        self._presenter.answer(self._chosen_id(), is_approved, self._reason.text())
        self._reason.clear()


class ApprovalsButton(QToolButton):
    """Opens the dialog; has the number of waiting requests. Hidden while no gateway is known."""

    def __init__(self, window: Window, parent: QWidget) -> None:
        super().__init__(parent)
        self.setObjectName("approvalsButton")
        self.presenter = ApprovalsPresenter(window, self._show)
        self.dialog = ApprovalsDialog(self.presenter, parent)
        self.clicked.connect(self._open)
        self._timer = timer(self, _SEARCH_PERIOD, self.presenter.refresh, repeats=True)
        self._timer.start()
        self._show()
        self.presenter.refresh()

    def close_timer(self) -> None:
        """Stops the timer, ends the session, and closes the dialog."""
        self._timer.stop()
        self.presenter.log_out()
        self.dialog.close()

    def _open(self) -> None:
        self.dialog.show()
        self.dialog.set_focus()
        self.dialog.raise_()
        self.dialog.activateWindow()

    def _show(self) -> None:
        state, number = self.presenter, len(self.presenter.waiting)
        self.setVisible(bool(state.address or state.user))
        self.setText(f"{number} approval{'s wait' if number > 1 else ' waits'}" if number else "Approvals…")
        self.setToolTip("What agents ask for" if state.user else "Log in to answer what agents ask for")
        font = self.font()
        font.setBold(number > 0)
        self.setFont(font)
        self._timer.setInterval(_PERIOD if state.user else _SEARCH_PERIOD)
        self.dialog.show_changes()


def _field(name: str) -> QLineEdit:
    field = QLineEdit()
    field.setObjectName(name)
    return field
