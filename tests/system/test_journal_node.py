"""The journal of the world model node: recovery of a killed node, and the service `~history`."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import rospy

from skiros2_common.core.world_element import Element
from skiros2_msgs import srv as srvs
from skiros2_world_model.core.wm_errors import WmException
from skiros2_world_model.ros.world_model_interface import WorldModelInterface
from support.programs import Program
from support.ros import Ros, wait_until

pytestmark = pytest.mark.timeout(90)

SCENE = "skiros:Scene-0"


@pytest.fixture
def start(ros: Ros, tmp_path: Path) -> Callable[..., Program]:
    """Starts a world model node and waits until it answers."""

    def start(wait: bool = True, **params: Any) -> Program:
        params = {"workspace_dir": str(tmp_path), "journal": str(tmp_path / "wm.journal"), **params}
        node = ros.run("skiros2_world_model", "world_model_server_node", name="wm", params=params)
        if wait:
            ros.service("/wm/history", srvs.WmHistory)
        return node

    return start


def kill(ros: Ros, node: Program) -> None:
    os.kill(ros.master.node_pid("/wm"), signal.SIGKILL)
    node.wait()


def test_running_node_follows_the_parameter_for_syncs(ros: Ros, start: Callable[..., Program]) -> None:
    node = start()
    for wanted, line in ((True, "each change is synced"), (False, "each change is no longer synced")):
        ros.master.set_parameter("/wm/journal_sync", wanted)
        node.wait_for_line(line)


@pytest.mark.parametrize("make_cache", [False, True])
def test_killed_node_recovers_its_scene_and_clients_continue(
    ros: Ros, start: Callable[..., Program], make_cache: bool
) -> None:
    node = start()
    client = WorldModelInterface("tester", make_cache=make_cache)
    part = Element("skiros:Part", "first life")
    client.add_element(part)
    client.set_relation(SCENE, "skiros:contain", part)
    client.add_class("skiros:OddPart", "skiros:Part")
    _, before = client.get_scene()
    kill(ros, node)
    again = start()
    again.wait_for_line(r"has recovered from its journal .*/wm\.journal: 2 elements in scene; .* by tester")
    client.catch_up()
    assert client.get_scene()[1] == before
    assert client.get_element(part.id).label == "first life"
    assert client.get_relations(SCENE, "skiros:contain", part.id)
    assert client.is_subclass("skiros:OddPart", "skiros:Part")
    part.setProperty("skiros:Weight", 2.0)
    client.update_element(part)
    assert client.get_element(part.id).getProperty("skiros:Weight").value == 2.0


def test_node_after_a_clean_shutdown_starts_from_its_files(ros: Ros, start: Callable[..., Program]) -> None:
    node = start()
    WorldModelInterface("tester").add_element(Element("skiros:Part", "first life"))
    node.stop()
    start()
    client = WorldModelInterface("tester")
    assert not client.resolve_elements(Element("skiros:Part"))
    assert [e.label for entry in client.history() for e in entry.after if e.type == "skiros:Part"] == ["first life"]


def test_node_with_other_files_does_not_recover(ros: Ros, start: Callable[..., Program], tmp_path: Path) -> None:
    node = start()
    WorldModelInterface("tester").add_element(Element("skiros:Part", "first life"))
    kill(ros, node)
    (tmp_path / "cell.ttl").write_text(
        "@prefix : <http://rvmi.aau.dk/ontologies/skiros.owl#> .\n:Scene-0 a :Scene .\n:Part-7 a :Part .\n"
    )
    start(init_scene="cell.ttl")
    wait_until(lambda: WorldModelInterface("tester").is_scene_element("skiros:Part-7"))
    assert not WorldModelInterface("tester").resolve_elements(Element("skiros:Part", "first life"))


def test_second_node_on_the_same_journal_ends_with_a_message(ros: Ros, start: Callable[..., Program]) -> None:
    start(journal=True)
    journal = next(ros.master.home.glob("skiros2/localhost_*/wm.journal"))
    other = ros.run("skiros2_world_model", "world_model_server_node", name="other", params={"journal": str(journal)})
    assert other.wait() == 78
    assert f"{journal}: another process is using it" in other.output


@pytest.mark.parametrize(
    ("name", "value"), [("journal_recover", "sometimes"), ("journal_days", -1), ("journal_megabytes", "much")]
)
def test_invalid_journal_parameter_is_named(start: Callable[..., Program], name: str, value: Any) -> None:
    node = start(wait=False, **{name: value})
    assert node.wait() == 78
    assert name in node.output and repr(value) in node.output


def test_history_is_unavailable_without_a_journal(ros: Ros, start: Callable[..., Program]) -> None:
    start(journal=False)
    with pytest.raises(WmException, match="has no journal"):
        WorldModelInterface("tester").history()


def test_history_service_returns_past_changes(ros: Ros, start: Callable[..., Program]) -> None:
    start()
    mary, paul = WorldModelInterface("mary"), WorldModelInterface("paul")
    part = Element("skiros:Part", "a part")
    part.setProperty("skiros:Weight", 1.0)
    mary.add_element(part)
    then = time.time()
    number = part.version
    part.setProperty("skiros:Weight", 2.0)
    paul.update_element(part)
    paul.set_relation(SCENE, "skiros:contain", part)
    mary.remove_element(part.id)

    told = mary.history(part.id)
    assert [entry.author for entry in told] == ["mary", "paul", "paul", "mary"]
    weights = [[e and e.value_of("skiros:Weight") for e in pair] for entry in told for pair in entry.pairs()]
    assert weights == [[None, 1.0], [1.0, 2.0], [2.0, None]]
    assert [(r["src"], r["dst"]) for r in told[2].related] == [(SCENE, part.id)]
    assert [(r["src"], r["dst"]) for r in told[3].unrelated] == [(SCENE, part.id)]
    numbers = [entry.number for entry in told]
    assert [entry.number for entry in mary.history(part.id, author="paul")] == numbers[1:3]
    assert [entry.number for entry in mary.history(part.id, limit=1)] == numbers[3:]
    assert [entry.number for entry in mary.history(since=number)] == numbers[1:]
    for point in (number, then):
        assert mary.scene_at(point).author == "mary"
        assert {e.id: e.value_of("skiros:Weight") for e in mary.scene_at(point).after}[part.id] == 1.0
        difference = mary.difference(point)
        assert [e.id for e in difference.before] == [part.id]
        assert not difference.after and not difference.related and not difference.unrelated
    assert not mary.difference(then, then)


def test_history_service_names_unknown_arguments(ros: Ros, start: Callable[..., Program]) -> None:
    start()
    client = WorldModelInterface("tester")
    with pytest.raises(WmException, match="no element 'skiros:Part-99'"):
        client.history("skiros:Part-99")
    with pytest.raises(WmException, match="no context 'nowhere'"):
        client.history(context_id="nowhere")
    with pytest.raises(WmException, match="journal begins with change"):
        client.scene_at(time.time() - 86400.0)
    with pytest.raises(WmException, match="no change 9223372036854775807"):
        client.scene_at(2**63 - 1)
    with pytest.raises(rospy.ServiceException, match="unknown action 'guess'"):
        ros.service("/wm/history", srvs.WmHistory)(action="guess")
