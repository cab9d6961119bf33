"""What the world model has of a skill manager: whether it still stands, and how it is made good."""

from __future__ import annotations

import pytest

from skiros2_common.core.world_element import Element
from skiros2_skill.core.library.library import SkillLibrary
from skiros2_skill.ros.registration import Registration
from skiros2_world_model.core.local_world_model import LocalWorldModel
from skiros2_world_model.core.world_model_abstract_interface import WmException

MANAGER = "/test_robot"


@pytest.fixture
def wmi() -> LocalWorldModel:
    return LocalWorldModel()


@pytest.fixture
def library(wmi: LocalWorldModel) -> SkillLibrary:
    library = SkillLibrary(wmi)
    library.import_libraries(["skiros2_std_skills"])
    library.load(["wait", "counter"])
    return library


@pytest.fixture
def registration(wmi: LocalWorldModel, library: SkillLibrary) -> Registration:
    registration = Registration(wmi, "skiros", "test_robot", MANAGER)
    registration.register_robot()
    registration.register_skills(library.implementations())
    return registration


def skills(wmi: LocalWorldModel, robot: str) -> list[str]:
    ids = [r["dst"] for r in wmi.get_relations(robot, "skiros:hasSkill", "")]
    return sorted(wmi.get_element(eid).label for eid in ids)


def test_a_registration_stands_while_others_change_the_scene(wmi: LocalWorldModel, registration: Registration) -> None:
    wmi.add_element(Element("skiros:Part", "part"))
    part = wmi.resolve_element(Element("skiros:Part"))
    wmi.set_relation(registration.robot_id, "skiros:at", part)
    assert registration.stands()


def test_it_does_not_stand_without_one_of_the_skills(wmi: LocalWorldModel, registration: Registration) -> None:
    counter = wmi.resolve_element(Element("skiros:Counter"))
    assert counter is not None
    wmi.remove_element(counter)
    assert not registration.stands()


def test_it_does_not_stand_when_another_manager_has_the_robot(wmi: LocalWorldModel, registration: Registration) -> None:
    robot = registration.robot
    robot.setProperty("skiros:SkillMgr", "/another")
    wmi.update_element(robot)
    assert not registration.stands()


def test_it_does_not_stand_when_an_id_is_another_skill_s(wmi: LocalWorldModel, registration: Registration) -> None:
    counter = wmi.resolve_element(Element("skiros:Counter"))
    assert counter is not None
    counter.label = "another"
    wmi.update_element(counter)
    assert not registration.stands()


def test_after_another_scene_robot_and_skills_are_there_again_once(
    wmi: LocalWorldModel, library: SkillLibrary, registration: Registration
) -> None:
    for element in wmi.resolve_elements(Element("cora:Robot")):
        wmi.remove_element(element)
    assert not registration.stands()
    registration.register_robot()
    registration.register_skills(library.implementations())
    assert registration.stands()
    assert skills(wmi, registration.robot_id) == ["counter", "wait"]
    assert len(wmi.resolve_elements(Element("skiros:Skill"))) == 2


def test_skills_of_which_the_world_model_refused_one_do_not_stand(
    wmi: LocalWorldModel, library: SkillLibrary, registration: Registration, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(element: Element) -> str:
        raise WmException("not now")

    monkeypatch.setattr(wmi, "add_element", refuse)
    with pytest.raises(WmException):
        registration.register_skills(library.implementations())
    monkeypatch.undo()
    assert not registration.stands()
    assert registration.enter(library.implementations())
    assert skills(wmi, registration.robot_id) == ["counter", "wait"]


def test_one_that_stands_is_not_entered_again(
    wmi: LocalWorldModel, library: SkillLibrary, registration: Registration
) -> None:
    told: list[object] = []
    wmi.add_listener(told.append)
    assert not registration.enter(library.implementations())
    assert told == []


def test_devices_that_an_earlier_life_has_locked_are_free_when_a_manager_enters(
    wmi: LocalWorldModel, library: SkillLibrary
) -> None:
    arm = Element("rparts:ArmDevice", "arm")
    arm.setProperty("skiros:StateProperty", "Busy")
    arm.setProperty("skiros:LockedBy", wmi.author)
    wmi.add_element(arm)
    assert Registration(wmi, "skiros", "test_robot", MANAGER).enter(library.implementations())
    assert wmi.get_element(arm.id).value_of("skiros:StateProperty") == "Idle"
