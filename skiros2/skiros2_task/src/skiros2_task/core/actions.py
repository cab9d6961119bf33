"""Planning actions of skills: pre-conditions and effects over variables for the parameters."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

from skiros2_common.core.names import local_name
from skiros2_common.core.params import ParamTypes
from skiros2_task.core.conditions import IN_SCENE, Unusable, contradict, predicate_of
from skiros2_task.core.formula import (
    FALSE,
    TRUE,
    Atom,
    Formula,
    Kind,
    Not,
    Predicate,
    bind,
    conjunction,
    conjuncts,
    disjunction,
)
from skiros2_task.core.pddl_names import Naming
from skiros2_task.core.skills import Robot, Skill, SkillCondition, SkillParameter

ROBOT_KEY = "Robot"

#: The `planned_as` of conditions on whether a parameter holds an element of the scene.
_PRESENCE = ("specified", Kind.IN_SCENE)


@dataclass(frozen=True)
class Variable:
    """A variable of an action.

    :param name: in formulas, `?Key`.
    :param key: the skill's parameter that gets the value; "" for none.
    :param classes: the value must be an instance of all of them.
    """

    name: str
    key: str
    classes: tuple[str, ...]


@dataclass(frozen=True)
class Effect:
    """Makes an atom true or false, for all values of the variables in `each` ((variable, class) pairs)."""

    atom: Atom
    state: bool
    each: tuple[tuple[str, str], ...] = ()


@dataclass(frozen=True)
class Action:
    """A skill as a planning action.

    :param name: unique and valid in PDDL.
    :param robot: the variable of the executing robot.
    :param managers: (robot id, manager) pairs of the robots that have the skill.
    :param during: effects that last only while the skill runs, such as a lock.
    """

    name: str
    skill: Skill
    robot: str
    managers: tuple[tuple[str, str], ...]
    variables: tuple[Variable, ...]
    precondition: Formula
    effects: tuple[Effect, ...]
    during: tuple[Effect, ...] = ()

    def manager_of(self, robot: str) -> str:
        """Returns the manager of a robot; "" if the robot does not have the skill."""
        return dict(self.managers).get(robot, "")

    @property
    def created(self) -> frozenset[str]:
        """The variables whose elements the skill creates."""
        return frozenset(e.atom.terms[0] for e in self.effects if e.atom.predicate == IN_SCENE and e.state)

    @property
    def removed(self) -> frozenset[str]:
        """The variables whose elements the skill removes."""
        return frozenset(e.atom.terms[0] for e in self.effects if e.atom.predicate == IN_SCENE and not e.state)


def make_actions(robots: Sequence[Robot]) -> tuple[list[Action], list[str]]:
    """Returns the actions of the robots' skills, and messages about unusable skills and ignored conditions.

    Robots whose managers declare the same skill share one action; `CAN` facts state which robots have it.
    """
    owners: dict[Skill, list[tuple[str, str]]] = {}
    for robot in robots:
        for skill in robot.skills:
            owners.setdefault(skill, []).append((robot.id, robot.manager))
    naming = Naming()
    actions: list[Action] = []
    notes: list[str] = []
    for skill, managers in owners.items():
        name = naming.name(skill, (skill.label or local_name(skill.type), f"{local_name(skill.type)}_{skill.label}"))
        try:
            action, opaque = _action(name, skill, tuple(managers))
        except Unusable as reason:
            names = ", ".join(manager for _, manager in managers)
            notes.append(f"skill {skill.name} of {names} is left out: {reason}")
            continue
        actions.append(action)
        if opaque:
            notes.append(f"skill {skill.name}: planning ignores conditions that it cannot read: {', '.join(opaque)}")
    return actions, notes


def condition_predicates(robots: Iterable[Robot]) -> set[Predicate]:
    """Returns the predicates of the conditions of the robots' skills."""
    found: set[Predicate] = set()
    for robot in robots:
        for skill in robot.skills:
            waiting = [*skill.pre, *skill.hold, *skill.post]
            while waiting:
                condition = waiting.pop()
                waiting += condition.parts
                try:
                    found |= {p for p in [predicate_of(condition)] if p is not None}
                except Unusable:
                    continue  # reported by `make_actions`
    return found


def why_unusable(skill: Skill) -> str:
    """Returns why a skill has no planning action; "" if it has one."""
    try:
        _action("", skill, ())
    except Unusable as reason:
        return str(reason)
    return ""


def declared_effects(skill: Skill) -> list[tuple[Predicate, bool]]:
    """Returns the literals of a skill's post-conditions, also of a skill without an action."""
    found = []
    for condition in skill.post:
        try:
            predicate = predicate_of(condition)
        except Unusable:
            continue  # reported by `why_unusable`
        if predicate is not None:
            found.append((predicate, condition.state))
    return found


def _action(name: str, skill: Skill, managers: tuple[tuple[str, str], ...]) -> tuple[Action, list[str]]:
    if skill.unreadable:
        raise Unusable(skill.unreadable)
    if not skill.available:
        raise Unusable("it is not available for planning")
    if not skill.pre or not skill.post:
        raise Unusable(f"it has no {'pre' if not skill.pre else 'post'}-conditions")
    for parameter in skill.parameters:
        if parameter.missing:
            raise Unusable(f"its parameter {parameter.key} has no default, and planning cannot give it a value")
    for conditions, kind in ((skill.pre, "pre"), (skill.hold, "hold"), (skill.post, "post")):
        _check_contradictions(conditions, kind)
    reader = _ConditionReader(skill)
    # A hold-condition that contradicts a pre-condition, such as a lock, is established by the skill itself.
    own = [c for c in skill.hold if any(contradict(c, pre) for pre in skill.pre)]
    holds = [c for c in skill.hold if c not in own]
    precondition = conjunction([reader.formula(c) for c in (*skill.pre, *holds)])
    if precondition == FALSE:
        raise Unusable("its pre-conditions can never hold")
    effects = tuple(Effect(atom, state) for c in skill.post for atom, state in reader.effects(c))
    if not effects:
        raise Unusable("its post-conditions change nothing that planning can read")
    during = tuple(Effect(atom, state) for c in own for atom, state in reader.effects(c))
    robot, variables = reader.variables()
    fixed = {f"?{p.key}": p.fixed for p in skill.parameters if p.fixed}
    precondition = bind(precondition, fixed)
    effects, during = (
        tuple(Effect(Atom(e.atom.predicate, tuple(fixed.get(t, t) for t in e.atom.terms)), e.state) for e in some)
        for some in (effects, during)
    )
    variables, precondition = _lift_classes(variables, precondition)
    can = Atom(Predicate(Kind.CAN, name), (robot,))
    created = [Not(e.atom) for e in effects if e.atom.predicate == IN_SCENE and e.state]
    precondition = conjunction([can, precondition, *created])
    return Action(name, skill, robot, managers, variables, precondition, effects, during), reader.opaque


def _check_contradictions(conditions: Sequence[SkillCondition], kind: str) -> None:
    for one, other in combinations(conditions, 2):
        if contradict(one, other):
            raise Unusable(f"its {kind}-conditions {one.label!r} and {other.label!r} contradict each other")


def _lift_classes(variables: tuple[Variable, ...], precondition: Formula) -> tuple[tuple[Variable, ...], Formula]:
    """Moves class conditions on variables from the formula to the variables."""
    classes = {v.name: list(v.classes) for v in variables}
    kept = []
    for part in conjuncts(precondition):
        if isinstance(part, Atom) and part.predicate.kind is Kind.IS_A and part.terms[0] in classes:
            classes[part.terms[0]].append(part.predicate.name)
        else:
            kept.append(part)
    lifted = tuple(replace(v, classes=tuple(dict.fromkeys(classes[v.name]))) for v in variables)
    return lifted, conjunction(kept)


class _ConditionReader:
    """Turns the conditions of one skill into formulas, and collects the parameters that planning has to choose."""

    def __init__(self, skill: Skill) -> None:
        self._skill = skill
        self.opaque: list[str] = []
        given = [c for c in skill.pre if c.planned_as in _PRESENCE]
        #: Parameters that must be unset when the skill starts.
        self._unset = {c.subject for c in given if not c.state}
        #: Parameters whose elements the skill creates.
        self._created = {c.subject for c in skill.post if c.planned_as == Kind.IN_SCENE and c.state}
        self._created -= {c.subject for c in given if c.state}
        self._named: set[str] = set()

    def variables(self) -> tuple[str, tuple[Variable, ...]]:
        """Returns the robot's variable, and all variables, the robot's first. Call it after all conditions are read."""
        chosen = []
        robot = self._skill.parameter(ROBOT_KEY)
        if robot is not None and robot.element_class is not None and not robot.fixed:
            chosen.append(Variable(f"?{ROBOT_KEY}", ROBOT_KEY, (robot.element_class,)))
        else:
            name = "?Manager"
            while self._skill.parameter(name[1:]) is not None:
                name += "_"
            chosen.append(Variable(name, "", ("sumo:Agent",)))
        for parameter in self._skill.parameters:
            if parameter.element_class is None or parameter.fixed or parameter.key == chosen[0].key:
                continue
            required = parameter.kind is ParamTypes.Required and not self._is_unset(parameter)
            if required or parameter.key in self._named:
                chosen.append(Variable(f"?{parameter.key}", parameter.key, (parameter.element_class,)))
        return chosen[0].name, tuple(chosen)

    def formula(self, condition: SkillCondition) -> Formula:
        """Returns the formula of a condition; TRUE if planning cannot read it."""
        fact = self._fact(condition)
        if fact is None:
            return TRUE
        if condition.state:
            return fact
        return TRUE if fact == FALSE else FALSE if fact == TRUE else Not(fact)

    def effects(self, condition: SkillCondition) -> list[tuple[Atom, bool]]:
        """Returns the effects of a post-condition; none of a disjunction."""
        if condition.planned_as == Kind.IN_SCENE:
            self._parameters(condition, condition.subject)
            if condition.state and condition.subject not in self._created:
                return []  # the element exists already
            self._named.add(condition.subject)
            return [(Atom(IN_SCENE, (f"?{condition.subject}",)), condition.state)]
        predicate = predicate_of(condition)
        if predicate is None or predicate.kind in (Kind.ALLOWED, Kind.IS_A):
            return []
        fact = self._fact(condition)
        return [(fact, condition.state)] if isinstance(fact, Atom) else []

    def _fact(self, condition: SkillCondition) -> Formula | None:
        """Returns the condition without its desired state; None if planning cannot read it, or it always holds."""
        if condition.planned_as == "any":
            facts = [self._fact(part) for part in condition.parts]
            return None if None in facts else disjunction([self.formula(part) for part in condition.parts])
        if condition.planned_as in _PRESENCE:
            parameter = self._parameters(condition, condition.subject, elements=False)[0]
            if self._is_unset(parameter):
                return FALSE
            if parameter.element_class is None:
                return TRUE
            self._named.add(parameter.key)
            return Atom(IN_SCENE, (f"?{parameter.key}",)) if parameter.key in self._created else TRUE
        if condition.planned_as == "ignored":
            return None
        predicate = predicate_of(condition)
        if predicate is None:
            self.opaque.append(f"{condition.kind} {condition.label!r}")
            return None
        keys = (condition.subject, condition.object)[: predicate.arity]
        parameters = self._parameters(condition, *keys)
        if predicate.kind is Kind.HAS and parameters[0].kind is ParamTypes.Optional:
            return None  # holds for an unset parameter
        if any(self._is_unset(p) for p in parameters):
            return FALSE
        self._named.update(keys)
        return Atom(predicate, tuple(f"?{key}" for key in keys))

    def _is_unset(self, parameter: SkillParameter) -> bool:
        return parameter.key in self._unset and parameter.key not in self._created

    def _parameters(self, condition: SkillCondition, *keys: str, elements: bool = True) -> list[SkillParameter]:
        """Returns the parameters of a condition.

        :param elements: whether they must hold elements.
        """
        found = []
        for key in keys:
            parameter = self._skill.parameter(key)
            if parameter is None:
                raise Unusable(f"condition {condition.label!r} refers to {key!r}, which is not one of its parameters")
            if elements and parameter.element_class is None:
                raise Unusable(f"condition {condition.label!r} refers to {key!r}, which does not hold an element")
            found.append(parameter)
        return found
