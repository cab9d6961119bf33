"""What hooks may answer, compounds with code of their own, threads, and the end from outside at each point."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

from catalogue.case import PREEMPT, Tree, case
from skiros2_common.core.abstract_skill import State
from skiros2_skill.core.skill import NoFail, ParallelFf, ParallelFs, Selector, SerialStar

# -- what hooks answer -------------------------------------------------------------------------------------------------


@case(
    """
    root           S1
      hooks        S1
        nofail(?)  S
          act      F-7
          act      F-404
          act      F-405
          act      F-405
          act      F-405
          act      F-405
          act      F-3
    """
)
class hooks(Tree):
    """Each hook refuses or raises, or answers nothing or no state: the skill fails, and the next one is tried."""

    def expand(self, skill: Any) -> None:
        skill(
            self.skill(NoFail(Selector()))(
                self.act(Start="F"),
                self.act(Start="X"),
                self.act("X"),
                self.act("N"),
                self.act("7"),
                self.act(End="X"),
                self.act(End="F"),
            )
        )


@case(
    """
    root            R   S1
      bool_answers  R   S1
        act         S   S
        |fs|        R   S
          act       R1  S2
          act       R1  S1
          act       R1  S2
          act       R1  F-406
    """
)
class bool_answers(Tree):
    """`execute` and `onPreempt` may answer with a bool, `onPreempt` with any state; what it raises is a failure."""

    def expand(self, skill: Any) -> None:
        skill(
            self.act("T"),
            self.skill(ParallelFs())(
                self.act("RS"), self.act("RR", Stop="T"), self.act("RR", Stop="S"), self.act("RR", Stop="X")
            ),
        )


# -- compounds with code of their own ----------------------------------------------------------------------------------


@case(
    """
    root             R   S1
      keeps          R   S1
        act          R1  S2
    """
)
class keeps(Tree):
    """A compound's own `execute` runs after its children; None keeps their state."""

    def expand(self, skill: Any) -> None:
        skill(self.act("RS"))

    def execute(self) -> None:
        return None


@case(
    """
    root             R   S1
      waits          R   S1
        act          R1  S2
    """
)
class waits(Tree):
    """It runs when the children have ended, not before."""

    def expand(self, skill: Any) -> None:
        skill(self.act("RS"))

    def execute(self) -> State:
        return self.success("enough")


@case(
    """
    root             F-1
      vetoes         F-4
        act          S1
    """
)
class vetoes(Tree):
    """It may fail though they have succeeded."""

    def expand(self, skill: Any) -> None:
        skill(self.act("S"))

    def execute(self) -> State:
        return self.fail("no", 4)


@case(
    """
    root             R   S1
      recovers       R   S1
        |ff|         R   S
          recovery   R   S1
            act      R1  F-5
          act        R1  S2
    """
)
class recovers(Tree):
    """It may succeed though they have failed."""

    def expand(self, skill: Any) -> None:
        skill(self.skill(ParallelFf())(self.skill("RecoveryCase", "recovery"), self.act("RS")))


class recovery(Tree):
    """Takes the failure of its child for a success, and the running for what it is."""

    def expand(self, skill: Any) -> None:
        skill.setProcessor(SerialStar())
        skill(self.act("RF"))
        self._leaf = skill.last()

    def execute(self) -> State | None:
        return self.success("never mind") if self._leaf.state is State.Failure else None


@case(
    """
    root         F-1
      refuses    F-2
        refusal  F-2
          act    .
    """
)
class refuses(Tree):
    """A compound whose `onStart` refuses does not tick its children."""

    def expand(self, skill: Any) -> None:
        skill(self.skill("RefusalCase", "refusal"))


class refusal(Tree):
    """Refuses."""

    def expand(self, skill: Any) -> None:
        skill(self.act("S"))

    def onStart(self) -> bool:
        return self.startError("not now", 2)


# -- threads -----------------------------------------------------------------------------------------------------------


class Thoughts(Tree, ABC):
    """One that works in a thread."""

    @property
    @abstractmethod
    def more(self) -> dict[str, str]:
        """The parameters of its leaf."""

    def expand(self, skill: Any) -> None:
        skill(self.skill("Think", "think", specify=self.more), self.act("S"))


@case(
    """
    root        R   R   S1
      thread    R   R   S1
        think   R1  R2  S3
        act     .   .   S1
    """
)
class thread(Thoughts):
    """Runs until its thread has ended."""

    more = {"Answer": "S"}


@case(
    """
    root            R  R  F-1
      thread_fails  R  R  F-8
        think       R1 R2 F-8
        act         .  .  .
    """
)
class thread_fails(Thoughts):
    """`run` fails."""

    more = {"Answer": "F"}


@case(
    """
    root             R  R  F-1
      thread_raises  R  R  F-405
        think        R1 R2 F-405
        act          .  .  .
    """
)
class thread_raises(Thoughts):
    """`run` raises."""

    more = {"Answer": "X"}


@case(
    """
    root                     R  R  F-1
      thread_without_answer  R  R  F-405
        think                R1 R2 F-405
        act                  .  .  .
    """
)
class thread_without_answer(Thoughts):
    """`run` answers nothing."""

    more = {"Answer": "N"}


@case(
    """
    root              F-1
      thread_refuses  F-1
        think         F-1
        act           .
    """
)
class thread_refuses(Thoughts):
    """`preStart` says no."""

    more = {"Before": "F"}


@case(
    """
    root                R   F-1
      thread_preempted  R   F-1
        think           R1  F-9
        act             .   .
    """,
    events={2: PREEMPT},
)
class thread_preempted(Thoughts):
    """Preempted while its thread works."""

    more = {"Answer": "S"}


# -- the end from outside ----------------------------------------------------------------------------------------------


def _some_of_each(self: Tree, skill: Any) -> None:
    """A tree with something of each kind."""
    skill(
        self.act("RS"),
        self.skill(ParallelFf())(
            self.skill(NoFail(SerialStar()))(self.act("RF"), self.act("S")),
            self.skill("InnerCase", "inner", specify={"Script": "RRS"}),
            self.skill(Selector())(self.act("F"), self.act("RRS", Stop="S")),
        ),
        self.act("S"),
    )


@case(
    """
    root               R   F-1
      stop_first       R   F-1
        act            R1  F-9
        |ff|           .   .
          nofail(->*)  .   .
            act        .   .
            act        .   .
          inner        .   .
          ?            .   .
            act        .   .
            act        .   .
        act            .   .
    """,
    events={2: PREEMPT},
)
class stop_first(Tree):
    """In the first leaf."""

    expand = _some_of_each


@case(
    """
    root               R   R    F-1
      stop_parallel    R   R    F-1
        act            R1  S2   S2
        |ff|           .   R    F
          nofail(->*)  .   R    F
            act        .   R1   F-9
            act        .   .    .
          inner        .   R    F-1
            act        -   R1   F-9
          ?            .   R    F
            act        .   F-5  F-5
            act        .   R1   S2
        act            .   .    .
    """,
    events={3: PREEMPT},
)
class stop_parallel(Tree):
    """In the parallel part. What has ended stays as it is; what runs ends as its `onPreempt` says, leaves first."""

    expand = _some_of_each


@case(
    """
    root                    R   R    R    F-1
      stop_parallel_later   R   R    R    F-1
        act                 R1  S2   S2   S2
        |ff|                .   R    R    F
          nofail(->*)       .   R    S    S
            act             .   R1   F-5  F-5
            act             .   .    .    .
          inner             .   R    R    F-1
            act             -   R1   R2   F-9
          ?                 .   R    R    F
            act             .   F-5  F-5  F-5
            act             .   R1   R2   S3
        act                 .   .    .    .
    """,
    events={4: PREEMPT},
)
class stop_parallel_later(Tree):
    """When a part of it has ended already."""

    expand = _some_of_each


@case(
    """
    root           R   F-1
      stop_second  R   F-1
        act        S1  S1
        act        R1  F-9
    """,
    events={2: PREEMPT},
)
class stop_second(Tree):
    """In the second of two."""

    def expand(self, skill: Any) -> None:
        skill(self.act("S"), self.act("RS"))
