"""Successive studies: the good configurations of earlier studies are the priors of a new one.

The density of the good values of each variable is written into the scenario of the new study, so that the study can be
resumed and repeated without the earlier ones.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np

from skiros2_common.core.errors import Refused
from skiros2_learning.core.scenario import Scenario
from skiros2_learning.core.study import LearningStudy
from skiros2_learning.core.variables import Value, Variable, configuration_problems

#: Fraction of an earlier study's configurations that count as good, and their minimum number.
_GOOD, _LEAST = 0.15, 3
#: Minimum standard deviation of the kernels, as a fraction of the range of the variable.
_NARROWEST = 0.04
#: Best configurations of each earlier study that a new one evaluates first.
_REPEATED = 2


def with_earlier(scenario: Scenario, studies: Sequence[LearningStudy]) -> tuple[Scenario, list[dict[str, Value]]]:
    """Returns a scenario whose priors are the densities of the good configurations of earlier studies, in place of its
    own, and the configurations to evaluate first: the best ones of the earlier studies that the scenario allows.

    Variables are the same if their names are. A variable without values in its range keeps its prior.

    :raises Refused: an earlier study has no results, or none of the variables.
    """
    good: list[dict[str, Value]] = []
    first: list[dict[str, Value]] = []
    names = {variable.name for variable in scenario.variables}
    for study in studies:
        ranked = study.ranked()
        found = [study.result(number).configuration for number in ranked[: max(_LEAST, round(_GOOD * len(ranked)))]]
        if not found:
            raise Refused(f"the study in {study.folder} has no results; run it first: learn resume {study.folder}")
        if not names & set(found[0]):
            texts = ", ".join(sorted(names)), ", ".join(sorted(found[0]))
            raise Refused(f"the study in {study.folder} has none of the variables {texts[0]}; it has {texts[1]}")
        good += found
        first += [each for each in found[:_REPEATED] if not configuration_problems(scenario.variables, each)]
    priors = {}
    for variable in scenario.variables:
        values = [each[variable.name] for each in good if variable.name in each]
        values = [value for value in values if not variable.problem(value)]
        if values:
            priors[variable.name] = _density(variable, values)
    return scenario.derived(changed_priors=priors), first


def _density(variable: Variable, values: Sequence[Value]) -> dict[str, Any]:
    """Returns the prior of a variable as in a scenario file."""
    if variable.values:
        counts = Counter(values)  # one more of each: no value is excluded
        return {"weights": [counts[value] + 1.0 for value in variable.values]}
    numbers = np.array(values, dtype=float)
    # Silverman's rule ("Density Estimation for Statistics and Data Analysis", 1986) for the width of the kernels
    width = 1.06 * float(numbers.std()) * len(numbers) ** -0.2
    return {"samples": numbers.tolist(), "std": max(width, _NARROWEST * (variable.high - variable.low))}
