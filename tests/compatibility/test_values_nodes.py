"""The table of `test_values.py` on a skill manager, with another node as the editor of the scene."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from compatibility.rules import rule
from skiros2_msgs import msg as msgs
from skiros2_msgs import srv as srvs
from skiros2_skill.ros.skill_manager_interface import SkillManagerInterface
from skiros2_world_model.ros.world_model_interface import WorldModelInterface
from support.ros import Ros, RosMaster, wait_until
from support.value_table import CHANGES, WAYS, Call, Outcome, Stage, check, furnish, seen_by

pytestmark = pytest.mark.timeout(120)

ROBOT = "/test_robot"
LIBRARIES = Path(__file__).parents[1] / "libraries"
PRIMITIVES = (
    "[gate, edit, use_required, use_optional, use_inferred, use_at_second_try, use_late, hold_given, hold_inferred,"
    " find, rework]"
)
COMPOUNDS = "[above, above_inferred, remapped, specified, find_below, again, run_plan]"


class Cell:
    """A manager with the library."""

    def __init__(self, ros: Ros) -> None:
        path = f"{LIBRARIES}:{LIBRARIES.parent}:{ros.master.env['PYTHONPATH']}"
        env = {**ros.master.env, "PYTHONPATH": path}
        ros.launch("skiros2", "world_model_server.launch", gui=False)
        ros.launch(
            "skiros2", "skill_mgr.launch", libraries_list="[value_skills]",
            primitive_list=PRIMITIVES, skill_list=COMPOUNDS, env=env,
        )  # fmt: skip
        self.command = ros.service(f"{ROBOT}/command", srvs.SkillCommand)
        self.editor = WorldModelInterface("editor")
        self.client = SkillManagerInterface(ROBOT, "tests")
        self.progress = ros.messages(f"{ROBOT}/monitor", msgs.TreeProgress).connected()

    def run(self, way: str, change: str, author: str) -> None:
        """Runs a cell of the table in a scene of its own."""
        with self.stage() as stage:
            if way == "an id in JSON":
                task = self._start_by_id(stage.part)
            else:
                task = self._start(WAYS[way](self.editor.get_element(stage.part)))
            self.progress.wait_for(
                lambda m: any(p.task_id == task and p.progress_message == "waiting" for p in m.progress)
            )
            if author == "the robot":
                succeeded, messages = self._end(self._start([("Edit", {"Change": change, "Stage": vars(stage)})]))
                assert succeeded, messages
            else:
                CHANGES[change](self.editor, stage)
            self._open_gate(stage)
            succeeded, messages = self._end(task)
            said = " ".join(text for _, text in messages)
            kind = "a command" if way == "an id in JSON" else way
            check(kind, change, stage, Outcome(succeeded, seen_by(messages), said), self.editor)

    def run_late(self, change: str) -> None:
        """Another author changes the element while a skill works with it."""
        with self.stage() as stage:
            task = self._start([("UseLate", {"Object": self.editor.get_element(stage.part)})])
            wait_until(lambda: self.editor.get_element(stage.gate).hasProperty("skiros:CadModel"), what="the start")
            CHANGES[change](self.editor, stage)
            self._open_gate(stage)
            succeeded, _ = self._end(task)
            if change == "removed":
                assert not succeeded and self.editor.find_element(stage.part) is None
                return
            assert succeeded
            part = self.editor.get_element(stage.part)
            assert part.value_of("skiros:CadModel") == "used"
            assert part.value_of("skiros:Weight") == (2.0 if change == "a property" else 1.0)
            holder = stage.table if change == "a relation" else stage.shelf
            assert [r["src"] for r in part.getRelations("", "skiros:contain", "-1")] == [holder]

    @contextmanager
    def stage(self) -> Iterator[Stage]:
        stage = furnish(self.editor)
        before = {e.id for e in self.editor.get_scene_elements()}
        try:
            yield stage
        finally:
            now = {e.id for e in self.editor.get_scene_elements()}
            for eid in (now - before) | (set(vars(stage).values()) & now):
                if self.editor.find_element(eid) is not None:
                    self.editor.remove_element(eid)

    def _start(self, calls: list[Call]) -> int:
        skills = []
        for stype, params in calls:
            name = next(s.name for s in self.client.skills.values() if s.type.endswith(f":{stype}"))
            skill = self.client.get_skill(name)
            for key, value in params.items():
                skill.ph.specify(key, value)
            skills.append(skill)
        task: int = self.client.execute(skill_list=skills)
        assert task >= 0, self.client.last_error
        return task

    def _start_by_id(self, part: str) -> int:
        param = msgs.Param(json.dumps({"key": "Object", "values": part}))
        skills = [msgs.ResourceDescription(type="Gate"), msgs.ResourceDescription("UseRequired", "", [param])]
        answer = self.command("tests", "start", -1, skills)
        assert answer.ok
        return int(answer.execution_id)

    def _open_gate(self, stage: Stage) -> None:
        gate = self.editor.get_element(stage.gate)
        gate.setProperty("skiros:Weight", 1.0)
        self.editor.update_element(gate)

    def _end(self, task: int) -> tuple[bool, list[tuple[str, str]]]:
        end = self.progress.wait_for(
            lambda m: m.progress[0].task_id == task and abs(m.progress[0].progress_code) == 1 and m
        )
        nodes = [p for m in self.progress.all for p in m.progress if p.task_id == task]
        return end.progress[0].state == msgs.SkillProgress.SUCCESS, [(p.label, p.progress_message) for p in nodes]


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
@pytest.mark.parametrize("author", ["another author", "the robot"])
@pytest.mark.parametrize("way", [*WAYS, "an id in JSON"])
def test_a_skill_starts_with_the_element_as_it_is(cell: Cell, way: str, author: str) -> None:
    for change in CHANGES:
        cell.run(way, change, author)


@rule(
    "blackboard", "On a robot, a write changes only what the skill has changed, whatever another author does meanwhile"
)
@pytest.mark.parametrize("change", ["a property", "a relation", "removed"])
def test_a_write_keeps_what_another_author_has_changed_meanwhile(cell: Cell, change: str) -> None:
    cell.run_late(change)
