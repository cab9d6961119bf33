"""Explains why there is no plan: the unreachable parts of a goal, with the unsatisfied conditions of each.

Based on relaxed reachability (see `reachability`): a part reported as unreachable is so for certain; other parts may be
unreachable too.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations, islice

from skiros2_common.core.json_data import JsonData
from skiros2_common.core.wording import ids_in, label_text, with_names
from skiros2_task.core.actions import Action
from skiros2_task.core.engines import Outcome
from skiros2_task.core.formula import And, Atom, Formula, Kind, Not, Or, bind, conjuncts
from skiros2_task.core.no_plan_sentence import Clauses, needs
from skiros2_task.core.reachability import Binding, Deadline, Reached, bindings, explore
from skiros2_task.core.task import PlanningTask
from skiros2_task.core.unusable_skills import UnusableSkill
from skiros2_task.core.world import WorldView

#: The states of a fact: it holds initially; it is reachable in the relaxed task; it is not; the deadline passed.
HOLDS, REACHABLE, UNREACHABLE, UNKNOWN = "holds", "reachable", "unreachable", "unknown"

#: The number of skills, and of parts of a fact, in an explanation.
MAX_LISTED = 3

#: The start of the sentence, by verdict.
_VERDICTS = {
    Outcome.TIMED_OUT.value: "No plan found in time",
    Outcome.CANCELLED.value: "Planning was cancelled",
    Outcome.FAILED.value: "Planning failed",
}

_CONTRADICTED = "the goal asks for it and for the opposite"
_NO_ELEMENT = "the scene has no element for it"

#: The default timeout (s).
_TIMEOUT = 5.0

#: The largest number of dropped conditions in the search for the nearest binding of a skill.
_MAX_DROPPED = 3

#: The number of bindings tried for each set of dropped conditions.
_MAX_BINDINGS = 200


@dataclass
class Achiever:
    """A skill with a fact as its effect, with the binding that has the fewest unsatisfied conditions.

    :param values: the bound parameters: elements by key.
    :param obstacles: reasons that no skill can change, such as "needs a product for Object, but Table is a location".
    :param unsatisfied: its unreachable conditions.
    """

    skill: str
    values: dict[str, str] = field(default_factory=dict)
    obstacles: list[str] = field(default_factory=list)
    unsatisfied: list[Fact] = field(default_factory=list)

    def lines(self) -> Iterator[str]:
        values = ", ".join(f"{key}={value}" for key, value in self.values.items())
        name = f"{self.skill} with {values}" if values else self.skill
        yield f"{name} {' and '.join(self.obstacles) or 'needs'}"
        for fact in self.unsatisfied:
            yield from (f"  {line}" for line in fact.lines())


@dataclass
class Fact:
    """A part of a goal, or a condition.

    :param text: in goal syntax.
    :param clause: for people, such as "Shelf contains Blue cup".
    :param state: `HOLDS`, `REACHABLE`, `UNREACHABLE` or `UNKNOWN`.
    :param note: a further reason.
    :param parts: the unreachable parts of a conjunction or disjunction.
    :param achievers: the skills with this effect, the nearest match first.
    :param more: the number of skills or parts that are not listed.
    """

    text: str
    state: str
    note: str = ""
    parts: list[Fact] = field(default_factory=list)
    achievers: list[Achiever] = field(default_factory=list)
    more: int = 0
    clause: str = ""

    def lines(self) -> Iterator[str]:
        state = {UNREACHABLE: "cannot be reached: ", UNKNOWN: "not known to be reachable: "}.get(self.state, "")
        yield f"{state}{self.clause or self.text}{f' ({self.note})' if self.note else ''}"
        for part in self.parts:
            yield from (f"  {line}" for line in part.lines())
        for achiever in self.achievers:
            yield from (f"  {line}" for line in achiever.lines())
        if self.more:
            yield f"  and {self.more} more"


@dataclass
class NoPlan(JsonData):
    """An explanation why there is no plan.

    :param verdict: the value of an `Outcome`: "proven impossible", "timed out", "cancelled" or "failed".
    :param reason: from the planner, or from the checks before it.
    :param goals: the parts of the goal, unreachable ones first, satisfied ones last.
    :param missing: unsatisfied facts that the goal depends on and no skill has as an effect; if there are none, those
        that skills have as an effect only if they hold already.
    :param left_out: the skills that planning cannot use, with the reasons.
    :param missing_values: parameters as SKILL.PARAMETER: with values for them there would be a plan.
    :param sentence: the cause as one main clause, with labels and times.
    :param labels: of the elements in the other texts, by id.
    """

    verdict: str
    reason: str
    goals: list[Fact] = field(default_factory=list)
    missing: list[str] = field(default_factory=list)
    left_out: list[str] = field(default_factory=list)
    missing_values: list[str] = field(default_factory=list)
    sentence: str = ""
    labels: dict[str, str] = field(default_factory=dict)
    _data_name = "why there is no plan"

    def __str__(self) -> str:
        return "\n".join(self.lines())

    @property
    def unreachable(self) -> list[Fact]:
        """The unreachable parts of the goal."""
        return [goal for goal in self.goals if goal.state == UNREACHABLE]

    @property
    def headline(self) -> str:
        """The verdict and the cause in one sentence: "No plan: Blue cup is nowhere."."""
        cause = (self.sentence or self.undecided or self.reason).rstrip(".")
        verdict = _VERDICTS.get(self.verdict, "No plan")
        return f"{verdict}: {cause}." if cause else f"{verdict}."

    def lines(self) -> Iterator[str]:
        """Yields the text: the sentence, then the details."""
        yield self.headline
        yield f"verdict: {self.verdict}{f' ({self.reason})' if self.reason else ''}"
        for line in (line for goal in self.unreachable for line in goal.lines()):
            yield with_names(line, lambda eid: "", lambda eid: self.labels.get(eid, eid))
        if self.goals and not self.unreachable and self.sentence:
            yield self.undecided

    @property
    def undecided(self) -> str:
        """The clause for a goal whose parts are not known to be unreachable; "" if one is."""
        if not self.goals or self.unreachable:
            return ""
        if any(goal.state == UNKNOWN for goal in self.goals):
            return "the time was too short to find the unreachable parts of the goal"
        several = len(self.goals) > 1
        subject = "each part of the goal" if several else f"the goal ({self.goals[0].clause or self.goals[0].text})"
        if self.verdict != Outcome.IMPOSSIBLE.value:
            return f"{subject} may be reachable, more time may help"
        if several:
            return f"{subject} may be reachable alone, but not all parts together"
        return f"{subject} could be reached only if no effect were ever undone"


def explain_no_plan(
    task: PlanningTask,
    outcome: Outcome,
    reason: str = "",
    left_out: Sequence[UnusableSkill] = (),
    deadline: Deadline | None = None,
    world: WorldView | None = None,
) -> NoPlan:
    """Explains why a task has no plan. Blocks until the deadline at most.

    :param outcome: the planner's; replaced by `IMPOSSIBLE` if the goal is unreachable.
    :param reason: the planner's.
    :param left_out: the skills that are not part of the task.
    :param deadline: by default in 5 s.
    :param world: the snapshot, for labels and places; None: the text names elements by their ids.
    """
    deadline = deadline or Deadline(_TIMEOUT)
    reached = explore(task, deadline)
    clauses = Clauses(world)
    explainer = _Explainer(task, reached, left_out, deadline, clauses)
    parts = conjuncts(task.goal)
    contradicted = _contradicted(parts)
    goals = {
        part: Fact(format_formula(part), UNREACHABLE, _CONTRADICTED, clause=clauses.fact(part))
        if part in contradicted
        else explainer.explain(part)
        for part in parts
    }
    found = sorted(goals.values(), key=lambda fact: (fact.state != UNREACHABLE, fact.state == HOLDS))
    if outcome is not Outcome.IMPOSSIBLE and any(fact.state == UNREACHABLE for fact in found):
        reason = f"the planner did not prove it ({outcome.value}{f': {reason}' if reason else ''}), but this does"
        outcome = Outcome.IMPOSSIBLE
    missing = explainer.missing or explainer.circular
    sentence = _sentence(found, missing, clauses)
    why = NoPlan(outcome.value, reason, found, list(missing), [str(skill) for skill in left_out], sentence=sentence)
    return replace(why, labels={eid: clauses.name(eid) for eid in ids_in(why.to_json())} if world is not None else {})


def _sentence(goals: Sequence[Fact], missing: Mapping[str, Formula], clauses: Clauses) -> str:
    """Returns the cause: that of the first unreachable part of the goal, in its nearest achiever."""
    fact = first = next((goal for goal in goals if goal.state == UNREACHABLE), None)
    while fact is not None:
        if fact.achievers and fact.achievers[0].obstacles:
            nearest = fact.achievers[0]
            return f"{_short(nearest.skill)} {' and '.join(nearest.obstacles)}"
        if fact.note == _CONTRADICTED:
            return f"{_CONTRADICTED}: {fact.clause}"
        inner = [*fact.parts, *(part for achiever in fact.achievers[:1] for part in achiever.unsatisfied)]
        fact = inner[0] if inner else None
    causes = (clauses.obstacle(formula) for formula in missing.values())
    return next(causes, f"{first.clause}: {first.note}" if first is not None else "")


def _short(skill: str) -> str:
    """Returns the label of a skill that is named with its type: `skiros:Pick (pick)` gives `pick`."""
    return label_text(skill.rpartition("(")[2].rstrip(")"))


class _Explainer:
    """Explains facts of one task. Each fact is explained in full once.

    :param clauses: formats facts for people.
    """

    def __init__(
        self,
        task: PlanningTask,
        reached: Reached,
        left_out: Sequence[UnusableSkill],
        deadline: Deadline,
        clauses: Clauses,
    ) -> None:
        self._clauses = clauses
        self._task = task
        self._reached = reached
        self._now = Reached(task.init, set(task.init))
        self._left_out = left_out
        self._deadline = deadline
        self._explained: set[Formula] = set()
        self._open: list[Formula] = []  # the formulas that are being explained
        #: Facts that no skill has as an effect, and facts that skills have as an effect only if they hold already.
        self.missing: dict[str, Formula] = {}
        self.circular: dict[str, Formula] = {}

    def holds(self, formula: Formula) -> bool:
        return self._now.may_hold(formula)

    def explain(self, formula: Formula) -> Fact:
        """Returns the state of a formula, with the reasons if it is unreachable."""
        fact = Fact(format_formula(formula), UNREACHABLE, clause=self._clauses.fact(formula))
        if self.holds(formula):
            return replace(fact, state=HOLDS)
        if self._reached.may_hold(formula):
            return replace(fact, state=REACHABLE)
        if not self._reached.complete:
            return replace(fact, state=UNKNOWN, note="the time was too short")
        if isinstance(formula, And | Or):
            return self._compound(formula)
        if formula in self._explained:
            fact.note = "see above"
            if formula in self._open:
                self.circular[fact.text] = formula
            return fact
        self._explained.add(formula)
        self._open.append(formula)
        achievers = [*self._achievers(formula), *self._unused(formula)]
        achievers.sort(key=lambda a: (len(a.obstacles), len(a.unsatisfied)))
        achievers = [a for a in achievers if not a.obstacles] or achievers
        being_explained = set(map(format_formula, self._open))
        straight = [a for a in achievers if not any(part.text in being_explained for part in a.unsatisfied)]
        if achievers and not straight:
            names = " and ".join(dict.fromkeys(_short(a.skill) for a in achievers))
            needed = dict.fromkeys(p.clause for a in achievers for p in a.unsatisfied if p.text in being_explained)
            fact.note = f"only by {names}, which needs that {' or '.join(needed)}"
        fact.achievers, fact.more = straight[:MAX_LISTED], max(0, len(straight) - MAX_LISTED)
        if not achievers:
            is_skill = isinstance(formula, Atom) and formula.predicate.kind is Kind.CAN
            fact.note = "its manager does not offer it" if is_skill else "no skill achieves it"
            self.missing[fact.text] = formula
        self._open.pop()
        return fact

    def _compound(self, formula: And | Or) -> Fact:
        unreachable = [part for part in formula.parts if not self._reached.may_hold(part)]
        if not unreachable:
            return Fact("(or)", UNREACHABLE, _NO_ELEMENT)
        note = "all parts are needed" if isinstance(formula, And) else "no alternative can be reached"
        is_short = len(formula.parts) <= MAX_LISTED
        text = format_formula(formula) if is_short else f"({_connective(formula)} ...)"
        parts = [self.explain(part) for part in unreachable[:MAX_LISTED]]
        clause = self._clauses.fact(formula) if is_short else f"{len(formula.parts)} conditions"
        return Fact(text, UNREACHABLE, note, parts, more=len(unreachable) - len(parts), clause=clause)

    def _achievers(self, formula: Formula) -> Iterator[Achiever]:
        """Yields the skills of the task with the formula as an effect."""
        atom, state = _literal(formula)
        for action in self._task.actions:
            for effect in action.effects:
                given = _unify(effect.atom, atom) if effect.state == state else None
                if given is not None:
                    yield self._achiever(action, given)

    def _achiever(self, action: Action, given: Binding) -> Achiever:
        keys = {v.name: v.key or "Robot" for v in action.variables}
        known = {keys[name]: value for name, value in given.items() if name in keys}
        wrong = []
        for v in action.variables:
            element, candidates = given.get(v.name), self._task.candidates(v.classes)
            if not candidates:
                wrong.append(f"{needs(v)}, but the scene has none")
            elif element is not None and element not in candidates:
                wrong.append(f"{needs(v)}, but {self._clauses.name(element)} is {self._clauses.kind(element)}")
        if wrong:
            return Achiever(action.skill.name, known, wrong)
        binding, unsatisfied = self._nearest(action, given)
        values = {key: binding[name] for name, key in keys.items() if name in binding}
        return Achiever(action.skill.name, values, unsatisfied=[self.explain(part) for part in unsatisfied])

    def _nearest(self, action: Action, given: Binding) -> tuple[Binding, list[Formula]]:
        """Returns the binding of an action with the fewest unreachable conditions, and these conditions."""
        parts = conjuncts(action.precondition)
        # `CAN` is dropped last.
        atoms = sorted((p for p in parts if isinstance(p, Atom)), key=lambda atom: atom.predicate.kind is Kind.CAN)
        rest = [part for part in parts if not isinstance(part, Atom)]
        for size in range(min(len(atoms), _MAX_DROPPED) + 1):
            best: tuple[Binding, list[Formula]] | None = None
            for dropped in combinations(atoms, size):
                if self._deadline.has_passed:
                    break
                kept = [atom for atom in atoms if atom not in dropped]
                for binding in islice(bindings(self._task, action, kept, self._reached, given), _MAX_BINDINGS):
                    unsatisfied = [bind(part, binding) for part in (*dropped, *rest)]
                    unsatisfied = [part for part in unsatisfied if not self._reached.may_hold(part)]
                    if best is None or len(unsatisfied) < len(best[1]):
                        best = binding, unsatisfied
            if best is not None:
                return best
        bound = [bind(atom, given) for atom in atoms]
        return given, [atom for atom in bound if isinstance(atom, Atom) and not any(self._reached.matches(atom, {}))]

    def _unused(self, formula: Formula) -> Iterator[Achiever]:
        """Yields the skills with the formula as an effect that are not part of the task."""
        atom, state = _literal(formula)
        for skill in self._left_out:
            if (atom.predicate, state) in skill.effects:
                yield Achiever(skill.name, {}, [skill.obstacle or f"cannot be planned with: {skill.reason}"])


def _contradicted(parts: Sequence[Formula]) -> set[Formula]:
    """Returns the parts of a goal that contradict other parts."""
    literals = {part for part in parts if not isinstance(part, And | Or)}

    def is_contradicted(part: Formula) -> bool:
        if isinstance(part, Or):
            return bool(part.parts) and all(map(is_contradicted, part.parts))
        return (part.part if isinstance(part, Not) else Not(part)) in literals

    return {part for part in parts if is_contradicted(part)}


def _literal(formula: Formula) -> tuple[Atom, bool]:
    atom = formula.part if isinstance(formula, Not) else formula
    assert isinstance(atom, Atom), f"{formula} is not in negation normal form"
    return atom, not isinstance(formula, Not)


def _connective(formula: And | Or) -> str:
    return "and" if isinstance(formula, And) else "or"


def format_formula(formula: Formula) -> str:
    """Returns a formula in goal syntax; facts that goals cannot express as a phrase."""
    if isinstance(formula, Atom):
        kind, terms = formula.predicate.kind, formula.terms
        if kind is Kind.CAN:
            return f"{terms[0]} has the skill {formula.predicate.name}"
        if kind is Kind.IN_SCENE:
            return f"{terms[0]} is in the scene"
        if kind is Kind.ALLOWED:
            return f"the ontology allows ({formula.predicate.name} {' '.join(terms)})"
    if isinstance(formula, Not) and isinstance(formula.part, Atom) and formula.part.predicate.kind is Kind.IN_SCENE:
        return f"{formula.part.terms[0]} is not in the scene"
    return str(formula)


def _unify(effect: Atom, wanted: Atom) -> Binding | None:
    """Returns the binding that makes an effect equal to an atom; None if there is none."""
    if effect.predicate != wanted.predicate:
        return None
    binding: Binding = {}
    for own, term in zip(effect.terms, wanted.terms, strict=True):
        if term.startswith("?"):
            continue  # matches any term
        if (binding.setdefault(own, term) if own.startswith("?") else own) != term:
            return None
    return binding
