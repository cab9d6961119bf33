"""A world model node with a SPARQL endpoint over HTTP, and one with query limits."""

from __future__ import annotations

import pytest
import rospy

from skiros2_common.core.processes import free_port
from skiros2_common.core.world_element import Element
from skiros2_msgs import srv as srvs
from skiros2_world_model.ros.world_model_interface import WmException, WorldModelInterface
from support.ros import Ros
from support.sparql_endpoint import SparqlEndpoint

pytestmark = pytest.mark.timeout(90)

BOXES = "SELECT ?x { ?x rdf:type/rdfs:subClassOf* skiros:Container }"


@pytest.fixture
def start(ros: Ros, tmp_path):
    def start(**params):
        params = {"workspace_dir": str(tmp_path), "journal": False, **params}
        return ros.run("skiros2_world_model", "world_model_server_node", name="wm", params=params)

    return start


def test_scene_is_in_the_endpoint_and_stays_available_without_it(ros: Ros, start):
    with SparqlEndpoint() as endpoint:
        start(sparql_endpoint=endpoint.url, sparql_update_endpoint=endpoint.url)
        wm = WorldModelInterface("tester", make_cache=True)
        first = wm.add_element(Element("skiros:LargeBox", "first")).id
        assert first in wm.query_ontology(BOXES)
        assert any("first" in triple for triple in endpoint.graph("scene"))
        endpoint.stop()
        second = wm.add_element(Element("skiros:LargeBox", "second")).id
        with pytest.raises(WmException, match=f"SPARQL endpoint {endpoint.url} cannot be reached"):
            wm.query_ontology(BOXES)
        late = WorldModelInterface("late comer", make_cache=True)
        assert late.get_element(second).label == "second"
        assert late.get_sub_classes("skiros:Container") == wm.get_sub_classes("skiros:Container")
        endpoint.start()
        assert {first, second} <= set(wm.query_ontology(BOXES))


@pytest.mark.parametrize(
    ("params", "said"),
    [
        ({"sparql_endpoint": "http://localhost:{port}/x"}, "SPARQL endpoint http://localhost:{port}/x cannot be"),
        ({"sparql_update_endpoint": "http://localhost/x"}, "but /wm/sparql_endpoint is not set"),
        ({"query_seconds": -1}, "parameter /wm/query_seconds is -1"),
    ],
)
def test_mistakes_in_the_parameters_end_the_node(start, params, said):
    port = free_port()
    node = start(**{key: value.format(port=port) if isinstance(value, str) else value for key, value in params.items()})
    assert node.wait() == 78
    assert said.format(port=port) in node.output


def test_query_ends_after_its_timeout(ros: Ros, start):
    start(query_seconds=0.3, query_rows=1000)
    wm = WorldModelInterface("tester")
    query = ros.service("/wm/ontology/query", srvs.WoQuery)
    pairs = "{ ?a ?b ?c . ?d ?e ?f . ?g a owl:Class FILTER(?b != ?e) }"
    with pytest.raises(rospy.ServiceException, match=r"ended after 0\.3 s"):
        query(query_string=f"SELECT (COUNT(*) AS ?n) {pairs}")
    eid = wm.add_element(Element("skiros:LargeBox", "box")).id
    with pytest.raises(rospy.ServiceException, match="more than 1000 rows; expected a LIMIT"):
        query(query_string=f"SELECT * {pairs}")
    assert eid in query(query_string=BOXES, cut_prefix=True).answer
