"""Runs for other tools: the files are read back with the libraries of those tools."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections import Counter
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import jsonschema
import pytest
from rosbags.rosbag1 import Reader

from skiros2_bags.core.mcap_scene import _Meshes
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
        times = [message.log_time for _, _, message in read]
        assert times == sorted(times)
        topics = Counter(channel.topic for schema, channel, _ in read if schema.encoding == "ros1msg")
        assert topics == Counter(message.topic for message in recorded)
        assert len(list(reader.iter_decoded_messages(topics))) == len(recorded)
        wrenches = [
            (message.log_time, content.wrench.force.z)
            for _, _, message, content in reader.iter_decoded_messages(["/piston_cell/right_arm/wrist/wrench"])
        ]
    expected = [(m.time, m.content.wrench.force.z) for m in recorded if m.type == "geometry_msgs/WrenchStamped"]
    assert [force for _, force in wrenches] == [force for _, force in expected]
    assert wrenches[0][0] / 1e9 == pytest.approx(expected[0][0], abs=1e-6)


def test_mcap_has_the_exact_times_of_the_bag(tmp_path: Path) -> None:
    """A float of seconds holds times to 0.2 µs only."""
    pytest.importorskip("mcap", reason="needs requirements/export.txt")
    from mcap.reader import make_reader

    from skiros2_bags.core.mcap_export import export_mcap

    export_mcap(Run.open(BAG), tmp_path / "run.mcap")
    with Reader(BAG) as bag:
        recorded = [(connection.topic, time, bytes(data)) for connection, time, data in bag.messages()]
    with (tmp_path / "run.mcap").open("rb") as file:
        read = list(make_reader(file).iter_messages(log_time_order=False))
    copied = [(channel.topic, m.log_time, m.data) for schema, channel, m in read if schema.encoding == "ros1msg"]
    assert copied == recorded
    assert all(message.publish_time == message.log_time for _, _, message in read)


def test_mcap_has_frames_shapes_and_robots_for_the_3d_view(tmp_path: Path) -> None:
    pytest.importorskip("mcap", reason="needs requirements/export.txt")
    from mcap.reader import make_reader

    from skiros2_bags.core.mcap_export import export_mcap

    run = Run.open(BAG)
    export_mcap(run, tmp_path / "run.mcap")
    frames, entities, schemas = {}, {}, {}
    with (tmp_path / "run.mcap").open("rb") as file:
        for schema, channel, message in make_reader(file).iter_messages():
            if channel.message_encoding == "json":
                schemas[schema.name] = json.loads(schema.data)
                data = json.loads(message.data)
                jsonschema.validate(data, schemas[schema.name])
                if schema.name == "foxglove.FrameTransform":
                    frames[data["child_frame_id"]] = data["parent_frame_id"]
                entities.update({each["id"]: each for each in data.get("entities", [])})
    moved = {t.child_frame_id.lstrip("/"): t.header.frame_id.lstrip("/")
             for m in run.messages("/tf", "/tf_static") for t in m.content.transforms}  # fmt: skip
    assert not frames.keys() & moved.keys()  # no frame has two parents
    known = frames | moved
    roots = set(known.values()) - known.keys()
    drawn = [each for each in entities.values() if each["cubes"] or each["models"] or each["cylinders"]]
    assert {each["frame_id"] for each in drawn} <= known.keys() | roots  # each is somewhere in the tree of frames
    [(name, (urdf, _))] = run.robot_descriptions().items()
    links = [each for each in drawn if each["id"].startswith(name)]
    assert 0 < len(links) <= urdf.count("<link ")
    assert len(drawn) > len(links)  # elements too


def test_mcap_has_the_meshes_themselves_and_no_other_files(tmp_path: Path) -> None:
    meshes = _Meshes()
    (tmp_path / "part.STL").write_bytes(b"solid")
    (tmp_path / "secret.txt").write_bytes(b"secret")
    assert meshes.model(f"file://{tmp_path}/part.STL") == {"media_type": "model/stl", "data": "c29saWQ="}
    for url in (f"file://{tmp_path}/secret.txt", f"file://{tmp_path}/missing.stl", "package://no_such_package/a.stl"):
        assert meshes.model(url) is None


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
