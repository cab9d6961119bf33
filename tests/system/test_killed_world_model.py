"""A world model node that is killed under load loses no acknowledged change."""

from __future__ import annotations

import os
import random
import signal
import threading
import time
from pathlib import Path
from typing import Any

import pytest

from skiros2_common.core.element_content import ElementChanges
from skiros2_common.core.operations import Add, Operation, Patch, Relate, Remove
from skiros2_common.core.property import Property
from skiros2_common.core.world_element import Element
from skiros2_world_model.core.wm_errors import WmException
from skiros2_world_model.ros.world_model_interface import WorldModelInterface
from support.programs import Program
from support.ros import INSTALL, Ros, wait_until

KILLS = 20
WRITERS = 3
ROOT = "skiros:Scene-0"
NODE = INSTALL / "lib/skiros2_world_model/world_model_server_node"

#: What a scene holds of one writer: the counts of its two elements, and its parts, each with what it is in.
State = tuple[int, int, dict[str, str]]


class Writer:
    """A client that changes elements of its own, one request after the other, and knows what the scene must hold.

    Request number k writes k into both of its elements, and beside that adds a part, moves one or removes one: so it
    shows which requests the scene has, and whether it has each whole.
    """

    def __init__(self, name: str, chance: random.Random) -> None:
        self.wmi = WorldModelInterface(name)
        self._name = name
        self._chance = chance
        self.boxes = [Element("skiros:LargeBox", f"{name} {side}") for side in ("left", "right")]
        self.wmi.add_elements(self.boxes)
        services = self.wmi.remote.services
        services.transaction.timeout = services.get.timeout = 0.0  # it does not wait for a new node
        self.acknowledged = 0
        self._parts: dict[str, str] = {}
        self._asked: State | None = None  # what the scene holds when the request that broke off was carried out
        self._thread: threading.Thread | None = None
        self.error: Exception | None = None

    def start(self) -> None:
        """Continues until a request fails."""
        self._thread = threading.Thread(target=self._work)
        self._thread.start()

    def join(self) -> None:
        assert self._thread is not None
        self._thread.join(30.0)
        assert not self._thread.is_alive()
        assert self.error is None, self.error

    def check(self, elements: dict[str, Element]) -> None:
        """The scene holds what was acknowledged, and of the request that broke off all or nothing."""
        found = self._found(elements)
        known = (self.acknowledged, self.acknowledged, self._parts)
        assert found in (known, self._asked), f"{self._name}: {found}, expected {known} or {self._asked}"
        if found == self._asked:
            self.acknowledged, _, self._parts = self._asked
        self._asked = None

    def _found(self, elements: dict[str, Element]) -> State:
        counts = [elements[box.id].value_of("skiros:Count") or 0 for box in self.boxes]
        holders = {r["dst"]: eid for eid, element in elements.items() for r in element.relation_view}
        parts = {eid for eid, element in elements.items() if element.label == f"part of {self._name}"}
        return counts[0], counts[1], {elements[eid].value_of("skiros:Key"): holders.get(eid, "") for eid in parts}

    def _work(self) -> None:
        before = self.acknowledged
        while True:
            try:
                self._write()
            except WmException as error:
                if "does not answer" in str(error) and self.acknowledged == before:
                    continue  # a busy machine: the node, which runs, was not reached in time
                if not ("broke off" in str(error) or "does not answer" in str(error)):
                    self.error = error
                return

    def _write(self) -> None:
        count = self.acknowledged + 1
        operations, parts = self._request(count)
        self._asked = count, count, parts
        self.wmi.transact(operations)
        self.acknowledged, self._parts, self._asked = count, parts, None

    def _request(self, count: int) -> tuple[list[Operation], dict[str, str]]:
        counted = ElementChanges({"skiros:Count": Property("skiros:Count", count)})
        operations: list[Operation] = [Patch(box.id, counted) for box in self.boxes]
        parts = dict(self._parts)
        kinds = ("add", "move", "remove")[len(parts) == 8 : 3 if parts else 1]
        kind = self._chance.choice(kinds)
        key = str(count) if kind == "add" else self._chance.choice(sorted(parts))
        holder = self._chance.choice(self.boxes).id
        if kind == "add":
            part = Element("skiros:Part", f"part of {self._name}")
            part.setProperty("skiros:Key", key)
            part.addRelation(holder, "skiros:contain", "-1")
            operations.append(Add(part))
            parts[key] = holder
        elif kind == "move":
            eid = self._id(key)
            operations.append(Relate(parts[key], "skiros:contain", eid, False))
            operations.append(Relate(holder, "skiros:contain", eid))
            parts[key] = holder
        else:
            operations.append(Remove(self._id(key)))
            del parts[key]
        return operations, parts

    def _id(self, key: str) -> str:
        wanted = Element("skiros:Part", f"part of {self._name}")
        wanted.setProperty("skiros:Key", key)
        return self.wmi.resolve_elements(wanted)[0].id


@pytest.fixture
def start(ros: Ros, tmp_path: Path) -> Any:
    params = {
        "workspace_dir": str(tmp_path),
        "journal": str(tmp_path / "wm.journal"),
        "journal_megabytes": 0.5,  # so that it is killed while it drops the past, too
    }
    for key, value in params.items():
        ros.master.set_parameter(f"/wm/{key}", value)

    def start() -> Program:
        node = ros.program(str(NODE), "__name:=wm")
        node.wait_for_line("the world model is ready")
        return node

    return start


@pytest.mark.long
@pytest.mark.timeout(420)
def test_no_acknowledged_change_is_lost_when_the_node_is_killed(start: Any) -> None:
    seed = random.randrange(1 << 32)
    print(f"seed {seed}")
    chance = random.Random(seed)
    node = start()
    reader = WorldModelInterface("reader")
    writers = [Writer(f"writer {i}", random.Random(chance.random())) for i in range(WRITERS)]
    session = reader.session
    for _ in range(KILLS):
        before = [writer.acknowledged for writer in writers]
        for writer in writers:
            writer.start()
        wait_until(lambda: all(w.acknowledged > b or w.error for w, b in zip(writers, before, strict=True)))  # noqa: B023
        time.sleep(chance.uniform(0.0, 0.05))  # the moment of the kill
        os.kill(node.pid, signal.SIGKILL)
        node.wait()
        for writer in writers:
            writer.join()
        node = start()
        snapshot = reader.remote.fetch()
        elements = {element.id: element for element in snapshot.elements}
        assert snapshot.snapshot_id.split("-")[0] == session
        for writer in writers:
            writer.check(elements)
        assert len(elements) == 1 + sum(len(writer.boxes) + len(writer._parts) for writer in writers)
    print(f"{sum(writer.acknowledged for writer in writers)} requests acknowledged")
    for writer in writers:
        counts = [e.after[0].value_of("skiros:Count") or 0 for e in reader.history(writer.boxes[0].id) if e.after]
        assert counts == list(range(writer.acknowledged - len(counts) + 1, writer.acknowledged + 1))
