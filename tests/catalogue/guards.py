"""Conditions of compounds, conditions that come with a node, and conditions that siblings break."""

from __future__ import annotations

from abc import ABC
from typing import Any

from catalogue.case import Tree, case
from catalogue.processors import THING, heavy, light, weight
from skiros2_skill.core.skill import ParallelFf, SerialStar

_GIVEN = {"Thing": "@thing"}


class _Guarded(Tree, ABC):
    """A compound that needs a heavy thing."""

    declares = (THING,)

    def heavy(self) -> Any:
        return self.getPropCond("Heavy", "skiros:Weight", "Thing", ">", 1.0, True)


class starts_heavy(_Guarded):
    """At its start."""

    def createDescription(self) -> None:
        super().createDescription()
        self.addPreCondition(self.heavy())

    def expand(self, skill: Any) -> None:
        skill(self.act("RS"))


class stays_heavy(_Guarded):
    """All the time."""

    def createDescription(self) -> None:
        super().createDescription()
        self.addHoldCondition(self.heavy())

    def expand(self, skill: Any) -> None:
        skill(self.act("RRRS"))


class ends_heavy(_Guarded):
    """At its end."""

    def createDescription(self) -> None:
        super().createDescription()
        self.addPostCondition(self.heavy())

    def expand(self, skill: Any) -> None:
        skill(self.act("RS"))


@case(
    """
    root                R   R   S1
      compound_starts   R   R   S1
        starts_heavy    R   S1  S1
          act           R1  S2  S2
        act             .   R1  S2
    """,
    scene=heavy,
    given=_GIVEN,
    events={2: weight(0.5)},
)
class compound_starts(Tree):
    """A pre-condition speaks of the start alone."""

    declares = (THING,)

    def expand(self, skill: Any) -> None:
        skill(self.skill("StartsHeavyCase", "starts_heavy"), self.act("RS"))


@case(
    """
    root                       F-1
      compound_does_not_start  F-1
        starts_heavy           F-1
        act                    .
    """,
    scene=light,
    given=_GIVEN,
)
class compound_does_not_start(Tree):
    """A compound that does not start has no children."""

    declares = (THING,)

    def expand(self, skill: Any) -> None:
        skill(self.skill("StartsHeavyCase", "starts_heavy"), self.act("RS"))


@case(
    """
    root             R  R  F-1
      compound_held  R  R  F-2
        act          R1 R2 F-9
        stays_heavy  R  R  F-2
          act        R1 R2 F-9
        act          R1 R2 F-9
    """,
    scene=heavy,
    given=_GIVEN,
    events={3: weight(0.5)},
)
class compound_held(Tree):
    """The compound and what is below it are preempted, and so are its siblings."""

    declares = (THING,)

    def expand(self, skill: Any) -> None:
        skill.setProcessor(ParallelFf())
        skill(self.act("RRRS"), self.skill("StaysHeavyCase", "stays_heavy"), self.act("RRRS"))


@case(
    """
    root              R  F-1
      compound_ended  R  F-3
        ends_heavy    R  F-3
          act         R1 S2
        act           .  .
    """,
    scene=heavy,
    given=_GIVEN,
    events={2: weight(0.5)},
)
class compound_ended(Tree):
    """What is below it has succeeded; it has not."""

    declares = (THING,)

    def expand(self, skill: Any) -> None:
        skill(self.skill("EndsHeavyCase", "ends_heavy"), self.act("S"))


@case(
    """
    root                   R  F-1
      broken_by_the_first  R  F-2
        ->*                R  S
          act              R1 S2
          weigh            .  S1
        stays_heavy        R  F-2
          act              R1 F-9
    """,
    scene=heavy,
    given=_GIVEN,
)
class broken_by_the_first(Tree):
    """What a sibling changes is seen by those that are ticked after it in the same tick."""

    declares = (THING,)

    def expand(self, skill: Any) -> None:
        skill.setProcessor(ParallelFf())
        skill(
            self.skill(SerialStar())(self.act("RS"), self.skill("Weigh", "", specify={"Weight": 0.5})),
            self.skill("StaysHeavyCase", "stays_heavy"),
        )


@case(
    """
    root                  R  R  F-1
      broken_by_the_last  R  R  F-2
        stays_heavy       R  R  F-2
          act             R1 R2 F-9
        ->*               R  S  S
          act             R1 S2 S2
          weigh           .  S1 S1
    """,
    scene=heavy,
    given=_GIVEN,
)
class broken_by_the_last(Tree):
    """And by those before it in the next one."""

    declares = (THING,)

    def expand(self, skill: Any) -> None:
        skill.setProcessor(ParallelFf())
        skill(
            self.skill("StaysHeavyCase", "stays_heavy"),
            self.skill(SerialStar())(self.act("RS"), self.skill("Weigh", "", specify={"Weight": 0.5})),
        )


@case(
    """
    root             F-1
      own_condition  F-1
        weigh        S1
        weigh        S1
        Weigh        F-1
    """,
    scene=heavy,
    given={"Object": "@thing"},
)
class own_condition(Tree):
    """A pre-condition that comes with the node, by the names that it has after the remap."""

    declares = (("Object", *THING[1:]),)

    def expand(self, skill: Any) -> None:
        condition = self.getPropCond("Heavy", "skiros:Weight", "Object", ">", 1.0, True)
        remap = {"Thing": "Object"}
        skill(
            self.skill("Weigh", "", remap, {"Weight": 3.0}, [condition]),
            self.skill("Weigh", "", remap, {"Weight": 0.5}, [condition]),
            self.skill("Weigh", "", remap, {"Weight": 3.0}, [condition]),
        )
