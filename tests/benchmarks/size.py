"""Scenes of 1000 to 100 000 elements: memory, an update, a lookup and a start, beside the smallest scene.

Each size has a process of its own. A million elements (`size_million`) take ten times as long.
"""

from __future__ import annotations

import json
import logging
import random
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

from benchmarks.measurement import Measurement
from benchmarks.world_model import _resident, fill
from skiros2_common.core.element_content import ElementChanges
from skiros2_common.core.operations import Patch
from skiros2_common.core.property import Property
from skiros2_common.core.world_element import Element
from skiros2_world_model.core.local_world_model import LocalWorldModel, source_ontologies
from skiros2_world_model.core.world_model import WorldModel

SIZES = (1_000, 10_000, 100_000)
CALLS = 500
#: What each figure may be, beside that of the smallest scene.
FLAT = 1.5

UNITS = {
    "memory of an element": "bytes",
    "an update": "µs",
    "resolve of 10 elements": "µs",
    "start, for each element": "µs",
}


def measure(folder: Path, sizes: Sequence[int] = SIZES) -> Iterator[Measurement]:
    """Measures the scenes, each beside the first one."""
    found = {size: _in_own_process(folder, size) for size in sizes}
    least = found[sizes[0]]
    for size in sizes[1:]:
        for what, figure in found[size].items():
            name = f"scene of {size} elements: {what}"
            peer = f"the same, {sizes[0]} elements"
            yield Measurement(name, figure, UNITS[what], 1, peer, least[what], figure / least[what], FLAT)


def _in_own_process(folder: Path, size: int) -> dict[str, float]:
    command = [sys.executable, "-m", "benchmarks.size", str(size), str(folder)]
    answer = subprocess.run(command, cwd=Path(__file__).parents[1], check=True, stdout=subprocess.PIPE, text=True)
    found: dict[str, float] = json.loads(answer.stdout)
    return found


def _main(size: int, folder: Path) -> None:
    """Prints the figures of a size, as JSON: CPU time, as one thread does it all."""
    logging.disable(logging.WARNING)
    workspace = folder / f"size-{size}"
    workspace.mkdir(exist_ok=True)
    model = WorldModel(source_ontologies(), workspace)
    wm = LocalWorldModel("bench", model)
    wm.resolve_elements(Element("skiros:Starter"))
    before = _resident()
    fill(model, size)
    figures = {"memory of an element": (_resident() - before) / size}
    ids = [node.id for node in model.scene() if node.type == "skiros:Product"]

    def update() -> None:
        changed = {"skiros:SizeX": Property("skiros:SizeX", random.random())}
        model.transact([Patch(random.choice(ids), ElementChanges(changed))], "bench")

    for what, call in (("an update", update), ("resolve of 10 elements", lambda: _starters(wm))):
        call()
        begin = time.process_time()
        for _ in range(CALLS):
            call()
        figures[what] = 1e6 * (time.process_time() - begin) / CALLS
    model.save("size.ttl")
    begin = time.process_time()
    again = WorldModel(source_ontologies(), workspace, initial=[("scene", "size.ttl")])
    figures["start, for each element"] = 1e6 * (time.process_time() - begin) / size
    assert len(again.scene()) == size + 1
    print(json.dumps(figures))


def _starters(wm: LocalWorldModel) -> None:
    assert len(wm.resolve_elements(Element("skiros:Starter"))) == 10


if __name__ == "__main__":
    _main(int(sys.argv[1]), Path(sys.argv[2]))
