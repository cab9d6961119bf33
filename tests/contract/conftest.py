"""The world model behind each transport: in process and over ROS, with and without a replica."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from skiros2_common.core.world_element import Element
from skiros2_world_model.core.local_world_model import LocalWorldModel, source_ontologies
from skiros2_world_model.core.replica_transport import ReplicaTransport
from skiros2_world_model.core.world_model import WorldModel
from skiros2_world_model.core.world_model_client import WorldModelClient
from support.replicated import ReplicatedTransport
from support.ros import Ros

SCENE = "skiros:Scene-0"
ADAPTERS = ["in process", "in process with a replica", "over ROS", "over ROS with a replica"]

ONTOLOGY = """@prefix : <http://x.org/Factory.owl#> .
@prefix skiros: <http://rvmi.aau.dk/ontologies/skiros.owl#> .
@prefix sumo: <http://www.inf.ufrgs.br/phi-group/ontologies/sumo.owl#> .
@prefix rparts: <http://www.inf.ufrgs.br/phi-group/ontologies/RParts.owl#> .
@prefix owl: <http://www.w3.org/2002/07/owl#> .
@prefix rdfs: <http://www.w3.org/2000/01/rdf-schema#> .
<http://x.org/Factory.owl> a owl:Ontology .
:Pallet a owl:Class ; rdfs:subClassOf skiros:Container .
:euro_pallet a owl:NamedIndividual, :Pallet ; skiros:SizeX 1.2 ;
    skiros:contain :part, skiros:starter ; skiros:hasA :euro_pallet .
:part a owl:NamedIndividual, skiros:Part ; skiros:contain :screw ; skiros:partReference skiros:starter .
:screw a owl:NamedIndividual, skiros:Part .
"""


class World:
    """A world model behind one of the adapters, and how to get further clients of it."""

    def __init__(self, client, connect, workspace):
        self.wm = client
        self.connect = connect
        self.workspace = workspace

    def add(self, etype, label="", parent=SCENE, relation="skiros:contain", **properties):
        element = Element(etype, label)
        for key, value in properties.items():
            element.setProperty(f"skiros:{key}", value)
        element.addRelation(getattr(parent, "id", parent), relation, "-1")
        self.wm.add_element(element)
        return element


def write_workspace(folder: Path) -> Path:
    folder.mkdir()
    (folder / "factory.owl").write_text(ONTOLOGY)
    (folder / "blank.ttl").write_text(
        '@prefix : <http://rvmi.aau.dk/ontologies/skiros.owl#> .\n:Scene-0 a :Scene ; :FrameId "map" .\n'
    )
    return folder


@pytest.fixture(scope="module", params=ADAPTERS)
def connected(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[World]:
    workspace = write_workspace(tmp_path_factory.mktemp("contract") / "workspace")
    if request.param == "in process":
        model = WorldModel(source_ontologies(), workspace)
        yield World(LocalWorldModel("tester", model), lambda name: LocalWorldModel(name, model), workspace)
        return
    if request.param == "in process with a replica":
        model = WorldModel(source_ontologies(), workspace)

        def replicated(name: str) -> WorldModelClient:
            return WorldModelClient(ReplicaTransport(ReplicatedTransport(name, model)))

        yield World(replicated("tester"), replicated, workspace)
        return
    from skiros2_world_model.ros.world_model_interface import WorldModelInterface

    ros = Ros(request.getfixturevalue("ros_master"))
    ros.run("skiros2_world_model", "world_model_server_node", name="wm", params={"workspace_dir": str(workspace)})
    replica = request.param.endswith("replica")
    yield World(
        WorldModelInterface("tester", make_cache=replica),
        lambda name: WorldModelInterface(name, make_cache=replica),
        workspace,
    )
    ros.stop()


@pytest.fixture
def world(connected: World) -> World:
    connected.wm.load("blank.ttl")
    return connected


@pytest.fixture
def wm(world: World):
    return world.wm
