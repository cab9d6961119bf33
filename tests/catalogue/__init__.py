"""Skills and trees with known traces: what each node is and tells after each tick, written by hand from the contract.

Each case is a compound, with its trace beside it. All of them run in one process (tests/unit/skiros2_skill) and over
ROS, by one manager (tests/system), with the same traces. The package is a skill library: a manager loads it as any.
"""

from catalogue import conditions, control, elements, guards, parameters, processors
from catalogue.case import CASES, PREEMPT, Case

__all__ = ["CASES", "PREEMPT", "Case", "conditions", "control", "elements", "guards", "parameters", "processors"]
