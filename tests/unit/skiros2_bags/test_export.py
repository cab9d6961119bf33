"""Runs for other tools: the files are read back with the libraries of those tools."""

from __future__ import annotations

import os
import subprocess
import sys
from collections import Counter
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from skiros2_bags.core.run import Run
from support.source import ROOT

#: Contact skills of two arms, with tf, forces, a depth image and the robot's description.
BAG = ROOT / "tests/bags/contact.bag"


def test_mcap_has_the_messages_of_the_bag(tmp_path: Path) -> None:
    pytest.importorskip("mcap", reason="needs requirements/export.txt")
    ros1 = pytest.importorskip("mcap_ros1.decoder", reason="needs requirements/export.txt")
    from mcap.reader import make_reader

    from skiros2_bags.core.mcap_export import export_mcap

    run = Run.open(BAG)
    recorded = list(run.messages())
    assert export_mcap(run, tmp_path / "run.mcap") == len(recorded)
    with (tmp_path / "run.mcap").open("rb") as file:
        reader = make_reader(file, decoder_factories=[ros1.DecoderFactory()])
        assert reader.get_header().profile == "ros1"
        read = list(reader.iter_messages(log_time_order=False))
        assert len(list(reader.iter_decoded_messages())) == len(recorded)
        times = [message.log_time for _, _, message in read]
        assert times == sorted(times)
        assert Counter(channel.topic for _, channel, _ in read) == Counter(message.topic for message in recorded)
        wrenches = [
            (message.log_time, content.wrench.force.z)
            for _, _, message, content in reader.iter_decoded_messages(["/piston_cell/right_arm/wrist/wrench"])
        ]
    expected = [(m.time, m.content.wrench.force.z) for m in recorded if m.type == "geometry_msgs/WrenchStamped"]
    assert [force for _, force in wrenches] == [force for _, force in expected]
    assert wrenches[0][0] / 1e9 == pytest.approx(expected[0][0], abs=1e-6)


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """The exported recording: the file as `path`, and its `chunks`."""
    pytest.importorskip("rerun", reason="needs requirements/export.txt")
    from rerun.chunk import RrdReader

    from skiros2_bags.core.rerun_export import export_rerun

    target = tmp_path_factory.mktemp("rerun") / "run.rrd"
    assert export_rerun(Run.open(BAG), target) == len(Run.open(BAG).tasks())
    return SimpleNamespace(path=target, chunks=RrdReader(target).stream().to_chunks())


@pytest.mark.long
def test_rerun_can_read_each_column_of_a_recording(recording: Any, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "rerun", "rrd", "verify", str(recording.path)]
    env = {**os.environ, "HOME": str(tmp_path), "XDG_CONFIG_HOME": str(tmp_path)}  # a first run sends no statistics
    done = subprocess.run(command, env=env, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr


def test_rerun_recording_has_trees_scene_robot_images_and_forces(recording: Any) -> None:
    entities = Counter[str]()
    for chunk in recording.chunks:
        entities[str(chunk.entity_path)] += chunk.num_rows
    parts = Counter[str]()
    for entity in entities:
        parts["/".join(entity.strip("/").split("/")[:2])] += 1
    of_robot = [f"{kind}/piston_cell" for kind in ("tasks", "log", "skills", "images", "forces")]
    for part in (*of_robot, "scene/elements", "scene/tf"):
        assert parts[part], f"{part} of {sorted(parts)}"
    assert any("/visual_geometries/" in entity for entity in entities if entity.startswith("/robot_piston_cell/"))
    run = Run.open(BAG)
    forces = sum(1 for _ in run.messages("geometry_msgs/WrenchStamped"))
    [shown] = [count for entity, count in entities.items() if entity.startswith("/forces/")]
    assert shown == forces


def test_states_of_the_skills_begin_and_end(recording: Any) -> None:
    states: list[str] = []
    for chunk in recording.chunks:
        if str(chunk.entity_path) == "/skills/piston_cell":
            batch = chunk.to_record_batch()
            [column] = [name for name in batch.schema.names if name.endswith("state")]
            states += [value[0] for value in batch.column(column).to_pylist()]
    labels = [skill.label for skill in Run.open(BAG).skills() if skill.depth == 1]
    assert [state for state in states if state] == labels
    assert states.count("") == len(labels)  # the end of a state
