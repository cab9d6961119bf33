"""Deordering of plans."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from skiros2_common.core.errors import WrongValue
from skiros2_common.core.skill_description import ParamOptions
from skiros2_task.core.actions import Action, Effect, Variable, condition_predicates
from skiros2_task.core.compiler import make_task
from skiros2_task.core.formula import Atom, Formula, Kind, Not, Or, Predicate, conjunction, disjunction
from skiros2_task.core.goal_reader import GoalReader
from skiros2_task.core.partial_order import GOAL, INIT, CausalLink, PartialOrder, deorder
from skiros2_task.core.skills import Skill
from skiros2_task.core.task import EVERYTHING, PlanningTask, PlanStep, validate
from skiros2_task.core.world import WorldView
from support.planning_world import INFERRED, REQUIRED, PlanningWorld, prop, skill
from support.planning_world import given as specified
from support.random_tasks import planned_tasks
from support.transport_task import at, contain, transport_task

R, G = ("cora:Robot-0", "cora:Robot-1"), ("rparts:GripperEffector-0", "rparts:GripperEffector-1")
L = ("skiros:Location-0", "skiros:Location-1", "skiros:Location-2")
P = ("skiros:Product-0", "skiros:Product-1")


def bring(robot: int, product: int, start: int, target: int) -> tuple[PlanStep, ...]:
    """The steps by which a robot at the start brings a product that is there to the target."""
    hand = (R[robot], G[robot])
    return (
        PlanStep("pick", (*hand, L[start], P[product])),
        PlanStep("drive", (R[robot], L[start], L[target])),
        PlanStep("place", (*hand, L[target], P[product])),
    )


# -- which order is kept ------------------------------------------------------------------------------------------


def test_dependent_steps_of_one_robot_stay_in_order() -> None:
    assert deorder(transport_task(1, 2, 1), bring(0, 0, 0, 1)).before == {(0, 1), (1, 2)}


def test_two_robots_work_at_the_same_time() -> None:
    task = transport_task(2, 2, 2, conjunction([contain(L[1], P[0]), at(R[1], L[1])]))
    plan = (*bring(0, 0, 0, 1), PlanStep("drive", (R[1], L[0], L[1])))
    assert deorder(task, plan).before == {(0, 1), (1, 2)}


def test_step_follows_producer_on_other_robot() -> None:
    task = transport_task(2, 3, 1, contain(L[2], P[0]))
    plan = (*bring(0, 0, 0, 1), PlanStep("drive", (R[1], L[0], L[1])), *bring(1, 0, 1, 2))
    assert deorder(task, plan).before == {(0, 1), (1, 2), (2, 4), (3, 4), (4, 5), (5, 6)}


def test_causal_links_name_producers() -> None:
    links = deorder(transport_task(1, 2, 1), bring(0, 0, 0, 1)).links
    assert CausalLink(INIT, 0, at(R[0], L[0]), True) in links
    assert CausalLink(1, 2, at(R[0], L[1]), True) in links
    assert CausalLink(2, GOAL, contain(L[1], P[0]), True) in links


def test_order_is_transitively_reduced() -> None:
    """The order of pick and place follows from the drive between them."""
    assert (0, 2) not in deorder(transport_task(1, 2, 1), bring(0, 0, 0, 1)).before


def test_predecessors_are_direct() -> None:
    order = PartialOrder(bring(0, 0, 0, 1), frozenset({(0, 2), (1, 2)}), ())
    assert order.predecessors() == [[], [], [0, 1]]


# -- small tasks of one predicate each --------------------------------------------------------------------------------

A, B, C = (Atom(Predicate(Kind.VALUE, f"skiros:{name}", True), ("thing",)) for name in "ABC")


def small_task(
    goal: Formula, init: frozenset[Atom], **skills: tuple[Formula, dict[Atom, bool], dict[Atom, bool]]
) -> tuple[PlanningTask, tuple[PlanStep, ...]]:
    """A task, and as plan each skill once, in that order, each by a robot of its own.

    :param skills: what each needs, makes, and makes while it runs.
    """
    robots = tuple(f"robot-{name}" for name in skills)
    actions = tuple(
        Action(
            name,
            Skill(f"skiros:{name}", name, (), (), (), ()),
            "?Robot",
            (),
            (Variable("?Robot", "Robot", ("cora:Robot",)),),
            needs,
            tuple(Effect(atom, state) for atom, state in makes.items()),
            tuple(Effect(atom, state) for atom, state in during.items()),
        )
        for name, (needs, makes, during) in skills.items()
    )
    members = {"cora:Robot": robots, EVERYTHING: (*robots, "thing")}
    predicates = tuple(atom.predicate for atom in (A, B, C))
    task = PlanningTask(actions, {}, members, predicates, init, goal)
    return task, tuple(PlanStep(name, (f"robot-{name}",)) for name in skills)


NOTHING = conjunction([])


def test_deleting_step_follows_consumer() -> None:
    task, plan = small_task(B, frozenset({A}), use=(A, {B: True}, {}), spoil=(NOTHING, {A: False}, {}))
    assert deorder(task, plan).before == {(0, 1)}


def test_deleting_step_precedes_producer() -> None:
    task, plan = small_task(
        C, frozenset({A}), spoil=(A, {A: False, B: False}, {}), make=(NOTHING, {B: True}, {}), use=(B, {C: True}, {})
    )
    assert deorder(task, plan).before == {(0, 1), (1, 2)}


def test_negative_condition_is_a_need() -> None:
    task, plan = small_task(
        B, frozenset({A}), clear=(NOTHING, {A: False}, {}), use=(Not(A), {B: True}, {}), again=(NOTHING, {A: True}, {})
    )
    assert deorder(task, plan).before == {(0, 1), (1, 2)}


def test_opposite_effects_stay_in_order() -> None:
    task, plan = small_task(NOTHING, frozenset(), make=(NOTHING, {A: True}, {}), undo=(NOTHING, {A: False}, {}))
    assert deorder(task, plan).before == {(0, 1)}


def test_first_of_two_producers_is_linked() -> None:
    task, plan = small_task(
        C, frozenset(), one=(NOTHING, {A: True}, {}), two=(NOTHING, {A: True}, {}), use=(A, {C: True}, {})
    )
    assert deorder(task, plan).before == {(0, 2)}


def test_disjunction_uses_oldest_fact() -> None:
    task, plan = small_task(C, frozenset({B}), one=(NOTHING, {A: True}, {}), use=(disjunction([A, B]), {C: True}, {}))
    assert deorder(task, plan).before == set()


def test_negated_disjunction_needs_all_parts() -> None:
    nor = Not(Or((A, B)))
    task, plan = small_task(
        C, frozenset({A, B}), a=(NOTHING, {A: False}, {}), b=(NOTHING, {B: False}, {}), use=(nor, {C: True}, {})
    )
    assert deorder(task, plan).before == {(0, 2), (1, 2)}


def test_steps_that_lock_one_device_are_ordered() -> None:
    lock = (A, {A: True}, {A: False})
    task, plan = small_task(A, frozenset({A}), one=lock, two=lock, three=lock)
    assert deorder(task, plan).before == {(0, 1), (1, 2)}


def test_step_that_needs_free_device_is_ordered() -> None:
    task, plan = small_task(B, frozenset({A}), lock=(A, {}, {A: False}), use=(A, {B: True}, {}))
    assert deorder(task, plan).before == {(0, 1)}


def test_readers_of_a_fact_may_overlap() -> None:
    task, plan = small_task(conjunction([B, C]), frozenset({A}), one=(A, {B: True}, {}), two=(A, {C: True}, {}))
    assert deorder(task, plan).before == set()


@pytest.mark.parametrize("plan", [bring(0, 0, 1, 0), bring(0, 0, 0, 1)[:2]], ids=["a step", "the goal"])
def test_deorder_raises_on_invalid_plan(plan: tuple[PlanStep, ...]) -> None:
    with pytest.raises(WrongValue, match=r"the plan does not work: .* does not hold"):
        deorder(transport_task(1, 2, 1), plan)


def test_lock_of_skill_orders_steps() -> None:
    """Two robots share a camera, which each locks while it looks."""
    world = PlanningWorld()
    camera = world.thing("skiros:DepthCamera", StateProperty="Idle")
    products = [world.thing("skiros:Product") for _ in range(2)]
    look = skill(
        "Look",
        [
            ("Object", "skiros:Product", REQUIRED),
            ("Camera", "skiros:DepthCamera", INFERRED, [ParamOptions.Lock]),
        ],
        [specified("Object")],
        [prop("Object", "skiros:Seen", "=", True)],
    )
    robots = [world.robot(name, look) for name in ("alpha", "beta")]
    view = WorldView(world.wm)
    goal = GoalReader(view, condition_predicates(view.robots)).read(", ".join(f"(Seen {p})" for p in products))
    task = make_task(view, goal)
    plan = [PlanStep("look", (robot, product, camera)) for robot, product in zip(robots, products, strict=True)]
    assert deorder(task, plan).before == {(0, 1)}


# -- of all plans -----------------------------------------------------------------------------------------------------


@given(planned=planned_tasks(), data=st.data())
def test_every_linearisation_is_valid(planned: tuple[PlanningTask, tuple[PlanStep, ...]], data: st.DataObject) -> None:
    task, plan = planned
    order = deorder(task, plan)
    done: list[int] = []
    above = order.predecessors()
    while len(done) < len(plan):
        ready = [i for i in range(len(plan)) if i not in done and all(p in done for p in above[i])]
        done.append(data.draw(st.sampled_from(ready)))
    assert validate(task, [plan[i] for i in done]) == ""


@given(planned=planned_tasks())
def test_unordered_steps_do_not_interfere(
    planned: tuple[PlanningTask, tuple[PlanStep, ...]],
) -> None:
    """Unordered steps have different robots, and neither changes a fact that the other produces."""
    task, plan = planned
    for i, j in unordered(deorder(task, plan)):
        assert task.ground(plan[i]).robot != task.ground(plan[j]).robot
        for one, other in ((plan[i], plan[j]), (plan[j], plan[i])):
            spoilt = {(atom, not state) for atom, state in task.ground(one).changes}
            assert not spoilt & set(task.ground(other).changes)


@given(planned=planned_tasks())
def test_no_step_breaks_a_causal_link(
    planned: tuple[PlanningTask, tuple[PlanStep, ...]],
) -> None:
    task, plan = planned
    for link in deorder(task, plan).links:
        end = len(plan) if link.consumer == GOAL else link.consumer
        assert link.producer < end
        for k in range(link.producer + 1, end):
            assert (link.atom, not link.state) not in task.ground(plan[k]).changes


def unordered(order: PartialOrder) -> list[tuple[int, int]]:
    """The pairs of steps that may run at the same time."""
    above: list[set[int]] = []
    for before in order.predecessors():
        above.append({*before, *(i for b in before for i in above[b])})
    return [(i, j) for j in range(len(order.steps)) for i in range(j) if i not in above[j]]
