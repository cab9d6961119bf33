"""Explains why there is no plan: the unreachable parts of a goal, with the unsatisfied conditions of each.

Based on relaxed reachability (see `reachability`): a part reported as unreachable is so for certain; other parts may be
unreachable too.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import combinations, islice

from skiros2_common.core.json_data import JsonData
from skiros2_task.core.actions import Action, declared_effects, make_actions, why_unusable
from skiros2_task.core.conditions import FactFamilies
from skiros2_task.core.conditions import Literal as PredicateLiteral
from skiros2_task.core.engines import Outcome
from skiros2_task.core.formula import And, Atom, Formula, Kind, Not, Or, Predicate, bind, conjuncts
from skiros2_task.core.no_plan_sentence import label_of, sentence_of
from skiros2_task.core.reachability import Binding, Deadline, Reached, bindings, explore
from skiros2_task.core.skills import Skill
from skiros2_task.core.task import PlanningTask
from skiros2_task.core.world import WorldView

#: The states of a fact: it holds initially; it is reachable in the relaxed task; it is not; the deadline passed.
HOLDS, REACHABLE, UNREACHABLE, UNKNOWN = "holds", "reachable", "unreachable", "unknown"

#: The number of skills, and of parts of a fact, in an explanation.
MAX_LISTED = 3

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
    :param obstacles: reasons that no skill can change, such as an element of a different class.
    :param unsatisfied: its unreachable conditions.
    """

    skill: str
    values: dict[str, str] = field(default_factory=dict)
    obstacles: list[str] = field(default_factory=list)
    unsatisfied: list[Fact] = field(default_factory=list)

    def lines(self) -> Iterator[str]:
        values = ", ".join(f"{key}={value}" for key, value in self.values.items())
        name = f"{self.skill} with {values}" if values else self.skill
        yield f"{name}: {'; '.join(self.obstacles)}" if self.obstacles else f"{name} needs"
        for fact in self.unsatisfied:
            yield from (f"  {line}" for line in fact.lines())


@dataclass
class Fact:
    """A part of a goal, or a condition.

    :param text: in goal syntax.
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

    def lines(self) -> Iterator[str]:
        state = {UNREACHABLE: " cannot be reached", UNKNOWN: " is not known to be reachable"}.get(self.state, "")
        yield f"{self.text}{state}{f': {self.note}' if self.note else ''}"
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
    :param sentence: the cause in one sentence, with labels; "" if it has none.
    """

    verdict: str
    reason: str
    goals: list[Fact] = field(default_factory=list)
    missing: list[str] = field(default_factory=list)
    left_out: list[str] = field(default_factory=list)
    missing_values: list[str] = field(default_factory=list)
    sentence: str = ""
    _data_name = "why there is no plan"

    def __str__(self) -> str:
        return "\n".join(self.lines())

    @property
    def unreachable(self) -> list[Fact]:
        """The unreachable parts of the goal."""
        return [goal for goal in self.goals if goal.state == UNREACHABLE]

    def lines(self) -> Iterator[str]:
        """Yields the text: the sentence, then the details."""
        if self.sentence:
            yield self.sentence
        yield f"no plan ({self.verdict}){f': {self.reason}' if self.reason else ''}"
        for goal in self.unreachable:
            yield from goal.lines()
        if self.goals and not self.unreachable:
            yield self._undecided()
        if self.missing:
            yield "missing facts:"
            yield from (f"  {fact}" for fact in self.missing)

    def _undecided(self) -> str:
        """Returns the text for a goal whose parts are not known to be unreachable."""
        if any(goal.state == UNKNOWN for goal in self.goals):
            return "the time was too short to find the unreachable parts of the goal"
        several = len(self.goals) > 1
        subject = "each part of the goal" if several else self.goals[0].text
        if self.verdict != Outcome.IMPOSSIBLE.value:
            return f"{subject} may be reachable; more time may help"
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
    :param world: the snapshot, for the sentence; None: there is none.
    """
    deadline = deadline or Deadline(_TIMEOUT)
    reached = explore(task, deadline)
    name = (lambda eid: eid) if world is None else partial(label_of, world)
    explainer = _Explainer(task, reached, left_out, deadline, name)
    parts = conjuncts(task.goal)
    contradicted = _contradicted(parts)
    goals = {
        part: Fact(format_formula(part), UNREACHABLE, "the goal asks for it and for the opposite")
        if part in contradicted
        else explainer.explain(part)
        for part in parts
    }
    found = sorted(goals.values(), key=lambda fact: (fact.state != UNREACHABLE, fact.state == HOLDS))
    if outcome is not Outcome.IMPOSSIBLE and any(fact.state == UNREACHABLE for fact in found):
        reason = f"the planner did not prove it ({outcome.value}{f': {reason}' if reason else ''}), but this does"
        outcome = Outcome.IMPOSSIBLE
    missing = explainer.missing or explainer.circular
    sentence = _sentence(found, missing, world) if world is not None else ""
    return NoPlan(outcome.value, reason, found, list(missing), [str(skill) for skill in left_out], sentence=sentence)


def _sentence(goals: Sequence[Fact], missing: Mapping[str, Formula], world: WorldView) -> str:
    """Returns the cause: that of the first unreachable part of the goal, in its nearest achiever."""
    fact = next((goal for goal in goals if goal.state == UNREACHABLE), None)
    while fact is not None:
        if fact.achievers and fact.achievers[0].obstacles:
            first = fact.achievers[0]
            return f"{first.skill} cannot help: {'; '.join(first.obstacles)}."
        inner = [*fact.parts, *(part for achiever in fact.achievers[:1] for part in achiever.unsatisfied)]
        fact = inner[0] if inner else None
    return next((text for formula in missing.values() if (text := sentence_of(formula, world))), "")


class _Explainer:
    """Explains facts of one task. Each fact is explained in full once.

    :param name: names an element for people.
    """

    def __init__(
        self,
        task: PlanningTask,
        reached: Reached,
        left_out: Sequence[UnusableSkill],
        deadline: Deadline,
        name: Callable[[str], str],
    ) -> None:
        self._name = name
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
        if self.holds(formula):
            return Fact(format_formula(formula), HOLDS)
        if self._reached.may_hold(formula):
            return Fact(format_formula(formula), REACHABLE)
        if not self._reached.complete:
            return Fact(format_formula(formula), UNKNOWN, "the time was too short")
        if isinstance(formula, And | Or):
            return self._compound(formula)
        fact = Fact(format_formula(formula), UNREACHABLE)
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
        fact.achievers, fact.more = achievers[:MAX_LISTED], max(0, len(achievers) - MAX_LISTED)
        if not achievers:
            is_skill = isinstance(formula, Atom) and formula.predicate.kind is Kind.CAN
            fact.note = "its manager does not offer it" if is_skill else "no skill brings it about"
            self.missing[fact.text] = formula
        self._open.pop()
        return fact

    def _compound(self, formula: And | Or) -> Fact:
        unreachable = [part for part in formula.parts if not self._reached.may_hold(part)]
        if not unreachable:
            return Fact("(or)", UNREACHABLE, "the scene has no element for it")
        note = "all parts are needed" if isinstance(formula, And) else "no alternative can be reached"
        text = format_formula(formula) if len(formula.parts) <= MAX_LISTED else f"({_connective(formula)} ...)"
        parts = [self.explain(part) for part in unreachable[:MAX_LISTED]]
        return Fact(text, UNREACHABLE, note, parts, more=len(unreachable) - len(parts))

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
        wrong = [
            f"{self._name(given[v.name])} is no {' and '.join(v.classes)}"
            for v in action.variables
            if v.name in given and given[v.name] not in self._task.candidates(v.classes)
        ]
        wrong += [
            f"the scene has no element for {v.key or 'Robot'} ({' and '.join(v.classes)})"
            for v in action.variables
            if not self._task.candidates(v.classes)
        ]
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
                yield Achiever(skill.name, {}, [skill.reason])


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


# -- skills that planning cannot use -----------------------------------------------------------------------------------


@dataclass(frozen=True)
class UnusableSkill:
    """A skill with effects that no plan can use.

    :param managers: the node names of its managers.
    :param reason: why it is unusable.
    :param effects: the task's literals that it would make true.
    """

    name: str
    managers: tuple[str, ...]
    reason: str
    effects: frozenset[PredicateLiteral]

    def __str__(self) -> str:
        return f"{self.name} of {', '.join(self.managers)}: {self.reason}"


#: Why a plan cannot use the effect of a hold-condition. It would need concurrency (Cushing, Kambhampati, Mausam, Weld:
#: When is temporal planning really temporal?, IJCAI 2007), but planners produce sequences.
_TEMPORARY = "this lasts only while it runs, and plans start no step during another one; a skill that runs both can"


def unusable_skills(world: WorldView, task: PlanningTask) -> list[UnusableSkill]:
    """Returns the robots' skills with effects that a task needs and cannot use.

    :param world: the snapshot that the task was compiled from.
    """
    predicates = {p for p in task.predicates if p.kind is not Kind.CAN}
    families = FactFamilies((), world.is_subproperty)
    owners: dict[Skill, list[str]] = {}
    for robot in world.robots:
        for skill in robot.skills:
            owners.setdefault(skill, []).append(robot.manager)
    usable = {action.skill: action for action in make_actions(world.robots)[0]}
    in_task = {action.skill for action in task.actions}
    found = []
    for skill, managers in owners.items():
        reasons: dict[str, list[PredicateLiteral]] = {}
        if skill not in usable:
            reasons[why_unusable(skill)] = declared_effects(skill)
        else:
            reasons[_TEMPORARY] = [(e.atom.predicate, e.state) for e in usable[skill].during]
            empty = [v for v in usable[skill].variables if not world.members_of_all(v.classes)]
            if empty and skill not in in_task:
                wanted = ", ".join(f"{v.key or 'Robot'} ({' and '.join(v.classes)})" for v in empty)
                reasons[f"the scene has no element for {wanted}"] = declared_effects(skill)
        for reason, declared in reasons.items():
            effects = frozenset(_consequences(declared, predicates, families, world))
            if effects:
                found.append(UnusableSkill(skill.name, tuple(managers), reason, effects))
    return found


def _consequences(
    effects: Iterable[PredicateLiteral], predicates: set[Predicate], families: FactFamilies, world: WorldView
) -> Iterator[PredicateLiteral]:
    for effect, state in effects:
        yield from families.consequences(effect, state, predicates)
        if effect.kind is Kind.RELATION and state:
            yield from ((p, True) for p in predicates if _is_subproperty(effect, p, world))


def _is_subproperty(effect: Predicate, predicate: Predicate, world: WorldView) -> bool:
    return predicate.kind is Kind.RELATION and world.is_subproperty(effect.name, predicate.name)
