"""Drive, pick and place as a planning task, of any size, without a world model."""

from __future__ import annotations

from skiros2_task.core.actions import Action, Effect, Variable
from skiros2_task.core.formula import Atom, Formula, Kind, Predicate, conjunction
from skiros2_task.core.skills import Skill
from skiros2_task.core.task import EVERYTHING, PlanningTask

AT = Predicate(Kind.RELATION, "skiros:at")
CONTAIN = Predicate(Kind.RELATION, "skiros:contain")
HAS_A = Predicate(Kind.RELATION, "skiros:hasA")

ROBOT, GRIPPER = "cora:Robot", "rparts:GripperEffector"
PLACE, PRODUCT, OBJECT = "skiros:Location", "skiros:Product", "sumo:Object"

_NAMES = ("drive", "pick", "place")


def at(robot: str, place: str) -> Atom:
    return Atom(AT, (robot, place))


def contain(outer: str, inner: str) -> Atom:
    return Atom(CONTAIN, (outer, inner))


def transport_task(robots: int, places: int, products: int, goal: Formula | None = None) -> PlanningTask:
    """Robots with a gripper each at the first place, the products dealt out to the places.

    :param goal: by default each product at the place after its own.
    """
    there = {
        ROBOT: tuple(f"{ROBOT}-{i}" for i in range(robots)),
        GRIPPER: tuple(f"{GRIPPER}-{i}" for i in range(robots)),
        PLACE: tuple(f"{PLACE}-{i}" for i in range(places)),
        PRODUCT: tuple(f"{PRODUCT}-{i}" for i in range(products)),
    }
    facts = {_can(name, robot) for name in _NAMES for robot in there[ROBOT]}
    facts |= {at(robot, there[PLACE][0]) for robot in there[ROBOT]}
    facts |= {Atom(HAS_A, pair) for pair in zip(there[ROBOT], there[GRIPPER], strict=True)}
    facts |= {contain(there[PLACE][i % places], product) for i, product in enumerate(there[PRODUCT])}
    if goal is None:
        goal = conjunction(contain(there[PLACE][(i + 1) % places], p) for i, p in enumerate(there[PRODUCT]))
    everything = tuple(name for names in there.values() for name in names)
    return PlanningTask(
        actions=_actions(there[ROBOT]),
        objects={name: cls for cls, names in there.items() for name in names},
        members={OBJECT: everything, **there, EVERYTHING: everything},
        predicates=(AT, CONTAIN, HAS_A, *(Predicate(Kind.CAN, name) for name in _NAMES)),
        init=frozenset(facts),
        goal=goal,
    )


def _can(name: str, robot: str) -> Atom:
    return Atom(Predicate(Kind.CAN, name), (robot,))


def _actions(robots: tuple[str, ...]) -> tuple[Action, ...]:
    robot, start = Variable("?Robot", "Robot", (ROBOT,)), Variable("?Place", "Place", (PLACE,))
    gripper, product = Variable("?Gripper", "Gripper", (GRIPPER,)), Variable("?Object", "Object", (PRODUCT,))
    here, held, inside = at("?Robot", "?Place"), contain("?Gripper", "?Object"), contain("?Place", "?Object")
    owned = Atom(HAS_A, ("?Robot", "?Gripper"))

    managers = tuple((robot, robot) for robot in robots)

    def action(name: str, variables: tuple[Variable, ...], needs: tuple[Atom, ...], gone: Atom, made: Atom) -> Action:
        skill = Skill(f"skiros:{name.capitalize()}", name, (), (), (), ())
        effects = (Effect(gone, False), Effect(made, True))
        return Action(name, skill, "?Robot", managers, variables, conjunction([_can(name, "?Robot"), *needs]), effects)

    return (
        action("drive", (robot, start, Variable("?To", "To", (PLACE,))), (here,), here, at("?Robot", "?To")),
        action("pick", (robot, gripper, start, product), (here, owned, inside), inside, held),
        action("place", (robot, gripper, start, product), (here, owned, held), held, inside),
    )
