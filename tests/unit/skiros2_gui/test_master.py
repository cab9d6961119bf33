"""The check for a master, whatever listens at its address."""

from __future__ import annotations

import socket
import threading
from collections.abc import Iterator
from xmlrpc.server import SimpleXMLRPCServer

import pytest

from skiros2_common.command_line.command import Unavailable
from skiros2_common.command_line.master import ask_master
from skiros2_gui.app.ros import system as master


@pytest.fixture
def address(monkeypatch: pytest.MonkeyPatch) -> Iterator[socket.socket]:
    """A socket at the master's address, which nobody serves."""
    with socket.create_server(("localhost", 0)) as listening:
        monkeypatch.setenv("ROS_MASTER_URI", f"http://localhost:{listening.getsockname()[1]}")
        monkeypatch.setattr(master, "TIMEOUT", 0.1)
        yield listening


def test_master_that_hangs_times_out(address: socket.socket) -> None:
    assert not master.master_answers()


def test_missing_master_does_not_answer(address: socket.socket) -> None:
    address.close()
    assert not master.master_answers()


def test_http_server_is_no_master(address: socket.socket) -> None:
    def answer() -> None:
        connection, _ = address.accept()
        with connection:
            connection.recv(4096)
            connection.sendall(b"HTTP/1.0 200 OK\r\nContent-Length: 2\r\n\r\nhi")

    threading.Thread(target=answer, daemon=True).start()
    assert not master.master_answers()
    threading.Thread(target=answer, daemon=True).start()
    with pytest.raises(Unavailable, match="no ROS master answers"):
        ask_master("getPid")


@pytest.mark.parametrize(
    ("answer", "is_master"), [([1, "", 42], True), ([-1, "no", 0], False), (3, False), ([], False)]
)
def test_xmlrpc_server_must_answer_as_a_master(
    monkeypatch: pytest.MonkeyPatch, answer: object, is_master: bool
) -> None:
    with SimpleXMLRPCServer(("localhost", 0), logRequests=False) as server:
        server.register_function(lambda caller: answer, "getPid")
        threading.Thread(target=server.handle_request, daemon=True).start()
        monkeypatch.setenv("ROS_MASTER_URI", f"http://localhost:{server.server_address[1]}")
        assert master.master_answers() is is_master


def test_invalid_master_uri_does_not_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_MASTER_URI", "nonsense")
    assert not master.master_answers()
