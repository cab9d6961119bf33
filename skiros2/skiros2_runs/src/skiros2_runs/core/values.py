"""The values of a node: its parameters, and its conditions as they were evaluated."""

from __future__ import annotations

from dataclasses import dataclass, field

from skiros2_common.core.explanation import Provenance
from skiros2_common.core.json_data import JsonData

#: The verdict on a condition; `UNKNOWN` when it was not or cannot be evaluated.
HOLDS, FAILS, UNKNOWN = "holds", "fails", "unknown"

#: The sides of a limit.
MINIMUM, MAXIMUM = "minimum", "maximum"


@dataclass
class ConditionStatus:
    """A condition as it was evaluated.

    :param stage: `PRE`, `HOLD` or `POST`.
    :param text: its description, with the values of the parameters.
    :param verdict: `HOLDS`, `FAILS` or `UNKNOWN`.
    :param found: the fact found instead, or why it is unknown; may be "".
    :param elements: the elements named in the text, as `id-label`.
    :param time: when the task evaluated it (s since the epoch); 0.0: not yet, the verdict is a preview.
    """

    stage: str
    label: str
    text: str
    verdict: str
    found: str = ""
    elements: list[str] = field(default_factory=list)
    time: float = 0.0


@dataclass
class SignalBound:
    """A limit that a hold-condition of a node sets for a signal.

    :param node: its id in the task.
    :param condition: the label of the condition.
    :param signal: the id of the signal's element.
    :param side: `MINIMUM` or `MAXIMUM`.
    :param value: in the signal's unit.
    :param violated: when the signal left the limits of the condition (s since the epoch); 0.0: it has not.
    """

    node: int
    condition: str
    signal: str
    side: str
    value: float
    violated: float = 0.0


@dataclass
class TaskBounds(JsonData):
    """The limits for signals that the nodes of a task have set in their last runs."""

    _data_name = "bounds"

    bounds: list[SignalBound] = field(default_factory=list)


@dataclass
class NodeStatus(JsonData):
    """The values of a node at a time.

    :param node: its id in the task.
    :param params: the values of its parameters and their provenance.
    :param time: s since the epoch.
    """

    _data_name = "node"

    node: int
    type: str
    label: str
    params: list[Provenance] = field(default_factory=list)
    conditions: list[ConditionStatus] = field(default_factory=list)
    time: float = 0.0

    def equals(self, other: NodeStatus) -> bool:
        """Returns whether values and verdicts are equal, whenever they were evaluated."""
        verdicts = [[(c.stage, c.text, c.verdict, c.found) for c in values.conditions] for values in (self, other)]
        return self.params == other.params and verdicts[0] == verdicts[1]

    def started_by(self, time: float) -> bool:
        """Returns whether the run of the node that it describes had started, or been tried, at a time."""
        times = [c.time for c in self.conditions if c.time]
        return not times or min(times) <= time
