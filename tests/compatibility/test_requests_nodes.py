"""Requests by `rosservice call`: see the sections "Run a skill by hand" and "The services by hand" of docs."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import pytest

from compatibility.rules import rule
from compatibility.test_preempt_nodes import LIBRARIES, ROBOT
from skiros2_common.core.world_element import Element
from skiros2_msgs import srv as srvs
from skiros2_skill.ros.skill_manager_interface import SkillManagerInterface
from skiros2_world_model.ros.world_model_interface import WorldModelInterface
from support.ros import Ros, RosMaster

pytestmark = pytest.mark.timeout(240)


@pytest.fixture(scope="module")
def product(ros_master: RosMaster) -> Iterator[Element]:
    """An element of the scene of a manager with the skill `block`."""
    ros = Ros(ros_master)
    env = {**ros.master.env, "PYTHONPATH": f"{LIBRARIES}:{ros.master.env['PYTHONPATH']}"}
    ros.launch("skiros2", "world_model_server.launch", gui=False)
    skills = {"libraries_list": "[stubborn_skills]", "primitive_list": "[block]", "skill_list": "[]"}
    ros.launch("skiros2", "skill_mgr.launch", env=env, **skills)
    ros.service(f"{ROBOT}/command", srvs.SkillCommand)
    product = Element("skiros:Product", "bolt")
    product.addRelation("skiros:Scene-0", "skiros:contain", "-1")
    WorldModelInterface("tests").add_element(product)
    yield product
    ros.stop()


@pytest.fixture
def call(ros: Ros) -> Callable[..., str]:
    """Starts a skill by `rosservice call` and returns the output."""

    def call(*params: str, skill: str = "Block") -> str:
        written = ", ".join("{param: '" + param.replace("'", "''") + "'}" for param in params)
        request = f"{{author: me, action: start, execution_id: -1, skills: [{{type: {skill}, params: [{written}]}}]}}"
        program = ros.program("rosservice", "call", f"{ROBOT}/command", request)
        program.wait(60.0)
        return program.output

    return call


@rule(
    "more", "In `rosservice call ~command`, parameters need no `specType` and `type`; elements are named by id or label"
)
def test_parameters_need_no_types(product: Element, call: Callable[..., str]) -> None:
    for thing in (product.id, product.label):
        printed = call('{"key": "Seconds", "values": 0}', f'{{"key": "Thing", "values": "{thing}"}}')
        assert "ok: True" in printed
    client = SkillManagerInterface(ROBOT, "tests")
    holder = client.get_skill("block")
    holder.ph.specify("Thing", product)
    assert client.run([holder]).succeeded(timeout=30.0)
    client.shutdown()


@rule("robustness", "A wrong request is refused and changes nothing", better="all its problems are reported at once")
def test_all_problems_of_a_request_are_reported(product: Element, call: Callable[..., str]) -> None:
    printed = call(
        '{"key": "Thing", "values": "bolz"}', '{"key": "Second", "values": 1}', '{"key": "Seconds", "values": "x"}'
    )
    assert "ERROR" in printed
    for named in ("no element has the id or label", "near: bolt", "has no parameter", "expected a value of type float"):
        assert named in printed
