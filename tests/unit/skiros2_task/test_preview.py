"""Plan simulation. The fixture `plan` also simulates each plan of the catalogue."""

from __future__ import annotations

from skiros2_common.core.world_element import Element
from skiros2_task.core.actions import condition_predicates
from skiros2_task.core.compiler import make_task
from skiros2_task.core.goal_reader import GoalReader
from skiros2_task.core.partial_order import PartialOrder
from skiros2_task.core.plan import plan_of
from skiros2_task.core.preview import FactChange, Preview, preview
from skiros2_task.core.schedule import Schedule, Scheduled
from skiros2_task.core.task import PlanStep
from skiros2_task.core.world import WorldView
from skiros2_world_model.core.preview_copy import PreviewCopy
from support.planning_world import INFERRED, REQUIRED, PlanningWorld, has, made, prop, related, skill, transport_world

HERE = [("Place", "skiros:Location", INFERRED)]
PRODUCT = [("Object", "skiros:Product", REQUIRED)]


def tried(world: PlanningWorld, goal: str, *plan: PlanStep) -> Preview:
    view = WorldView(world.wm)
    order = PartialOrder(plan, frozenset(), ())
    scheduled = Schedule(order, tuple(Scheduled(i, "", 0.0, 0.0) for i in range(len(plan))), 0.0)
    task = make_task(view, GoalReader(view, condition_predicates(view.robots)).read(goal))
    return preview(PreviewCopy(world.wm), plan_of(task, scheduled, view.objects))


def drive(world: PlanningWorld, start: int, end: int) -> PlanStep:
    return PlanStep("drive", (world.robots[0], world.places[start], world.places[end]))


def test_step_reports_changes() -> None:
    world = transport_world(places=3)
    found = tried(world, f"(skiros:at {world.robots[0]} {world.places[2]})", drive(world, 0, 1), drive(world, 1, 2))
    robot = world.robots[0]
    assert found.works
    assert found.labels[robot] == "skiros:alpha"
    assert f'Robot={robot} "skiros:alpha"' in str(found)
    assert [step.changes for step in found.steps] == [
        [
            FactChange(robot, "skiros:at", world.places[i], False, is_relation=True),
            FactChange(robot, "skiros:at", world.places[i + 1], True, is_relation=True),
        ]
        for i in range(2)
    ]
    assert found.steps[0].manager == "/alpha"
    assert found.steps[0].arguments == {
        "Robot": robot,
        "StartLocation": world.places[0],
        "TargetLocation": world.places[1],
    }


def test_world_model_is_unchanged() -> None:
    world = transport_world()
    before = {e.id: e.printState(verbose=True) for e in world.wm.resolve_elements(Element())}
    version = world.wm.version
    tried(world, f"(skiros:at {world.robots[0]} {world.places[1]})", drive(world, 0, 1))
    assert {e.id: e.printState(verbose=True) for e in world.wm.resolve_elements(Element())} == before
    assert world.wm.version == version


def test_unsatisfied_conditions_are_reported() -> None:
    world = transport_world(places=3)
    found = tried(world, f"(skiros:at {world.robots[0]} {world.places[2]})", drive(world, 1, 2))
    assert not found.works
    (unmet,) = found.steps[0].unsatisfied
    assert world.places[0] in unmet
    assert found.reached


def test_unreached_goal_is_reported() -> None:
    world = transport_world(places=3)
    found = tried(world, f"(skiros:at {world.robots[0]} {world.places[2]})", drive(world, 0, 1))
    assert not found.reached
    assert not found.works
    assert str(found).endswith("the goal does not hold at the end")


def test_created_and_removed_elements_affect_later_steps() -> None:
    world = transport_world()
    bake = skill(
        "Bake",
        [*PRODUCT, *HERE],
        [related("Robot", "skiros:at", "Place")],
        [made("Object"), related("Place", "skiros:contain", "Object")],
    )
    eat = skill(
        "Eat",
        [*PRODUCT, *HERE],
        [related("Place", "skiros:contain", "Object")],
        [made("Object", False), prop("Robot", "skiros:Fed", "=", True)],
    )
    cook = world.robot("cook", bake, eat, at=world.places[0])
    world.robots = [cook]
    found = tried(
        world,
        f"(skiros:Fed {cook})",
        PlanStep("bake", (cook, "new skiros:Product 1", world.places[0])),
        PlanStep("eat", (cook, "new skiros:Product 1", world.places[0])),
    )
    assert found.works, str(found)
    baked, eaten = found.steps
    assert baked.arguments["Object"] == "a new skiros:Product"
    (new,) = [change.element for change in baked.changes if not change.name]
    assert FactChange(world.places[0], "skiros:contain", new, True, is_relation=True) in baked.changes
    assert FactChange(new, "", "", False) in eaten.changes


def test_open_effect_is_assumed_and_reported() -> None:
    world = transport_world()
    fill = skill(
        "Fill", [*PRODUCT], [has("Object", "skiros:Weight", False)], [prop("Object", "skiros:Weight", ">", 2.0)]
    )
    filler = world.robot("filler", fill)
    found = tried(world, f"(> (skiros:Weight {world.products[0]}) 1)", PlanStep("fill", (filler, world.products[0])))
    assert found.works, str(found)
    (assumed,) = found.steps[0].assumed
    assert assumed.startswith(f"{world.products[0]} skiros:Weight 3.0, an example for: ")


def test_preview_json_round_trip() -> None:
    world = transport_world(places=3)
    found = tried(world, f"(skiros:at {world.robots[0]} {world.places[2]})", drive(world, 1, 2))
    assert Preview.from_json(found.to_json()) == found
