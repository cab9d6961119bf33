"""The command `run` with a manager in this process: what it tells of the task, and how it ends."""

import json
from types import SimpleNamespace

import pytest

from skiros2_common.command_line.command import Unavailable
from skiros2_common.command_line.layout import Screen
from skiros2_common.core.errors import Refused, SkirosError, TimedOut
from skiros2_common.core.explanation import EXECUTE, PREEMPT, Explanation
from skiros2_msgs import msg as msgs
from skiros2_skill.client.description import Why, read_skill
from skiros2_skill.command_line import connection, run_skills

ADD = read_skill(
    "skiros:Add",
    "add",
    [
        '{"key": "A", "specType": 0, "type": "float", "values": []}',
        '{"key": "Speed", "specType": 1, "type": "float", "values": [0.5]}',
        '{"key": "Sum", "specType": 1, "type": "float", "values": []}',
        '{"key": "Box", "specType": 2, "type": "skiros_wm::Element", "values": []}',
        '{"key": "Robot", "specType": 2, "type": "skiros_wm::Element", "values": []}',
    ],
)
SUCCESS, FAILURE, RUNNING = msgs.SkillProgress.SUCCESS, msgs.SkillProgress.FAILURE, msgs.SkillProgress.RUNNING


def feedback(state):
    root = msgs.SkillProgress(id=4, type=":Root", state=state, progress_code={SUCCESS: 1, FAILURE: -1}.get(state, 0))
    node = msgs.SkillProgress(id=1, parent_id=4, type="skiros:Add", label="add", state=state)
    return msgs.ExecuteSkillsFeedback(4, [root, node])


def result(state, message="", explanations=(), task_id=4, **params):
    encoded = [msgs.Param(json.dumps({"key": key, "values": values})) for key, values in params.items()]
    explained = json.dumps([explanation.to_dict() for explanation in explanations])
    return msgs.ExecuteSkillsResult(task_id, state, 1 if state == SUCCESS else -7, message, encoded, explained)


def failure(stage, label, message):
    return Explanation(stage, "skiros:Add", label, 1, -7, message)


class FakeRun:
    """A task that has a result after a number of interruptions."""

    task = 4

    def __init__(self, outcome, interruptions):
        self._outcome = outcome
        self._interruptions = interruptions
        self.cancelled = 0

    def wait(self, timeout):
        if isinstance(self._outcome, Exception):
            raise self._outcome
        if self._interruptions:
            self._interruptions -= 1
            raise KeyboardInterrupt
        return True

    def cancel(self):
        self.cancelled += 1

    def result(self):
        return self._outcome

    def succeeded(self):
        return self._outcome.state == SUCCESS

    def explanations(self):
        return [Explanation.from_dict(data) for data in json.loads(self._outcome.explanation)]


@pytest.fixture
def run(monkeypatch):
    """Runs `add` with a task that ends so. Returns the answer and the task."""
    sent = []

    def run(outcome, *words, interruptions=0, as_json=False, asked=None):
        def why(task_id):
            if asked is None:
                raise SkirosError("the manager does not answer")
            assert task_id == outcome.task_id
            return Why("", asked)

        one = FakeRun(outcome, interruptions)

        def start(steps, take):
            sent.append(steps)
            take(feedback(RUNNING))
            take(feedback(getattr(outcome, "state", RUNNING)))
            return one

        monkeypatch.setattr(connection, "become_node", lambda name: None)
        monkeypatch.setattr(run_skills, "_PROGRESS_TIMEOUT", 0.0)
        manager = SimpleNamespace(
            name="/arm", author="tests", world_model=None, read_skills=lambda: [ADD], run=start, why=why
        )
        arguments = SimpleNamespace(words=["add", "A=1", *words], detach=False, json=as_json)
        return run_skills.run(manager, arguments, Screen()), one

    return run


def test_run_prints_progress_and_found_values(run, capsys):
    box = {"id": "skiros:Box-3", "label": "tray", "type": "skiros:Box", "relations": [], "properties": {}}
    answer, _ = run(result(SUCCESS, "Success", A=[1.0], Speed=[0.7], Sum=[3.0], Box=[box], Robot=[box], Inner=[9]))
    told = capsys.readouterr().out.splitlines()
    assert told[0] == "task 4 on /arm"
    assert [line.split()[2:] for line in told[1:]] == [["▶", "add"], ["✓", "add"]]
    assert answer.status == 0
    assert answer.lines[0].startswith("task 4 has succeeded after 0.")
    assert answer.lines[1:] == ['  Box = skiros:Box-3 "tray"', "  Sum = 3.0"]
    assert answer.data["params"]["Box"] == [{"id": "skiros:Box-3", "label": "tray", "type": "skiros:Box"}]
    assert answer.data["state"] == "success"


def test_json_output_is_printed_at_the_end(run, capsys):
    answer, _ = run(result(SUCCESS), as_json=True)
    assert capsys.readouterr().out == ""
    assert answer.data["task"] == 4


def test_failure_is_explained_by_the_last_explanation(run):
    reasons = [failure(EXECUTE, "first", "slipped"), failure(EXECUTE, "add", "too heavy")]
    answer, _ = run(result(FAILURE, "add: too heavy", reasons))
    assert answer.status == 1
    assert answer.lines[0] == "add failed: too heavy."
    assert answer.lines[1].startswith("task 4 has failed after")
    assert "    too heavy" in answer.lines
    assert answer.lines[-1] == "  1 more failed before: why 4"
    assert not any("slipped" in line for line in answer.lines)
    assert [data["label"] for data in answer.data["explanations"]] == ["first", "add"]


def test_missing_explanation_is_requested_from_the_manager(run):
    asked = [failure(EXECUTE, "add", "too heavy since mary has filled it")]
    answer, _ = run(result(FAILURE, "add: too heavy", [failure(EXECUTE, "add", "too heavy")]), asked=asked)
    assert "    too heavy since mary has filled it" in answer.lines


def test_failure_without_explanation_shows_its_message(run):
    answer, _ = run(result(FAILURE, "nobody knows"))
    assert answer.lines[0].endswith(" s: nobody knows")


def test_first_interruption_preempts_and_waits(run, capsys):
    answer, task = run(result(FAILURE, "Preempted", [failure(PREEMPT, "", "Preempted")]), interruptions=1)
    assert task.cancelled == 1
    assert capsys.readouterr().err == "preempting task 4; Ctrl-C again ends this command at once\n"
    assert answer.status == 130
    assert answer.lines[0].startswith("Add was preempted at ")
    assert answer.lines[1].startswith("task 4 was preempted after")
    assert answer.data["state"] == "preempted"


def test_second_interruption_stops_waiting(run, capsys):
    with pytest.raises(KeyboardInterrupt):
        run(result(FAILURE), interruptions=2)
    assert capsys.readouterr().err.endswith("task 4 has not ended yet; it keeps running\n")


def test_refused_start_is_an_error(run):
    with pytest.raises(Refused, match="no such element"):
        run(result(FAILURE, "no such element", task_id=-1))


def test_lost_manager_is_reported(run):
    with pytest.raises(Unavailable, match="sent no status"):
        run(TimedOut("/arm/execute sent no status for 5 s"))
