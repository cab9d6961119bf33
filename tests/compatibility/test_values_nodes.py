"""The table of `test_values.py` on a skill manager, with another node as the editor of the scene."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from compatibility.rules import rule
from skiros2_msgs import msg as msgs
from skiros2_msgs import srv as srvs
from skiros2_skill.ros.skill_manager_interface import SkillManagerInterface
from skiros2_world_model.ros.world_model_interface import WorldModelInterface
from support.ros import Ros, RosMaster
from support.value_table import CHANGES, WAYS, Outcome, Stage, check, furnish, seen_by

pytestmark = pytest.mark.timeout(120)

ROBOT = "/test_robot"
LIBRARIES = Path(__file__).parents[1] / "libraries"
PRIMITIVES = (
    "[gate, use_required, use_optional, use_inferred, use_at_second_try, hold_given, hold_inferred, find, rework]"
)
COMPOUNDS = "[above, above_inferred, remapped, specified, find_below, again, run_plan]"


class Cell:
    """A manager with the library."""

    def __init__(self, ros: Ros) -> None:
        env = {**ros.master.env, "PYTHONPATH": f"{LIBRARIES}:{ros.master.env['PYTHONPATH']}"}
        ros.launch("skiros2", "world_model_server.launch", gui=False)
        ros.launch(
            "skiros2", "skill_mgr.launch", libraries_list="[value_skills]",
            primitive_list=PRIMITIVES, skill_list=COMPOUNDS, env=env,
        )  # fmt: skip
        ros.service(f"{ROBOT}/command", srvs.SkillCommand)
        self.editor = WorldModelInterface("editor")
        self.client = SkillManagerInterface(ROBOT, "tests")
        self.progress = ros.messages(f"{ROBOT}/monitor", msgs.TreeProgress).connected()

    def run(self, way: str, change: str) -> None:
        """Runs a cell of the table in a scene of its own."""
        stage = furnish(self.editor)
        before = {e.id for e in self.editor.get_scene_elements()}
        try:
            self._run(way, change, stage)
        finally:
            now = {e.id for e in self.editor.get_scene_elements()}
            for eid in (now - before) | (set(vars(stage).values()) & now):
                if self.editor.find_element(eid) is not None:
                    self.editor.remove_element(eid)

    def _run(self, way: str, change: str, stage: Stage) -> None:
        calls = WAYS[way](self.editor.get_element(stage.part))
        skills = []
        for stype, params in calls:
            name = next(s.name for s in self.client.skills.values() if s.type.endswith(f":{stype}"))
            skill = self.client.get_skill(name)
            for key, value in params.items():
                skill.ph.specify(key, value)
            skills.append(skill)
        task = self.client.execute(skill_list=skills)
        assert task >= 0, self.client.last_error
        self.progress.wait_for(lambda m: any(p.task_id == task and p.progress_message == "waiting" for p in m.progress))
        CHANGES[change](self.editor, stage)
        gate = self.editor.get_element(stage.gate)
        gate.setProperty("skiros:Weight", 1.0)
        self.editor.update_element(gate)
        end = self.progress.wait_for(
            lambda m: m.progress[0].task_id == task and abs(m.progress[0].progress_code) == 1 and m
        )
        messages = [
            (p.label, p.progress_message) for m in self.progress.all for p in m.progress if p.task_id == task
        ]
        root = end.progress[0]
        succeeded = root.state == msgs.SkillProgress.SUCCESS
        said = " ".join(text for _, text in messages)
        check(way, change, stage, Outcome(succeeded, seen_by(messages), said), self.editor)


@pytest.fixture(scope="module")
def cell(ros_master: RosMaster) -> Iterator[Cell]:
    ros = Ros(ros_master)
    try:
        cell = Cell(ros)
        yield cell
        cell.client.shutdown()
    finally:
        ros.stop()


@rule("blackboard", "On a robot, an element is read when the skill starts, whichever way it came",
      better="a write changes only what the skill has changed since then")  # fmt: skip
@pytest.mark.parametrize("way", WAYS)
def test_a_skill_starts_with_the_element_as_it_is(cell: Cell, way: str) -> None:
    for change in CHANGES:
        cell.run(way, change)
