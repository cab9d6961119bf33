"""Work masters that elements of the scene define."""

from __future__ import annotations

import asyncio

import pytest

from skiros2_common.core.world_element import Element
from skiros2_gateway.core.problems import Rejected
from skiros2_gateway.core.work_masters import DEFINITION, WORK_MASTER, WorkMasters, work_masters_of
from skiros2_gateway.ros.scene_work_masters import SceneWorkMasters
from skiros2_skill.testing import SkillBench
from skiros2_world_model.core.wm_errors import WmException

PARK = """
goal: (skiros:at cora:Robot-1 {Place})
parameters: [{id: Place, type: "skiros:Location"}]
"""


def element(label: str, definition: str = "") -> Element:
    made = Element(WORK_MASTER, label)
    if definition:
        made.setProperty(DEFINITION, definition)
    return made


def test_element_defines_a_work_master_with_its_label_as_the_id() -> None:
    (master,), problems = work_masters_of([element("park", PARK)])
    assert not problems
    assert master.id == "park"
    assert master.goal_for({"Place": "skiros:Location-5"}) == '(skiros:at cora:Robot-1 "skiros:Location-5")'


def test_each_wrong_element_is_named_and_the_others_are_kept() -> None:
    wrong = [element("empty"), element("broken", "goal: ["), element("two words", "gaol: x"), element("park", PARK)]
    masters, problems = work_masters_of([element("park", PARK), *wrong])
    assert [master.id for master in masters] == ["park"]
    assert len(problems) == 4
    for name, reason in zip(problems, ("expected the fields", "while parsing", "gaol", "another element"), strict=True):
        assert reason in name
    assert "two words" in problems[2] and "goal: " in problems[2]


def test_definition_that_grows_without_end_is_refused() -> None:
    anchors = [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]" for i in range(1, 12)]
    masters, (problem,) = work_masters_of([element("bomb", "\n".join([PARK.strip(), "a0: &a0 [x]", *anchors]))])
    assert not masters and "stands for more than" in problem and len(problem) < 300


def test_changes_of_the_scene_take_effect(caplog: pytest.LogCaptureFixture) -> None:
    async def follow() -> None:
        with SkillBench() as bench:
            masters = WorkMasters()
            eid = bench.wmi.add_element(element("park", PARK)).id
            SceneWorkMasters(bench.wmi, masters, asyncio.get_running_loop())
            await asyncio.sleep(0)
            assert set(masters.all) == {"park"}
            changed = bench.wmi.get_element(eid)
            changed.setProperty(DEFINITION, "goal: (skiros:at cora:Robot-1 {Site})")
            bench.wmi.update_element(changed)
            await asyncio.sleep(0)
            assert not masters.all
            bench.wmi.remove_element(eid)
            await asyncio.sleep(0)
            with pytest.raises(Rejected, match="no work master 'park'"):
                masters.get("park")

    asyncio.run(follow())
    assert [record.message for record in caplog.records if "Site" in record.message]


def test_failed_read_is_repeated_with_the_next_change(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(_: Element) -> list[Element]:
        raise WmException("service wm/get does not answer")

    async def follow() -> None:
        with SkillBench() as bench:
            masters = WorkMasters()
            SceneWorkMasters(bench.wmi, masters, asyncio.get_running_loop())
            with monkeypatch.context() as broken:
                broken.setattr(bench.wmi, "resolve_elements", fail)
                bench.wmi.add_element(element("park", PARK))
            bench.wmi.add_element(Element("skiros:Product", "box"))
            await asyncio.sleep(0)
            assert set(masters.all) == {"park"}

    asyncio.run(follow())
