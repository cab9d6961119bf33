"""Random kills and silences of all nodes lose no acknowledged change and no goal, and nothing is done twice.

`KILLS`, `SILENCES`, `GOALS` and `JOBS` in the environment set how many; `KILLS=12 SILENCES=4 GOALS=8 JOBS=6` takes
about a minute. A silent node is stopped for seconds and then continues, as one behind a radio network.
"""

from __future__ import annotations

import os
import random
import threading
import time
from collections import Counter
from pathlib import Path
from typing import Any

import pytest
import rospy
from actionlib_msgs.msg import GoalID

from skiros2_common.core.errors import SkirosError
from skiros2_gateway.ros.goals import set_on_restart
from skiros2_msgs import msg as msgs
from skiros2_world_model.ros.world_model_interface import WorldModelInterface
from support.job_cell import RESTART, ROBOT, JobCell
from support.ros import Ros, wait_until

pytestmark = pytest.mark.long

KILLS, SILENCES, GOALS, JOBS = (
    int(os.environ.get(*each)) for each in (("KILLS", "300"), ("SILENCES", "60"), ("GOALS", "200"), ("JOBS", "100"))
)
#: How long a node is silent (s): robots count as lost after 2 s, connections after 5 s.
SILENCE = 0.5, 8.0
NODES = ("/wm", "/tm", "/gateway", ROBOT)
POLICIES = ("", "continue", "ask", "abort")
#: Goals and jobs under way at once.
AT_ONCE = 3
REACHED = ("succeeded", "nothing_to_do")
#: How long a goal or a job may take, with several restarts beside other load (s).
PATIENCE = 900.0


class Goals:
    """A client that sends a goal again until it has its result: the task manager executes it once."""

    def __init__(self) -> None:
        self.results: dict[str, Any] = {}
        self._waiting: dict[str, Any] = {}
        self._asking: set[str] = set()
        self._publisher = rospy.Publisher("tm/achieve/goal", msgs.AchieveActionGoal, queue_size=100)
        self._subscribers = [
            rospy.Subscriber("tm/achieve/result", msgs.AchieveActionResult, self._on_result),
            rospy.Subscriber("tm/achieve/feedback", msgs.AchieveActionFeedback, self._on_feedback),
        ]

    def send(self, goal_id: str, text: str, policy: str) -> None:
        persist(lambda: set_on_restart(goal_id, policy))
        goal = msgs.AchieveGoal("tests", text, "", 0.0, 0, 20)
        self._waiting[goal_id] = msgs.AchieveActionGoal(goal_id=GoalID(rospy.Time.now(), goal_id), goal=goal)

    def wait(self, goal_id: str) -> Any:
        """Returns the result. Answers a question with `continue`."""
        end = time.monotonic() + PATIENCE
        while goal_id not in self.results:
            assert time.monotonic() < end, f"{goal_id} has not ended"
            self._publisher.publish(self._waiting[goal_id])
            if goal_id in self._asking:
                self._asking.discard(goal_id)
                persist(lambda: set_on_restart(goal_id, "continue"))
            time.sleep(1.0)
        return self.results[goal_id]

    def close(self) -> None:
        for subscriber in self._subscribers:
            subscriber.unregister()
        self._publisher.unregister()

    def _on_result(self, message: Any) -> None:
        self.results.setdefault(message.status.goal_id.id, message.result)

    def _on_feedback(self, message: Any) -> None:
        if message.feedback.phase == "asking":
            self._asking.add(message.status.goal_id.id)


def persist(call: Any) -> Any:
    """Repeats a call until its node runs again."""

    def once() -> Any:
        try:
            return (call(),)
        except (SkirosError, rospy.ServiceException):
            return None

    return wait_until(once, RESTART, "an answer")[0]


class Client(threading.Thread):
    """Has products carried one after the other, by goals or by jobs, and checks each."""

    def __init__(self, cell: JobCell, goals: Goals, names: list[str]) -> None:
        super().__init__(daemon=True)
        self._cell = cell
        self._goals = goals
        self._names = names
        self.outcomes: Counter[str] = Counter()
        self.wrong: list[str] = []
        self.ended = 0

    def run(self) -> None:
        for name in self._names:
            try:
                self._carry(name, POLICIES[int(name.partition("-")[2]) % len(POLICIES)])
            except Exception as error:
                self.wrong.append(f"{name}: {type(error).__name__}: {error}")
            self.ended += 1

    def _carry(self, name: str, policy: str) -> None:
        cell = self._cell
        store = cell.stores[0]
        wm = cell.world.wm
        product = persist(lambda: wm.resolve_elements(labelled(name)) or [wm.get_element(add(cell, name))])[0].id
        if name.startswith("goal"):
            self._goals.send(name, f"(skiros:contain {store} {product})", policy)
            result = self._goals.wait(name)
            state, message = result.state, result.message
        else:
            order = {"id": name, "work_master": "carry", "parameters": {"Product": product, "Place": store}}
            wait_until(lambda: self._post({**order, "on_restart": policy}), RESTART, f"that {name} is stored")
            state, message = self._wait_for_job(name)
        is_there = store == persist(lambda: place_of(wm, product))
        times = cell.carried()[product, store]
        self.outcomes[f"{policy or 'default'}: {state}"] += 1
        expected = state in REACHED or (policy == "abort" and "on_restart is abort" in message)
        if not expected:
            self.wrong.append(f"{name} ({policy or 'default'}) ended as {state}: {message}")
        if times > 1:
            self.wrong.append(f"{name} was done {times} times")
        if not is_there and (state in REACHED or times):
            self.wrong.append(f"{name} ended as {state}, was done {times} times, and its product is not there")

    def _post(self, order: dict[str, Any]) -> bool:
        """Returns whether the job is stored: a gateway that has just started may not know its elements yet."""
        status, answer = self._cell.rest.post("/api/jobs", order)
        assert status in (200, 201) or answer["code"] in ("rejected", "refused", "timed_out"), answer
        return status in (200, 201)

    def _wait_for_job(self, name: str) -> tuple[str, str]:
        end = time.monotonic() + PATIENCE
        while True:
            assert time.monotonic() < end, f"{name} has not ended"
            _, job = self._cell.rest.request("GET", f"/api/jobs/{name}", None, "operate")
            if job["response"]["collected"]:
                return job["response"]["outcome"], job["response"]["message"]
            if job["state"] == "Interrupted":
                self._cell.rest.post(f"/api/jobs/{name}/resume", {})
            time.sleep(0.5)


def labelled(name: str) -> Any:
    from skiros2_common.core.world_element import Element

    return Element("skiros:Product", name)


def add(cell: JobCell, name: str) -> str:
    return cell.world.thing("skiros:Product", name, inside=cell.shelf)


def place_of(wm: WorldModelInterface, product: str) -> str:
    (relation,) = wm.get_element(product).getRelations("", "skiros:contain", "-1")
    return str(relation["src"])


def test_faults_lose_nothing_and_nothing_is_done_twice(ros: Ros, tmp_path: Path) -> None:
    seed = int(os.environ.get("SEED", random.randrange(1 << 32)))
    chance = random.Random(seed)
    cell = JobCell(ros, tmp_path, products=0, skill="carry_once")
    goals = Goals()
    names = [f"goal-{k}" for k in range(GOALS)], [f"job-{k}" for k in range(JOBS)]
    clients = [Client(cell, goals, kind[k::AT_ONCE]) for kind in names for k in range(AT_ONCE)]
    faults = ["kill"] * KILLS + ["silence"] * SILENCES
    chance.shuffle(faults)
    done: Counter[str] = Counter()
    begin = time.monotonic()
    for client in clients:
        client.start()
    total = GOALS + JOBS
    for k, fault in enumerate(faults):
        due = k * total // len(faults)
        wait_until(lambda due=due: sum(c.ended for c in clients) >= due, PATIENCE, f"{due} ends before the next fault")
        time.sleep(chance.uniform(0.0, 0.7))  # the moment of the fault
        nodes = NODES if chance.random() < 0.1 else (chance.choice(NODES),)
        if fault == "kill":
            cell.kill(*nodes)
        else:
            cell.silence(chance.uniform(*SILENCE), *nodes)
        done[f"{fault} of {'all' if len(nodes) > 1 else nodes[0]}"] += 1
    for client in clients:
        client.join(PATIENCE)
    goals.close()
    outcomes = sum((client.outcomes for client in clients), Counter())
    wrong = [text for client in clients for text in client.wrong]
    print(f"seed {seed}: {dict(done)} in {time.monotonic() - begin:.0f} s, {dict(outcomes)}")
    assert not any(client.is_alive() for client in clients)
    assert not wrong, "\n".join(wrong)
    assert outcomes.total() == total
