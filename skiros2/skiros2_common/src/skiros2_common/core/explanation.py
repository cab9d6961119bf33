"""The explanation of a node's failure: plain data with a JSON form, created on failure only."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field

from skiros2_common.core.failure_kind import FailureKind
from skiros2_common.core.json_data import JsonData
from skiros2_common.core.names import local_name
from skiros2_common.core.wording import in_words, label_text, moment, with_names, words

#: The stage of a skill run that failed: START (no implementation, or `onStart` failed), PARAMETER (a value of the wrong
#: type), INFERENCE (no elements for unset parameters), PRE, HOLD and POST (unsatisfied condition), EXECUTE (`fail` or a
#: returned bool), EXCEPTION (a hook raised), PREEMPT, STOP (the robot is stopped).
START, PARAMETER, INFERENCE, PRE, HOLD = "start", "parameter", "inference", "pre", "hold"
EXECUTE, POST, EXCEPTION, PREEMPT, STOP = "execute", "post", "exception", "preempt", "stop"
STAGES = (START, PARAMETER, INFERENCE, PRE, HOLD, EXECUTE, POST, EXCEPTION, PREEMPT, STOP)

#: The sources of a parameter's value: the client that started the task, `specify` in a tree, the declared default, a
#: parameter set of the world model, an ancestor (which may hold a sibling's output), the conditions, the skill's own
#: code. The values are stored data.
GIVEN, SPECIFIED, DEFAULT, LEARNED, PULLED, INFERRED, CHANGED, UNSET = (
    "given", "fixed", "default", "learned", "above", "inferred", "changed", "unset",
)  # fmt: skip

#: The sentence about a failure by stage.
_SENTENCES = {
    HOLD: "{} was interrupted: {cause}",
    EXECUTE: "{} failed: {cause}",
    POST: "{} ended without its effect: {cause}",
    EXCEPTION: "{} failed with an error in its code: {cause}",
    PREEMPT: "{} was preempted{by} at {at}",
    STOP: "{} was stopped at {at}: {cause}",
}
_NOT_STARTED = "{} did not start: {cause}"

#: The folder of a source location in a message.
_FOLDER = re.compile(r"\((?:/[^/(),]*)+/(?=[^/(),]+, line \d)")

#: The number of elements that a text lists before it says how many more there are.
MAX_EXAMPLES = 3


@dataclass
class NearMatch:
    """An element that satisfies the failed condition, or most of the conditions.

    :param element: `id-label`.
    :param why: the relevant facts about it.
    """

    element: str
    why: str = ""

    def __str__(self) -> str:
        return f"{self.element}: {self.why}" if self.why else self.element


@dataclass
class Change:
    """The last known change of a fact.

    :param element: the id of the element.
    :param name: the property or relation; "" for the element as a whole.
    :param number: of the change in the world model; -1 if unknown.
    :param stamp: time of the change (s since the epoch); 0.0 if unknown.
    :param author: of the change; "" if unknown.
    :param removed_from: the element that no longer has the relation to this one; "" if the change is another one.
    """

    element: str
    name: str = ""
    number: int = -1
    stamp: float = 0.0
    author: str = ""
    removed_from: str = ""

    def __str__(self) -> str:
        fact = " ".join(part for part in (self.element, self.name) if part)
        time_text = time.strftime(" at %Y-%m-%d %H:%M:%S", time.localtime(self.stamp)) if self.stamp else ""
        author = f" by {self.author}" if self.author else ""
        return f"{fact} was last changed{time_text}{author}"

    def clause(self, now: float) -> str:
        """Returns author and time as a clause about the element: "root removed it from Table-1 at 20:17 (3 s ago)"."""
        if self.removed_from:
            done = f"removed it from {self.removed_from}"
        else:
            done = "changed it" if self.name else "removed it"
        return f"{self.author.strip('/')} {done} at {moment(self.stamp, now)}"


@dataclass
class Finding:
    """An unsatisfied condition.

    :param kind: its class, such as `ConditionRelation`.
    :param values: the values of its parameters, by key.
    :param expected, found: the wanted and the actual state, as text.
    :param nearest: elements that satisfy it.
    :param changes: the last changes of its facts.
    :param parts: the findings of its parts, for a condition composed of others.
    :param statement: the actual state as a main clause; "" if unknown.
    """

    kind: str
    label: str
    values: dict[str, str]
    expected: str
    found: str
    nearest: list[NearMatch] = field(default_factory=list)
    changes: list[Change] = field(default_factory=list)
    parts: list[Finding] = field(default_factory=list)
    statement: str = ""

    def cause(self, now: float, with_change: bool = True) -> str:
        """Returns the actual state, and the change that made it, if its author is known."""
        change = next((change for change in reversed(self.changes) if change.author and with_change), None)
        state = self.statement or self.found
        return state if change is None else f"{state}: {change.clause(now)}"

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
    """One condition that filters the candidates.

    :param condition: its `filter_text`.
    :param count: the number of candidates that remain after it.
    :param label: its label.
    """

    condition: str
    count: int
    label: str

    def __str__(self) -> str:
        return f"{self.count or 'none'} {self.condition} [{self.label}]"


@dataclass
class InferenceFailure:
    """Why inference found no element for an unset parameter.

    :param wanted: the class, and the label if one was given.
    :param total: the number of such elements in the scene.
    :param left: the filter steps in order, up to the first that rejects all remaining candidates.
    :param nearest: near matches: of the candidates before that step, those that satisfy most conditions.
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
        if len(self.left) > 1 and not self.left[-1].count:  # others of the class may satisfy this condition
            last = self.left[-1]
            counts[-1] = f"none of the remaining {self.left[-2].count} {last.condition} [{last.label}]"
        nearest = f" ({'; '.join(map(str, self.nearest))})" if self.nearest else ""
        return f"parameter {self.key!r}: {', '.join(counts)}{nearest}"

    @property
    def emptied(self) -> bool:
        """Whether no candidate remains."""
        return not self.total or bool(self.left and not self.left[-1].count)

    @property
    def cause(self) -> str:
        """Why there is no element for the parameter, as a main clause."""
        kind = words(self.wanted)
        if not self.total:
            return f"the scene has no {kind} for {self.key}"
        if not self.emptied:
            return f"each {kind} for {self.key} contradicts another parameter"
        others = ""
        if len(self.left) > 1:
            count = self.left[-2].count
            others = f", although {'one meets' if count == 1 else f'{count} meet'} the other conditions"
        nearest = f" ({'; '.join(map(str, self.nearest))})" if self.nearest else ""
        return f"for {self.key}, no {kind} {self.left[-1].condition}{others}{nearest}"


@dataclass
class Provenance:
    """The source of a parameter's value.

    :param value: as text; "" if unset.
    :param source: `GIVEN`, `SPECIFIED`, `DEFAULT`, `LEARNED`, `PULLED`, `INFERRED`, `CHANGED` or `UNSET`.
    :param by: for `PULLED` the node that set it, for `INFERRED` the conditions on it, for `CHANGED` the descendant that
        changed it, [] when the skill's own code did.
    """

    key: str
    value: str
    source: str
    by: list[str] = field(default_factory=list)

    def __str__(self) -> str:
        return f"{self.key} = {self.value} ({self.source_text})" if self.value else f"{self.key} is unset"

    @property
    def source_text(self) -> str:
        """The source for people."""
        by = ", ".join(self.by)
        texts = {
            SPECIFIED: "specified",
            PULLED: f"from {by}",
            INFERRED: f"inferred by {by}" if by else "inferred",
            CHANGED: f"changed by {by or 'the skill'}",
        }
        return texts.get(self.source, self.source)


@dataclass
class Explanation(JsonData):
    """Why a node failed.

    :param stage: one of `STAGES`.
    :param type, label: of the skill; the label is the implementation's, "" if none was selected.
    :param node: its id in the task; -1 if unknown.
    :param code, message: its progress code and message.
    :param path: the names of its ancestors, root first, and its own.
    :param findings: the unsatisfied conditions.
    :param candidates: for `INFERENCE`, the inference failure of each unset parameter.
    :param params: the provenance of its parameters.
    :param tried: the explanations of the rejected implementations, if there were several.
    :param stamp: time of the first failure with this message (s since the epoch).
    :param times: the number of failures with this message; messages that differ only in numbers count as the same.
    :param by: the client that has preempted the task; "" if unknown.
    :param running: for `PREEMPT` and `STOP`, the names of the skills that were running.
    :param labels: of the elements in the texts, by id; ambiguous ones with the id in brackets.
    :param kind: a value of `FailureKind`.
    """

    _data_name = "explanation"

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
    by: str = ""
    running: list[str] = field(default_factory=list)
    labels: dict[str, str] = field(default_factory=dict)
    kind: str = FailureKind.RETRYABLE.value

    @property
    def failure_kind(self) -> FailureKind:
        """Whether the skill may be tried again."""
        return FailureKind.read(self.kind)

    @property
    def name(self) -> str:
        """`type-label`, or the type alone."""
        return f"{self.type}-{self.label}" if self.label else self.type

    @property
    def sentence(self) -> str:
        """Why it failed, in one sentence with labels and times."""
        name = label_text(self.label or local_name(self.type)).replace("task_", "task ")
        if self.path and self.path[0] != self.path[-1]:
            name += f" (in {label_text(self.path[0])})"
        if self.stage in (PREEMPT, STOP) and self.running:
            name = " and ".join(map(label_text, self.running))
        is_refused = self.stage == STOP and not self.running
        text = _NOT_STARTED if is_refused else _SENTENCES.get(self.stage, _NOT_STARTED)
        at, by = moment(self.stamp, time.time()), f" by {self.by.strip('/')}" if self.by else ""
        sentence = text.format(name, cause=self._cause(self._named), at=at, by=by)
        return f"{sentence.rstrip('.')}."

    def __str__(self) -> str:
        """The explanation for people, in several lines."""
        return "\n".join(self.lines())

    def lines(self) -> Iterator[str]:
        """The lines of the text: the sentence, then the details."""
        yield self.sentence
        yield from self.details()

    def details(self) -> Iterator[str]:
        """The lines after the sentence: stage and code, reasons, and where the values came from."""
        yield from self._details(self._named)

    def _details(self, named: Callable[[str], str]) -> Iterator[str]:
        times = f", {self.times} times" if self.times > 1 else ""
        path = " > ".join(self.path) or self.name
        clock = time.strftime("%H:%M:%S", time.localtime(self.stamp))
        yield f"{path} failed at {clock} ({self.stage}, code {self.code}{times})"
        if self.failure_kind.is_final:
            yield f"  it is not retried: {self.failure_kind.words}"
        facts = [line for finding in self.findings for line in finding.lines()]
        reasons = [in_words(named(line)) for line in (*facts, *map(str, self.candidates))]
        reasons += [line for tried in self.tried for line in tried._details(named)]
        yield from (f"  {line}" for line in reasons or map(named, self.message.splitlines()))
        for provenance in self.params:
            yield f"  parameter {named(str(provenance))}"

    def _cause(self, named: Callable[[str], str]) -> str:
        """Why it failed, as one clause or more.

        :param named: replaces ids by labels.
        """
        now = time.time()
        emptied = [candidate for candidate in self.candidates if candidate.emptied]
        clauses = [finding.cause(now, with_change=self.stage != POST) for finding in self.findings]
        clauses += [candidate.cause for candidate in emptied or self.candidates]
        causes = [in_words(named(clause)) for clause in clauses]
        causes += [tried._cause(named) for tried in self.tried]
        return "; ".join(dict.fromkeys(causes)) or named(self._first_line)

    @property
    def _first_line(self) -> str:
        """The first line of the message, without the name of the skill, and of a file without its folder."""
        line = next((line.strip() for line in self.message.splitlines() if line.strip()), "it gave no reason")
        line = line.removeprefix(f"{self.name}, parameter ").removeprefix(f"{self.name}: ")
        return _FOLDER.sub("(", line)

    def _named(self, text: str) -> str:
        """Returns a text with labels instead of ids."""
        return with_names(text, self._label, lambda eid: label_text(self.labels.get(eid) or local_name(eid)))

    def _label(self, eid: str) -> str:
        return self.labels.get(eid, "").removesuffix(f" ({local_name(eid)})")

    def all_changes(self) -> Iterator[Change]:
        """The changes of all findings, including those of rejected implementations."""
        for tried in self.tried:
            yield from tried.all_changes()
        waiting = list(self.findings)
        while waiting:
            finding = waiting.pop()
            yield from finding.changes
            waiting += finding.parts


def cause_of(explanations: Sequence[Explanation], message: str) -> str:
    """Returns the sentence of the failure that ended a task, the last explanation; without any, the message."""
    return explanations[-1].sentence if explanations else message


def worst_kind(explanations: Iterable[Explanation]) -> FailureKind:
    """Returns the most severe kind of the failures of a task, which decides whether it may be tried again."""
    return max(
        (why.failure_kind for why in explanations), key=lambda kind: kind.severity, default=FailureKind.RETRYABLE
    )
