"""Planning with given planner answers."""

from __future__ import annotations

import threading
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from skiros2_common.core.world_element import Element
from skiros2_task.core.engines import FoundPlan, Limits, Outcome, PlannerAnswer
from skiros2_task.core.formula import Atom, Kind, Predicate
from skiros2_task.core.planning import TaskPlanner, Verdict
from skiros2_task.core.store import Archive
from skiros2_task.core.task import PlanningTask, PlanStep
from skiros2_task.core.world import WorldView
from support.planning_world import DRIVE, PlanningWorld, transport_world

AT = Predicate(Kind.RELATION, "skiros:at")


@dataclass
class GivenAnswer:
    """A planner that always answers the same."""

    answer: PlannerAnswer
    asked: list[PlanningTask] = field(default_factory=list)
    name: str = "given"

    def solve(self, task: PlanningTask, limits: Limits, cancelled: threading.Event | None = None) -> PlannerAnswer:
        self.asked.append(task)
        return self.answer


@pytest.fixture
def world() -> PlanningWorld:
    return transport_world()


def drive_goal(world: PlanningWorld) -> str:
    return f"(skiros:at {world.robots[0]} {world.places[1]})"


def drive_step(world: PlanningWorld) -> PlanStep:
    return PlanStep("drive", (world.robots[0], *world.places))


def planner(world: PlanningWorld, answer: PlannerAnswer, archive: Archive | None = None) -> TaskPlanner:
    return TaskPlanner(world.wm, GivenAnswer(answer), Limits(), archive)


def test_valid_plan_is_returned(world: PlanningWorld) -> None:
    answer = PlannerAnswer(Outcome.SOLVED, (FoundPlan("given", (drive_step(world),)),))
    result = planner(world, answer).plan(drive_goal(world))
    assert result.verdict is Verdict.PLANNED
    (call,) = result.calls
    assert (call.manager, call.type, call.label) == ("/alpha", "skiros:Drive", "drive")
    assert "skiros:Drive (drive) by /alpha" in result.message


@pytest.mark.parametrize("plan", [(), (PlanStep("drive", ("nobody", "nowhere", "nowhere")),), (PlanStep("dance", ()),)])
def test_invalid_plan_is_not_returned(world: PlanningWorld, plan: tuple[PlanStep, ...]) -> None:
    result = planner(world, PlannerAnswer(Outcome.SOLVED, (FoundPlan("given", plan),))).plan(drive_goal(world))
    assert (result.verdict, result.calls) == (Verdict.FAILED, ())
    assert "a plan that does not work" in result.message


@pytest.mark.parametrize(
    ("outcome", "verdict", "message"),
    [
        (Outcome.CANCELLED, Verdict.CANCELLED, "Planning was cancelled: because."),
        (Outcome.FAILED, Verdict.FAILED, "Planning failed: because."),
    ],
)
def test_reason_of_planner_is_quoted(world: PlanningWorld, outcome: Outcome, verdict: Verdict, message: str) -> None:
    result = planner(world, PlannerAnswer(outcome, reason="because")).plan(drive_goal(world))
    assert (result.verdict, result.calls, result.message) == (verdict, (), message)


def test_timeout_of_planner_is_quoted(world: PlanningWorld) -> None:
    result = planner(world, PlannerAnswer(Outcome.TIMED_OUT, reason="60 s were over")).plan(drive_goal(world))
    assert (result.verdict, result.calls) == (Verdict.TIMED_OUT, ())
    first, second = result.message.splitlines()
    expected = "No plan found in time: the goal (alpha is at Location-2) may be reachable, more time may help."
    assert (first, second) == (expected, "verdict: timed out (60 s were over)")


def test_unreachable_goal_overrides_timeout(world: PlanningWorld) -> None:
    answer = PlannerAnswer(Outcome.TIMED_OUT, reason="60 s were over")
    result = planner(world, answer).plan(f"(skiros:at {world.robots[0]} {world.products[0]})")
    assert result.verdict is Verdict.IMPOSSIBLE
    assert "(timed out: 60 s were over)" in result.message


def test_impossible_goal_is_explained(world: PlanningWorld) -> None:
    goal = f"(skiros:at {world.robots[0]} {world.products[0]})"
    result = planner(world, PlannerAnswer(Outcome.IMPOSSIBLE, reason="no way")).plan(goal)
    sentence, verdict, *_ = result.message.splitlines()
    assert sentence == "No plan: drive needs a location for TargetLocation, but Product-3 is a product."
    assert verdict == "verdict: proven impossible (no way)"


def test_planner_is_not_called_for_trivial_goals(world: PlanningWorld) -> None:
    given = GivenAnswer(PlannerAnswer(Outcome.FAILED))
    tasks = TaskPlanner(world.wm, given, Limits())
    assert tasks.plan(f"(skiros:at {world.robots[0]} {world.places[0]})").verdict is Verdict.NOTHING_TO_DO
    assert tasks.plan(f"(skiros:hasA {world.places[0]} {world.products[0]})").verdict is Verdict.IMPOSSIBLE
    assert given.asked == []


def test_reading_the_world_for_a_goal_needs_no_query(world: PlanningWorld, monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(*_: object, **__: object) -> list[str]:
        raise AssertionError("a SPARQL query")

    monkeypatch.setattr(world.wm.transport.server, "query", refused)
    monkeypatch.setattr(world.wm.transport.server, "query_json", refused)
    planner = TaskPlanner(world.wm, GivenAnswer(PlannerAnswer(Outcome.FAILED)), Limits(30.0))
    for goal in (drive_goal(world), f"(forall (?p - skiros:Product) (skiros:contain {world.places[-1]} ?p))"):
        assert planner.read_task(goal).init


def test_goals_share_one_reading_of_the_scene_until_it_changes(
    world: PlanningWorld, monkeypatch: pytest.MonkeyPatch
) -> None:
    readings, resolve = [], type(world.wm).resolve_elements
    monkeypatch.setattr(
        type(world.wm), "resolve_elements", lambda self, wanted: readings.append(wanted) or resolve(self, wanted)
    )
    planner = TaskPlanner(world.wm, GivenAnswer(PlannerAnswer(Outcome.FAILED)), Limits(30.0))
    (robot,), (here, there) = world.robots, world.places
    for number in range(1, 4):
        for place in world.places:
            task = planner.read_task(f"(skiros:at {robot} {place})")
            assert Atom(AT, (robot, here)) in task.init
            assert Atom(AT, (robot, there)) not in task.init
        assert len(readings) == number
        world.wm.set_relation(robot, "skiros:at", here, False)
        world.relate(robot, "skiros:at", there)
        here, there = there, here


def test_objects_of_one_goal_are_not_in_the_next(world: PlanningWorld) -> None:
    world.wm.add_individual(Element("skiros:Location", "skiros:somewhere"))
    planner = TaskPlanner(world.wm, GivenAnswer(PlannerAnswer(Outcome.FAILED)), Limits(30.0))
    assert "skiros:somewhere" in planner.read_task(f"(skiros:at {world.robots[0]} skiros:somewhere)").objects
    assert "skiros:somewhere" not in planner.read_task(drive_goal(world)).objects


def test_manager_that_appears_is_known_without_a_change_of_the_scene(world: PlanningWorld) -> None:
    running = {"/other": ""}
    given = GivenAnswer(PlannerAnswer(Outcome.FAILED))
    planner = TaskPlanner(world.wm, given, Limits(30.0), running=lambda named: dict(running))
    assert not planner.read_task(drive_goal(world)).actions
    running["/alpha"] = ""
    assert planner.read_task(drive_goal(world)).actions


def test_view_has_the_names_of_the_ontologies(world: PlanningWorld) -> None:
    view = WorldView(world.wm)
    assert {"skiros:Location", "skiros:Product"} <= view.classes()
    assert {"skiros:contain", "skiros:at"} <= view.relations()
    assert "skiros:PublishTf" in view.boolean_properties()
    assert "skiros:Weight" in view.properties() - view.boolean_properties()
    assert "skiros:unknown_location" in view.templates()
    assert not {name for name in view.classes() if name.startswith("_:")}


def test_cancelled_request_does_not_reach_planner(world: PlanningWorld) -> None:
    given = GivenAnswer(PlannerAnswer(Outcome.FAILED))
    cancelled = threading.Event()
    result = TaskPlanner(world.wm, given, Limits()).plan(drive_goal(world), cancelled, lambda _: cancelled.set())
    assert (result.verdict, result.calls) == (Verdict.CANCELLED, ())
    assert given.asked == []


def test_goal_about_missing_class_is_impossible(world: PlanningWorld) -> None:
    given = GivenAnswer(PlannerAnswer(Outcome.FAILED))
    goal = f"(exists (?x - skiros:Starter) (skiros:contain {world.places[1]} ?x))"
    result = TaskPlanner(world.wm, given, Limits()).plan(goal)
    assert result.verdict is Verdict.IMPOSSIBLE
    assert "the scene has no element of class skiros:Starter" in result.message
    assert given.asked == []


def test_skill_manager_gets_plan_for_its_robot() -> None:
    world = transport_world(robots=2)
    given = GivenAnswer(PlannerAnswer(Outcome.FAILED))
    tasks = TaskPlanner(world.wm, given, Limits())
    goal = f"(skiros:contain {world.places[1]} {world.products[0]})"
    tasks.plan(goal, asked_by="/beta")
    tasks.plan(goal, asked_by="somebody")
    managers = [{manager for a in task.actions for _, manager in a.managers} for task in given.asked]
    assert managers == [{"/beta"}, {"/alpha", "/beta"}]


def test_goal_with_too_large_expansion_is_refused(world: PlanningWorld) -> None:
    for _ in range(60):
        world.thing("skiros:Product")
    goal = "(forall (?a ?b ?c - skiros:Product) (skiros:contain ?a ?b))"
    result = planner(world, PlannerAnswer(Outcome.SOLVED)).plan(goal)
    assert result.verdict is Verdict.FAILED
    assert "the limit is 100000" in result.message


def test_files_of_request_are_archived(world: PlanningWorld, tmp_path: Path) -> None:
    files = (("domain.pddl", "(define"), ("p01.pddl", "(define"))
    answer = PlannerAnswer(Outcome.SOLVED, (FoundPlan("given", (drive_step(world),)),), log="found it", files=files)
    planner(world, answer, Archive(tmp_path)).plan(drive_goal(world))
    (request,) = (p for p in tmp_path.iterdir() if p.is_dir())
    assert {p.name for p in request.iterdir()} == {
        "domain.pddl",
        "p01.pddl",
        "goal.txt",
        "result.txt",
        "planner.log",
    }
    assert (request / "goal.txt").read_text() == drive_goal(world)
    assert "planned\nskiros:Drive (drive)" in (request / "result.txt").read_text()
    assert {p.name for p in tmp_path.iterdir() if p.is_file()} == {"domain.pddl", "p01.pddl"}


def test_only_the_registered_robot_of_a_running_manager_takes_steps() -> None:
    world = transport_world()
    stale, (start, place) = world.robots[0], world.places
    registered = world.robot("alpha", DRIVE, at=start)
    gone = world.robot("beta", DRIVE, at=start)
    given = GivenAnswer(PlannerAnswer(Outcome.FAILED))

    def robots(running: dict[str, str]) -> set[tuple[str, str]]:
        goal = f"(exists (?x - cora:Robot) (skiros:at ?x {place}))"
        TaskPlanner(world.wm, given, Limits(), running=lambda _: running).plan(goal)
        return {pair for action in given.asked.pop().actions for pair in action.managers}

    assert robots({"/alpha": registered}) == {(registered, "/alpha")}
    both = {(registered, "/cell/alpha"), (gone, "/other/beta")}
    assert robots({"/cell/alpha": registered, "/other/beta": gone}) == both
    assert robots({"/alpha": ""}) == {(stale, "/alpha"), (registered, "/alpha")}  # an older manager
    assert robots({}) == {(stale, "/alpha"), (registered, "/alpha"), (gone, "/beta")}
