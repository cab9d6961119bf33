"""Last wills: the changes they make, when they are executed, and their recovery from the journal."""

from __future__ import annotations

from pathlib import Path

import pytest

from skiros2_common.core.errors import SkirosError, WrongValue
from skiros2_common.core.operations import CleanupAction
from skiros2_common.core.property import Property
from skiros2_common.core.world_element import Element
from skiros2_world_model.core.journal import ALWAYS, Journal
from skiros2_world_model.core.last_will import LastWill, LastWillStore, NodeProcess
from skiros2_world_model.core.local_world_model import LocalWorldModel, source_ontologies
from skiros2_world_model.core.world_model import WorldModel

NODE = "/robot"
STATE, HOLDER = "skiros:StateProperty", "skiros:LockedBy"
FIRST, SECOND = NodeProcess("http://localhost:1/", 11), NodeProcess("http://localhost:2/", 22)
FREE = CleanupAction(HOLDER, NODE, properties={STATE: Property(STATE, "Idle"), HOLDER: Property(HOLDER, str)})
NO_SKILLS = CleanupAction("skiros:SkillMgr", NODE, "skiros:hasSkill", "skiros:skillProperty")


@pytest.fixture
def wmi() -> LocalWorldModel:
    return LocalWorldModel()


@pytest.fixture
def wills(wmi: LocalWorldModel) -> LastWillStore:
    return LastWillStore(wmi.model)


@pytest.fixture
def arm(wmi: LocalWorldModel) -> Element:
    return device(wmi, NODE)


@pytest.fixture
def robot(wmi: LocalWorldModel) -> Element:
    """A robot with a skill that has a parameter."""
    robot, skill = Element("cora:Robot", "robot"), Element("skiros:Skill", "pick")
    robot.setProperty("skiros:SkillMgr", NODE)
    skill.addRelation("-1", "skiros:hasParam", Element("skiros:Parameter", "Arm"))
    robot.addRelation("-1", "skiros:hasSkill", skill)
    wmi.add_element(robot)
    return robot


def device(wmi: LocalWorldModel, holder: str) -> Element:
    arm = Element("rparts:ArmDevice", "arm")
    arm.setProperty(STATE, "Busy")
    arm.setProperty(HOLDER, holder)
    arm.setProperty("skiros:Weight", 2.0)
    wmi.add_element(arm)
    return arm


def left(wills: LastWillStore, *actions: CleanupAction, process: NodeProcess = FIRST) -> LastWill:
    will = LastWill(NODE, process, actions)
    wills.put(will)
    return will


def state(wmi: LocalWorldModel, arm: Element) -> tuple[str | None, str | None]:
    found = wmi.get_element(arm.id)
    return found.value_of(STATE), found.value_of(HOLDER)


# -- what it does ------------------------------------------------------------------------------------------------------


def test_properties_are_written_and_taken_away_and_the_rest_stays(
    wmi: LocalWorldModel, wills: LastWillStore, arm: Element
) -> None:
    foreign = device(wmi, "/another")
    wills.execute(NODE, left(wills, FREE).process)
    assert state(wmi, arm) == ("Idle", None)
    assert wmi.get_element(arm.id).value_of("skiros:Weight") == 2.0
    assert state(wmi, foreign) == ("Busy", "/another")


def test_objects_of_the_relation_are_removed_with_their_descendants(
    wmi: LocalWorldModel, wills: LastWillStore, robot: Element
) -> None:
    wills.execute(NODE, left(wills, NO_SKILLS).process)
    assert wmi.resolve_elements(Element("skiros:Skill")) == []
    assert wmi.resolve_elements(Element("skiros:Parameter")) == []
    assert wmi.is_scene_element(robot.id)


def test_it_is_about_the_scene_as_it_is_when_it_is_carried_out(wmi: LocalWorldModel, wills: LastWillStore) -> None:
    will = left(wills, FREE)
    arm = device(wmi, NODE)
    wills.execute(NODE, will.process)
    assert state(wmi, arm) == ("Idle", None)


def test_the_author_of_the_changes_is_named(
    wmi: LocalWorldModel, wills: LastWillStore, arm: Element, robot: Element
) -> None:
    will = left(wills, FREE, NO_SKILLS)
    told = []
    wmi.add_listener(told.append)
    wills.execute(NODE, will.process)
    assert {change.author for change in told} == {"last will of /robot"}
    assert [change.action for change in told] == ["remove_recursive", "update"]


def test_where_a_part_is_refused_the_rest_is_done(
    wmi: LocalWorldModel, wills: LastWillStore, arm: Element, caplog: pytest.LogCaptureFixture
) -> None:
    unfit = CleanupAction("skiros:Weight", "2.0", properties={"skiros:Weight": Property("skiros:Weight", "no number")})
    with pytest.raises(SkirosError):
        broken = wmi.get_element(arm.id)
        broken.removeProperty("skiros:Weight")
        broken.setProperty("skiros:Weight", "no number")
        wmi.update_element(broken)
    wills.execute(NODE, left(wills, unfit, FREE).process)
    assert "each action is tried on its own" in caplog.text
    assert state(wmi, arm) == ("Idle", None)
    assert wmi.get_element(arm.id).value_of("skiros:Weight") == 2.0


@pytest.mark.parametrize("action", [CleanupAction("", NODE), CleanupAction(HOLDER, "")])
def test_action_without_key_or_value_is_refused(wills: LastWillStore, action: CleanupAction) -> None:
    with pytest.raises(WrongValue, match="expected an owner, and key and value in each cleanup action"):
        left(wills, action)
    assert wills.all() == []


# -- when --------------------------------------------------------------------------------------------------------------


def test_it_is_carried_out_once(wmi: LocalWorldModel, wills: LastWillStore, arm: Element) -> None:
    will = left(wills, FREE)
    wills.execute(NODE, will.process)
    again = device(wmi, NODE)
    wills.execute(NODE, will.process)
    assert state(wmi, again) == ("Busy", NODE)
    assert wills.all() == []


def test_one_that_was_taken_back_is_not_carried_out(wmi: LocalWorldModel, wills: LastWillStore, arm: Element) -> None:
    will = left(wills, FREE)
    wills.remove(NODE)
    wills.execute(NODE, will.process)
    assert state(wmi, arm) == ("Busy", NODE)


def test_second_will_of_a_process_replaces_the_first(wmi: LocalWorldModel, wills: LastWillStore, arm: Element) -> None:
    left(wills, NO_SKILLS)
    after = left(wills, FREE)
    assert state(wmi, arm) == ("Busy", NODE)
    assert wills.all() == [after]


def test_will_of_another_process_runs_the_former(wmi: LocalWorldModel, wills: LastWillStore, arm: Element) -> None:
    former = left(wills, FREE)
    now = left(wills, FREE, process=SECOND)
    assert state(wmi, arm) == ("Idle", None)
    mine = device(wmi, NODE)
    wills.execute(NODE, former.process)
    assert state(wmi, mine) == ("Busy", NODE)
    assert wills.all() == [now]


# -- kept --------------------------------------------------------------------------------------------------------------


def life_of_world_model(path: Path, recover: str) -> tuple[LocalWorldModel, LastWillStore, Journal]:
    journal = Journal(path, recover=recover)
    wmi = LocalWorldModel("test", WorldModel(source_ontologies(), journal=journal))
    return wmi, LastWillStore(wmi.model, journal), journal


def test_recovered_world_model_has_its_last_wills(tmp_path: Path) -> None:
    wmi, wills, journal = life_of_world_model(tmp_path / "journal", ALWAYS)
    arm = device(wmi, NODE)
    left(wills, FREE, NO_SKILLS)
    journal.close(clean=False)
    wmi, wills, journal = life_of_world_model(tmp_path / "journal", ALWAYS)
    (will,) = wills.all()
    assert (will.owner, will.process) == (NODE, FIRST)
    wills.execute(NODE, will.process)
    assert state(wmi, arm) == ("Idle", None)
    journal.close(clean=False)
    _, wills, journal = life_of_world_model(tmp_path / "journal", ALWAYS)
    assert wills.all() == []
    journal.close()


def test_world_model_without_recovery_has_no_last_wills(tmp_path: Path) -> None:
    _, wills, journal = life_of_world_model(tmp_path / "journal", "killed")
    left(wills, FREE)
    journal.close()
    _, wills, journal = life_of_world_model(tmp_path / "journal", "killed")
    assert wills.all() == []
    journal.close()


def test_unreadable_last_wills_in_the_journal_are_logged_and_dropped(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    _, _, journal = life_of_world_model(tmp_path / "journal", ALWAYS)
    journal.set_meta("last wills", '[["/robot", 1]]')
    journal.close(clean=False)
    _, wills, journal = life_of_world_model(tmp_path / "journal", ALWAYS)
    assert wills.all() == []
    assert "cannot be read" in caplog.text
    journal.close()
