"""Elements as parameters: inference, classes, options, several implementations, the same skill several times."""

from __future__ import annotations

from typing import Any

from catalogue.case import Tree, case
from catalogue.parts import OPTIONAL, REQUIRED
from skiros2_common.core.world_element import Element
from skiros2_skill.core.skill import NoFail, ParallelFf, SerialStar
from skiros2_skill.testing import SkillBench

PRODUCT = Element("skiros:Product")
THING = ("Thing", PRODUCT, REQUIRED)


def two_trays(world: SkillBench) -> None:
    """The second product comes before the first by id."""
    for number in ("2", "1"):
        tray = world.add("skiros:LargeBox", f"tray {number}")
        world.add("skiros:Product", f"bolt {number}", tray, Weight=float(number))


def arm(world: SkillBench) -> None:
    world.add("rparts:ArmDevice", "arm", StateProperty="Idle")


# -- inference ---------------------------------------------------------------------------------------------------------


@case(
    """
    root                    S1
      inferred_for_oneself  S1
        take                S1
        take                S1
        take                S1
    """,
    scene=two_trays,
    given={"First": "@bolt 1", "Second": "@bolt 2"},
)
class inferred_for_oneself(Tree):
    """What a skill has inferred is found anew by the next one; it is nobody's given value."""

    declares = (("First", PRODUCT, REQUIRED), ("Second", PRODUCT, REQUIRED))

    def expand(self, skill: Any) -> None:
        for key, label in (("First", "1"), ("Second", "2"), ("First", "1")):
            expected = {"Expected": f"tray {label}, bolt {label}"}
            skill(self.skill("Take", "", remap={"Object": key}, specify=expected))


@case(
    """
    root                S1
      inferred_by_id    S1
        take            S1
    """,
    scene=two_trays,
)
class inferred_by_id(Tree):
    """Of several that fit, the one with the smallest id."""

    def expand(self, skill: Any) -> None:
        skill(self.skill("Take", "", specify={"Expected": "tray 2, bolt 2"}))


@case(
    """
    root                  S1
      known_is_preferred  S1
        take              S1
    """,
    scene=two_trays,
    given={"Known": "@tray 1"},
)
class known_is_preferred(Tree):
    """Elements that are on the blackboard already come first."""

    declares = (("Known", Element("skiros:LargeBox"), REQUIRED),)

    def expand(self, skill: Any) -> None:
        skill(self.skill("Take", "", specify={"Expected": "tray 1, bolt 1"}))


@case(
    """
    root            F-1
      nothing_fits  F-1
        Take        F-1
    """,
    scene=lambda world: world.add("skiros:Product", "lost"),
)
class nothing_fits(Tree):
    """Nothing in the scene fits: a pre-condition that fails."""

    def expand(self, skill: Any) -> None:
        skill(self.skill("Take", ""))


@case(
    """
    root             F-1
      given_wrongly  F-1
        Take         F-1
    """,
    scene=two_trays,
    given={"Object": "@bolt 1", "Container": "@tray 2"},
)
class given_wrongly(Tree):
    """What is given is not replaced by what would fit."""

    declares = (("Object", PRODUCT, REQUIRED), ("Container", Element("skiros:LargeBox"), REQUIRED))

    def expand(self, skill: Any) -> None:
        skill(self.skill("Take", ""))


# -- elements that change ----------------------------------------------------------------------------------------------


@case(
    """
    root             S1
      written_back   S1
        weigh        S1
        check        S1
        weigh        S1
        nofail(->*)  S
          Check      F-1
        act          S1
    """,
    scene=two_trays,
    given={"Thing": "@bolt 1"},
)
class written_back(Tree):
    """What a skill changes on its elements is in the world model for the next."""

    declares = (THING,)

    def expand(self, skill: Any) -> None:
        skill(
            self.skill("Weigh", "", specify={"Weight": 2.0}),
            self.skill("Check", ""),
            self.skill("Weigh", "", specify={"Weight": 0.5}),
            self.skill(NoFail(SerialStar()))(self.skill("Check", "")),
            self.act(),
        )


# -- options -----------------------------------------------------------------------------------------------------------


@case(
    """
    root            S1
      consumed      S1
        remove      S1
    """,
    scene=two_trays,
    given={"Thing": "@bolt 1"},
)
class consumed(Tree):
    """Consume: the element is gone after."""

    declares = (THING,)

    def expand(self, skill: Any) -> None:
        skill(self.skill("Remove", "remove"))


@case(
    """
    root            F-1
      not_consumed  F-3
        remove_not  F-3
    """,
    scene=two_trays,
    given={"Thing": "@bolt 1"},
)
class not_consumed(Tree):
    """Consume: it is not, which makes the success a failure."""

    declares = (THING,)

    def expand(self, skill: Any) -> None:
        skill(self.skill("Remove", "remove_not"))


@case(
    """
    root            S1
      unspecified   S1
        forget      S1
    """,
    scene=two_trays,
    given={"Thing": "@bolt 1"},
)
class unspecified(Tree):
    """Unspecify: the parameter is unset after."""

    declares = (THING,)

    def expand(self, skill: Any) -> None:
        skill(self.skill("Forget", "forget"))


@case(
    """
    root               F-1
      not_unspecified  F-3
        forget_not     F-3
    """,
    scene=two_trays,
    given={"Thing": "@bolt 1"},
)
class not_unspecified(Tree):
    """Unspecify: it is not."""

    declares = (THING,)

    def expand(self, skill: Any) -> None:
        skill(self.skill("Forget", "forget_not"))


@case(
    """
    root              R   S1
      locked          R   S1
        nofail(|ff|)  R   S
          use_arm     R1  F-9
          act         R1  F-5
        use_arm       .   S1
        nofail(|ff|)  .   S
          use_arm     .   F-9
          UseArm      .   F-1
        use_arm       .   S1
    """,
    scene=arm,
    given={"Arm": "@arm"},
)
class locked(Tree):
    """Lock: one skill at a time has the device, and it is free again however that skill ends."""

    declares = (("Arm", Element("rparts:ArmDevice"), REQUIRED),)

    def expand(self, skill: Any) -> None:
        use = lambda script: self.skill("UseArm", "", specify={"Script": script})  # noqa: E731
        skill(
            self.skill(NoFail(ParallelFf()))(use("RRRS"), self.act("RF")),
            use("S"),
            self.skill(NoFail(ParallelFf()))(use("RRRS"), use("S")),
            use("S"),
        )


@case(
    """
    root              F-1
      respected_type  F-1
        box           S1
        Box           F-1
    """,
    scene=two_trays,
    given={"Good": "@tray 1", "Bad": "@bolt 1"},
)
class respected_type(Tree):
    """RespectType: the value has to be of the default's class."""

    declares = (("Good", Element("sumo:Object"), REQUIRED), ("Bad", Element("sumo:Object"), REQUIRED))

    def expand(self, skill: Any) -> None:
        skill(self.skill("Box", "", remap={"Thing": "Good"}), self.skill("Box", "", remap={"Thing": "Bad"}))


# -- several implementations -------------------------------------------------------------------------------------------


@case(
    """
    root              R   S1
      choice          R   S1
        lift_box      R1  S2
        lift_heavy    S1  S1
        lift_light    S1  S1
    """,
    scene=lambda world: (
        world.add("skiros:LargeBox", "crate", Weight=5.0),
        world.add("skiros:Product", "anvil", Weight=5.0),
        world.add("skiros:Product", "feather", Weight=0.1),
    ),
    given={"Crate": "@crate", "Anvil": "@anvil", "Feather": "@feather"},
)
class choice(Tree):
    """The first whose parameters fit and whose pre-conditions hold; the first narrows the type of its parameter."""

    declares = tuple((key, Element("sumo:Object"), REQUIRED) for key in ("Crate", "Anvil", "Feather"))

    def expand(self, skill: Any) -> None:
        skill.setProcessor(ParallelFf())
        skill(*(self.skill("Lift", "", remap={"Thing": key}) for key in ("Crate", "Anvil", "Feather")))


@case(
    """
    root            F-1
      no_choice     F-1
        lift_heavy  F-1
    """,
    scene=lambda world: world.add("skiros:Product", "feather", Weight=0.1),
    given={"Thing": "@feather"},
)
class no_choice(Tree):
    """One that is asked for by label is not replaced by one that fits."""

    declares = (THING,)

    def expand(self, skill: Any) -> None:
        skill(self.skill(":Lift", "lift_heavy"))


@case(
    """
    root         F-1
      none_fits  F-1
        Lift     F-1
    """,
    scene=lambda world: world.add("skiros:Product", "vapour"),
    given={"Thing": "@vapour"},
)
class none_fits(Tree):
    """No implementation fits: neither comparison holds of a weight that is missing, and one respects its type."""

    declares = (THING,)

    def expand(self, skill: Any) -> None:
        skill(self.skill("skiros:Lift"))


@case(
    """
    root          R   S1
      crowd       R   S1
        job_one   R1  S2
        job_two   R1  S2
        job_one   R1  S2
        job_two   R1  S2
    """
)
class crowd(Tree):
    """Those that do not run come first; busy ones are duplicated: the same skill runs several times at once."""

    def expand(self, skill: Any) -> None:
        skill.setProcessor(ParallelFf())
        skill(self.skill("Job"), self.skill("Job"), self.skill("Job"), self.skill("Job", "job_two"))


@case(
    """
    root          R   R   S1
      sequel      R   R   S1
        job_one   R1  S2  S2
        job_one   .   R1  S2
    """
)
class sequel(Tree):
    """One that has ended is free again."""

    def expand(self, skill: Any) -> None:
        skill(self.skill("Job"), self.skill("Job"))


@case(
    """
    root            S1
      optional      S1
        passes_by   S1
          act       S1
    """
)
class optional(Tree):
    """An optional element may stay unset."""

    def expand(self, skill: Any) -> None:
        skill(self.skill("PassesByCase", ""))


class passes_by(Tree):
    """Has an optional element."""

    declares = (("Extra", PRODUCT, OPTIONAL),)

    def expand(self, skill: Any) -> None:
        skill(self.act("S" if self.params["Extra"].value.isAbstract() else "F"))
