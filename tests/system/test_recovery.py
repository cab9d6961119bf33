"""Skill managers register again after the world model was killed or loaded another scene."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import rospy

from skiros2_common.core.world_element import Element
from skiros2_msgs import msg as msgs
from skiros2_msgs import srv as srvs
from skiros2_skill.ros.skill_manager import SkillManager
from skiros2_skill.ros.skill_manager_interface import SkillManagerInterface
from skiros2_world_model.core.local_world_model import LocalWorldModel
from skiros2_world_model.ros.world_model_interface import WmException, WorldModelInterface
from support.ros import Ros, wait_until

pytestmark = pytest.mark.timeout(90)

ROBOT = "/test_robot"


@pytest.fixture
def start(ros: Ros, tmp_path: Path) -> Callable[..., None]:
    """Starts a world model and waits until it answers."""

    def start(**params: Any) -> None:
        params = {"workspace_dir": str(tmp_path), **params}
        ros.run("skiros2_world_model", "world_model_server_node", name="wm", params=params)
        ros.service("/wm/history", srvs.WmHistory)

    return start


def start_manager(ros: Ros) -> None:
    params = {"libraries_list": ["skiros2_std_skills"], "primitive_list": ["counter", "wait"]}
    ros.run("skiros2_skill", "skill_manager_node", name="test_robot", params=params)
    ros.service(f"{ROBOT}/command", srvs.SkillCommand)


@pytest.fixture
def wmi(ros: Ros, start: Callable[..., None]) -> WorldModelInterface:
    start(journal=False)
    start_manager(ros)
    return WorldModelInterface("tests")


@pytest.fixture
def robot(wmi: WorldModelInterface) -> Iterator[SkillManagerInterface]:
    client = SkillManagerInterface(ROBOT, "tests")
    yield client
    client.shutdown()


def skills(wmi: WorldModelInterface) -> dict[str, str]:
    """The skills of the robot that the manager has: id by label."""
    robots = [r for r in wmi.resolve_elements(Element("cora:Robot")) if r.hasProperty("skiros:SkillMgr", ROBOT[1:])]
    ids = [r["dst"] for robot in robots for r in wmi.get_relations(robot.id, "skiros:hasSkill", "")]
    return {str(wmi.get_element(eid).label): eid for eid in ids}


def has_its_skills(wmi: WorldModelInterface) -> Any:
    try:
        return sorted(skills(wmi)) == ["counter", "wait"]
    except WmException:  # one of them has just been replaced
        return False


def runs_a_task(ros: Ros, robot: SkillManagerInterface) -> bool:
    heard = ros.messages(f"{ROBOT}/monitor", msgs.TreeProgress)
    counter = robot.get_skill("counter")
    counter.ph.specify("CountTarget", 3)
    task = robot.execute(skill_list=[counter])
    last = heard.wait_for(lambda m: m.progress[0].id == task and abs(m.progress[0].progress_code) == 1)
    return bool(last.progress[0].state == msgs.SkillProgress.SUCCESS)


def test_manager_registers_again_with_a_blank_world_model(
    ros: Ros, start: Callable[..., None], wmi: WorldModelInterface, robot: SkillManagerInterface
) -> None:
    ros.kill_node("/wm")
    start(journal=False)
    wait_until(lambda: has_its_skills(wmi), what="the skills in the new world model")
    assert "skiros:Counter" in wmi.get_sub_classes("skiros:Skill")
    assert runs_a_task(ros, robot)


def test_manager_registers_again_after_a_scene_is_loaded(
    ros: Ros, wmi: WorldModelInterface, robot: SkillManagerInterface, tmp_path: Path
) -> None:
    (tmp_path / "cell.ttl").write_text(
        "@prefix : <http://rvmi.aau.dk/ontologies/skiros.owl#> .\n:Scene-0 a :Scene .\n:Part-7 a :Part .\n"
    )
    wmi.load("cell.ttl")
    wait_until(lambda: has_its_skills(wmi), what="the skills in the new scene")
    assert wmi.is_scene_element("skiros:Part-7")
    assert runs_a_task(ros, robot)


def test_recovered_world_model_keeps_its_managers(ros: Ros, start: Callable[..., None]) -> None:
    start()
    start_manager(ros)
    wmi = WorldModelInterface("tests")
    before = skills(wmi)
    assert sorted(before) == ["counter", "wait"]
    ros.kill_node("/wm")
    start()
    client = SkillManagerInterface(ROBOT, "tests")
    try:
        assert runs_a_task(ros, client)
    finally:
        client.shutdown()
    assert skills(wmi) == before
    assert wmi.history(author=ROBOT, since=wmi.last_change(before["wait"]).number) == []


def looks_whether_it_is_registered() -> bool:
    """Whether the manager in this process does."""
    return any(thread.name == "register" for thread in threading.enumerate())


def test_manager_that_missed_a_load_notices_the_gap(ros_master: Any) -> None:
    wmi = LocalWorldModel("tests")
    manager = SkillManager("test_robot", wmi=wmi)
    manager.load(["skiros2_std_skills"], ["wait"])
    manager.start()
    try:
        wmi.add_element(Element("skiros:Part", "heard"))
        wait_until(lambda: not looks_whether_it_is_registered(), what="the manager, which sees a first change")
        wmi.remove_listener(manager._on_world_change)
        for robot in wmi.resolve_elements(Element("cora:Robot")):
            wmi.remove_element(robot)
        wmi.add_element(Element("skiros:Part", "not heard"))
        wmi.add_listener(manager._on_world_change)
        assert wmi.resolve_elements(Element("skiros:Skill")) == []
        wmi.add_element(Element("skiros:Part", "heard again"))
        wait_until(lambda: wmi.resolve_elements(Element("skiros:Wait")), what="the skill again")
        (robot,) = wmi.resolve_elements(Element("cora:Robot"))
        assert robot.hasProperty("skiros:SkillMgr", rospy.get_name()[1:])
    finally:
        manager.shutdown()
