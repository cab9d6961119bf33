"""How each processor ticks its children."""

from __future__ import annotations

from typing import Any

from catalogue.case import Tree, case
from catalogue.parts import REQUIRED
from skiros2_common.core.world_element import Element
from skiros2_skill.core.skill import (
    Loop,
    NoFail,
    ParallelFf,
    ParallelFs,
    RetryOnFail,
    Selector,
    SelectorStar,
    Sequential,
    Serial,
    SerialStar,
)
from skiros2_skill.testing import SkillBench

THING = ("Thing", Element("skiros:Product"), REQUIRED)


def light(world: SkillBench) -> None:
    world.add("skiros:Product", "thing", Weight=0.5)


def heavy(world: SkillBench) -> None:
    world.add("skiros:Product", "thing", Weight=2.0)


def weight(kilograms: float) -> Any:
    """The thing's weight changes."""

    def change(world: SkillBench) -> None:
        thing = world.element("thing")
        thing.setProperty("skiros:Weight", kilograms)
        world.wmi.update_element(thing)

    return change


# -- in order ----------------------------------------------------------------------------------------------------------


@case(
    """
    root           R   R   R   S1
      serial_star  R   R   R   S1
        act        R1  S2  S2  S2
        act        .   S1  S1  S1
        act        .   R1  R2  S3
    """
)
class serial_star(Tree):
    """Goes on at the child that was running."""

    def expand(self, skill: Any) -> None:
        skill.setProcessor(SerialStar())
        skill(self.act("RS"), self.act("S"), self.act("RRS"))


@case(
    """
    root          R   R   S1
      sequential  R   R   S1
        act       R1  S2  S2
        act       .   R1  S2
    """
)
class sequential(Tree):
    """`SerialStar` under its other name."""

    def expand(self, skill: Any) -> None:
        skill.setProcessor(Sequential())
        skill(self.act("RS"), self.act("RS"))


@case(
    """
    root                R   R   S1
      default_sequence  R   R   S1
        act             R1  S2  S2
        act             .   R1  S2
    """
)
class default_sequence(Tree):
    """The default processor is `Sequential`."""

    def expand(self, skill: Any) -> None:
        skill(self.act("RS"), self.act("RS"))


@case(
    """
    root        R  F-1
      self_set  R  F-5
        act     R1 F-9
        act     R1 F-5
    """
)
class self_set(Tree):
    """`expand` may also call `self.setProcessor`."""

    def expand(self, skill: Any) -> None:
        self.setProcessor(ParallelFf())
        skill(self.act("RRS"), self.act("RF"))


@case(
    """
    root                 R  F-1
      serial_star_fails  R  F-5
        act              S1 S1
        act              R1 F-5
        act              .  .
    """
)
class serial_star_fails(Tree):
    """What comes after a failure is not ticked."""

    def expand(self, skill: Any) -> None:
        skill.setProcessor(SerialStar())
        skill(self.act("S"), self.act("RF"), self.act("S"))


@case(
    """
    root       R  R  F-1
      serial   R  R  F-1
        check  S1 S1 F-1
        act    R1 R2 F-9
        act    .  .  .
    """,
    scene=heavy,
    given={"Thing": "@thing"},
    events={3: weight(0.5)},
)
class serial(Tree):
    """From the first each time; what runs after a child that is not Success any more is preempted."""

    declares = (THING,)

    def expand(self, skill: Any) -> None:
        skill.setProcessor(Serial())
        skill(self.skill("Check", ""), self.act("RRRS"), self.act("S"))


@case(
    """
    root             R   R   S1
      serial_again   R   R   S1
        count        S1  S1  S1
        act          R1  R2  S3
        count        .   .   S1
        hear_number  .   .   S1
    """
)
class serial_again(Tree):
    """Children that have succeeded are started again, at each tick."""

    declares = (("Number", 0, REQUIRED),)

    def expand(self, skill: Any) -> None:
        skill.setProcessor(Serial())
        skill(
            self.skill("Count", ""),
            self.act("RRS"),
            self.skill("Count", ""),
            self.skill("HearNumber", "", specify={"Expected": 4}),
        )


@case(
    """
    root        R    S1
      selector  R    S1
        act     F-5  F-5
        act     R1   F-5
        act     .    S1
        act     .    .
    """
)
class selector(Tree):
    """From the first each time, until one is Success or Running."""

    def expand(self, skill: Any) -> None:
        skill.setProcessor(Selector())
        skill(self.act("F"), self.act("RF"), self.act("S"), self.act("S"))


@case(
    """
    root                  R    R    S1
      selector_preempts   R    R    S1
        check             F-1  F-1  S1
        act               R1   R2   F-9
    """,
    scene=light,
    given={"Thing": "@thing"},
    events={3: weight(2.0)},
)
class selector_preempts(Tree):
    """What runs after a child that is Success now is preempted."""

    declares = (THING,)

    def expand(self, skill: Any) -> None:
        skill.setProcessor(Selector())
        skill(self.skill("Check", ""), self.act("RRRS"))


@case(
    """
    root              R   F-1
      selector_fails  R   F-5
        act           F-5 F-5
        act           R1  F-5
    """
)
class selector_fails(Tree):
    """Fails when none is Success or Running."""

    def expand(self, skill: Any) -> None:
        skill.setProcessor(Selector())
        skill(self.act("F"), self.act("RF"))


@case(
    """
    root             R    R    R    S1
      selector_star  R    R    R    S1
        Check        F-1  F-1  F-1  F-1
        act          R1   F-5  F-5  F-5
        act          .    R1   R2   S3
        act          .    .    .    .
    """,
    scene=light,
    given={"Thing": "@thing"},
    events={2: weight(2.0)},
)
class selector_star(Tree):
    """Remembers where it was: what has failed is not tried again."""

    declares = (THING,)

    def expand(self, skill: Any) -> None:
        skill.setProcessor(SelectorStar())
        skill(self.skill("Check", ""), self.act("RF"), self.act("RRS"), self.act("S"))


# -- in parallel -------------------------------------------------------------------------------------------------------


@case(
    """
    root           R   R   R   S1
      parallel_ff  R   R   R   S1
        act        R1  S2  S2  S2
        act        R1  R2  R3  S4
        act        S1  S1  S1  S1
    """
)
class parallel_ff(Tree):
    """Succeeds when all have; those that have are not ticked any more."""

    def expand(self, skill: Any) -> None:
        skill.setProcessor(ParallelFf())
        skill(self.act("RS"), self.act("RRRS"), self.act("S"))


@case(
    """
    root                 R  F-1
      parallel_ff_fails  R  F-5
        act              R1 F-9
        act              S1 S1
        act              R1 F-5
        act              R1 F-9
    """
)
class parallel_ff_fails(Tree):
    """Fails when one fails; the others are preempted, whether they come before or after it."""

    def expand(self, skill: Any) -> None:
        skill.setProcessor(ParallelFf())
        skill(self.act("RRRS"), self.act("S"), self.act("RF"), self.act("RRRS"))


@case(
    """
    root           R   S1
      parallel_fs  R   S1
        act        R1  F-9
        act        R1  S2
        act        R1  F-9
    """
)
class parallel_fs(Tree):
    """Ends with the state of the first that ends; the others are preempted."""

    def expand(self, skill: Any) -> None:
        skill.setProcessor(ParallelFs())
        skill(self.act("RRRS"), self.act("RS"), self.act("RRRS"))


@case(
    """
    root                 R  F-1
      parallel_fs_fails  R  F-5
        act              R1 F-9
        act              R1 F-5
    """
)
class parallel_fs_fails(Tree):
    """Also with a failure."""

    def expand(self, skill: Any) -> None:
        skill.setProcessor(ParallelFs())
        skill(self.act("RRRS"), self.act("RF"))


# -- decorated ---------------------------------------------------------------------------------------------------------


@case(
    """
    root       R   S1
      no_fail  R   S1
        act    R1  F-5
        act    .   .
    """
)
class no_fail(Tree):
    """A failure counts as Success; for the children all is as with the other processor."""

    def expand(self, skill: Any) -> None:
        skill.setProcessor(NoFail(SerialStar()))
        skill(self.act("RF"), self.act("S"))


@case(
    """
    root                R   S1
      no_fail_parallel  R   S1
        nofail(|ff|)    R   S
          act           R1  F-9
          act           R1  F-5
        act             .   S1
    """
)
class no_fail_parallel(Tree):
    """Around a parallel one."""

    def expand(self, skill: Any) -> None:
        skill(self.skill(NoFail(ParallelFf()))(self.act("RRS"), self.act("RF")), self.act("S"))


@case(
    """
    root             R   R   F-1
      retry_on_fail  R   R   F-5
        act          S1  S1  S1
        act          F-5 F-5 F-5
    """
)
class retry_on_fail(Tree):
    """Starts again from the first child, twice; Running in between."""

    def expand(self, skill: Any) -> None:
        skill.setProcessor(RetryOnFail(2))
        skill(self.act("S"), self.act("F"))


@case(
    """
    root            R   S1
      loop          R   S1
        retry(1,?)  S   S
          act       F-5 F-5
          act       S1  S1
        act         S1  S1
    """
)
class loop(Tree):
    """Twice, around children that are tried again."""

    def expand(self, skill: Any) -> None:
        skill.setProcessor(Loop(2))
        skill(self.skill(RetryOnFail(1, Selector()))(self.act("F"), self.act("S")), self.act("S"))


@case(
    """
    root                R    R    R    S1
      retry_until_good  R    R    R    S1
        act             R1   S2   R1   S2
        check           .    F-1  F-1  S1
    """,
    scene=light,
    given={"Thing": "@thing"},
    events={4: weight(2.0)},
)
class retry_until_good(Tree):
    """Without limit, and not again once it has succeeded."""

    declares = (THING,)

    def expand(self, skill: Any) -> None:
        skill.setProcessor(RetryOnFail())
        skill(self.act("RS"), self.skill("Check", ""))


# -- nested ------------------------------------------------------------------------------------------------------------


@case(
    """
    root               R    R    R    S1
      nested           R    R    R    S1
        |ff|           R    S    S    S
          act          R1   S2   S2   S2
          act          S1   S1   S1   S1
        ?*             .    R    R    S
          ->*          .    R    F    F
            act        .    S1   S1   S1
            act        .    R1   F-5  F-5
          ->*          .    .    R    S
            act        .    .    R1   S2
        nofail(|fs|)   .    .    .    S
          act          .    .    .    F-9
          act          .    .    .    F-5
    """
)
class nested(Tree):
    """One in another. (Here the last but one leaf is preempted in the tick in which it starts.)"""

    def expand(self, skill: Any) -> None:
        skill(
            self.skill(ParallelFf())(self.act("RS"), self.act("S")),
            self.skill(SelectorStar())(
                self.skill(SerialStar())(self.act("S"), self.act("RF")),
                self.skill(SerialStar())(self.act("RS")),
            ),
            self.skill(NoFail(ParallelFs()))(self.act("RRS"), self.act("F")),
        )


@case(
    """
    root      S1
      empty   S1
        ->    S
        ->*   S
        |ff|  S
        |fs|  S
    """
)
class empty(Tree):
    """What has no children succeeds at once: nothing of it has failed or runs."""

    def expand(self, skill: Any) -> None:
        skill(self.skill(Serial()), self.skill(SerialStar()), self.skill(ParallelFf()), self.skill(ParallelFs()))


@case(
    """
    root           R   R   S1
      two_levels   R   R   S1
        inner      R   R   S1
          act      R1  R2  S3
        inner      S1  S1  S1
          act      S1  S1  S1
    """
)
class two_levels(Tree):
    """Compounds of compounds: the same one twice at once, with other parameters."""

    def expand(self, skill: Any) -> None:
        skill.setProcessor(ParallelFf())
        skill(
            self.skill("InnerCase", "inner", specify={"Script": "RRS"}),
            self.skill("InnerCase", "inner", specify={"Script": "S"}),
        )


class inner(Tree):
    """A compound with one leaf, which takes its script."""

    declares = (("Script", str, REQUIRED),)

    def expand(self, skill: Any) -> None:
        skill(self.skill("Act", "act", specify={"Script": self.params["Script"].value}))
