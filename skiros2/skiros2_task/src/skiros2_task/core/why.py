"""Why there is no plan: which parts of a goal cannot come about, and what each lacks. It travels as JSON.

What is told follows from what may come about when nothing is ever undone (see `reachability`): what is said to be
unreachable is so for sure; what is not may still be.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations, islice

from skiros2_common.core.json_data import JsonData
from skiros2_task.core.actions import Action
from skiros2_task.core.exclusion import Exclusion, exclusion
from skiros2_task.core.formula import And, Atom, Formula, Kind, Not, Or, bind, conjuncts
from skiros2_task.core.left_out import LeftOut
from skiros2_task.core.planner import Outcome
from skiros2_task.core.reachability import Binding, Patience, Reached, explore, ways
from skiros2_task.core.task import PlanningTask

IMPOSSIBLE = Outcome.IMPOSSIBLE.value

#: What is known of a fact: it holds at the start; it may come about when deletes are ignored; it cannot even then; the
#: time to find out was too short.
HOLDS, REACHABLE, UNREACHABLE, UNKNOWN = "holds", "reachable", "unreachable", "unknown"

#: So many skills, and parts of a fact, are told where there are more.
MOST_TOLD = 3

#: How long to look for reasons, where nothing else is said.
_SECONDS = 5.0

#: So many conditions of a skill are left open at most to find the way that comes nearest.
_MOST_OPEN = 3

#: So many ways to do a skill are looked at.
_MOST_WAYS = 200


@dataclass
class Achiever:
    """A skill that could bring a fact about, done in the way that comes nearest, and what keeps it from that.

    :param values: the parameters of that way, as far as they are settled: elements by key.
    :param obstacles: in words, what no skill can change: it is left out, an element is of another class.
    :param unmet: its conditions that cannot come about.
    """

    skill: str
    values: dict[str, str] = field(default_factory=dict)
    obstacles: list[str] = field(default_factory=list)
    unmet: list[Fact] = field(default_factory=list)

    def lines(self) -> Iterator[str]:
        values = ", ".join(f"{key}={value}" for key, value in self.values.items())
        name = f"{self.skill} with {values}" if values else self.skill
        yield f"{name}: {'; '.join(self.obstacles)}" if self.obstacles else f"{name} needs"
        for fact in self.unmet:
            yield from (f"  {line}" for line in fact.lines())


@dataclass
class Fact:
    """A part of a goal, or a condition, and what is known of it.

    :param text: as goals are written.
    :param state: `HOLDS`, `REACHABLE`, `UNREACHABLE` or `UNKNOWN`.
    :param note: what else is to be said, in words.
    :param parts: of what is made of others, those that cannot come about.
    :param achievers: the skills that could bring it about, the nearest first.
    :param more: so many skills or parts are left out.
    """

    text: str
    state: str
    note: str = ""
    parts: list[Fact] = field(default_factory=list)
    achievers: list[Achiever] = field(default_factory=list)
    more: int = 0

    def lines(self) -> Iterator[str]:
        said = {UNREACHABLE: " cannot be reached", UNKNOWN: " is not known to be reachable"}.get(self.state, "")
        yield f"{self.text}{said}{f': {self.note}' if self.note else ''}"
        for part in self.parts:
            yield from (f"  {line}" for line in part.lines())
        for achiever in self.achievers:
            yield from (f"  {line}" for line in achiever.lines())
        if self.more:
            yield f"  and {self.more} more"


@dataclass
class NoPlan(JsonData):
    """Why there is no plan.

    :param verdict: the value of an `Outcome`: "proven impossible", "timed out", "cancelled" or "failed".
    :param reason: in words, from the planner or from what was found before it was asked.
    :param goals: the parts of the goal, those that cannot be reached first, those that hold already last.
    :param missing: facts that do not hold and on which the goal depends: those that no skill brings about; where there
        are none, those that skills bring about only where they hold already.
    :param excluded: parts of the goal that can never hold together, in pairs.
    :param left_out: in words, the skills that planning cannot use, and why.
    """

    verdict: str
    reason: str
    goals: list[Fact] = field(default_factory=list)
    missing: list[str] = field(default_factory=list)
    excluded: list[list[str]] = field(default_factory=list)
    left_out: list[str] = field(default_factory=list)
    _data_name = "why there is no plan"

    def __str__(self) -> str:
        return "\n".join(self.lines())

    @property
    def unreachable(self) -> list[Fact]:
        """The parts of the goal that cannot be reached."""
        return [goal for goal in self.goals if goal.state == UNREACHABLE]

    def lines(self) -> Iterator[str]:
        """The text for people."""
        yield f"no plan ({self.verdict}){f': {self.reason}' if self.reason else ''}"
        for goal in self.unreachable:
            yield from goal.lines()
        if self.goals and not self.unreachable and not self.excluded:
            yield from self._in_doubt()
        for pair in self.excluded:
            yield f"{pair[0]} and {pair[1]} can never hold together"
        if self.missing:
            yield "what would have to be so first:"
            yield from (f"  {fact}" for fact in self.missing)

    def _in_doubt(self) -> Iterator[str]:
        """What is said where nothing is known to be unreachable."""
        if any(goal.state == UNKNOWN for goal in self.goals):
            yield "there was no time to find out which parts of the goal can be reached"
            return
        several = len(self.goals) > 1
        what = "each part of the goal" if several else self.goals[0].text
        if self.verdict != IMPOSSIBLE:
            yield f"{what} may be reachable, as far as this tells: more time may help"
        elif several:
            yield f"{what} can be reached on its own, as far as this tells, but not all together"
        else:
            yield f"{what} could be reached if nothing were ever undone on the way"


def no_plan(
    task: PlanningTask,
    verdict: str,
    reason: str = "",
    left_out: Sequence[LeftOut] = (),
    patience: Patience | None = None,
) -> NoPlan:
    """Why a task has no plan.

    What is unreachable for sure makes the verdict `IMPOSSIBLE`, whatever the planner said.

    :param reason: the planner's.
    :param left_out: the skills that are not part of the task.
    :param patience: how long to look for the reasons; by default 5 s. Blocks so long at most.
    """
    patience = patience or Patience(_SECONDS)
    reached = explore(task, patience)
    told = _Telling(task, reached, left_out, patience)
    parts = conjuncts(task.goal)
    against = _contradicted(parts)
    goals = {
        part: Fact(said(part), UNREACHABLE, "the goal asks for it and for the opposite")
        if part in against
        else told.fact(part)
        for part in parts
    }
    excluded: list[list[str]] = []
    if not any(fact.state == UNREACHABLE for fact in goals.values()):
        together = exclusion(task, reached, patience)
        if together is not None:
            excluded = _tell_excluded(task, together, parts, goals)
    found = sorted(goals.values(), key=lambda fact: (fact.state != UNREACHABLE, fact.state == HOLDS))
    if verdict != IMPOSSIBLE and (excluded or any(fact.state == UNREACHABLE for fact in found)):
        reason = f"the planner could not tell ({verdict}{f': {reason}' if reason else ''}), but this shows it"
        verdict = IMPOSSIBLE
    missing = told.missing or told.circular
    return NoPlan(verdict, reason, found, list(missing), excluded, [str(skill) for skill in left_out])


def _tell_excluded(
    task: PlanningTask, together: Exclusion, parts: Sequence[Formula], goals: Mapping[Formula, Fact]
) -> list[list[str]]:
    """The pairs of parts of a goal that can never hold together. What can never hold by itself is told in its fact."""
    atoms = [part for part in parts if isinstance(part, Atom)]
    for part in atoms:
        if together.excluded(part, part) and part in goals:
            goals[part].state = UNREACHABLE
            step, one, other = together.obstacle(part)
            name = task.action(step.action).skill.name
            goals[part].note = f"{name} would need {said(one)} and {said(other)}, which can never hold together"
    possible = [part for part in atoms if not together.excluded(part, part)]
    return [[said(a), said(b)] for a, b in combinations(possible, 2) if together.excluded(a, b)]


class _Telling:
    """Tells of the facts of one task, of each at length once."""

    def __init__(self, task: PlanningTask, reached: Reached, left_out: Sequence[LeftOut], patience: Patience) -> None:
        self._task = task
        self._reached = reached
        self._now = Reached(task.init, set(task.init))
        self._left_out = left_out
        self._patience = patience
        self._told: set[Formula] = set()
        self._open: list[Formula] = []  # what is being told of
        #: Facts that no skill brings about, and facts that skills bring about only where they hold already.
        self.missing: dict[str, None] = {}
        self.circular: dict[str, None] = {}

    def holds(self, formula: Formula) -> bool:
        return self._now.may_hold(formula)

    def fact(self, formula: Formula) -> Fact:
        """What is known of a formula, with the reasons where it cannot come about."""
        if self.holds(formula):
            return Fact(said(formula), HOLDS)
        if self._reached.may_hold(formula):
            return Fact(said(formula), REACHABLE)
        if not self._reached.complete:
            return Fact(said(formula), UNKNOWN, "the time to find out was too short")
        if isinstance(formula, And | Or):
            return self._compound(formula)
        fact = Fact(said(formula), UNREACHABLE)
        if formula in self._told:
            fact.note = "see above"
            if formula in self._open:
                self.circular[fact.text] = None
            return fact
        self._told.add(formula)
        self._open.append(formula)
        achievers = [*self._achievers(formula), *self._unused(formula)]
        achievers.sort(key=lambda a: (len(a.obstacles), len(a.unmet)))
        possible = [a for a in achievers if not a.obstacles]
        achievers = possible or achievers  # what could never do it is of interest only where nothing else could
        fact.achievers, fact.more = achievers[:MOST_TOLD], max(0, len(achievers) - MOST_TOLD)
        if not achievers:
            is_skill = isinstance(formula, Atom) and formula.predicate.kind is Kind.CAN
            fact.note = "its manager does not offer it" if is_skill else "no skill brings it about"
            self.missing[fact.text] = None
        self._open.pop()
        return fact

    def _compound(self, formula: And | Or) -> Fact:
        wrong = [part for part in formula.parts if not self._reached.may_hold(part)]
        if not wrong:
            return Fact("one of nothing", UNREACHABLE, "the scene has nothing that it could be about")
        note = "all of it is needed" if isinstance(formula, And) else "none of its alternatives can"
        text = said(formula) if len(formula.parts) <= MOST_TOLD else f"({_word(formula)} ...)"
        parts = [self.fact(part) for part in wrong[:MOST_TOLD]]
        return Fact(text, UNREACHABLE, note, parts, more=len(wrong) - len(parts))

    def _achievers(self, formula: Formula) -> Iterator[Achiever]:
        """The skills of the task that have the fact as an effect."""
        atom, state = _literal(formula)
        for action in self._task.actions:
            for effect in action.effects:
                given = _unify(effect.atom, atom) if effect.state == state else None
                if given is not None:
                    yield self._achiever(action, given)

    def _achiever(self, action: Action, given: Binding) -> Achiever:
        keys = {v.name: v.key or "Robot" for v in action.variables}
        known = {keys[name]: value for name, value in given.items() if name in keys}
        wrong = [
            f"{given[v.name]} is no {' and '.join(v.classes)}"
            for v in action.variables
            if v.name in given and given[v.name] not in self._task.candidates(v.classes)
        ]
        wrong += [
            f"the scene has nothing for {v.key or 'Robot'} ({' and '.join(v.classes)})"
            for v in action.variables
            if not self._task.candidates(v.classes)
        ]
        if wrong:
            return Achiever(action.skill.name, known, wrong)
        binding, unmet = self._nearest(action, given)
        values = {key: binding[name] for name, key in keys.items() if name in binding}
        return Achiever(action.skill.name, values, unmet=[self.fact(part) for part in unmet])

    def _nearest(self, action: Action, given: Binding) -> tuple[Binding, list[Formula]]:
        """The way to do an action with the fewest conditions that cannot come about, and these."""
        parts = conjuncts(action.precondition)
        # That a robot lacks the skill is what can be helped least.
        atoms = sorted((p for p in parts if isinstance(p, Atom)), key=lambda atom: atom.predicate.kind is Kind.CAN)
        rest = [part for part in parts if not isinstance(part, Atom)]
        for size in range(min(len(atoms), _MOST_OPEN) + 1):
            best: tuple[Binding, list[Formula]] | None = None
            for dropped in combinations(atoms, size):
                if self._patience.is_over:
                    break
                kept = [atom for atom in atoms if atom not in dropped]
                for binding in islice(ways(self._task, action, kept, self._reached, given), _MOST_WAYS):
                    unmet = [bind(part, binding) for part in (*dropped, *rest)]
                    unmet = [part for part in unmet if not self._reached.may_hold(part)]
                    if best is None or len(unmet) < len(best[1]):
                        best = binding, unmet
            if best is not None:
                return best
        bound = [bind(atom, given) for atom in atoms]
        return given, [atom for atom in bound if isinstance(atom, Atom) and not any(self._reached.matches(atom, {}))]

    def _unused(self, formula: Formula) -> Iterator[Achiever]:
        """The skills that would bring the fact about and are not part of the task."""
        atom, state = _literal(formula)
        for skill in self._left_out:
            if (atom.predicate, state) in skill.makes:
                yield Achiever(skill.name, {}, [skill.reason])


def _contradicted(parts: Sequence[Formula]) -> set[Formula]:
    """Those parts of a goal that others rule out."""
    literals = {part for part in parts if not isinstance(part, And | Or)}

    def ruled_out(part: Formula) -> bool:
        if isinstance(part, Or):
            return bool(part.parts) and all(map(ruled_out, part.parts))
        return (part.part if isinstance(part, Not) else Not(part)) in literals

    return {part for part in parts if ruled_out(part)}


def _literal(formula: Formula) -> tuple[Atom, bool]:
    atom = formula.part if isinstance(formula, Not) else formula
    assert isinstance(atom, Atom), f"{formula} is not in negation normal form"
    return atom, not isinstance(formula, Not)


def _word(formula: And | Or) -> str:
    return "and" if isinstance(formula, And) else "or"


def said(formula: Formula) -> str:
    """A formula as goals are written; what goals cannot say in words."""
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
    """The variables' values with which an effect is the wanted atom."""
    if effect.predicate != wanted.predicate:
        return None
    binding: Binding = {}
    for mine, term in zip(effect.terms, wanted.terms, strict=True):
        if term.startswith("?"):
            continue  # any will do
        if (binding.setdefault(mine, term) if mine.startswith("?") else mine) != term:
            return None
    return binding
