"""Registration of a skill manager in the world model."""

from __future__ import annotations

import pytest

from skiros2_common.core.world_element import Element
from skiros2_skill.core.library.library import SkillLibrary
from skiros2_skill.ros.registration import Registration
from skiros2_world_model.core.local_world_model import LocalWorldModel
from skiros2_world_model.core.wm_errors import WmException

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


def test_registration_survives_changes_of_other_elements(wmi: LocalWorldModel, registration: Registration) -> None:
    wmi.add_element(Element("skiros:Part", "part"))
    part = wmi.resolve_element(Element("skiros:Part"))
    wmi.set_relation(registration.robot_id, "skiros:at", part)
    assert registration.is_registered()


def test_removed_skill_invalidates_registration(wmi: LocalWorldModel, registration: Registration) -> None:
    counter = wmi.resolve_element(Element("skiros:Counter"))
    assert counter is not None
    wmi.remove_element(counter)
    assert not registration.is_registered()


def test_robot_of_another_manager_invalidates_registration(wmi: LocalWorldModel, registration: Registration) -> None:
    robot = registration.robot
    robot.setProperty("skiros:SkillMgr", "/another")
    wmi.update_element(robot)
    assert not registration.is_registered()


def test_changed_skill_label_invalidates_registration(wmi: LocalWorldModel, registration: Registration) -> None:
    counter = wmi.resolve_element(Element("skiros:Counter"))
    assert counter is not None
    counter.label = "another"
    wmi.update_element(counter)
    assert not registration.is_registered()


def test_registration_after_scene_change_creates_no_duplicates(
    wmi: LocalWorldModel, library: SkillLibrary, registration: Registration
) -> None:
    for element in wmi.resolve_elements(Element("cora:Robot")):
        wmi.remove_element(element)
    assert not registration.is_registered()
    registration.register_robot()
    registration.register_skills(library.implementations())
    assert registration.is_registered()
    assert skills(wmi, registration.robot_id) == ["counter", "wait"]
    assert len(wmi.resolve_elements(Element("skiros:Skill"))) == 2


def test_refused_skill_invalidates_registration(
    wmi: LocalWorldModel, library: SkillLibrary, registration: Registration, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(elements: list[Element]) -> list[Element]:
        raise WmException("not now")

    monkeypatch.setattr(wmi, "add_elements", refuse)
    with pytest.raises(WmException):
        registration.register_skills(library.implementations())
    monkeypatch.undo()
    assert not registration.is_registered()
    assert registration.register(library.implementations())
    assert skills(wmi, registration.robot_id) == ["counter", "wait"]


def test_all_skills_appear_and_disappear_at_once(
    wmi: LocalWorldModel, library: SkillLibrary, registration: Registration
) -> None:
    """Else a goal that is planned meanwhile is impossible, for lack of a skill that is about to be registered."""
    seen: list[list[str]] = []
    wmi.add_listener(lambda change: seen.append(skills(wmi, registration.robot_id)))
    registration.register_skills(library.implementations())
    registration.unregister()
    assert [labels for labels, before in zip(seen, [["counter", "wait"], *seen], strict=False) if labels != before] == [
        [], ["counter", "wait"], [],
    ]  # fmt: skip


def test_valid_registration_is_not_repeated(
    wmi: LocalWorldModel, library: SkillLibrary, registration: Registration
) -> None:
    changes: list[object] = []
    wmi.add_listener(changes.append)
    assert not registration.register(library.implementations())
    assert changes == []


def test_register_releases_devices_locked_by_former_process(wmi: LocalWorldModel, library: SkillLibrary) -> None:
    arm = Element("rparts:ArmDevice", "arm")
    arm.setProperty("skiros:StateProperty", "Busy")
    arm.setProperty("skiros:LockedBy", wmi.author)
    wmi.add_element(arm)
    assert Registration(wmi, "skiros", "test_robot", MANAGER).register(library.implementations())
    assert wmi.get_element(arm.id).value_of("skiros:StateProperty") == "Idle"
