"""Where parameters come from and where they go, through several levels."""

from __future__ import annotations

from typing import Any

from catalogue.case import Tree, case
from catalogue.parts import OPTIONAL, REQUIRED
from skiros2_skill.core.skill import ParallelFf, RetryOnFail

TITLE = ("Title", str, REQUIRED)
TEXT = ("Text", str, OPTIONAL)


@case(
    """
    root                        S1
      remap_three_levels        S1
        heading_to_title        S1
          text_to_heading       S1
            hear                S1
    """,
    given={"Title": "hello"},
)
class remap_three_levels(Tree):
    """Each level has a name of its own for the value."""

    declares = (TITLE,)

    def expand(self, skill: Any) -> None:
        skill(self.skill("HeadingToTitleCase", "", remap={"Heading": "Title"}))


class heading_to_title(Tree):
    """The second level."""

    declares = (("Heading", str, REQUIRED),)

    def expand(self, skill: Any) -> None:
        skill(self.skill("TextToHeadingCase", "", remap={"Line": "Heading"}))


class text_to_heading(Tree):
    """The third level."""

    declares = (("Line", str, REQUIRED),)

    def expand(self, skill: Any) -> None:
        skill(self.skill("Hear", "hear", remap={"Text": "Line"}, specify={"Expected": "hello"}))


@case(
    """
    root                  S1
      remap_of_the_below  S1
        passes_on         S1
          hear            S1
    """,
    given={"Title": "hello"},
)
class remap_of_the_below(Tree):
    """A remap of a key that the child has not, but one below it has."""

    declares = (TITLE,)

    def expand(self, skill: Any) -> None:
        skill(self.skill("PassesOnCase", "", remap={"Text": "Title"}))


class passes_on(Tree):
    """Declares nothing of what its leaf takes."""

    def expand(self, skill: Any) -> None:
        skill(self.skill("Hear", "hear", remap="", specify={"Expected": "hello"}))


@case(
    """
    root                   F-1
      specify_after_remap  F-6
        hear               S1
        hear               F-6
    """
)
class specify_after_remap(Tree):
    """`specify` goes by the new names; what it fixes goes up under them when the skill has succeeded."""

    declares = (TEXT,)

    def expand(self, skill: Any) -> None:
        skill(
            self.skill("Hear", "hear", remap={"Text": "Title"}, specify={"Title": "a", "Expected": "a"}),
            self.skill("Hear", "hear", specify={"Expected": "a"}),
        )


@case(
    """
    root                 S1
      output_to_sibling  S1
        tell             S1
        hear             S1
        hear             S1
    """
)
class output_to_sibling(Tree):
    """What a skill sets reaches its siblings and its parent, under the names that they have for it."""

    declares = (TEXT,)

    def expand(self, skill: Any) -> None:
        skill(
            self.skill("Tell", "tell", remap={"Text": "Word"}, specify={"Words": "hello"}),
            self.skill("Hear", "hear", remap={"Text": "Word"}, specify={"Expected": "hello"}),
            self.skill("Hear", "hear", remap={"Text": "Word"}, specify={"Expected": "hello"}),
        )


@case(
    """
    root                R   S1
      output_at_once    R   S1
        tell            R1  S2
        await_text      R1  S2
    """
)
class output_at_once(Tree):
    """Before every execute the parameters are taken again: what a parallel sibling sets is seen in the same tick."""

    def expand(self, skill: Any) -> None:
        skill.setProcessor(ParallelFf())
        skill(
            self.skill("Tell", "tell", specify={"Words": "not hello"}),
            self.skill("Hear", "await_text", specify={"Expected": "hello"}),
        )


@case(
    """
    root              R   S1
      filled_later    R   S1
        await_text    R1  S2
        tell          S1  S1
    """
)
class filled_later(Tree):
    """One that is unset at the start may be filled by a sibling that is ticked after it."""

    def expand(self, skill: Any) -> None:
        skill.setProcessor(ParallelFf())
        skill(
            self.skill("Hear", "await_text", specify={"Expected": "hello"}),
            self.skill("Tell", "tell", specify={"Words": "hello"}),
        )


@case(
    """
    root                S1
      default_is_kept   S1
        tell            S1
        hear_default    S1
        hear            S1
    """
)
class default_is_kept(Tree):
    """A parameter with a default keeps it whatever is on the blackboard, and has it there when it has succeeded."""

    def expand(self, skill: Any) -> None:
        skill(
            self.skill("Tell", "tell", specify={"Words": "yours"}),
            self.skill("HearDefault", "", specify={"Expected": "mine"}),
            self.skill("Hear", "hear", specify={"Expected": "mine"}),
        )


@case(
    """
    root               R   R   S1
      expand_anew      R   R   S1
        count          S1  S1  S1
        grows          F-6 F-6 S1
          hear_number  F-6 F-6 S1
          act          -   .   S1
          act          -   -   S1
    """
)
class expand_anew(Tree):
    """`expand` on start: another subtree each time, made of the values that the skill has then."""

    declares = (("Number", 0, REQUIRED),)

    def expand(self, skill: Any) -> None:
        skill.setProcessor(RetryOnFail())
        skill(self.skill("Count", ""), self.skill("GrowsCase", ""))


class grows(Tree):
    """Has as many leaves as its number says."""

    declares = (("Number", int, REQUIRED),)

    def createDescription(self) -> None:
        super().createDescription()
        self._expand_on_start = True

    def expand(self, skill: Any) -> None:
        skill(self.skill("HearNumber", "", specify={"Expected": 3}))
        skill(*(self.act() for _ in range(self.params["Number"].value - 1)))


@case(
    """
    root               R   R   S1
      expand_once      R   R   S1
        count          S1  S1  S1
        stays          F-6 F-6 S1
          hear_number  F-6 F-6 S1
    """
)
class expand_once(Tree):
    """Without: the subtree of the first start stays."""

    declares = (("Number", 0, REQUIRED),)

    def expand(self, skill: Any) -> None:
        skill.setProcessor(RetryOnFail())
        skill(self.skill("Count", ""), self.skill("StaysCase", ""))


class stays(grows):
    """The same, made once."""

    def createDescription(self) -> None:
        Tree.createDescription(self)


@case(
    """
    root           R   S1
      told_tree    R   S1
        act        R1  S2
    """,
    given={"Script": "RS"},
)
class told_tree(Tree):
    """`expand` sees the values that the skill was given."""

    declares = (("Script", str, REQUIRED),)

    def expand(self, skill: Any) -> None:
        skill(self.act(self.params["Script"].value))
