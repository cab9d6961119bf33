"""Reasons why an estimate is refused."""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple

from skiros2_common.core.errors import Refused


class Code(Enum):
    """The kinds of reasons."""

    TOO_FEW_POINTS = "too_few_points"
    LOW_FITNESS = "low_fitness"
    LARGE_RESIDUAL = "large_residual"
    CONTRADICTED = "contradicted"
    FAR_FROM_PRIOR = "far_from_prior"
    NOT_DETERMINED = "not_determined"
    INCONSISTENT = "inconsistent"
    OUT_OF_VIEW = "out_of_view"


class Problem(NamedTuple):
    """A reason, with numbers and the expectation."""

    code: Code
    text: str


class Rejected(Refused):
    """An estimate that does not meet its limits. Nothing has changed.

    :param problems: all reasons.
    """

    code = "estimate_rejected"

    def __init__(self, *problems: Problem) -> None:
        super().__init__("; ".join(problem.text for problem in problems))
        self.problems = problems

    @property
    def codes(self) -> set[Code]:
        """The kinds of the reasons."""
        return {problem.code for problem in self.problems}
