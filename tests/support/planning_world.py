"""Small worlds for planning: a world model in process, with robots, their skills, and things.

world = PlanningWorld()
robot = world.robot("alpha", DRIVE, PICK, PLACE)
table = world.thing("skiros:Location")
world.relate(robot, "skiros:at", table)
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from skiros2_common.core.abstract_skill import SkillCore, SkillDescription
from skiros2_common.core.params import ParamTypes
from skiros2_common.core.world_element import Element
from skiros2_world_model.core.local_world_model import LocalWorldModel

SCENE = "skiros:Scene-0"
REQUIRED, OPTIONAL, INFERRED = ParamTypes.Required, ParamTypes.Optional, ParamTypes.Inferred

#: Makes a condition of a description.
Condition = Callable[[SkillDescription], Any]


def skill(
    name: str,
    params: Sequence[tuple[Any, ...]] = (),
    pre: Sequence[Condition] = (),
    post: Sequence[Condition] = (),
    hold: Sequence[Condition] = (),
    available: bool = True,
    label: str = "",
) -> SkillCore:
    """An implementation of a skill that is only described.

    :param params: (key, class or default, kind, options...) as `addParam` takes them; a text is a class.
    :param label: of the implementation, by default the name in lower case.
    """

    def create(self: SkillDescription) -> None:
        for key, value, kind, *options in params:
            self.addParam(key, Element(value) if isinstance(value, str) and ":" in value else value, kind, *options)
        for condition in pre:
            self.addPreCondition(condition(self))
        for condition in hold:
            self.addHoldCondition(condition(self))
        for condition in post:
            self.addPostCondition(condition(self))
        self.setAvailableForPlanning(available)

    core = SkillCore()
    core.setDescription(type(name, (SkillDescription,), {"createDescription": create})(), label or name.lower())
    return core


def related(subj: str, relation: str, obj: str, state: bool = True) -> Condition:
    return lambda d: d.getRelationCond(f"{subj}{relation}{obj}{state}", relation, subj, obj, state)


def allowed(subj: str, relation: str, obj: str) -> Condition:
    return lambda d: d.getAbstractRelationCond(f"{subj}{relation}{obj}", relation, subj, obj, True)


def prop(subj: str, key: str, operator: str, value: Any, state: bool = True) -> Condition:
    return lambda d: d.getPropCond(f"{subj}{key}{operator}{value}{state}", key, subj, operator, value, state)


def has(subj: str, key: str, state: bool = True) -> Condition:
    return lambda d: d.getHasPropCond(f"{subj}{key}{state}", key, subj, state)


def made(subj: str, state: bool = True) -> Condition:
    return lambda d: d.getGenerateCond(f"{subj}{state}", subj, state)


def given(subj: str, state: bool = True) -> Condition:
    return lambda d: d.getIsSpecifiedCond(f"{subj}{state}", subj, state)


def of_type(subj: str, cls: str) -> Condition:
    return lambda d: d.getOnTypeCond(f"{subj}{cls}", subj, cls)


def one_of(*parts: Condition, state: bool = True) -> Condition:
    def make(d: SkillDescription) -> Any:
        either = d.getOrCond(state)
        for part in parts:
            either.addCondition(part(d))
        return either

    return make


DRIVE = skill(
    "Drive",
    [("StartLocation", "skiros:Location", INFERRED), ("TargetLocation", "skiros:Location", REQUIRED)],
    pre=[related("Robot", "skiros:at", "StartLocation")],
    post=[
        related("Robot", "skiros:at", "StartLocation", False),
        related("Robot", "skiros:at", "TargetLocation"),
    ],
)
_HAND = [
    ("Gripper", "rparts:GripperEffector", INFERRED),
    ("Place", "skiros:Location", INFERRED),
    ("Object", "skiros:Product", REQUIRED),
]
_AT_PLACE = [related("Robot", "skiros:at", "Place"), related("Robot", "skiros:hasA", "Gripper")]
EMPTY, FULL = ("skiros:ContainerState", "=", "Empty"), ("skiros:ContainerState", "=", "Full")
PICK = skill(
    "Pick",
    _HAND,
    pre=[*_AT_PLACE, related("Place", "skiros:contain", "Object"), prop("Gripper", *EMPTY)],
    hold=[related("Robot", "skiros:at", "Place")],
    post=[
        related("Place", "skiros:contain", "Object", False),
        related("Gripper", "skiros:contain", "Object"),
        prop("Gripper", *EMPTY, False),
        prop("Gripper", *FULL),
    ],
)
PLACE = skill(
    "Place",
    _HAND,
    pre=[*_AT_PLACE, related("Gripper", "skiros:contain", "Object")],
    post=[
        related("Gripper", "skiros:contain", "Object", False),
        related("Place", "skiros:contain", "Object"),
        prop("Gripper", *EMPTY),
    ],
)


class PlanningWorld:
    """A world model with the package's ontologies and a blank scene.

    :param wm: by default a new one in this process.
    """

    def __init__(self, wm: Any = None) -> None:
        self.wm = wm if wm is not None else LocalWorldModel()
        #: The skills of each robot, by manager, class and label.
        self.offered: dict[tuple[str, str, str], SkillCore] = {}
        # Of a transport world:
        self.places: list[str] = []
        self.products: list[str] = []
        self.robots: list[str] = []
        self.grippers: list[str] = []

    def thing(self, cls: str, label: str = "", inside: str = SCENE, **properties: Any) -> str:
        """Adds an element and gives its id.

        :param properties: keys without their prefix, `skiros`.
        """
        element = Element(cls, label)
        for key, value in properties.items():
            element.setProperty(f"skiros:{key}", value)
        element.addRelation(inside, "skiros:contain", "-1")
        return self.wm.add_element(element).id

    def robot(self, name: str, *skills: SkillCore, at: str = "", cls: str = "cora:Robot") -> str:
        """Adds a robot whose manager `/name` offers these skills."""
        robot = self.thing(cls, f"skiros:{name}", SkillMgr=f"/{name}")
        for offered in skills:
            element = offered.toElement()
            element.addRelation(robot, "skiros:hasSkill", "-1")
            self.wm.add_element(element)
            self.offered[f"/{name}", element.type, element.label] = offered
        if at:
            self.relate(robot, "skiros:at", at)
        return robot

    def gripper(self, robot: str) -> str:
        """Gives a robot an empty gripper."""
        gripper = Element("rparts:GripperEffector")
        gripper.setProperty("skiros:ContainerState", "Empty")
        gripper.addRelation(robot, "skiros:hasA", "-1")
        return self.wm.add_element(gripper).id

    def relate(self, subj: str, relation: str, obj: str) -> None:
        self.wm.set_relation(subj, relation, obj, True)


def transport_world(robots: int = 1, places: int = 2, products: int = 1, wm: Any = None) -> PlanningWorld:
    """Robots `alpha`, `beta`, ... with a gripper each, at the first place; the products dealt out to the places."""
    world = PlanningWorld(wm)
    world.places = [world.thing("skiros:Location") for _ in range(places)]
    world.products = [world.thing("skiros:Product", inside=world.places[i % places]) for i in range(products)]
    names = ["alpha", "beta", "gamma", "delta"][:robots]
    world.robots = [world.robot(name, DRIVE, PICK, PLACE, at=world.places[0]) for name in names]
    world.grippers = [world.gripper(robot) for robot in world.robots]
    return world
