"""Converts a planning task to a unified-planning problem with PDDL names, and plans back.

A class of the ontology may have several superclasses, but PDDL types form a tree. So the types are the classes whose
objects nest: of two types, one contains all objects of the other, or they are disjoint. Other classes become static
predicates.
"""

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

#: The kind of actions without a plan step.
_GOAL = "goal action"
_OPERATOR_WORDS = {"=": "eq", ">": "gt", "<": "lt", ">=": "ge", "<=": "le"}


class TypeTree:
    """The types of objects, by class name; `EVERYTHING` is the root."""

    def __init__(self, members: Mapping[str, Sequence[str]], flat: bool = False) -> None:
        """
        :param members: the objects of each class, with `EVERYTHING`; superclasses come first.
        :param flat: use no types but the root, so that all classes are static predicates.
        """
        everything = frozenset(members[EVERYTHING])
        self._objects: dict[str, frozenset[str]] = {EVERYTHING: everything}
        #: The parent of each type but the root.
        self.parent: dict[str, str] = {}
        #: The classes that are static predicates.
        self.crossing: list[str] = []
        sizes = sorted((cls for cls in members if cls != EVERYTHING), key=lambda cls: -len(members[cls]))
        for cls in sizes:
            objects = frozenset(members[cls])
            if not flat and all(objects <= other or not objects & other for other in self._objects.values()):
                self.parent[cls] = self.smallest(objects)
                self._objects[cls] = objects
            else:
                self.crossing.append(cls)
        self._depth = {t: len(self.lineage(t)) for t in self._objects}
        #: The type of each object: the smallest that contains it.
        self.type_of: dict[str, str] = dict.fromkeys(members[EVERYTHING], EVERYTHING)
        for cls in sorted(self.parent, key=lambda t: self._depth[t]):
            self.type_of.update(dict.fromkeys(self._objects[cls], cls))

    def smallest(self, objects: Iterable[str]) -> str:
        """Returns the smallest type that contains some objects; of equal types the last."""
        wanted = frozenset(objects)
        best = EVERYTHING
        for cls, members in self._objects.items():
            if wanted <= members and len(members) <= len(self._objects[best]):
                best = cls
        return best

    def lineage(self, cls: str) -> list[str]:
        """Returns a type and its ancestors, up to the root."""
        found = [cls]
        while found[-1] in self.parent:
            found.append(self.parent[found[-1]])
        return found

    def join(self, one: str, other: str) -> str:
        """Returns the smallest common ancestor of two types."""
        ancestors = set(self.lineage(one))
        return next(t for t in self.lineage(other) if t in ancestors)


class SparseProblem(Problem):  # type: ignore[misc]
    """A problem whose initial values are only those that are set; all others are false.

    The full list grows with the square of the number of objects; PDDL needs only the true ones.
    """

    @property
    def initial_values(self) -> dict[Any, Any]:
        return dict(self.explicit_initial_values)

    def add_object(self, obj: Object, typename: None = None) -> Object:
        """Adds an object without the check for a unique name, which is linear in the number of objects."""
        self._objects.append(obj)
        self._add_user_type(obj.type)
        return obj


class UpProblem:
    """The unified-planning problem of a task, with the mapping of its names."""

    def __init__(self, task: PlanningTask, sparse: bool = True, goal_action: bool = False, flat: bool = False) -> None:
        """
        :param sparse: list only true initial values, for engines that read PDDL.
        :param goal_action: make the goal the pre-condition of an action that ends every plan.
        :param flat: use one type only, for engines without type hierarchy.
        """
        self._task = task
        self._naming = Naming()
        self._env = get_environment()  # some engines take no other
        self._env.credits_stream = None
        self._tree = TypeTree(task.members, flat)
        self._predicate_names = _predicate_names(task.predicates)
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
            goals = [self._goal_actions(goals)]
        elif sparse and sum(goal.is_or() for goal in goals) > 1:
            goals = self._quantify_alternatives(goals)
        for goal in goals:
            self.problem.add_goal(goal)

    def steps(self, plan: Any) -> tuple[PlanStep, ...]:
        """Returns the steps of a sequential plan for this problem."""
        return tuple(
            PlanStep(
                self._original(instance.action.name),
                tuple(self._original(argument.object().name) for argument in instance.actual_parameters),
            )
            for instance in plan.actions
        )

    def named_steps(self, names: Iterable[Sequence[str]]) -> tuple[PlanStep, ...]:
        """Returns the steps of a plan in PDDL names; the inverse of `names_of`."""
        return tuple(
            PlanStep(self._original(action), tuple(self._original(argument) for argument in arguments))
            for action, *arguments in names
            if self._key(action)[0] != _GOAL
        )

    def names_of(self, step: PlanStep) -> tuple[str, ...]:
        """Returns the PDDL names of a step's action and objects."""
        objects = (self._objects[argument].object().name for argument in step.arguments)
        return (self._naming.name(("action", step.action), ()), *objects)

    @property
    def environment(self) -> Any:
        """The unified-planning environment of the problem."""
        return self._env

    def _original(self, name: str) -> str:
        return self._key(name)[1]

    def _key(self, name: str) -> tuple[str, str]:
        """Returns the kind and the original name of a PDDL name."""
        found = self._naming.key(name)
        assert isinstance(found, tuple)
        return str(found[0]), str(found[1])

    def _quantify_alternatives(self, goals: list[Any]) -> list[Any]:
        """Wraps disjunctive goals into quantifiers.

        Fast Downward expands a conjunction of disjunctions to disjunctive normal form (3^12 parts for a dozen goals of
        three alternatives), but makes a quantified formula an axiom first. The quantified formula contains a fact that
        never holds, so that it is not simplified.
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

    def _goal_actions(self, goals: list[Any]) -> Any:
        """Adds an action whose pre-condition is the goal, and returns its effect.

        Pre-conditions are expanded to disjunctive normal form too. So for several disjunctions, an `end` action
        disables all actions of the plan, and each disjunction becomes the pre-condition of an own action after it.
        """
        if sum(goal.is_or() for goal in goals) > 1:
            actions = list(self.problem.actions)
            ended = self._goal_action("end", [])
            for action in actions:
                action.add_precondition(self._env.expression_manager.Not(ended))
            goals = [
                self._goal_action(f"answer_{number}", [ended, goal]) if goal.is_or() else goal
                for number, goal in enumerate(goals, 1)
            ]
        return self._goal_action("reach_goal", goals)

    def _goal_action(self, name: str, conditions: list[Any]) -> Any:
        """Adds an action without a plan step, and returns its effect."""
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
            parent = self._types.get(self._tree.parent.get(cls, ""))
            self._types[cls] = self._env.type_manager.UserType(name, parent)

    def _add_objects(self) -> None:
        for name in self._task.objects:
            kind = self._types[self._tree.type_of[name]]
            obj = Object(self._naming.name(("object", name), [name]), kind, environment=self._env)
            self._objects[name] = self._env.expression_manager.ObjectExp(obj)
            self.problem.add_object(obj)

    def _add_fluents(self) -> None:
        for predicate, types in self._signatures().items():
            names = Naming()
            candidates = self._predicate_names.get(predicate) or [str(predicate)]
            parameters = OrderedDict(
                (names.name(position, [self._types[t].name]), self._types[t]) for position, t in enumerate(types)
            )
            fluent = Fluent(
                self._naming.name(("predicate", predicate), candidates),
                self._env.type_manager.BoolType(),
                parameters,
                environment=self._env,
            )
            self._fluents[predicate] = fluent
            self.problem.add_fluent(fluent, default_initial_value=False)

    def _signatures(self) -> dict[Predicate, list[str]]:
        """Returns the smallest types for the terms of each predicate."""
        found: dict[Predicate, list[str]] = {p: [] for p in self._task.predicates}

        def add(atom: Atom, types: Mapping[str, str]) -> None:
            new = [types.get(t) or self._tree.type_of[t] for t in atom.terms]
            known = found.setdefault(atom.predicate, [])
            found[atom.predicate] = [self._tree.join(a, b) for a, b in zip(known, new, strict=True)] if known else new

        for action in self._task.actions:
            types = self._variable_types(action)
            for atom, _ in literals(action.precondition):
                add(atom, types)
            for effect in action.effects:
                each = {name: self._each_type(cls) for name, cls in effect.each}
                add(effect.atom, {**types, **each})
                for name, cls in effect.each:
                    if cls in self._tree.crossing:
                        add(Atom(Predicate(Kind.IS_A, cls), (name,)), each)
            for variable in action.variables:
                for cls in variable.classes:
                    if cls in self._tree.crossing:
                        add(Atom(Predicate(Kind.IS_A, cls), (variable.name,)), types)
        for atom, _ in literals(self._task.goal):
            add(atom, {})
        for atom in self._task.init:
            add(atom, {})
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
        result = InstantaneousAction(action_name, parameters, _env=self._env)
        bound = {
            v.name: self._env.expression_manager.ParameterExp(result.parameter(name))
            for v, name in zip(action.variables, parameters, strict=True)
        }
        for variable in action.variables:
            for cls in variable.classes:
                if cls in self._tree.crossing:
                    result.add_precondition(self._is_a(cls, bound[variable.name]))
        for part in _parts(action.precondition):
            result.add_precondition(self._expression(part, bound))
        for effect in action.effects:
            each = {
                name: up.model.Variable(pddl_name(name[1:]), self._types[self._each_type(cls)], self._env)
                for name, cls in effect.each
            }
            inner = {**bound, **{name: self._env.expression_manager.VariableExp(v) for name, v in each.items()}}
            crossing = [self._is_a(cls, inner[name]) for name, cls in effect.each if cls in self._tree.crossing]
            result.add_effect(
                self._expression(effect.atom, inner),
                effect.state,
                self._env.expression_manager.And(crossing),
                forall=tuple(each.values()),
            )
        return result

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
        raise TypeError(f"{formula} has a quantifier; expand it first")

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


def _predicate_names(predicates: tuple[Predicate, ...]) -> dict[Predicate, list[str]]:
    """Returns candidate names of each predicate; a value alone only if no other predicate has it."""
    short = Counter(pddl_name(str(p.value)) for p in predicates if p.kind is Kind.VALUE and isinstance(p.value, str))
    found = {}
    for p in predicates:
        local = local_name(p.name)
        if p.kind is Kind.RELATION or (p.kind is Kind.VALUE and p.value is True):
            names = [p.name]
        elif p.kind is Kind.VALUE:
            names = [f"{local}_{p.value}", f"{p.name}_{p.value}"]
            if isinstance(p.value, str) and short[pddl_name(p.value)] == 1:
                names.insert(0, p.value)
        elif p.kind is Kind.COMPARES:
            names = [f"{local}_{_OPERATOR_WORDS[p.operator]}_{p.value:g}"]
        elif p.kind is Kind.ALLOWED:
            names = [f"{p.name}_allowed"]
        else:
            word = p.kind.value.replace(" ", "_")
            names = [f"{word}_{local}" if local else word, f"{word}_{p.name}"]
        found[p] = names
    return found
