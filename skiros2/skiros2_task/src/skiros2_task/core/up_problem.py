"""A planning task as objects of unified-planning, under names that PDDL can hold."""

from __future__ import annotations

from collections import Counter, OrderedDict
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import unified_planning as up
from unified_planning.environment import get_environment
from unified_planning.model import Fluent, InstantaneousAction, Object, Problem

from skiros2_common.core.names import local_name
from skiros2_task.core.actions import Action
from skiros2_task.core.formula import And, Atom, Formula, Kind, Not, Or, Predicate, literals
from skiros2_task.core.pddl_names import Naming, pddl_name
from skiros2_task.core.task import EVERYTHING, PlanningTask, PlanStep
from skiros2_task.core.type_tree import TypeTree

#: What kind of thing an action is that no step of a plan stands for.
_GOAL = "goal action"
_OPERATOR_WORDS = {"=": "eq", ">": "gt", "<": "lt", ">=": "ge", "<=": "le"}


class SparseProblem(Problem):  # type: ignore[misc]
    """A problem that lists, as initial values, only those that are set: what is not true is false.

    The full list grows with the square of the number of objects; what writes PDDL needs only what is true.
    """

    @property
    def initial_values(self) -> dict[Any, Any]:
        return dict(self.explicit_initial_values)

    def add_object(self, obj: Object, typename: None = None) -> Object:
        """Adds an object whose name nothing else has; looking for it takes a time that grows with each object."""
        self._objects.append(obj)
        self._add_user_type(obj.type)
        return obj


class UpProblem:
    """The unified-planning problem of a task, and the way back from its names."""

    def __init__(self, task: PlanningTask, sparse: bool = True, goal_action: bool = False, flat: bool = False) -> None:
        """
        :param sparse: for engines that read PDDL; others get every initial value.
        :param goal_action: the goal becomes the pre-condition of an action that has to end every plan.
        :param flat: for engines that know no types under others: all objects are of one type.
        """
        self._task = task
        self._naming = Naming()
        self._env = get_environment()  # some engines take no other
        self._env.credits_stream = None
        self._tree = TypeTree(task.members, flat)
        self._predicate_names = _predicate_wishes(task.predicates)
        self._types: dict[str, Any] = {}
        self._fluents: dict[Predicate, Any] = {}
        self._objects: dict[str, Any] = {}
        self.problem: Any = (SparseProblem if sparse else Problem)("skiros", environment=self._env)
        self._add_types()
        self._add_objects()
        self._add_fluents()
        for action in task.actions:
            self.problem.add_action(self._action(action))
        self._add_facts()
        goals = [self._expression(goal, {}) for goal in _parts(task.goal)]
        if goal_action:
            goals = [self._reached(goals)]
        elif sparse and sum(goal.is_or() for goal in goals) > 1:
            goals = self._apart(goals)
        for goal in goals:
            self.problem.add_goal(goal)

    def steps(self, plan: Any) -> tuple[PlanStep, ...]:
        """The steps of a sequential plan for this problem."""
        return tuple(
            PlanStep(
                self._thing(instance.action.name),
                tuple(self._thing(argument.object().name) for argument in instance.actual_parameters),
            )
            for instance in plan.actions
        )

    def named_steps(self, names: Iterable[Sequence[str]]) -> tuple[PlanStep, ...]:
        """The steps of a plan as PDDL names them; the inverse of `names_of`."""
        return tuple(
            PlanStep(self._thing(action), tuple(self._thing(argument) for argument in arguments))
            for action, *arguments in names
            if self._kind(action) != _GOAL
        )

    def names_of(self, step: PlanStep) -> tuple[str, ...]:
        """A step as PDDL names it: the action and its objects."""
        objects = (self._objects[argument].object().name for argument in step.arguments)
        return (self._naming.name(("action", step.action), ()), *objects)

    @property
    def environment(self) -> Any:
        """The unified-planning environment that the problem belongs to."""
        return self._env

    def _thing(self, name: str) -> str:
        return self._kind_and_thing(name)[1]

    def _kind(self, name: str) -> str:
        return self._kind_and_thing(name)[0]

    def _kind_and_thing(self, name: str) -> tuple[str, str]:
        found = self._naming.thing(name)
        assert isinstance(found, tuple)
        return str(found[0]), str(found[1])

    def _apart(self, goals: list[Any]) -> list[Any]:
        """Goals whose alternatives stand in quantifiers that change nothing.

        Fast Downward multiplies out alternatives that all have to hold, 3^12 for a dozen of three; but of a quantifier
        it makes an axiom first. So that nobody simplifies it away, the quantifier speaks of a fact that never holds.
        """
        manager, thing = self._env.expression_manager, self._types[EVERYTHING]
        name = self._naming.name(("predicate", "never"), ["never"])
        never = Fluent(name, self._env.type_manager.BoolType(), environment=self._env, it=thing)
        self.problem.add_fluent(never, default_initial_value=False)
        anything = up.model.Variable("anything", thing, self._env)
        return [
            manager.Forall(manager.Or(*goal.args, never(anything)), anything) if goal.is_or() else goal
            for goal in goals
        ]

    def _reached(self, goals: list[Any]) -> Any:
        """The fact that an action brings about whose pre-condition is the goal.

        Alternatives that all have to hold are multiplied out there too. So where there are several, an action ends all
        others first, and each of the alternatives is answered by an action of its own.
        """
        if sum(goal.is_or() for goal in goals) > 1:
            actions = list(self.problem.actions)
            over = self._goal_action("end", [])
            for action in actions:
                action.add_precondition(self._env.expression_manager.Not(over))
            goals = [
                self._goal_action(f"answer_{number}", [over, goal]) if goal.is_or() else goal
                for number, goal in enumerate(goals, 1)
            ]
        return self._goal_action("reach_goal", goals)

    def _goal_action(self, name: str, conditions: list[Any]) -> Any:
        """The fact that an action brings about which no step of a plan stands for."""
        fluent = Fluent(self._naming.name(("predicate", (_GOAL, name)), [f"done_{name}"]), environment=self._env)
        self.problem.add_fluent(fluent, default_initial_value=False)
        action = InstantaneousAction(self._naming.name((_GOAL, name), [name]), _env=self._env)
        for condition in conditions:
            action.add_precondition(condition)
        action.add_effect(fluent, True)
        self.problem.add_action(action)
        return fluent()

    def _add_types(self) -> None:
        for cls in (EVERYTHING, *self._tree.parent):
            name = self._naming.name(("type", cls), ["thing" if cls == EVERYTHING else cls])
            father = self._types.get(self._tree.parent.get(cls, ""))
            self._types[cls] = self._env.type_manager.UserType(name, father)

    def _add_objects(self) -> None:
        for name in self._task.objects:
            kind = self._types[self._tree.type_of[name]]
            obj = Object(self._naming.name(("object", name), [name]), kind, environment=self._env)
            self._objects[name] = self._env.expression_manager.ObjectExp(obj)
            self.problem.add_object(obj)

    def _add_fluents(self) -> None:
        for predicate, types in self._signatures().items():
            names = Naming()
            wishes = self._predicate_names.get(predicate) or [str(predicate)]
            parameters = OrderedDict(
                (names.name(place, [self._types[t].name]), self._types[t]) for place, t in enumerate(types)
            )
            fluent = Fluent(
                self._naming.name(("predicate", predicate), wishes),
                self._env.type_manager.BoolType(),
                parameters,
                environment=self._env,
            )
            self._fluents[predicate] = fluent
            self.problem.add_fluent(fluent, default_initial_value=False)

    def _signatures(self) -> dict[Predicate, list[str]]:
        """The smallest types for the terms of each predicate."""
        found: dict[Predicate, list[str]] = {p: [] for p in self._task.predicates}

        def note(atom: Atom, types: Mapping[str, str]) -> None:
            there = [types.get(t) or self._tree.type_of[t] for t in atom.terms]
            known = found.setdefault(atom.predicate, [])
            found[atom.predicate] = (
                [self._tree.join(a, b) for a, b in zip(known, there, strict=True)] if known else there
            )

        for action in self._task.actions:
            types = self._variable_types(action)
            for atom, _ in literals(action.precondition):
                note(atom, types)
            for effect in action.effects:
                each = {name: self._each_type(cls) for name, cls in effect.each}
                note(effect.atom, {**types, **each})
                for name, cls in effect.each:
                    if cls in self._tree.crossing:
                        note(Atom(Predicate(Kind.IS_A, cls), (name,)), each)
            for variable in action.variables:
                for cls in variable.classes:
                    if cls in self._tree.crossing:
                        note(Atom(Predicate(Kind.IS_A, cls), (variable.name,)), types)
        for atom, _ in literals(self._task.goal):
            note(atom, {})
        for atom in self._task.init:
            note(atom, {})
        return {p: types for p, types in found.items() if types}

    def _variable_types(self, action: Action) -> dict[str, str]:
        return {v.name: self._tree.smallest(self._task.candidates(v.classes)) for v in action.variables}

    def _each_type(self, cls: str) -> str:
        return self._tree.smallest(self._task.members[cls])

    def _action(self, action: Action) -> Any:
        names = Naming()
        types = self._variable_types(action)
        parameters = OrderedDict(
            (names.name(v.name, [v.name[1:]]), self._types[types[v.name]]) for v in action.variables
        )
        action_name = self._naming.name(("action", action.name), [action.name])
        made = InstantaneousAction(action_name, parameters, _env=self._env)
        bound = {
            v.name: self._env.expression_manager.ParameterExp(made.parameter(name))
            for v, name in zip(action.variables, parameters, strict=True)
        }
        for variable in action.variables:
            for cls in variable.classes:
                if cls in self._tree.crossing:
                    made.add_precondition(self._is_a(cls, bound[variable.name]))
        for part in _parts(action.precondition):
            made.add_precondition(self._expression(part, bound))
        for effect in action.effects:
            each = {
                name: up.model.Variable(pddl_name(name[1:]), self._types[self._each_type(cls)], self._env)
                for name, cls in effect.each
            }
            inner = {**bound, **{name: self._env.expression_manager.VariableExp(v) for name, v in each.items()}}
            crossing = [self._is_a(cls, inner[name]) for name, cls in effect.each if cls in self._tree.crossing]
            made.add_effect(
                self._expression(effect.atom, inner),
                effect.state,
                self._env.expression_manager.And(crossing),
                forall=tuple(each.values()),
            )
        return made

    def _is_a(self, cls: str, thing: Any) -> Any:
        return self._fluents[Predicate(Kind.IS_A, cls)](thing)

    def _expression(self, formula: Formula, bound: Mapping[str, Any]) -> Any:
        manager = self._env.expression_manager
        if isinstance(formula, Atom):
            terms = [bound[t] if t in bound else self._objects[t] for t in formula.terms]
            return manager.FluentExp(self._fluents[formula.predicate], terms)
        if isinstance(formula, Not):
            return manager.Not(self._expression(formula.part, bound))
        if isinstance(formula, And | Or):
            parts = [self._expression(p, bound) for p in formula.parts]
            return manager.And(parts) if isinstance(formula, And) else manager.Or(parts)
        raise TypeError(f"{formula} has a quantifier; write it out first")

    def _add_facts(self) -> None:
        for atom in sorted(self._task.init, key=str):
            self.problem.set_initial_value(self._expression(atom, {}), True)
        for cls in self._tree.crossing:
            fluent = self._fluents.get(Predicate(Kind.IS_A, cls))
            if fluent is not None:
                for name in self._task.members[cls]:
                    self.problem.set_initial_value(fluent(self._objects[name]), True)


def _parts(formula: Formula) -> tuple[Formula, ...]:
    return formula.parts if isinstance(formula, And) else (formula,)


def _predicate_wishes(predicates: tuple[Predicate, ...]) -> dict[Predicate, list[str]]:
    """What each predicate would be called; a value's name alone only where no other predicate has it."""
    short = Counter(pddl_name(str(p.value)) for p in predicates if p.kind is Kind.VALUE and isinstance(p.value, str))
    found = {}
    for p in predicates:
        local = local_name(p.name)
        if p.kind is Kind.RELATION or (p.kind is Kind.VALUE and p.value is True):
            wishes = [p.name]
        elif p.kind is Kind.VALUE:
            wishes = [f"{local}_{p.value}", f"{p.name}_{p.value}"]
            if isinstance(p.value, str) and short[pddl_name(p.value)] == 1:
                wishes.insert(0, p.value)
        elif p.kind is Kind.COMPARES:
            wishes = [f"{local}_{_OPERATOR_WORDS[p.operator]}_{p.value:g}"]
        elif p.kind is Kind.ALLOWED:
            wishes = [f"{p.name}_allowed"]
        else:
            word = p.kind.value.replace(" ", "_")
            wishes = [f"{word}_{local}" if local else word, f"{word}_{p.name}"]
        found[p] = wishes
    return found
