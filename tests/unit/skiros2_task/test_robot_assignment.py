"""Assignment of plan parts to robots."""

from __future__ import annotations

import itertools
from collections.abc import Mapping

from hypothesis import given, settings
from hypothesis import strategies as st

from skiros2_common.core.skill_description import ParamOptions
from skiros2_task.core.actions import condition_predicates
from skiros2_task.core.compiler import make_task
from skiros2_task.core.formula import conjunction
from skiros2_task.core.goal_reader import GoalReader
from skiros2_task.core.partial_order import deorder
from skiros2_task.core.schedule import Schedule, schedule, seconds_of
from skiros2_task.core.store import Durations
from skiros2_task.core.task import PlanningTask, PlanStep, validate
from skiros2_task.core.world import WorldView
from support.planning_world import (
    DRIVE,
    INFERRED,
    PICK,
    PLACE,
    REQUIRED,
    PlanningWorld,
    prop,
    related,
    skill,
)
from support.planning_world import given as specified
from support.transport_task import at, contain, transport_task

R = tuple(f"cora:Robot-{i}" for i in range(3))
G = tuple(f"rparts:GripperEffector-{i}" for i in range(3))
L = tuple(f"skiros:Location-{i}" for i in range(6))
P = tuple(f"skiros:Product-{i}" for i in range(6))
SECONDS = {"drive": 5.0, "pick": 2.0, "place": 2.0}


def known(task: PlanningTask, seconds: Mapping[str, float] = SECONDS) -> Durations:
    durations = Durations()
    for action in task.actions:
        durations.record(action.skill, "", seconds.get(action.name, 1.0))
    return durations


def scheduled(task: PlanningTask, plan: list[PlanStep], durations: Durations | None = None) -> Schedule:
    assert validate(task, plan) == ""
    found = schedule(task, deorder(task, plan), durations or known(task))
    assert validate(task, found.order.steps) == ""
    assert found.bound <= found.makespan + 1e-9
    return found


def bring(robot: int, product: int, start: int, target: int) -> list[PlanStep]:
    hand = (R[robot], G[robot])
    return [
        PlanStep("pick", (*hand, L[start], P[product])),
        PlanStep("drive", (R[robot], L[start], L[target])),
        PlanStep("place", (*hand, L[target], P[product])),
    ]


def drive(robot: int, start: int, target: int) -> PlanStep:
    return PlanStep("drive", (R[robot], L[start], L[target]))


# -- drive, pick and place ----------------------------------------------------------------------------------------


def test_work_of_one_robot_is_shared() -> None:
    task = transport_task(2, 4, 4, conjunction([contain(L[1], P[0]), contain(L[3], P[2])]))
    plan = [*bring(0, 0, 0, 1), drive(0, 1, 2), *bring(0, 2, 2, 3)]
    found = scheduled(task, plan)
    assert {s.robot for s in found.steps} == {R[0], R[1]}
    assert found.makespan == 14.0  # the longer of 2 + 5 + 2 and 5 + 2 + 5 + 2, not their sum


def test_determined_parameters_follow_robot() -> None:
    task = transport_task(2, 4, 4, conjunction([contain(L[1], P[0]), contain(L[3], P[2])]))
    found = scheduled(task, [*bring(0, 0, 0, 1), drive(0, 1, 2), *bring(0, 2, 2, 3)])
    assert [str(found.order.steps[s.step]) for s in found.steps if s.robot == R[1]] == [
        f"(drive {R[1]} {L[0]} {L[2]})",
        f"(pick {R[1]} {G[1]} {L[2]} {P[2]})",
        f"(drive {R[1]} {L[2]} {L[3]})",
        f"(place {R[1]} {G[1]} {L[3]} {P[2]})",
    ]


def test_round_trip_is_split_into_parts() -> None:
    """Each product to the place of the next: a robot that goes round saves a drive for each."""
    task = transport_task(2, 6, 6)
    plan = [step for i in range(6) for step in bring(0, i, i, (i + 1) % 6)]
    found = scheduled(task, plan)
    assert found.makespan == 5.0 + 3 * 9.0


def test_goal_about_robot_pins_its_steps() -> None:
    goal = conjunction([contain(L[1], P[0]), contain(L[3], P[2]), at(R[0], L[5])])
    plan = [*bring(0, 0, 0, 1), drive(0, 1, 2), *bring(0, 2, 2, 3), drive(0, 3, 5)]
    found = scheduled(transport_task(2, 6, 6, goal), plan)
    assert found.makespan == 14.0
    last = max((s for s in found.steps if s.robot == R[0]), key=lambda s: s.end)
    assert found.order.steps[last.step].arguments[2] == L[5]


def test_shortest_plan_is_unchanged() -> None:
    task = transport_task(2, 2, 1)
    plan = bring(0, 0, 0, 1)
    assert scheduled(task, plan).order.steps == tuple(plan)


def test_handover_keeps_order() -> None:
    task = transport_task(2, 3, 1, contain(L[2], P[0]))
    plan = [*bring(0, 0, 0, 1), *bring(0, 0, 1, 2)]
    found = scheduled(task, plan)
    assert found.makespan == 18.0


# -- worlds ------------------------------------------------------------------------------------------------------------


def planned(world: PlanningWorld, goal: str) -> PlanningTask:
    view = WorldView(world.wm)
    return make_task(view, GoalReader(view, condition_predicates(view.robots)).read(goal))


def test_only_capable_robots_are_assigned() -> None:
    world = PlanningWorld()
    places = [world.thing("skiros:Location") for _ in range(4)]
    products = [world.thing("skiros:Product", inside=places[i]) for i in (0, 2)]
    robots = [world.robot("alpha", DRIVE, PICK, PLACE, at=places[0]), world.robot("driver", DRIVE, at=places[2])]
    gripper = world.gripper(robots[0])
    world.gripper(robots[1])
    task = planned(world, f"(skiros:contain {places[1]} {products[0]}), (skiros:contain {places[3]} {products[1]})")
    hand = (robots[0], gripper)
    plan = []
    for product, start, target in ((products[0], 0, 1), (products[1], 2, 3)):
        if start:
            plan.append(PlanStep("drive", (robots[0], places[1], places[start])))
        plan.append(PlanStep("pick", (*hand, places[start], product)))
        plan.append(PlanStep("drive", (robots[0], places[start], places[target])))
        plan.append(PlanStep("place", (*hand, places[target], product)))
    assert {s.robot for s in scheduled(task, plan).steps} == {robots[0]}


def test_shared_location_is_not_a_tool() -> None:
    """Each robot may go to some places only; one place is for both."""
    world = PlanningWorld()
    places = [world.thing("skiros:Location") for _ in range(4)]
    products = [world.thing("skiros:Product", inside=places[0]) for _ in range(3)]
    reach = [related("Robot", "skiros:hasAccess", key) for key in ("TargetLocation", "Place")]
    go = skill(
        "Drive",
        [("StartLocation", "skiros:Location", INFERRED), ("TargetLocation", "skiros:Location", REQUIRED)],
        [related("Robot", "skiros:at", "StartLocation"), reach[0]],
        [related("Robot", "skiros:at", "StartLocation", False), related("Robot", "skiros:at", "TargetLocation")],
    )
    look = skill(
        "Look",
        [("Place", "skiros:Location", INFERRED), ("Object", "skiros:Product", REQUIRED)],
        [related("Robot", "skiros:at", "Place"), reach[1], related("Place", "skiros:contain", "Object")],
        [SEE],
    )
    robots = [world.robot(name, go, look, at=places[at]) for name, at in (("alpha", 1), ("beta", 2), ("gamma", 3))]
    for robot, there in ((0, (0, 1)), (1, (0, 2)), (2, (3,))):
        for place in there:
            world.relate(robots[robot], "skiros:hasAccess", places[place])
    task = planned(world, ", ".join(f"(Seen {p})" for p in products))
    plan = [PlanStep("drive", (robots[0], places[1], places[0]))]
    plan += [PlanStep("look", (robots[0], places[0], product)) for product in products]
    found = scheduled(task, plan, known(task, {"drive": 1.0, "look": 5.0}))
    assert found.makespan == 11.0
    assert {s.robot for s in found.steps} == {robots[0], robots[1]}


def test_chained_moves_are_not_reassigned() -> None:
    """Only neighbouring places are connected: parts with several drives keep their robot."""
    world = PlanningWorld()
    places = [world.thing("skiros:Location") for _ in range(3)]
    for one, other in ((0, 1), (1, 2), (1, 0), (2, 1)):
        world.relate(places[one], "skiros:hasAccess", places[other])
    go = skill(
        "Drive",
        [("StartLocation", "skiros:Location", INFERRED), ("TargetLocation", "skiros:Location", REQUIRED)],
        [
            related("Robot", "skiros:at", "StartLocation"),
            related("StartLocation", "skiros:hasAccess", "TargetLocation"),
        ],
        [related("Robot", "skiros:at", "StartLocation", False), related("Robot", "skiros:at", "TargetLocation")],
    )
    product = world.thing("skiros:Product", inside=places[0])
    robots = [world.robot(name, go, PICK, PLACE, at=places[0]) for name in ("alpha", "beta")]
    hand = (robots[0], *[world.gripper(robot) for robot in robots][:1])
    task = planned(world, f"(skiros:contain {places[2]} {product})")
    plan = [
        PlanStep("pick", (*hand, places[0], product)),
        PlanStep("drive", (robots[0], places[0], places[1])),
        PlanStep("drive", (robots[0], places[1], places[2])),
        PlanStep("place", (*hand, places[2], product)),
    ]
    assert scheduled(task, plan).makespan == 14.0


SEE = prop("Object", "skiros:Seen", "=", True)


def looking_world() -> tuple[PlanningWorld, list[str], list[str], str]:
    """Two robots that look at four products, with a camera that they lock."""
    world = PlanningWorld()
    camera = world.thing("skiros:DepthCamera", StateProperty="Idle")
    products = [world.thing("skiros:Product") for _ in range(4)]
    look = skill(
        "Look",
        [("Object", "skiros:Product", REQUIRED), ("Camera", "skiros:DepthCamera", INFERRED, [ParamOptions.Lock])],
        [specified("Object")],
        [SEE],
    )
    return world, [world.robot(name, look) for name in ("alpha", "beta")], products, camera


def test_shared_device_orders_robots() -> None:
    world, robots, products, camera = looking_world()
    task = planned(world, ", ".join(f"(Seen {p})" for p in products))
    plan = [PlanStep("look", (robots[0], p, camera)) for p in products]
    found = scheduled(task, plan)
    assert found.makespan == 4.0
    times = sorted((s.start, s.end) for s in found.steps)
    assert all(one[1] <= other[0] for one, other in itertools.pairwise(times))


def test_steps_without_shared_device_overlap() -> None:
    world = PlanningWorld()
    products = [world.thing("skiros:Product") for _ in range(4)]
    look = skill("Look", [("Object", "skiros:Product", REQUIRED)], [specified("Object")], [SEE])
    robots = [world.robot(name, look) for name in ("alpha", "beta")]
    task = planned(world, ", ".join(f"(Seen {p})" for p in products))
    assert scheduled(task, [PlanStep("look", (robots[0], p)) for p in products]).makespan == 2.0


def test_faster_robot_gets_more_work() -> None:
    world = PlanningWorld()
    products = [world.thing("skiros:Product") for _ in range(4)]
    robots = []
    for name, seconds in (("slow", 6.0), ("fast", 2.0)):
        look = skill("Look", [("Object", "skiros:Product", REQUIRED)], [specified("Object")], [SEE])
        look.set_duration(seconds)
        robots.append(world.robot(name, look))
    task = planned(world, ", ".join(f"(Seen {p})" for p in products))
    slow = next(a.name for a in task.actions if a.skill.duration == 6.0)
    found = scheduled(task, [PlanStep(slow, (robots[0], p)) for p in products])
    assert found.makespan == 6.0
    assert sorted(s.robot for s in found.steps) == sorted([robots[0], *[robots[1]] * 3])


def test_prepared_robot_keeps_step() -> None:
    world = PlanningWorld()
    products = [world.thing("skiros:Product") for _ in range(2)]
    arm = skill("Arm", [], [prop("Robot", "skiros:Armed", "=", False)], [prop("Robot", "skiros:Armed", "=", True)])
    look = skill("Look", [("Object", "skiros:Product", REQUIRED)], [prop("Robot", "skiros:Armed", "=", True)], [SEE])
    robots = [world.robot(name, arm, look) for name in ("alpha", "beta")]
    for robot in robots:
        element = world.wm.get_element(robot)
        element.setProperty("skiros:Armed", False)
        world.wm.update_element(element)
    task = planned(world, ", ".join(f"(Seen {p})" for p in products))
    plan = [PlanStep("arm", (robots[0],)), *(PlanStep("look", (robots[0], p)) for p in products)]
    durations = known(task, {"arm": 1.0, "look": 5.0})
    assert scheduled(task, plan, durations).makespan == 6.0
    assert scheduled(task, plan, known(task, {"arm": 9.0, "look": 5.0})).makespan == 14.0


def test_ordered_parts_keep_order() -> None:
    """Base before lid; each may be done by any robot."""
    world = PlanningWorld()
    product = world.thing("skiros:Product")
    done = {name: prop("Object", f"skiros:{name}", "=", True) for name in ("Base", "Lid")}
    params = [("Object", "skiros:Product", REQUIRED)]
    base, lid = (
        skill("Base", params, [specified("Object")], [done["Base"]]),
        skill("Lid", params, [done["Base"]], [done["Lid"]]),
    )
    robots = [world.robot(name, base, lid) for name in ("alpha", "beta")]
    task = planned(world, f"(Lid {product})")
    plan = [PlanStep("base", (robots[0], product)), PlanStep("lid", (robots[0], product))]
    assert scheduled(task, plan).makespan == 2.0


# -- the lower bound of the makespan ------------------------------------------------------------------------------


def test_bound_of_products_for_one_place_is_the_makespan() -> None:
    plan = [step for p in range(1, 5) for step in (drive(0, 5 if p > 1 else 0, p), *bring(0, p, p, 5))]
    task = transport_task(2, 6, 6, conjunction(contain(L[5], P[p]) for p in range(1, 5)))
    found = scheduled(task, plan)
    assert (found.bound, found.makespan) == (28.0, 28.0)  # two products each: to it, 2 s, to the place, 2 s, twice


def test_bound_counts_the_first_move_of_each_robot() -> None:
    plan = [step for p in range(4) for step in bring(0, p, p, p + 1)]
    found = scheduled(transport_task(2, 6, 6, conjunction(contain(L[p + 1], P[p]) for p in range(4))), plan)
    assert (found.bound, found.makespan) == ((4 * 9.0 + 5.0) / 2, 23.0)  # the others are where the last one ended


@settings(deadline=None)
@given(
    robots=st.integers(1, 3),
    targets=st.lists(st.integers(0, 5), min_size=1, max_size=4),
    drive_time=st.integers(0, 9),
)
def test_no_order_of_the_parts_on_any_robots_is_shorter_than_the_bound(
    robots: int, targets: list[int], drive_time: int
) -> None:
    moved = [(product, target) for product, target in enumerate(targets) if product != target]
    plan, place = [], 0
    for product, target in moved:
        plan += [drive(0, place, product)] if place != product else []
        plan += bring(0, product, product, target)
        place = target
    task = transport_task(robots, 6, 6, conjunction(contain(L[target], P[product]) for product, target in moved))
    found = scheduled(task, plan, known(task, {**SECONDS, "drive": float(drive_time)}))

    def time_of(work: list[tuple[int, int]]) -> float:
        ends = [0, *(target for _, target in work)]
        return sum(4.0 + drive_time * (1 + (before != start)) for before, (start, _) in zip(ends, work, strict=False))

    shortest = min(
        max(time_of([part for part, robot in zip(order, on, strict=True) if robot == r]) for r in range(robots))
        for order in itertools.permutations(moved)
        for on in itertools.product(range(robots), repeat=len(moved))
    )
    assert found.bound <= shortest + 1e-9


# -- of all rounds ------------------------------------------------------------------------------------------------


@given(
    robots=st.integers(1, 3),
    targets=st.lists(st.tuples(st.integers(0, 5), st.integers(0, 5)), max_size=6),
    end=st.one_of(st.none(), st.integers(0, 5)),
    seconds=st.fixed_dictionaries({name: st.integers(0, 9).map(float) for name in SECONDS}),
)
def test_assignment_is_valid_and_not_longer(
    robots: int, targets: list[tuple[int, int]], end: int | None, seconds: dict[str, float]
) -> None:
    """One robot brings products to places, some several times; then it drives home."""
    where, place, plan = list(range(6)), 0, []
    for product, target in targets:
        if place != where[product]:
            plan.append(drive(0, place, where[product]))
        plan += bring(0, product, where[product], target)
        where[product] = place = target
    goal = [contain(L[where[product]], P[product]) for product in dict(targets)]
    if end is not None:
        plan.append(drive(0, place, end))
        goal.append(at(R[0], L[end]))
    task = transport_task(robots, 6, 6, conjunction(goal))
    durations = known(task, seconds)
    found = scheduled(task, plan, durations)
    in_time = sorted(found.steps, key=lambda s: (s.start, s.end, s.step))
    assert validate(task, [found.order.steps[s.step] for s in in_time]) == ""
    assert found.makespan <= sum(seconds_of(task, step, durations) for step in plan)
    assert found == scheduled(task, plan, durations)
    for robot in R:
        own = sorted((s.start, s.end) for s in found.steps if s.robot == robot)
        assert all(one[1] <= other[0] for one, other in itertools.pairwise(own))
