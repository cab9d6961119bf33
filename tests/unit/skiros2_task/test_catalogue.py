"""Worlds and goals with known answers, from the world model's elements to skill calls."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from skiros2_common.core.discrete_reasoner import DiscreteReasoner, reasoners
from skiros2_common.core.world_element import Element
from skiros2_task.core.planning import PlanningResult, Verdict
from support.planning_world import (
    DRIVE,
    INFERRED,
    OPTIONAL,
    PICK,
    PLACE,
    REQUIRED,
    PlanningWorld,
    allowed,
    given,
    has,
    made,
    of_type,
    one_of,
    prop,
    related,
    skill,
    transport_world,
)

Plan = Callable[[PlanningWorld, str], PlanningResult]
Step = tuple[str, dict[str, str]]

AT = related("Robot", "skiros:at", "Place")
HERE: list[tuple[Any, ...]] = [("Place", "skiros:Location", INFERRED)]
PRODUCT: list[tuple[Any, ...]] = [("Object", "skiros:Product", REQUIRED)]


def steps(result: PlanningResult) -> list[Step]:
    """(implementation, ids by parameter) of each call."""
    assert result.verdict is Verdict.PLANNED, result.message
    return [(call.label, {key: e.id or e.label for key, e in call.arguments}) for call in result.calls]


def labels(result: PlanningResult) -> list[str]:
    return [label for label, _ in steps(result)]


# -- drive, pick and place ----------------------------------------------------------------------------------------


def test_one_robot_brings_product(plan: Plan) -> None:
    world = transport_world()
    (robot,), (gripper,), (start, target), (product,) = (
        world.robots,
        world.grippers,
        world.places,
        world.products,
    )
    hand = {"Robot": robot, "Gripper": gripper, "Object": product}
    assert steps(plan(world, f"(skiros:contain {target} {product})")) == [
        ("pick", {**hand, "Place": start}),
        ("drive", {"Robot": robot, "StartLocation": start, "TargetLocation": target}),
        ("place", {**hand, "Place": target}),
    ]


def test_step_names_manager_of_its_robot(plan: Plan) -> None:
    world = transport_world(robots=2, places=3)
    alpha, beta = world.robots
    places = world.places
    result = plan(world, f"(skiros:at {alpha} {places[1]}), (skiros:at {beta} {places[2]})")
    assert {(call.manager, dict(call.arguments)["Robot"].id) for call in result.calls} == {
        ("/alpha", alpha),
        ("/beta", beta),
    }
    assert labels(result) == ["drive", "drive"]


def test_robot_with_the_skill_is_chosen(plan: Plan) -> None:
    world = transport_world(robots=1)
    driver = world.robot("driver", DRIVE, at=world.places[0])
    world.gripper(driver)
    result = plan(world, f"(skiros:contain {world.places[1]} {world.products[0]})")
    assert {call.manager for call in result.calls} == {"/alpha"}


def test_robots_cooperate(plan: Plan) -> None:
    world = PlanningWorld()
    near, far = world.thing("skiros:Location"), world.thing("skiros:Location")
    product = world.thing("skiros:Product", inside=near)
    paint = skill("Paint", [*HERE, *PRODUCT], [AT, related("Place", "skiros:contain", "Object")], [PAINTED])
    world.robot("painter", paint, at=far)
    carrier = world.robot("carrier", DRIVE, PICK, PLACE, at=near)
    world.gripper(carrier)
    result = plan(world, f"(Painted {product})")
    assert labels(result) == ["pick", "drive", "place", "paint"]
    assert [call.manager for call in result.calls] == ["/carrier", "/carrier", "/carrier", "/painter"]


def test_forall_goal_is_planned(plan: Plan) -> None:
    world = transport_world(places=2, products=4)
    goal = f"(forall (?x - skiros:Product) (skiros:contain {world.places[1]} ?x))"
    result = plan(world, goal)
    brought = [arguments["Object"] for label, arguments in steps(result) if label == "place"]
    assert sorted(brought) == sorted([world.products[0], world.products[2]])


def test_quantifier_may_use_class_without_skill(plan: Plan) -> None:
    world = transport_world(places=2)
    starter = world.thing("skiros:Starter", inside=world.places[0])
    result = plan(world, f"(forall (?x - skiros:Starter) (skiros:contain {world.places[1]} ?x))")
    assert {arguments.get("Object") for _, arguments in steps(result)} == {None, starter}


def test_exists_goal_needs_one_product(plan: Plan) -> None:
    world = transport_world(places=2, products=3)
    world.relate(world.robots[0], "skiros:at", world.places[1])
    goal = f"(exists (?x - skiros:Product) (skiros:contain {world.grippers[0]} ?x))"
    assert labels(plan(world, goal)) == ["pick"]


def test_or_goal_needs_one_part(plan: Plan) -> None:
    world = transport_world()
    product = world.products[0]
    goal = f"(or (skiros:contain {product} {world.places[0]}) (skiros:contain {world.places[1]} {product}))"
    assert labels(plan(world, goal)) == ["pick", "drive", "place"]


def test_conjunction_of_disjunctions_is_not_expanded(plan: Plan) -> None:
    world = transport_world(places=6, products=12)
    somewhere = " ".join(f"(contain {place} ?p)" for place in world.places[3:])
    result = plan(world, f"(forall (?p - skiros:Product) (or {somewhere}))")
    assert labels(result).count("place") == 6


def test_negative_goal_is_planned(plan: Plan) -> None:
    world = transport_world()
    goal = f"(not (skiros:contain {world.places[0]} {world.products[0]}))"
    assert labels(plan(world, goal)) == ["pick"]


# -- nothing to do, no plan ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "goal",
    [
        "(skiros:contain {place} {product})",
        "(not (skiros:at {robot} {other}))",
        "(forall (?x - skiros:DepthCamera) (skiros:contain {other} ?x))",
        "(exists (?x - skiros:Location) (skiros:at {robot} ?x))",
        "(Empty {gripper})",
        "(skiros:spatiallyRelated {place} {product})",
    ],
)
def test_satisfied_goal_needs_no_plan(plan: Plan, goal: str) -> None:
    world = transport_world()
    names = {"place": world.places[0], "other": world.places[1], "product": world.products[0]}
    names |= {"robot": world.robots[0], "gripper": world.grippers[0]}
    result = plan(world, goal.format(**names))
    assert (result.verdict, result.calls) == (Verdict.NOTHING_TO_DO, ()), result.message


def test_goal_without_skill_is_impossible(plan: Plan) -> None:
    world = transport_world()
    result = plan(world, f"(skiros:hasA {world.places[0]} {world.products[0]})")
    assert result.verdict is Verdict.IMPOSSIBLE
    assert "cannot be reached: Location-1 has Product-3 (no skill achieves it)" in result.message


def test_missing_condition_is_reported(plan: Plan) -> None:
    world = transport_world(robots=0)
    world.robot("handless", DRIVE, PICK, PLACE, at=world.places[0])
    world.thing("rparts:GripperEffector", ContainerState="Empty")  # lies about
    result = plan(world, f"(skiros:contain {world.places[1]} {world.products[0]})")
    assert result.verdict is Verdict.IMPOSSIBLE
    assert "needs\n" in result.message


def test_missing_class_of_elements_is_reported(plan: Plan) -> None:
    world = transport_world(robots=0)
    world.robot("handless", DRIVE, PICK, PLACE, at=world.places[0])
    result = plan(world, f"(skiros:contain {world.places[1]} {world.products[0]})")
    assert result.verdict is Verdict.IMPOSSIBLE
    assert any("the scene has no element for Gripper (rparts:GripperEffector)" in note for note in result.notes)


def test_mutex_goals_are_impossible(plan: Plan) -> None:
    world = transport_world(places=3)
    robot, places = world.robots[0], world.places
    result = plan(world, f"(skiros:at {robot} {places[1]}), (skiros:at {robot} {places[2]})")
    assert result.verdict is Verdict.IMPOSSIBLE
    assert "may be reachable alone, but not all parts together" in result.message


def test_contradictory_goal_is_impossible(plan: Plan) -> None:
    world = transport_world()
    atom = f"(skiros:at {world.robots[0]} {world.places[1]})"
    result = plan(world, f"{atom}, (not {atom})")
    assert result.verdict is Verdict.IMPOSSIBLE
    assert "No plan: the goal asks for it and for the opposite: alpha is at " in result.message


def test_world_without_robots_has_no_plan(plan: Plan) -> None:
    world = transport_world(robots=0)
    places, product = world.places, world.products[0]
    assert plan(world, f"(skiros:contain {places[0]} {product})").verdict is Verdict.NOTHING_TO_DO
    result = plan(world, f"(skiros:contain {places[1]} {product})")
    assert result.verdict is Verdict.IMPOSSIBLE
    assert "no robot" in result.message


# -- properties ---------------------------------------------------------------------------------------------------

PAINTED = prop("Object", "skiros:Surface", "=", "Painted")
IS_OPEN = prop("Door", "skiros:Open", "=", True)
DOOR: list[tuple[Any, ...]] = [("Door", "skiros:Container", REQUIRED)]

OPEN = skill("Open", DOOR, [prop("Door", "skiros:Open", "=", False)], [IS_OPEN])
CLOSE = skill("Close", DOOR, [IS_OPEN], [prop("Door", "skiros:Open", "=", True, False)])


@pytest.mark.parametrize(
    "goal",
    [
        "(= (Surface {product}) Painted)",
        '(= (skiros:Surface {product}) "Painted")',
        "(imply (Surface_Raw {product}) (Painted {product}))",
        "(exists (?x - skiros:Product) (and (= ?x {product}) (Painted ?x)))",
        "(forall (?x - skiros:Product) (or (not (= ?x {product})) (Painted ?x)))",
    ],
)
def test_goal_forms_can_be_nested(plan: Plan, goal: str) -> None:
    world = PlanningWorld()
    product, _ = world.thing("skiros:Product", Surface="Raw"), world.thing("skiros:Product", Surface="Raw")
    robot = world.robot("alpha", skill("Paint", PRODUCT, [given("Object")], [PAINTED]))
    assert steps(plan(world, goal.format(product=product))) == [("paint", {"Robot": robot, "Object": product})]


@pytest.mark.parametrize(
    ("is_open", "goal", "expected"),
    [
        (False, "(skiros:Open {door})", ["open"]),
        (False, "(Open {door})", ["open"]),
        (False, "(open {door})", ["open"]),
        (True, "(not (Open {door}))", ["close"]),
        (True, "(Open_False {door})", ["close"]),
        (True, "(not (Open_False {door}))", []),
        (False, "(not (Open {door}))", []),
    ],
)
def test_boolean_property_is_predicate(plan: Plan, is_open: bool, goal: str, expected: list[str]) -> None:
    world = PlanningWorld()
    door = world.thing("skiros:Container", Open=is_open)
    world.robot("alpha", OPEN, CLOSE)
    result = plan(world, goal.format(door=door))
    assert (labels(result) if expected else result.calls) == (expected or ())
    assert result.verdict is (Verdict.PLANNED if expected else Verdict.NOTHING_TO_DO)


def test_missing_boolean_is_neither_true_nor_false(plan: Plan) -> None:
    world = PlanningWorld()
    door = world.thing("skiros:Container")
    world.robot("alpha", OPEN, CLOSE)
    result = plan(world, f"(Open {door})")
    assert result.verdict is Verdict.IMPOSSIBLE
    assert "needs\n    cannot be reached: open of Container-1 is False" in result.message


def test_negative_boolean_condition_is_planned(plan: Plan) -> None:
    """The content of a container may be heated only if its door is shut (state False)."""
    world = PlanningWorld()
    oven = world.thing("skiros:Container", Open=True)
    hot = prop("Door", "skiros:Temperature", "=", "Hot")
    heat = skill("Heat", DOOR, [prop("Door", "skiros:Open", "=", True, False)], [hot])
    world.robot("alpha", OPEN, CLOSE, heat)
    assert labels(plan(world, f"(Hot {oven})")) == ["close", "heat"]
    assert labels(plan(world, f"(Temperature_Hot {oven}), (Open {oven})")) == ["close", "heat", "open"]


def test_text_property_changes_value(plan: Plan) -> None:
    world = PlanningWorld()
    product = world.thing("skiros:Product", Surface="Raw")
    raw = prop("Object", "skiros:Surface", "=", "Raw")
    prime = skill("Prime", PRODUCT, [raw], [prop("Object", "skiros:Surface", "=", "Primed")])
    paint = skill("Paint", PRODUCT, [prop("Object", "skiros:Surface", "=", "Primed")], [PAINTED])
    strip = skill("Strip", PRODUCT, [prop("Object", "skiros:Surface", "=", "Raw", False)], [raw])
    world.robot("alpha", prime, paint, strip)
    assert labels(plan(world, f"(Painted {product})")) == ["prime", "paint"]
    assert labels(plan(world, f"(skiros:Surface_Painted {product}), (not (Raw {product}))")) == [
        "prime",
        "paint",
    ]
    assert plan(world, f"(Painted {product}), (Primed {product})").verdict is Verdict.IMPOSSIBLE


def test_text_with_spaces_is_predicate(plan: Plan) -> None:
    world = PlanningWorld()
    product = world.thing("skiros:Product", Surface="Raw")
    paint = skill(
        "Paint",
        PRODUCT,
        [has("Object", "skiros:Surface")],
        [prop("Object", "skiros:Surface", "=", "Sky Blue")],
    )
    world.robot("alpha", paint)
    for goal in (f"(Sky_Blue {product})", f'("Sky Blue" {product})', f"(surface_sky_blue {product})"):
        assert labels(plan(world, goal)) == ["paint"]


def test_ambiguous_value_needs_property(plan: Plan) -> None:
    world = PlanningWorld()
    camera = world.thing("skiros:DepthCamera", StateProperty="Busy", Power="Busy")
    switch = skill(
        "Stop",
        [("Device", "sumo:Device", REQUIRED)],
        [prop("Device", "skiros:StateProperty", "=", "Busy")],
        [prop("Device", "skiros:StateProperty", "=", "Idle"), prop("Device", "skiros:Power", "=", "Idle")],
    )
    world.robot("alpha", switch)
    result = plan(world, f"(Idle {camera})")
    assert result.verdict is Verdict.FAILED
    assert "write skiros:Power_Idle or skiros:StateProperty_Idle" in result.message
    assert labels(plan(world, f"(Power_Idle {camera})")) == ["stop"]


def test_has_property_goal_is_planned(plan: Plan) -> None:
    world = PlanningWorld()
    product = world.thing("skiros:Product")
    weigh = skill("Weigh", PRODUCT, [has("Object", "skiros:Weight", False)], [has("Object", "skiros:Weight")])
    sort = skill("Sort", PRODUCT, [has("Object", "skiros:Weight")], [prop("Object", "skiros:Sorted", "=", True)])
    world.robot("alpha", weigh, sort)
    assert labels(plan(world, f"(Sorted {product})")) == ["weigh", "sort"]
    assert labels(plan(world, f"(has_Weight {product})")) == ["weigh"]


def test_numeric_comparisons_are_planned(plan: Plan) -> None:
    world = PlanningWorld()
    battery = world.thing("skiros:Product", Charge=20.0)
    low = prop("Object", "skiros:Charge", "<", 50.0)
    charge = skill("Charge", PRODUCT, [low], [prop("Object", "skiros:Charge", "=", 100.0)])
    work = skill(
        "Work",
        PRODUCT,
        [prop("Object", "skiros:Charge", ">=", 80.0)],
        [prop("Object", "skiros:Done", "=", True), prop("Object", "skiros:Charge", "<", 10.0)],
    )
    world.robot("alpha", charge, work)
    assert labels(plan(world, f"(Done {battery})")) == ["charge", "work"]
    assert labels(plan(world, f"(Done {battery}), (> (Charge {battery}) 90)")) == ["charge", "work", "charge"]
    assert plan(world, f"(= (Charge {battery}) 20)").verdict is Verdict.NOTHING_TO_DO
    assert plan(world, f"(> (Charge {battery}) 100)").verdict is Verdict.IMPOSSIBLE


def test_locked_device_is_free_before_and_after(plan: Plan) -> None:
    """A hold-condition that contradicts a pre-condition is not needed at the start."""
    from skiros2_common.core.abstract_skill import ParamOptions

    world = PlanningWorld()
    product = world.thing("skiros:Product")
    world.thing("skiros:DepthCamera", StateProperty="Idle")
    look = skill(
        "Look",
        [*PRODUCT, ("Camera", "skiros:DepthCamera", INFERRED, [ParamOptions.Lock])],
        [given("Object")],
        [prop("Object", "skiros:Seen", "=", True)],
    )
    world.robot("alpha", look)
    assert labels(plan(world, f"(Seen {product})")) == ["look"]


# -- relations ----------------------------------------------------------------------------------------------------


def test_relation_holds_by_subproperty(plan: Plan) -> None:
    """`contain` and `hasA` are under `spatiallyRelated`."""
    world = transport_world()
    inspect = skill(
        "Inspect",
        [*HERE, *PRODUCT],
        [AT, related("Place", "skiros:spatiallyRelated", "Object")],
        [prop("Object", "skiros:Seen", "=", True)],
    )
    inspector = world.robot("inspector", inspect, at=world.places[1])
    result = plan(world, f"(Seen {world.products[0]})")
    assert labels(result) == ["pick", "drive", "place", "inspect"]
    assert result.calls[-1].manager == "/inspector"
    assert dict(result.calls[-1].arguments)["Robot"].id == inspector


def test_negated_relation_includes_subproperties(plan: Plan) -> None:
    world = transport_world()
    sweep = skill(
        "Sweep",
        [*HERE, *PRODUCT],
        [AT, related("Place", "skiros:spatiallyRelated", "Object", False)],
        [prop("Place", "skiros:Clean", "=", True)],
    )
    world.robot("sweeper", sweep, at=world.places[0])
    assert labels(plan(world, f"(Clean {world.places[0]})")) == ["pick", "sweep"]


def test_abstract_relation_needs_statement(plan: Plan) -> None:
    world = PlanningWorld()
    kind = Element("skiros:LargeBox", "skiros:bolt_box")
    kind.addRelation("-1", "sumo:isLocationOf", "skiros:bolt")
    world.wm.add_individual(Element("skiros:Part", "skiros:bolt"))
    world.wm.add_individual(kind)
    box, other = world.thing("skiros:LargeBox", "left box", Template="skiros:bolt_box"), world.thing("skiros:LargeBox")
    part = world.thing("skiros:Part", "bolt 5", Template="skiros:bolt")
    store = skill(
        "Store",
        [("Where", "sumo:Object", REQUIRED), ("What", "skiros:Part", REQUIRED)],
        [allowed("Where", "sumo:isLocationOf", "What")],
        [related("Where", "skiros:contain", "What")],
    )
    world.robot("alpha", store)
    assert labels(plan(world, f"(contain {box} {part})")) == ["store"]
    assert plan(world, f"(contain {other} {part})").verdict is Verdict.IMPOSSIBLE


class Neighbours(DiscreteReasoner):
    """Elements whose numbers follow each other are near."""

    def getAssociatedRelations(self) -> list[str]:
        return [":nextTo"]

    def computeRelations(self, sub: Any, obj: Any, with_metrics: bool = False) -> list[Any]:
        return [":nextTo"] if obj.getIdNumber() == sub.getIdNumber() + 1 else []


def test_computed_relations_are_facts(plan: Plan, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reasoners, "_by_name", {})
    reasoners.add(Neighbours())
    world = PlanningWorld()
    first, second, third = (world.thing("skiros:Product") for _ in range(3))
    join = skill(
        "Join",
        [*PRODUCT, ("Other", "skiros:Product", REQUIRED)],
        [related("Object", "skiros:nextTo", "Other")],
        [related("Object", "skiros:partReference", "Other")],
    )
    world.robot("alpha", join)
    assert labels(plan(world, f"(partReference {first} {second})")) == ["join"]
    assert plan(world, f"(partReference {first} {third})").verdict is Verdict.IMPOSSIBLE
    assert plan(world, f"(nextTo {second} {third})").verdict is Verdict.NOTHING_TO_DO


def test_computed_relation_overrides_scene(plan: Plan, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reasoners, "_by_name", {})
    monkeypatch.setattr(reasoners, "_owners", {})
    monkeypatch.setattr(reasoners, "_cache", {})
    reasoners.add(Neighbours())
    world = PlanningWorld()
    first, _, third = (world.thing("skiros:Product") for _ in range(3))
    world.relate(first, "skiros:nextTo", third)
    assert not world.wm.check_relation(first, "skiros:nextTo", third, True, False)
    assert plan(world, f"(nextTo {first} {third})").verdict is Verdict.IMPOSSIBLE


def test_hold_condition_is_a_precondition(plan: Plan) -> None:
    world = transport_world()
    watch = skill(
        "Watch",
        [*HERE, *PRODUCT],
        [given("Object")],
        [prop("Object", "skiros:Watched", "=", True)],
        hold=[AT, related("Place", "skiros:contain", "Object")],
    )
    world.robot("watcher", watch, at=world.places[1])
    assert labels(plan(world, f"(Watched {world.products[0]})")) == ["pick", "drive", "place", "watch"]


def test_or_condition_needs_one_part(plan: Plan) -> None:
    world = transport_world()
    place, product = world.places[0], world.products[0]
    touch = skill(
        "Touch",
        [*HERE, *PRODUCT],
        [AT, one_of(related("Place", "skiros:contain", "Object"), prop("Object", "skiros:Near", "=", True))],
        [prop("Object", "skiros:Touched", "=", True)],
    )
    world.robot("toucher", touch, at=world.places[1])
    assert labels(plan(world, f"(Touched {product})")) == ["pick", "drive", "place", "touch"]
    near = world.thing("skiros:Product", inside=place, Near=True)
    assert labels(plan(world, f"(Touched {near})")) == ["touch"]


# -- parameters ---------------------------------------------------------------------------------------------------


def test_type_condition_restricts_parameter(plan: Plan) -> None:
    world = PlanningWorld()
    starter, part = world.thing("skiros:Starter"), world.thing("skiros:Part")
    turn = skill(
        "Turn",
        [("Object", "skiros:Manipulatable", REQUIRED)],
        [of_type("Object", "skiros:Starter")],
        [prop("Object", "skiros:Turned", "=", True)],
    )
    world.robot("alpha", turn)
    assert labels(plan(world, f"(Turned {starter})")) == ["turn"]
    assert plan(world, f"(Turned {part})").verdict is Verdict.IMPOSSIBLE


def test_class_with_two_superclasses_fits_both(plan: Plan) -> None:
    """A robot is an agent and a device; other agents and devices are not both."""
    world = PlanningWorld()
    human, arm = world.thing("sumo:Agent"), world.thing("rparts:ArmDevice")
    greet = skill(
        "Greet", [("Who", "sumo:Agent", REQUIRED)], [given("Who")], [prop("Who", "skiros:Greeted", "=", True)]
    )
    oil = skill("Oil", [("What", "sumo:Device", REQUIRED)], [given("What")], [prop("What", "skiros:Oiled", "=", True)])
    robot = world.robot("alpha", greet, oil)
    assert sorted(labels(plan(world, f"(Greeted {robot}), (Oiled {robot})"))) == ["greet", "oil"]
    assert sorted(labels(plan(world, f"(Greeted {human}), (Oiled {arm})"))) == ["greet", "oil"]
    assert plan(world, f"(Oiled {human})").verdict is Verdict.IMPOSSIBLE
    assert plan(world, f"(Greeted {arm})").verdict is Verdict.IMPOSSIBLE


def test_parameter_with_fixed_element_keeps_it(plan: Plan) -> None:
    world = PlanningWorld()
    first, second = world.thing("skiros:Product"), world.thing("skiros:Product")
    mark = skill(
        "Mark",
        [("Object", world.wm.get_element(first), REQUIRED)],
        [given("Object")],
        [prop("Object", "skiros:Marked", "=", True)],
    )
    robot = world.robot("alpha", mark)
    assert steps(plan(world, f"(Marked {first})")) == [("mark", {"Robot": robot})]
    assert plan(world, f"(Marked {second})").verdict is Verdict.IMPOSSIBLE


def test_optional_parameter_without_conditions_is_unset(plan: Plan) -> None:
    world = PlanningWorld()
    product = world.thing("skiros:Product")
    mark = skill(
        "Mark",
        [*PRODUCT, ("Pen", "sumo:Device", OPTIONAL), ("Ink", "black", REQUIRED)],
        [given("Object"), has("Pen", "skiros:Weight")],
        [prop("Object", "skiros:Marked", "=", True)],
    )
    robot = world.robot("alpha", mark)
    assert steps(plan(world, f"(Marked {product})")) == [("mark", {"Robot": robot, "Object": product})]


@pytest.mark.parametrize(
    ("offered", "reason"),
    [
        (skill("Hide", PRODUCT, [given("Object")], [PAINTED], available=False), "not available for planning"),
        (skill("Paint", PRODUCT, [], [PAINTED]), "it has no pre-conditions"),
        (skill("Paint", PRODUCT, [given("Object")], []), "it has no post-conditions"),
        (
            skill("Paint", [*PRODUCT, ("Colour", str, REQUIRED)], [given("Object")], [PAINTED]),
            "its parameter Colour",
        ),
        (
            skill(
                "Paint",
                PRODUCT,
                [given("Object")],
                [PAINTED, prop("Object", "skiros:Surface", "=", "Painted", False)],
            ),
            "contradict each other",
        ),
        (
            skill("Paint", PRODUCT, [prop("Nothing", "skiros:Surface", "=", "Raw")], [PAINTED]),
            "not one of its parameters",
        ),
        (
            skill("Paint", PRODUCT, [prop("Object", "skiros:Weight", ">", "much")], [PAINTED]),
            "expected a number",
        ),
    ],
)
def test_unusable_skill_is_reported(plan: Plan, offered: Any, reason: str) -> None:
    world = PlanningWorld()
    product = world.thing("skiros:Product", Surface="Raw")
    world.robot("alpha", offered)
    result = plan(world, f"(Surface_Painted {product})")
    assert result.verdict is Verdict.IMPOSSIBLE
    assert any(reason in note and "/alpha" in note for note in result.notes), result.notes


def test_irrelevant_skills_are_reported(plan: Plan) -> None:
    world = transport_world()
    world.robot("other", OPEN, CLOSE)
    result = plan(world, f"(skiros:at {world.robots[0]} {world.places[1]})")
    assert labels(result) == ["drive"]
    (note,) = (n for n in result.notes if "cannot help" in n)
    assert all(name in note for name in ("open", "close", "pick", "place"))


def test_irrelevant_elements_are_reported(plan: Plan) -> None:
    world = transport_world(1, 2, 1)
    tool = world.thing("skiros:Tool")
    result = plan(world, f"(skiros:at {world.robots[0]} {world.places[1]})")
    assert result.task is not None
    assert set(result.task.objects) == {world.robots[0], *world.places}
    assert tool not in result.task.objects
    (note,) = (n for n in result.notes if n.startswith("elements"))
    assert note.endswith("left out: 1 rparts:GripperEffector, 1 skiros:Product, 1 skiros:Scene, 1 skiros:Tool")


def test_labels_invalid_in_pddl_round_trip(plan: Plan) -> None:
    world = PlanningWorld()
    first, second = world.thing("skiros:Product"), world.thing("skiros:Part")
    one = skill(
        "Paint",
        [("The Object", "skiros:Product", REQUIRED)],
        [given("The Object")],
        [prop("The Object", "skiros:Surface", "=", "Painted")],
        label="Paint it / blue",
    )
    two = skill(
        "Dip",
        [("The Object", "skiros:Part", REQUIRED)],
        [given("The Object")],
        [prop("The Object", "skiros:Surface", "=", "Painted")],
        label="paint it / Blue",
    )
    robot = world.robot("alpha", one, two)
    result = plan(world, f"(Painted {first}), (Painted {second})")
    assert sorted(steps(result), key=str) == sorted(
        [
            ("Paint it / blue", {"Robot": robot, "The Object": first}),
            ("paint it / Blue", {"Robot": robot, "The Object": second}),
        ],
        key=str,
    )


# -- templates, elements that come and go -------------------------------------------------------------------------


def test_template_without_instance_stands_for_itself(plan: Plan) -> None:
    """The box of starters holds starters by its template; which one is taken is found when the skill runs."""
    world = PlanningWorld()
    table = world.thing("skiros:Location")
    kind = Element("skiros:LargeBox", "skiros:starter_box")
    kind.addRelation("-1", "sumo:isLocationOf", "skiros:starter")
    world.wm.add_individual(kind)
    box = world.wm.instanciate("skiros:starter_box").id
    fetch = skill(
        "Fetch",
        [("Box", "skiros:LargeBox", INFERRED), ("Object", "skiros:Product", REQUIRED), *HERE],
        [allowed("Box", "sumo:isLocationOf", "Object")],
        [related("Place", "skiros:contain", "Object")],
    )
    robot = world.robot("alpha", fetch)
    result = plan(world, f"(skiros:contain {table} skiros:starter)")
    assert steps(result) == [("fetch", {"Robot": robot, "Box": box, "Object": "skiros:starter", "Place": table})]
    (call,) = result.calls
    thing = dict(call.arguments)["Object"]
    assert (thing.type, thing.label, thing.isAbstract()) == ("skiros:Starter", "skiros:starter", True)


@pytest.mark.parametrize("label", ["skiros:starter", "motor 7"])
def test_template_denotes_its_instance(plan: Plan, label: str) -> None:
    world = transport_world()
    starter = world.thing("skiros:Starter", label, inside=world.places[0], Template="skiros:starter")
    result = plan(world, f"(skiros:contain {world.places[1]} skiros:starter)")
    assert {arguments.get("Object") for _, arguments in steps(result)} == {None, starter}


def test_plans_are_independent(plan: Plan) -> None:
    world = transport_world()
    plan(world, f"(skiros:contain {world.places[1]} skiros:starter)")
    result = plan(world, f"(forall (?x - skiros:Product) (skiros:contain {world.places[1]} ?x))")
    assert {arguments.get("Object") for _, arguments in steps(result)} == {None, world.products[0]}


def test_removed_element_is_not_used(plan: Plan) -> None:
    world = transport_world(products=2)
    eat = skill(
        "Eat",
        [*HERE, *PRODUCT],
        [AT, related("Place", "skiros:contain", "Object")],
        [made("Object", False), prop("Robot", "skiros:Fed", "=", True)],
    )
    eater = world.robot("eater", eat, at=world.places[0])
    first = world.products[0]
    assert labels(plan(world, f"(Fed {eater})")) == ["eat"]
    assert labels(plan(world, f"(not (skiros:contain {world.places[0]} {first})), (Fed {eater})")) == ["eat"]
    both = f"(Fed {eater}), (forall (?x - skiros:Product) (skiros:contain {world.places[1]} ?x))"
    result = plan(world, both)
    assert result.verdict is Verdict.PLANNED, result.message
    assert "eat" in labels(result)


def test_created_element_is_used(plan: Plan) -> None:
    world = transport_world(products=0)
    cast = skill("Cast", [*HERE, *PRODUCT], [AT], [made("Object"), related("Place", "skiros:contain", "Object")])
    world.robot("caster", cast, at=world.places[0])
    goal = f"(exists (?x - skiros:Product) (skiros:contain {world.places[1]} ?x))"
    result = plan(world, goal)
    assert labels(result) == ["cast", "pick", "drive", "place"]
    assert all("Object" not in arguments for _, arguments in steps(result))


# -- skills that are not as they should be ------------------------------------------------------------------------


def weight(operator: str, value: float, state: bool = True) -> Any:
    return prop("Object", "skiros:Weight", operator, value, state)


@pytest.mark.parametrize(
    "pre",
    [
        [weight(">", 5.0), weight("<", 5.0)],
        [weight(">=", 5.0), weight(">=", 5.0, False)],
        [weight("=", 5.0), weight("<=", 4.0)],
        [weight(">", 5.0), has("Object", "skiros:Weight", False)],
        [prop("Object", "skiros:Open", "=", True), prop("Object", "skiros:Open", "=", False)],
        [prop("Object", "skiros:Surface", "=", "Raw"), has("Object", "skiros:Surface", False)],
    ],
)
def test_skill_with_contradictory_conditions_is_reported(plan: Plan, pre: list[Any]) -> None:
    world = PlanningWorld()
    product = world.thing("skiros:Product", Surface="Raw", Weight=5.0, Open=True)
    world.robot("alpha", skill("Paint", PRODUCT, pre, [PAINTED]))
    result = plan(world, f"(Surface_Painted {product})")
    assert result.verdict is Verdict.IMPOSSIBLE
    assert any("contradict each other" in note for note in result.notes), result.notes


@pytest.mark.parametrize(
    "pre",
    [
        [weight(">=", 5.0), weight("<=", 5.0)],
        [weight(">", 7.0, False), weight("<", 3.0, False)],
        [prop("Object", "skiros:Open", "=", True), prop("Object", "skiros:Open", "=", False, False)],
        [prop("Object", "skiros:Wet", "=", True, False), prop("Object", "skiros:Wet", "=", False, False)],
    ],
)
def test_compatible_conditions_are_accepted(plan: Plan, pre: list[Any]) -> None:
    world = PlanningWorld()
    product = world.thing("skiros:Product", Surface="Raw", Weight=5.0, Open=True)
    world.robot("alpha", skill("Paint", PRODUCT, pre, [PAINTED]))
    assert labels(plan(world, f"(Surface_Painted {product})")) == ["paint"]


@pytest.mark.parametrize(
    ("cls", "key", "value", "reason"),
    [
        ("skiros:Parameter", "skiros:ParameterType", 7, "its parameter 'Object' is of type 7, expected 0, 1 or 2"),
        ("skiros:ConditionProperty", "skiros:hasSubject", "", "refers to '', which is not one of its parameters"),
        ("skiros:ConditionProperty", "skiros:operator", "!=", "has the operator '!=', expected one of = > < >= <="),
        ("skiros:ConditionProperty", "skiros:appliedOnType", "", "does not name its relation, property or class"),
    ],
)
def test_malformed_skill_element_is_reported(plan: Plan, cls: str, key: str, value: Any, reason: str) -> None:
    world = transport_world()
    world.robot("painter", skill("Paint", PRODUCT, [given("Object")], [PAINTED]))
    (painting,) = world.wm.resolve_elements(Element("skiros:Paint"))
    for part in world.wm.get_branch(painting.id):
        if part.type == cls and (cls != "skiros:Parameter" or part.label == "Object"):
            part.setProperty(key, value)
            world.wm.update_element(part)
    assert labels(plan(world, f"(at {world.robots[0]} {world.places[1]})")) == ["drive"]
    result = plan(world, f"(Painted {world.products[0]})")
    assert result.verdict in (Verdict.FAILED, Verdict.IMPOSSIBLE)
    assert any(reason in note and "/painter" in note for note in result.notes), result.notes


def test_recursive_condition_is_reported(plan: Plan) -> None:
    world = PlanningWorld()
    product = world.thing("skiros:Product")
    either = one_of(given("Object"), prop("Object", "skiros:Surface", "=", "Raw"))
    world.robot("alpha", skill("Paint", PRODUCT, [either], [PAINTED]))
    (condition,) = world.wm.resolve_elements(Element("skiros:ConditionOr"))
    world.relate(condition.id, "skiros:hasCondition", condition.id)
    result = plan(world, f"(Surface_Painted {product})")
    assert any("is a part of itself" in note for note in result.notes), result.notes


class Pose:
    """A value that the world model does not know."""


def test_parameter_of_python_type_is_not_an_element(plan: Plan) -> None:
    world = PlanningWorld()
    product = world.thing("skiros:Product")
    paint = skill("Paint", [*PRODUCT, ("Where", Pose(), REQUIRED)], [given("Object")], [PAINTED])
    robot = world.robot("alpha", paint)
    assert steps(plan(world, f"(Painted {product})")) == [("paint", {"Robot": robot, "Object": product})]


def test_class_name_may_omit_prefix(plan: Plan) -> None:
    world = PlanningWorld()
    product = world.thing("skiros:Product")
    world.robot("alpha", skill("Paint", [("Object", Element("Product"), REQUIRED)], [given("Object")], [PAINTED]))
    assert labels(plan(world, f"(Painted {product})")) == ["paint"]


def test_parameter_names_do_not_clash_with_robot(plan: Plan) -> None:
    world = PlanningWorld()
    product = world.thing("skiros:Product")
    painted = prop("Manager", "skiros:Surface", "=", "Painted")
    world.robot("alpha", skill("Paint", [("Manager", "skiros:Product", REQUIRED)], [given("Manager")], [painted]))
    assert [call[1]["Manager"] for call in steps(plan(world, f"(Painted {product})"))] == [product]


# -- goals that cannot be read ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("goal", "expected"),
    [
        ("(skiros:contain {place} ", "expected"),
        (
            "(skiros:contains {place} {product})",
            "unknown relation 'skiros:contains'; did you mean skiros:contain",
        ),
        ("(Emty {gripper})", "unknown predicate 'Emty'; did you mean Empty"),
        ("(contain {place})", "'contain' is a relation"),
        ("(contain {place} {product} {robot})", "expected one or two elements after 'contain', found 3"),
        ("(contain)", "found no subject"),
        ("(skiros:Product {product})", "'skiros:Product' is a class; no skill changes the class"),
        ("(> (Wieght {product}) 2)", "unknown property 'Wieght'"),
        ("(= {place} skiros:Product-9999)", "unknown element 'skiros:Product-9999'"),
        ("(contain {place} skiros:Product-9999)", "unknown element 'skiros:Product-9999'"),
        (
            "(contain {place} skiros:Product)",
            "'skiros:Product' is a class; for some element of it write (exists",
        ),
        ("(contain {place} ?x)", "unknown variable '?x'"),
        (
            "(forall (?x - skiros:Produkt) (contain {place} ?x))",
            "unknown type 'skiros:Produkt'; did you mean skiros:Pro",
        ),
    ],
)
def test_goal_error_has_position_and_reason(plan: Plan, goal: str, expected: str) -> None:
    world = transport_world()
    names = {"place": world.places[0], "product": world.products[0], "robot": world.robots[0]}
    result = plan(world, goal.format(**names, gripper=world.grippers[0]))
    assert result.verdict is Verdict.FAILED
    assert result.message.startswith("goal, line 1, column ")
    assert expected in result.message
