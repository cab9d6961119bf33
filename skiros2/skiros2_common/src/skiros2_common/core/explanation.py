"""Why a node of a tree failed. Plain data, which travels as JSON; made on failure only."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, field

from skiros2_common.core.json_data import JsonData

#: Where in the life of a node it failed: no implementation or `onStart` refused, a parameter does not fit, no elements
#: were found for unset parameters, a condition does not hold, the skill's own `fail` or a bool for an answer, a hook
#: that raised, and the end from outside.
START, PARAMETER, INFERENCE, PRE, HOLD = "start", "parameter", "inference", "pre", "hold"
EXECUTE, POST, EXCEPTION, PREEMPT = "execute", "post", "exception", "preempt"
STAGES = (START, PARAMETER, INFERENCE, PRE, HOLD, EXECUTE, POST, EXCEPTION, PREEMPT)

#: Where the value of a parameter came from: from the one who started the task, from `specify` in a tree, from the
#: declaration, from a node above (where a sibling may have put it), from the conditions, from the skill's own code.
GIVEN, SPECIFIED, DEFAULT, PULLED, INFERRED, CHANGED, UNSET = (
    "given", "fixed", "default", "above", "inferred", "changed", "unset",
)  # fmt: skip

#: So many elements are named where there are more.
MAX_EXAMPLES = 3


@dataclass
class NearMatch:
    """An element that comes near to what was wanted.

    :param element: as `id-label`.
    :param why: what is so of it.
    """

    element: str
    why: str = ""

    def __str__(self) -> str:
        return f"{self.element}: {self.why}" if self.why else self.element


@dataclass
class Change:
    """The last change of a fact, as far as it is known.

    :param element: the id of the element that the fact is about.
    :param name: the property or relation; "" when the fact is about the element as a whole.
    :param number: of the change in the world model; -1: not known.
    :param stamp: when (s since the epoch); 0.0: not known.
    :param author: who made it; "": not known.
    """

    element: str
    name: str = ""
    number: int = -1
    stamp: float = 0.0
    author: str = ""

    def __str__(self) -> str:
        what = " ".join(part for part in (self.element, self.name) if part)
        when = time.strftime(" at %Y-%m-%d %H:%M:%S", time.localtime(self.stamp)) if self.stamp else ""
        who = f" by {self.author}" if self.author else ""
        return f"{what} was last changed{when}{who}"


@dataclass
class Finding:
    """A condition that does not hold.

    :param kind: its class, such as `ConditionRelation`.
    :param values: what the parameters were that it speaks of, by key.
    :param expected, found: what should be so, and what is so, in words.
    :param nearest: elements of which it would hold, or nearly.
    :param changes: who last changed what it speaks of.
    :param parts: for a condition made of others, what is to say of these.
    """

    kind: str
    label: str
    values: dict[str, str]
    expected: str
    found: str
    nearest: list[NearMatch] = field(default_factory=list)
    changes: list[Change] = field(default_factory=list)
    parts: list[Finding] = field(default_factory=list)

    def __str__(self) -> str:
        return f"[{self.label}] {self.found}, expected {self.expected}"

    def lines(self) -> Iterator[str]:
        yield str(self)
        if self.nearest:
            yield "  nearest: " + "; ".join(map(str, self.nearest))
        for change in self.changes:
            if change.stamp or change.author:
                yield f"  {change}"
        for part in self.parts:
            yield from (f"  {line}" for line in part.lines())


@dataclass
class FilterStep:
    """How many candidates a condition left, of those that the ones before it had left.

    :param condition: as it is said of one candidate.
    :param label: of the condition.
    """

    condition: str
    count: int
    label: str

    def __str__(self) -> str:
        return f"{self.count or 'none'} {self.condition} [{self.label}]"


@dataclass
class InferenceFailure:
    """What the scene had for one unset parameter.

    :param wanted: the class, and the label where one was asked for.
    :param total: how many elements of the scene are so.
    :param left: what the conditions left, one after the other, up to the first that left none.
    :param nearest: of those left before that one, the ones that most conditions hold of.
    """

    key: str
    wanted: str
    total: int
    left: list[FilterStep] = field(default_factory=list)
    nearest: list[NearMatch] = field(default_factory=list)

    def __str__(self) -> str:
        if not self.total:
            return f"no {self.wanted} in the scene for parameter {self.key!r}"
        counts = [f"{self.total} {self.wanted} in the scene", *map(str, self.left)]
        nearest = f" ({'; '.join(map(str, self.nearest))})" if self.nearest else ""
        return f"parameter {self.key!r}: {', '.join(counts)}{nearest}"

    @property
    def emptied(self) -> bool:
        """Whether nothing is left."""
        return not self.total or bool(self.left and not self.left[-1].count)


@dataclass
class Provenance:
    """Where the value of a parameter came from.

    :param value: as a text; "" when unset.
    :param source: `GIVEN`, `SPECIFIED`, `DEFAULT`, `PULLED`, `INFERRED`, `CHANGED` or `UNSET`.
    :param by: for `PULLED` the node that set it, for `INFERRED` the conditions on it, for `CHANGED` the descendant that
        changed it, [] when the skill's own code did.
    """

    key: str
    value: str
    source: str
    by: list[str] = field(default_factory=list)

    def __str__(self) -> str:
        return f"{self.key} = {self.value} ({self.words})" if self.value else f"{self.key} is unset"

    @property
    def words(self) -> str:
        """The source in words."""
        by = ", ".join(self.by)
        if self.source == PULLED:
            return f"from {by}"
        if self.source == INFERRED:
            return f"inferred by {by}" if by else "inferred"
        return f"changed by {by or 'the skill'}" if self.source == CHANGED else self.source


@dataclass
class Explanation(JsonData):
    """Why a node failed.

    :param stage: one of `STAGES`.
    :param type, label: of the skill; the label is that of the implementation, "" when none was chosen.
    :param node: its id in the task; -1: not known.
    :param code, message: its progress code and message.
    :param path: the nodes that it is in, the outermost first, and itself.
    :param findings: the conditions that do not hold.
    :param candidates: for `INFERENCE`, what the scene had for each unset parameter.
    :param params: where the values of the parameters came from.
    :param tried: where there were several implementations, one for each that was tried.
    :param stamp: when it failed with this message first (s since the epoch).
    :param times: how often it failed so, with this message or one that is other in numbers alone.
    """

    _called = "explanation"

    stage: str
    type: str
    label: str
    node: int
    code: int
    message: str
    path: list[str] = field(default_factory=list)
    findings: list[Finding] = field(default_factory=list)
    candidates: list[InferenceFailure] = field(default_factory=list)
    params: list[Provenance] = field(default_factory=list)
    tried: list[Explanation] = field(default_factory=list)
    stamp: float = field(default_factory=time.time)
    times: int = 1

    @property
    def name(self) -> str:
        """`type-label`, or the type alone."""
        return f"{self.type}-{self.label}" if self.label else self.type

    def __str__(self) -> str:
        """The explanation for people, in several lines."""
        return "\n".join(self.lines())

    def lines(self) -> Iterator[str]:
        """The lines of the text."""
        times = f", {self.times} times" if self.times > 1 else ""
        place = " > ".join(self.path) or self.name
        yield f"{place} failed ({self.stage}, code {self.code}{times})"
        yield from (f"  {line}" for line in self._reasons() or self.message.splitlines())
        for origin in self.params:
            yield f"  parameter {origin}"

    def _reasons(self) -> list[str]:
        """What is known beyond the message, which says it in one line."""
        lines = [line for finding in self.findings for line in finding.lines()]
        lines += map(str, self.candidates)
        for tried in self.tried:
            lines += tried.lines()
        return lines

    def all_changes(self) -> Iterator[Change]:
        """The changes in it and in what was tried."""
        for tried in self.tried:
            yield from tried.all_changes()
        waiting = list(self.findings)
        while waiting:
            finding = waiting.pop()
            yield from finding.changes
            waiting += finding.parts
