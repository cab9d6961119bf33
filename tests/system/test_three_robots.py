"""Three simulated robots share a cell and a goal, with physics."""

from __future__ import annotations

import json
from typing import Any

import pytest

from controller_manager_msgs.srv import SwitchController
from skiros2_common.core.world_element import Element
from skiros2_demo.run_check import Thing
from skiros2_demo.simulation import Simulation
from skiros2_msgs import srv as srvs
from skiros2_sim_msgs.msg import Contacts
from skiros2_task.ros.task_manager_interface import TaskManagerInterface
from skiros2_world_model.ros.world_model_interface import WorldModelInterface
from support.ros import Ros, wait_until

pytestmark = [pytest.mark.long, pytest.mark.timeout(300)]

ROBOTS = ("mobile_1", "mobile_2", "stationary")
#: Which product is to lie in which tray.
PLACES = {
    "skiros:Product-40": "demo:Tray-34",
    "skiros:Product-41": "demo:Tray-35",
    "skiros:Product-42": "demo:Tray-37",
}
WAIT = 60.0  # s


def test_three_robots_share_a_cell_and_one_goal(ros: Ros) -> None:
    ros.launch("skiros2_sim_skills", "three_robots.launch", gui=False, rate=4.0)
    simulation = Simulation()
    contacts = ros.messages("/sim/contacts", Contacts)
    for robot in ROBOTS:
        ros.service(f"/{robot}/get_skills", srvs.ResourceGetDescriptions)()
        ros.service(f"/{robot}/controller_manager/switch_controller", SwitchController, WAIT)
    wait_until(lambda: "/tm/achieve/status" in ros.master.topics(), WAIT, "the task manager")

    tasks = TaskManagerInterface()
    goals = [f"(skiros:contain {tray} {product})" for product, tray in PLACES.items()]
    tasks.achieve(goals, quality="best", seconds=3.0)
    result = tasks.wait_for_result()

    assert result.state == "succeeded", f"{result.message}\n{result.done}\n{result.explanations}"
    done = json.loads(result.done)
    assert {step["robot"] for step in done} == {f"/{robot}" for robot in ROBOTS}
    placed = {step["robot"] for step in done if step["skill"] == "skiros:Place" and step["state"] == "succeeded"}
    assert placed == {f"/{robot}" for robot in ROBOTS}

    wm = WorldModelInterface("tests")
    for product, tray in PLACES.items():
        element = wm.get_element(product)
        assert element.getRelation("", "skiros:contain", "-1")["src"] == tray
        in_truth(simulation, element, wm.get_element(tray))
    between_robots = {
        (contact.first, contact.second)
        for message in contacts.all
        for contact in message.contacts
        if {name.partition("/")[0] for name in (contact.first, contact.second)} <= set(ROBOTS)
    }
    assert not between_robots


def in_truth(simulation: Simulation, product: Element, tray: Element) -> None:
    """The product lies in the tray, at rest, and nothing holds it."""
    findings = simulation.check_placement(*(Thing(e.id, e.type, e.label, sizes_of(e)) for e in (product, tray)))
    assert all(finding.holds for finding in findings), findings


def sizes_of(element: Element) -> dict[str, list[Any]]:
    return {f"skiros:Size{axis}": [element.value_of(f"skiros:Size{axis}")] for axis in "XYZ"}
