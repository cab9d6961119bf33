"""Domains and goals with known answers: for each the length of the shortest plan, nothing to do, or no plan.

The domains are those that planning is taught and measured with, written as skills of robots in a scene.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from skiros2_common.core.world_element import Element
from support.planning_world import (
    DRIVE,
    INFERRED,
    PICK,
    PLACE,
    REQUIRED,
    Condition,
    PlanningWorld,
    given,
    has,
    made,
    one_of,
    prop,
    related,
    skill,
    transport_world,
)

#: What the shortest plan is where there is none.
IMPOSSIBLE = -1

Problem = tuple[PlanningWorld, str]


@dataclass(frozen=True)
class Case:
    """A domain, a goal and its answer.

    :param build: makes the world, and the goal in it.
    :param steps: of the shortest plan; 0: the goal holds already; `IMPOSSIBLE`: there is no plan.
    :param managers: how many of them have to take part, at least.
    """

    name: str
    build: Callable[[], Problem]
    steps: int
    managers: int = 1


def param(key: str, cls: str = "skiros:Product", kind: Any = REQUIRED) -> tuple[Any, ...]:
    return (key, cls, kind)


def is_(subj: str, key: str, value: Any = True, state: bool = True) -> Condition:
    return prop(subj, f"skiros:{key}", "=", value, state)


# -- blocks -------------------------------------------------------------------------------------------------------

BLOCK, UNDER = param("Block"), param("Under")
TAKE = skill(
    "Take",
    [BLOCK],
    [is_("Robot", "Free"), is_("Block", "Clear"), is_("Block", "OnTable")],
    [is_("Robot", "Free", state=False), is_("Block", "OnTable", state=False), related("Robot", "skiros:hasA", "Block")],
)
PUT = skill(
    "Put",
    [BLOCK],
    [related("Robot", "skiros:hasA", "Block")],
    [is_("Robot", "Free"), is_("Block", "OnTable"), related("Robot", "skiros:hasA", "Block", False)],
)
STACK = skill(
    "Stack",
    [BLOCK, UNDER],
    [related("Robot", "skiros:hasA", "Block"), is_("Under", "Clear")],
    [
        is_("Robot", "Free"),
        is_("Under", "Clear", state=False),
        related("Robot", "skiros:hasA", "Block", False),
        related("Under", "skiros:contain", "Block"),
    ],
)
UNSTACK = skill(
    "Unstack",
    [BLOCK, param("Under", kind=INFERRED)],
    [is_("Robot", "Free"), is_("Block", "Clear"), related("Under", "skiros:contain", "Block")],
    [
        is_("Robot", "Free", state=False),
        is_("Under", "Clear"),
        related("Under", "skiros:contain", "Block", False),
        related("Robot", "skiros:hasA", "Block"),
    ],
)


def blocks(*towers: str) -> tuple[PlanningWorld, dict[str, str]]:
    """Towers of blocks, each named from the table up."""
    world = PlanningWorld()
    names = {}
    for tower in towers:
        for i, name in enumerate(tower):
            names[name] = world.thing("skiros:Product", OnTable=i == 0, Clear=i == len(tower) - 1)
            if i:
                world.relate(names[tower[i - 1]], "skiros:contain", names[name])
    arm = world.robot("arm", TAKE, PUT, STACK, UNSTACK)
    element = world.wm.get_element(arm)
    element.setProperty("skiros:Free", True)
    world.wm.update_element(element)
    return world, names


def on(names: dict[str, str], tower: str) -> str:
    """A goal: these blocks, from below, on each other."""
    return " ".join(f"(contain {names[a]} {names[b]})" for a, b in itertools.pairwise(tower))


def three_blocks() -> Problem:
    world, names = blocks("a", "b", "c")
    return world, f"(and {on(names, 'abc')})"


def sussman() -> Problem:
    """Sussman's anomaly: neither of the two goals can be reached first and kept."""
    world, names = blocks("ac", "b")
    return world, f"(and {on(names, 'cba')})"


def tower_turned() -> Problem:
    world, names = blocks("abcd")
    return world, f"(and {on(names, 'dcba')})"


def block_on_itself() -> Problem:
    world, names = blocks("a", "b")
    return world, f"(contain {names['a']} {names['b']}), (contain {names['b']} {names['a']})"


def all_on_the_table() -> Problem:
    world, _ = blocks("abc", "de")
    return world, "(forall (?x - skiros:Product) (OnTable ?x))"


def some_tower() -> Problem:
    """Any three different blocks on each other."""
    world, _ = blocks("ab", "c", "d")
    return world, (
        "(exists (?x ?y ?z - skiros:Product)\n"
        "  (and (not (= ?x ?z)) (contain ?x ?y) (contain ?y ?z)))  ; which ones does not matter"
    )


def tower_that_stands() -> Problem:
    world, names = blocks("abc")
    return world, on(names, "abc")


# -- discs on pegs ------------------------------------------------------------------------------------------------


def hanoi(count: int, goal: Callable[[list[str], list[str]], str] | None = None) -> Problem:
    """The towers of Hanoi. That a disc is smaller is a relation that never changes."""
    world = PlanningWorld()
    pegs = [world.thing("skiros:Location", Clear=i > 0) for i in range(3)]
    discs = [world.thing("skiros:Product", Clear=i == count - 1) for i in range(count)]
    for i, disc in enumerate(discs):
        world.relate(pegs[0] if not i else discs[i - 1], "skiros:contain", disc)
        for base in [*pegs, *discs[:i]]:
            world.relate(disc, "skiros:partReference", base)
    move = skill(
        "Move",
        [param("Disc"), param("From", "sumo:Object", INFERRED), param("To", "sumo:Object")],
        [
            related("From", "skiros:contain", "Disc"),
            related("Disc", "skiros:partReference", "To"),
            is_("Disc", "Clear"),
            is_("To", "Clear"),
        ],
        [
            related("From", "skiros:contain", "Disc", False),
            related("To", "skiros:contain", "Disc"),
            is_("From", "Clear"),
            is_("To", "Clear", state=False),
        ],
    )
    world.robot("arm", move)
    if goal is not None:
        return world, goal(pegs, discs)
    tower = [pegs[2], *discs]
    return world, ", ".join(f"(contain {a} {b})" for a, b in itertools.pairwise(tower))


# -- places, loads and robots -------------------------------------------------------------------------------------


def two_carriers_by_relay() -> Problem:
    """Each robot has its half of the building; a table in the middle belongs to both."""
    world = PlanningWorld()
    left, table, right = (world.thing("skiros:Location") for _ in range(3))
    product = world.thing("skiros:Product", inside=left)
    drive = skill(
        "Drive",
        [param("StartLocation", "skiros:Location", INFERRED), param("TargetLocation", "skiros:Location")],
        [related("Robot", "skiros:at", "StartLocation"), related("Robot", "skiros:partReference", "TargetLocation")],
        [related("Robot", "skiros:at", "StartLocation", False), related("Robot", "skiros:at", "TargetLocation")],
    )
    for name, places in (("left", (left, table)), ("right", (right, table))):
        robot = world.robot(name, drive, PICK, PLACE, at=places[0])
        world.gripper(robot)
        for place in places:
            world.relate(robot, "skiros:partReference", place)
    return world, f"(contain {right} {product})"


def everything_swapped() -> Problem:
    """Two products change places, with one gripper."""
    world = transport_world(robots=1, places=2, products=2)
    (a, b), (one, two) = world.places, world.products
    return world, f"(contain {b} {one}), (contain {a} {two})"


def two_grippers_swap() -> Problem:
    """The same with two grippers: both are carried at once."""
    world, goal = everything_swapped()
    world.gripper(world.robots[0])
    return world, goal


def each_robot_at_a_place_of_its_own() -> Problem:
    world = transport_world(robots=3, places=3, products=0)
    goal = (
        "(forall (?p - skiros:Location) (exists (?r - cora:Robot) (at ?r ?p)))\n"
        "(forall (?r - cora:Robot ?p ?q - skiros:Location) (imply (and (at ?r ?p) (at ?r ?q)) (= ?p ?q)))"
    )
    return world, goal


def more_places_than_robots() -> Problem:
    world = transport_world(robots=2, places=3, products=0)
    return world, "(forall (?p - skiros:Location) (exists (?r - cora:Robot) (at ?r ?p)))"


def no_way_back() -> Problem:
    """Roads lead on only; the two places lie on different branches."""
    world = PlanningWorld()
    start, one, other = (world.thing("skiros:Location") for _ in range(3))
    for place in (one, other):
        world.relate(start, "skiros:partReference", place)
    robot = world.robot("alpha", visiting(), at=start)
    return world, f"(Visited {one}), (Visited {other}), (at {robot} {other})"


def visiting() -> Any:
    return skill(
        "Go",
        [param("From", "skiros:Location", INFERRED), param("To", "skiros:Location")],
        [related("Robot", "skiros:at", "From"), related("From", "skiros:partReference", "To")],
        [related("Robot", "skiros:at", "From", False), related("Robot", "skiros:at", "To"), is_("To", "Visited")],
    )


def round_trip() -> Problem:
    """A ring of places: all are visited, and the robot is back."""
    world = PlanningWorld()
    ring = [world.thing("skiros:Location") for _ in range(5)]
    for a, b in zip(ring, [*ring[1:], ring[0]], strict=True):
        world.relate(a, "skiros:partReference", b)
    robot = world.robot("alpha", visiting(), at=ring[0])
    return world, f"(forall (?p - skiros:Location) (Visited ?p)) (at {robot} {ring[0]})"


def key_and_door() -> Problem:
    """The key lies behind another door, which needs no key."""
    world = PlanningWorld()
    hall, closet, vault = (world.thing("skiros:Location", Locked=i == 2) for i in range(3))
    key = world.thing("skiros:Starter", inside=closet)
    enter = skill(
        "Enter",
        [param("From", "skiros:Location", INFERRED), param("To", "skiros:Location")],
        [related("Robot", "skiros:at", "From"), is_("To", "Locked", state=False)],
        [related("Robot", "skiros:at", "From", False), related("Robot", "skiros:at", "To")],
    )
    grab = skill(
        "Grab",
        [param("Key", "skiros:Starter"), param("Place", "skiros:Location", INFERRED)],
        [related("Robot", "skiros:at", "Place"), related("Place", "skiros:contain", "Key")],
        [related("Place", "skiros:contain", "Key", False), related("Robot", "skiros:hasA", "Key")],
    )
    unlock = skill(
        "Unlock",
        [param("Door", "skiros:Location"), param("Key", "skiros:Starter", INFERRED)],
        [related("Robot", "skiros:hasA", "Key"), is_("Door", "Locked")],
        [is_("Door", "Locked", False)],
    )
    robot = world.robot("alpha", enter, grab, unlock, at=hall)
    return world, f"(at {robot} {vault}) (hasA {robot} {key})"


def key_locked_in() -> Problem:
    world, goal = key_and_door()
    for place in world.wm.resolve_elements(Element("skiros:Location"))[1:]:
        place.setProperty("skiros:Locked", True)
        world.wm.update_element(place)
    return world, goal


def ferry() -> Problem:
    """A boat for one car, on its side of the river; two cars want to the other side."""
    world = PlanningWorld()
    here, there = world.thing("skiros:Location"), world.thing("skiros:Location")
    cars = [world.thing("skiros:Product", inside=here) for _ in range(2)]
    boat = world.robot("boat", DRIVE, PICK, PLACE, at=there)
    world.gripper(boat)
    return world, " ".join(f"(contain {there} {car})" for car in cars)


# -- properties ---------------------------------------------------------------------------------------------------

CHARGE = skill(
    "Charge",
    [param("Cell")],
    [prop("Cell", "skiros:Charge", "<", 50.0)],
    [prop("Cell", "skiros:Charge", "=", 100.0)],
)
DRAIN = skill(
    "Drain",
    [param("Cell")],
    [prop("Cell", "skiros:Charge", ">=", 80.0)],
    [prop("Cell", "skiros:Charge", "<=", 10.0), is_("Cell", "Tested")],
)


def cells(goal: str, *charges: float | None) -> Callable[[], Problem]:
    def build() -> Problem:
        world = PlanningWorld()
        for charge in charges:
            world.thing("skiros:Product", **({} if charge is None else {"Charge": charge}))
        world.robot("alpha", CHARGE, DRAIN)
        return world, goal

    return build


def recipe(goal: str, *done: str) -> Callable[[], Problem]:
    """Steps of work that each need the one before, or one of two; states are texts and truths."""

    def build() -> Problem:
        world = PlanningWorld()
        part = world.thing("skiros:Part", State="Raw", **dict.fromkeys(done, True))
        piece = [param("Part", "skiros:Part")]
        world.robot(
            "alpha",
            skill("Wash", piece, [has("Part", "skiros:State")], [is_("Part", "Clean")]),
            skill("Saw", piece, [is_("Part", "State", "Raw")], [is_("Part", "State", "Cut to size")]),
            skill(
                "Mill",
                piece,
                [is_("Part", "State", "Raw")],
                [is_("Part", "State", "Milled"), is_("Part", "Clean", False)],
            ),
            skill(
                "Paint",
                piece,
                [
                    one_of(is_("Part", "State", "Cut to size"), is_("Part", "State", "Milled")),
                    is_("Part", "Clean"),
                    is_("Part", "Painted", state=False),
                ],
                [is_("Part", "Painted")],
            ),
            skill("Check", piece, [is_("Part", "State", "Raw", False)], [has("Part", "skiros:Report")]),
        )
        return world, goal.format(part=part)

    return build


def lamp(goal: str, **state: bool) -> Callable[[], Problem]:
    """A switch that turns a lamp on and off, and a cover that has to be shut for both."""

    def build() -> Problem:
        world = PlanningWorld()
        it = world.thing("skiros:Container", **state)
        box = [param("Lamp", "skiros:Container")]
        world.robot(
            "alpha",
            skill("On", box, [is_("Lamp", "On", False), is_("Lamp", "Open", state=False)], [is_("Lamp", "On")]),
            skill("Off", box, [is_("Lamp", "On"), is_("Lamp", "Open", False)], [is_("Lamp", "On", state=False)]),
            skill("Shut", box, [is_("Lamp", "Open")], [is_("Lamp", "Open", False)]),
            skill("Lift", box, [is_("Lamp", "Open", False)], [is_("Lamp", "Open")]),
        )
        return world, goal.format(lamp=it)

    return build


# -- several robots -----------------------------------------------------------------------------------------------


def line_of_work(*crew: str) -> Callable[[], Problem]:
    """Cutting, welding and painting at three stations, each by a robot of its own; a carrier between them."""

    def build() -> Problem:
        world = PlanningWorld()
        stations = [world.thing("skiros:Location") for _ in range(3)]
        product = world.thing("skiros:Product", inside=stations[0])
        place = param("Place", "skiros:Location", INFERRED)
        there = [related("Robot", "skiros:at", "Place"), related("Place", "skiros:contain", "Object")]
        work = {
            "cutter": skill("Cut", [place, param("Object")], there, [is_("Object", "Cut")]),
            "welder": skill(
                "Weld", [place, param("Object")], [*there, is_("Object", "Cut")], [is_("Object", "Welded")]
            ),
            "painter": skill(
                "Paint", [place, param("Object")], [*there, is_("Object", "Welded")], [is_("Object", "Painted")]
            ),
        }
        for name, station in zip(work, stations, strict=True):
            if name in crew:
                world.robot(name, work[name], at=station)
        if "carrier" in crew:
            world.gripper(world.robot("carrier", DRIVE, PICK, PLACE, at=stations[0]))
        return world, f"(Painted {product})"

    return build


def lift_together() -> Problem:
    """A beam is held at both ends, by one robot each, before it is bolted; a robot holds one end only."""
    world = PlanningWorld()
    beam = world.thing("skiros:Product")
    free = is_("Robot", "Busy", state=False)
    hold = [
        skill(f"Hold{end}", [param("Beam")], [free, given("Beam")], [is_("Beam", end), is_("Robot", "Busy")])
        for end in ("Left", "Right")
    ]
    bolt = skill("Bolt", [param("Beam")], [free, is_("Beam", "Left"), is_("Beam", "Right")], [is_("Beam", "Bolted")])
    for name in ("alpha", "beta", "gamma"):
        world.robot(name, *hold, bolt)
    return world, f"(Bolted {beam})"


# -- what comes and goes ------------------------------------------------------------------------------------------


def cast_and_stack() -> Problem:
    """Parts are made as they are needed."""
    world = PlanningWorld()
    table = world.thing("skiros:Location")
    cast = skill(
        "Cast",
        [param("Place", "skiros:Location"), param("Object")],
        [given("Place")],
        [made("Object"), related("Place", "skiros:contain", "Object")],
    )
    world.robot("caster", cast)
    return world, f"(exists (?x ?y - skiros:Product) (and (not (= ?x ?y)) (contain {table} ?x) (contain {table} ?y)))"


def clear_the_table() -> Problem:
    world = transport_world(robots=1, places=1, products=3)
    scrap = skill(
        "Scrap",
        [param("Place", "skiros:Location", INFERRED), param("Object")],
        [related("Robot", "skiros:at", "Place"), related("Place", "skiros:contain", "Object")],
        [made("Object", False)],
    )
    world.robot("bin", scrap, at=world.places[0])
    return world, f"(not (exists (?x - skiros:Product) (contain {world.places[0]} ?x))) (Empty {world.grippers[0]})"


def gripper_goal(goal: str) -> Callable[[], Problem]:
    def build() -> Problem:
        world = transport_world(robots=1, places=2, products=1)
        names = {"robot": world.robots[0], "gripper": world.grippers[0], "product": world.products[0]}
        return world, goal.format(**names, here=world.places[0], there=world.places[1])

    return build


CASES = (
    # blocks
    Case("three blocks are stacked", three_blocks, 4),
    Case("Sussman's anomaly", sussman, 6),
    Case("a tower is turned over", tower_turned, 8),
    Case("two blocks cannot lie on each other", block_on_itself, IMPOSSIBLE),
    Case("all blocks are put on the table", all_on_the_table, 6),
    Case("some tower of three", some_tower, 2),
    Case("a tower that stands already", tower_that_stands, 0),
    # pegs
    Case("Hanoi with three discs", lambda: hanoi(3), 7),
    Case("Hanoi with four discs", lambda: hanoi(4), 15),
    Case(
        "the largest disc does not lie on a smaller one",
        lambda: hanoi(2, lambda p, d: f"(contain {d[1]} {d[0]})"),
        IMPOSSIBLE,
    ),
    Case(
        "no disc is left on the first peg",
        lambda: hanoi(2, lambda p, d: f"(forall (?d - skiros:Product) (not (contain {p[0]} ?d)))"),
        2,
    ),
    # places and loads
    Case("two robots hand a product on", two_carriers_by_relay, 7, managers=2),
    Case("two products change places", everything_swapped, 6),
    Case("two products change places in two grippers", two_grippers_swap, 6),
    Case("each robot at a place of its own", each_robot_at_a_place_of_its_own, 2, managers=2),
    Case("more places than robots", more_places_than_robots, IMPOSSIBLE),
    Case("roads without a way back", no_way_back, IMPOSSIBLE),
    Case("a round trip", round_trip, 5),
    Case("a key and a door", key_and_door, 4),
    Case("a key behind the door that it opens", key_locked_in, IMPOSSIBLE),
    Case("a ferry for two cars", ferry, 8),
    # numbers
    Case("a cell is charged before it is tested", cells("(forall (?c - skiros:Product) (Tested ?c))", 20.0, 90.0), 3),
    Case(
        "tested and charged again",
        cells("(forall (?c - skiros:Product) (and (Tested ?c) (> (Charge ?c) 50)))", 20.0),
        3,
    ),
    Case(
        "nothing is charged beyond full", cells("(exists (?c - skiros:Product) (> (Charge ?c) 100))", 20.0), IMPOSSIBLE
    ),
    Case("a charge that is not known", cells("(forall (?c - skiros:Product) (has_Charge ?c))", 20.0, None), IMPOSSIBLE),
    Case("not above a number", cells("(forall (?c - skiros:Product) (not (> (Charge ?c) 15)))", 90.0, 20.0), 3),
    Case(
        "charged enough",
        cells("(forall (?c - skiros:Product) (and (>= (Charge ?c) 20) (<= (Charge ?c) 90)))", 20.0, 90.0),
        0,
    ),
    # texts and truths
    Case("painted by the short way", recipe("(Painted {part})"), 3),
    Case("painted and milled", recipe("(Painted {part}) (State_Milled {part})"), 3),
    Case("painted and not milled", recipe('(Painted {part}) (not (= (State {part}) "Milled"))'), 3),
    Case("clean already", recipe("(Painted {part})", "Clean"), 2),
    Case(
        "cut and milled exclude each other",
        recipe('(= (State {part}) "Cut to size") (State_Milled {part})'),
        IMPOSSIBLE,
    ),
    Case("a value that some skill only makes to be there", recipe("(has_Report {part})"), 2),
    Case("either of two", recipe("(or (State_Milled {part}) (has_Report {part}))"), 1),
    Case("a lamp under an open cover", lamp("(On {lamp})", On=False, Open=True), 2),
    Case("a lamp is turned off and the cover lifted", lamp("(not (On {lamp})) (Open {lamp})", On=True, Open=False), 2),
    Case("false is not the same as not there", lamp("(Open_False {lamp})", On=True), IMPOSSIBLE),
    # several robots
    Case("a line of work", line_of_work("cutter", "welder", "painter", "carrier"), 9, managers=4),
    Case("a line of work without a welder", line_of_work("cutter", "painter", "carrier"), IMPOSSIBLE),
    Case("a beam that two have to hold", lift_together, 3, managers=3),
    # what comes and goes
    Case("two parts are made", cast_and_stack, 2),
    Case("a table is cleared into a bin", clear_the_table, 3),
    # the goal's forms
    Case("nothing is asked for", gripper_goal("(and)"), 0),
    Case("what never holds", gripper_goal("(or)"), IMPOSSIBLE),
    Case("of nothing all holds", gripper_goal("(forall (?x - skiros:Starter) (contain {there} ?x))"), 0),
    Case("of nothing none holds", gripper_goal("(exists (?x - skiros:Starter) (contain {there} ?x))"), IMPOSSIBLE),
    Case(
        "for all some",
        gripper_goal("(forall (?l - skiros:Location) (exists (?p - skiros:Product) (contain ?l ?p)))"),
        IMPOSSIBLE,
    ),
    Case("what follows", gripper_goal("(imply (contain {here} {product}) (at {robot} {there}))"), 1),
    Case("not not", gripper_goal("(not (not (at {robot} {there})))"), 1),
    Case("one of two is nearer", gripper_goal("(or (contain {there} {product}) (Full {gripper}))"), 1),
)
