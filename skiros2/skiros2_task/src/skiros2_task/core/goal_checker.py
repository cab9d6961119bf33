"""Checks goals while they are edited."""

from __future__ import annotations

from dataclasses import dataclass

from skiros2_common.core.world_model_port import WorldModelPort
from skiros2_task.core.actions import condition_predicates
from skiros2_task.core.goal_choices import GoalChoices
from skiros2_task.core.goal_completion import GoalVocabulary, read_goal_vocabulary
from skiros2_task.core.goal_reader import GoalReader
from skiros2_task.core.goal_text import MAX_GOAL, GoalError, parse_goals
from skiros2_task.core.world import WorldView
from skiros2_world_model.core.vocabulary import Vocabulary, read_vocabulary


@dataclass(frozen=True)
class Diagnostic:
    """Why a goal cannot be read.

    :param line, column: the position, from 1.
    """

    line: int
    column: int
    reason: str

    def position(self, text: str) -> int:
        """Returns the position as an offset in the text."""
        before = text.split("\n")[: self.line - 1]
        return min(sum(len(line) + 1 for line in before) + self.column - 1, len(text))


def check_syntax(text: str) -> Diagnostic | None:
    """Returns the first syntax error of a goal, or None. Does not block."""
    if len(text) > MAX_GOAL:
        return Diagnostic(1, 1, f"expected at most {MAX_GOAL} characters, got {len(text)}")
    try:
        parse_goals(text)
    except GoalError as error:
        return Diagnostic(error.line, error.column, error.reason)
    return None


class GoalChecker:
    """Checks goals against a snapshot of the world. For one worker at a time.

    :param ontology: of `wm`; None reads it.
    :ivar vocabulary: the names that goals may use.
    :ivar choices: what the ontologies allow in goals.
    :raises WmException: the world model does not answer.
    """

    def __init__(self, wm: WorldModelPort, ontology: Vocabulary | None = None) -> None:
        world = WorldView(wm)
        self.ontology = ontology or read_vocabulary(wm)
        self.vocabulary: GoalVocabulary = read_goal_vocabulary(world)
        self.choices = GoalChoices(world, self.vocabulary, self.ontology)
        self._reader = GoalReader(world, condition_predicates(world.robots), self.ontology)

    def check(self, text: str) -> Diagnostic | None:
        """Returns the first error of a goal, unknown names and values of another kind included, or None."""
        try:
            self._reader.read(text)
        except GoalError as error:
            return Diagnostic(error.line, error.column, error.reason)
        return None
