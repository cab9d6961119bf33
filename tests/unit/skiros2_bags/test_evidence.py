"""A re-run compares what the engine does (conditions, hooks, values), and cancel requests."""

from __future__ import annotations

import sys
from copy import copy
from dataclasses import replace

import pytest

from skiros2_bags.testing.evidence import RecordedEvidence
from skiros2_bags.testing.field_tolerances import FieldTolerances
from skiros2_bags.testing.recording import Recording, recorded_tasks
from skiros2_bags.testing.rerun import Settings, rerun
from skiros2_common.core.abstract_skill import State
from skiros2_common.core.explanation import POST
from skiros2_common.core.world_element import Element
from skiros2_runs.core.states import SUCCESS
from skiros2_skill.core.engine.hooks import Hooks
from skiros2_skill.core.engine.parameters import Parameters
from skiros2_std_skills.action_client_primitive import PrimitiveActionClient
from skiros2_world_model.core.world_model_client import WorldModelClient
from support.ros import ROOT

BAGS = ROOT / "tests" / "bags"


@pytest.fixture(scope="module")
def engine() -> Recording:
    """Each rule of the engine makes a difference in it."""
    sys.path.append(str(ROOT / "tests" / "libraries"))
    return Recording(BAGS / "engine.bag")


def test_unchanged_engine_does_what_is_recorded(engine: Recording) -> None:
    found = rerun(engine, Settings())
    assert found.is_as_recorded
    assert not found.not_compared


def test_post_conditions_that_are_not_evaluated_are_found(monkeypatch: pytest.MonkeyPatch) -> None:
    genuine = Parameters.check
    monkeypatch.setattr(
        Parameters, "check", lambda self, stage, *args: None if stage == POST else genuine(self, stage, *args)
    )
    workspace = ROOT / "skiros2_std_lib/demos/timed_skills/owl"
    found = rerun(Recording(BAGS / "timed_drive.bag"), Settings(workspace)).divergence  # there all of them hold
    assert found is not None
    assert found.what == "root / drive"
    assert (found.expected, found.got) == ("post-condition RobotAtTarget holds", "onEnd is called")


def test_hook_that_is_not_called_is_found(engine: Recording, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Hooks, "on_end", lambda self, run, state, preempted: state)
    found = rerun(engine, Settings()).divergence
    assert found is not None
    assert found.expected == "onEnd is called"


def test_another_value_for_a_played_skill_is_found(engine: Recording, monkeypatch: pytest.MonkeyPatch) -> None:
    from replay_skills import engine as skills

    genuine = skills.engine_run.expand

    def faster(self: skills.engine_run, skill: object) -> None:
        genuine(self, skill)
        skill.children[-1].specifyParamDefault("Weight", 30.12346)  # type: ignore[attr-defined]

    monkeypatch.setattr(skills.engine_run, "expand", faster)
    found = rerun(engine, replace(Settings(), played=frozenset({"note_end"}))).divergence
    assert found is not None
    assert found.what == "root / engine_run / note_end, parameter Weight at its start"
    assert (found.expected, found.got) == ("[30.12345]", "[30.12346]")


def test_divergence_names_the_value_that_is_beyond_its_tolerance() -> None:
    recorded, now = ({"Force": [force], "Depth": [depth]} for force, depth in ((10.0, 1.0), (10.005, 2.0)))
    evidence = RecordedEvidence([("0", "pulled", "press", recorded)], FieldTolerances())
    found = evidence.difference([("0", "pulled", "press", now)], {}, is_end=True)
    assert found == ("node 0, parameter Depth at its start", "[1.0]", "[2.0]")


def test_values_that_a_played_skill_has_pushed_are_on_the_blackboard(engine: Recording) -> None:
    found = rerun(engine, replace(Settings(), played=frozenset({"produce", "step_aside"})))
    assert found.is_as_recorded, found


def test_write_of_a_played_skill_may_be_recorded_long_after_its_tick(engine: Recording) -> None:
    recording = copy(engine)
    task = recorded_tasks(recording)[0]
    nodes = (each.frame.nodes.values() for each in task.progress)
    ended = next(i for i, each in enumerate(nodes) if any(n.name == "note_end" and n.state == SUCCESS for n in each))
    tick = task.progress[ended]
    write = [e for e in recording.changes if e.change.author == task.manager and e.order < tick.order][-1]
    late = replace(write, order=tick.order + 0.5, time=tick.time + 0.1)  # type: ignore[arg-type]
    recording.events = sorted((late if e is write else e for e in engine.events), key=lambda event: event.order)
    found = rerun(recording, replace(Settings(), played=frozenset({"note_end"})))
    assert found.is_as_recorded, found


def test_goal_that_is_not_cancelled_is_found(engine: Recording, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(PrimitiveActionClient, "onPreempt", lambda self: self.success("Stopped"))
    found = rerun(engine, Settings()).divergence
    assert found is not None
    assert (found.what, found.expected) == ("a request to cancel all goals of /gripper", "sent")
    assert found.got == "not sent"


def test_cancel_request_that_is_not_recorded_is_found(engine: Recording, monkeypatch: pytest.MonkeyPatch) -> None:
    genuine = PrimitiveActionClient.onFeedback

    def cancelling(self: PrimitiveActionClient, message: object) -> State:
        self.client.cancel_goal()
        return genuine(self, message)

    from replay_skills import skills

    monkeypatch.setattr(skills.grasp, "onFeedback", cancelling)
    found = rerun(engine, Settings()).divergence
    assert found is not None
    assert (found.what, found.expected, found.got) == ("a request to cancel a goal of /gripper", "none", "sent")


def test_second_write_of_the_same_value_is_found(engine: Recording, monkeypatch: pytest.MonkeyPatch) -> None:
    genuine = WorldModelClient.update_element_properties

    def twice(self: WorldModelClient, element: Element) -> str:
        genuine(self, element)
        return genuine(self, element)

    monkeypatch.setattr(WorldModelClient, "update_element_properties", twice)
    found = rerun(engine, Settings()).divergence
    assert found is not None
    assert found.got == "writes: update cora:Robot-1"
    assert ", tick " in found.where


def test_write_that_changes_nothing_and_is_missing_is_found(engine: Recording, monkeypatch: pytest.MonkeyPatch) -> None:
    from replay_skills import engine as skills

    genuine = skills.set_weight.execute

    def unless_it_has_it(self: skills.set_weight) -> State:
        if self.params["Robot"].value.value_of(skills.WEIGHT) == self.params["Weight"].value:
            return self.success("written")
        return genuine(self)

    monkeypatch.setattr(skills.set_weight, "execute", unless_it_has_it)
    found = rerun(engine, Settings()).divergence
    assert found is not None
    assert found.what == "root / engine_run / set_weight"
    assert (found.expected, found.got) == ("writes: update cora:Robot-1", "post-condition Heavy holds")
