"""cell_client.py: a program that follows a cell for long: a replica of its scene, and its skill managers.

It prints `ready`, and answers each line of input with a line of JSON:

    add LABEL      adds a part; its id
    parts          the labels of all parts, as its replica has them
    skills         the labels of the skills of each manager that runs
    count          runs the skill `counter` of the first manager to its end; the state it ended with
    plan GOAL      has a goal planned; the code of the result
    lock, unlock   takes or gives back the world model's advisory lock; true
    changes        how many changes it was told of, and how many of them twice
"""

from __future__ import annotations

import json
import sys
import threading
from typing import Any

import rospy

from skiros2_common.core.world_element import Element
from skiros2_skill.ros.skill_layer_interface import SkillLayerInterface
from skiros2_task.ros.task_manager_interface import TaskManagerInterface
from skiros2_world_model.ros.world_model_interface import WmException, WorldModelInterface


class CellClient:
    def __init__(self) -> None:
        self._wmi = WorldModelInterface(rospy.get_name(), make_cache=True)
        self._layer = SkillLayerInterface(rospy.get_name())
        self._told: list[str] = []
        self._ended: dict[int, int] = {}
        self._progress = threading.Condition()
        self._layer.set_monitor_cb(self._on_progress)
        self._wmi.add_listener(lambda change: self._told.append(change.snapshot_id))

    def answer(self, line: str) -> Any:
        command, _, argument = line.strip().partition(" ")
        if command == "add":
            return self._wmi.add_element(Element("skiros:Part", argument)).id
        if command == "parts":
            return sorted(str(part.label) for part in self._wmi.resolve_elements(Element("skiros:Part")))
        if command == "skills":
            return {name: sorted(agent.get_skill_list(update=True)) for name, agent in self._layer.agents.items()}
        if command == "count":
            return self._count()
        if command == "plan":
            return self._plan(argument)
        if command in ("lock", "unlock"):
            getattr(self._wmi, command)()
            return True
        if command == "changes":
            return [len(self._told), len(self._told) - len(set(self._told))]
        raise ValueError(line)

    def _count(self) -> int:
        agent = self._layer.get_agent()
        counter = agent.get_skill("counter")
        counter.ph.specify("CountTarget", 3)
        task = agent.execute(skill_list=[counter])
        with self._progress:
            self._progress.wait_for(lambda: task in self._ended, 30.0)
            return self._ended.get(task, 0)

    def _plan(self, goal: str) -> int:
        ended = threading.Event()
        codes = []

        def on_end(_: int, result: Any) -> None:
            codes.append(result.progress_code)
            ended.set()

        TaskManagerInterface().plan(goal, on_end)
        ended.wait(30.0)
        return codes[0]

    def _on_progress(self, message: Any) -> None:
        root = message.progress[0]
        if abs(root.progress_code) == 1:
            with self._progress:
                self._ended[root.id] = root.state
                self._progress.notify_all()


def main() -> None:
    answers, sys.stdout = sys.stdout, sys.stderr  # rospy prints too, when there is no master
    rospy.init_node("cell_client", disable_signals=True)
    client = CellClient()
    print("ready", file=answers, flush=True)
    for line in sys.stdin:
        try:
            answer = client.answer(line)
        except WmException as error:
            answer = str(error)
        print(json.dumps(answer), file=answers, flush=True)
    rospy.signal_shutdown("done")


if __name__ == "__main__":
    main()
