"""Splits a plan into parts that one robot has to execute, for `robot_assignment`."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from skiros2_task.core.actions import Action
from skiros2_task.core.formula import Atom, Predicate, literals
from skiros2_task.core.partial_order import GOAL, INIT, CausalLink, PartialOrder, ordering_constraints
from skiros2_task.core.task import PlanningTask


@dataclass(frozen=True)
class Target:
    """A fact about the robot that a step needs and that a move brings about, such as its location.

    :param position: the robot's position among the terms.
    """

    predicate: Predicate
    position: int
    terms: tuple[str, ...]


@dataclass
class Part:
    """Steps that one robot has to execute.

    :param steps: their indices in the plan.
    :param targets: the targets of each step.
    :param after: the indices of the parts that must end before this one.
    :param pinned: the part stays with the robot of the plan.
    :param final: the goal needs a fact about the robot that the part brings about.
    """

    steps: list[int] = field(default_factory=list)
    targets: dict[int, list[Target]] = field(default_factory=dict)
    after: set[int] = field(default_factory=set)
    pinned: bool = False
    final: bool = False


class Roles:
    """The roles of an action's variables when its steps are given to robots. Variables are indices.

    :ivar robot: the robot.
    :ivar determined: the variables that are functionally determined by the robot: permanently, such as its gripper
        (tools), or by its state, such as its location; each with the predicate of the determining fact and the robot's
        position in it.
    :ivar tools: those that are determined permanently.
    :ivar essential: all other variables; they define the purpose of a step.
    :ivar is_move: whether the action changes only facts about the robot.
    """

    def __init__(self, task: PlanningTask, action: Action) -> None:
        self.action = action
        self._index = {v.name: i for i, v in enumerate(action.variables)}
        self._init = task.init
        self.robot = self._index[action.robot]
        conditions = task.grounder(action.name).conditions
        about_robot = [
            part
            for part in conditions
            if isinstance(part, Atom) and len(part.terms) == 2 and action.robot in part.terms
        ]
        static = self._determined([atom for atom in about_robot if atom.predicate not in task.changed])
        self.tools = {i: found for i, found in static.items() if self._is_functional(*found)}
        own = {action.robot, *(action.variables[i].name for i in self.tools)}
        effects = (*action.effects, *action.during)
        self.is_move = all(action.robot in e.atom.terms and not e.each for e in effects)
        # Static facts may relate the start of a move to its end, but make the location of other actions essential.
        named = [
            atom
            for part in conditions
            for atom, _ in literals(part)
            if len(atom.terms) > 1 and not (self.is_move and atom.predicate not in task.changed)
        ]
        named += [e.atom for e in effects]
        states = {
            i: found
            for i, found in self._determined([a for a in about_robot if a.predicate in task.changed]).items()
            if i not in self.tools and _occurs_only_with(own, action.variables[i].name, named)
        }
        self.determined = {**self.tools, **states}
        self.essential = [i for i in range(len(action.variables)) if i != self.robot and i not in self.determined]

    def move_effects(self) -> Iterator[tuple[Predicate, int, list[int]]]:
        """Yields the facts that the action makes true, if it is a move whose other parameters are determined: their
        predicate, the robot's position, and the variables of the terms.
        """
        for effect in self.action.effects if self.is_move else ():
            terms = [self._index.get(term, -1) for term in effect.atom.terms]
            if effect.state and -1 not in terms and set(self.essential) <= set(terms):
                yield effect.atom.predicate, terms.index(self.robot), terms

    def _determined(self, atoms: Iterable[Atom]) -> dict[int, tuple[Predicate, int]]:
        """Returns the other variable of each binary atom about the robot, with the atom's predicate and the robot's
        position; of several atoms, the first.
        """
        found: dict[int, tuple[Predicate, int]] = {}
        for atom in atoms:
            position = atom.terms.index(self.action.robot)
            other = self._index.get(atom.terms[1 - position], self.robot)
            if other != self.robot:
                found.setdefault(other, (atom.predicate, position))
        return found

    def _is_functional(self, predicate: Predicate, position: int) -> bool:
        """Whether the other term of an initial fact belongs to one robot only."""
        others = [atom.terms[1 - position] for atom in self._init if atom.predicate == predicate]
        return len(others) == len(set(others))


def _occurs_only_with(own: Collection[str], name: str, atoms: Iterable[Atom]) -> bool:
    """Whether every atom with a variable also has the robot or one of its tools."""
    return all(any(t in own for t in a.terms) for a in atoms if name in a.terms)


#: Actions that change only facts about the robot, by the predicate that they make true and the robot's position in it,
#: with the variable of each term. Their other parameters are functionally determined by the robot.
Moves = Mapping[tuple[Predicate, int], Sequence[tuple[Roles, list[int]]]]


def find_moves(actions: Iterable[Roles]) -> Moves:
    """Returns the moves among actions."""
    found: dict[tuple[Predicate, int], list[tuple[Roles, list[int]]]] = {}
    for roles in actions:
        for predicate, position, terms in roles.move_effects():
            found.setdefault((predicate, position), []).append((roles, terms))
    return found


def split_plan(task: PlanningTask, order: PartialOrder, actions: Mapping[str, Roles], moves: Moves) -> list[Part]:
    """Returns the parts of a plan. A move belongs to a part only if it matters which robot moves."""
    return _Splitter(task, order, actions, moves).split()


class _Splitter:
    def __init__(self, task: PlanningTask, order: PartialOrder, actions: Mapping[str, Roles], moves: Moves) -> None:
        self._init = task.init
        self._order = order
        self._moves = moves
        self._steps = [task.ground(step) for step in order.steps]
        self._roles = [actions[step.action] for step in order.steps]
        self._robots = [step.robot for step in self._steps]
        #: The robot and its tools, the essential arguments and the arguments determined by the robot's state, by step.
        together = [(step.arguments, roles) for step, roles in zip(order.steps, self._roles, strict=True)]
        self._own = [{values[i] for i in (roles.robot, *roles.tools)} for values, roles in together]
        self._essential = [{values[i] for i in roles.essential} for values, roles in together]
        self._state = [{values[i] for i in roles.determined.keys() - roles.tools} for values, roles in together]

    def split(self) -> list[Part]:
        """See `split_plan`."""
        links = self._order.links
        pinned = {link.producer: link for link in links if self._pins(link)}
        final = {link.producer for link in links if link.consumer == GOAL} & pinned.keys()
        moving = {id(roles) for some in self._moves.values() for roles, _ in some}
        group = {i: i for i, roles in enumerate(self._roles) if i in pinned or id(roles) not in moving}
        for link in links:
            if link.producer in group and link.consumer in group and self._requires_same_robot(link):
                old, new = group[link.consumer], group[link.producer]
                group = {i: new if g == old else g for i, g in group.items()}
        parts = {g: Part() for g in group.values()}
        for i, g in group.items():
            parts[g].steps.append(i)
            parts[g].pinned |= i in pinned
            parts[g].final |= i in final
        for link in links:
            if link.consumer in group and link.producer not in group:
                self._add_target(link, parts[group[link.consumer]])
        numbers = {g: number for number, g in enumerate(parts)}
        for i, j, atom in ordering_constraints(links, self._changes(group)):
            apart = i in group and j in group and group[i] != group[j]
            if apart and (self._robots[i] != self._robots[j] or not self._is_about_robot(j, atom)):
                parts[group[j]].after.add(numbers[group[i]])
        return list(parts.values())

    def _is_about_robot(self, index: int, atom: Atom) -> bool:
        """Whether a fact is about the robot of a step, or its tools."""
        return not self._own[index].isdisjoint(atom.terms)

    def _pins(self, link: CausalLink) -> bool:
        """Whether a link is about the robot of its producer, and the goal or another robot needs it."""
        i, j = link.producer, link.consumer
        return i != INIT and (j == GOAL or self._robots[i] != self._robots[j]) and self._is_about_robot(i, link.atom)

    def _requires_same_robot(self, link: CausalLink) -> bool:
        """Whether the robot of a link's producer must execute its consumer."""
        i, j, atom = link.producer, link.consumer, link.atom
        if self._robots[i] != self._robots[j] or not self._is_about_robot(j, atom):
            return False
        if not self._state[j].isdisjoint(atom.terms):
            return False
        # A fact that held initially is likely to hold for other robots as well.
        return not self._essential[j].isdisjoint(atom.terms) or (atom in self._init) != link.state

    def _add_target(self, link: CausalLink, part: Part) -> None:
        robot, terms = self._robots[link.consumer], link.atom.terms
        if link.state and robot in terms and self._essential[link.consumer].issuperset(t for t in terms if t != robot):
            target = Target(link.atom.predicate, terms.index(robot), terms)
            if (target.predicate, target.position) in self._moves:
                part.targets.setdefault(link.consumer, []).append(target)

    def _changes(self, steps: Iterable[int]) -> dict[Atom, list[tuple[int, bool]]]:
        found: dict[Atom, list[tuple[int, bool]]] = {}
        for i in steps:
            for some in (self._steps[i].during, self._steps[i].effects):
                for atom, state in some.items():
                    found.setdefault(atom, []).append((i, state))
        return found
