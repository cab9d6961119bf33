"""Plans cut into parts that one robot has to do, for `reassignment` to deal out."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field

from skiros2_task.core.formula import Atom
from skiros2_task.core.ground_actions import Facts, GroundAction
from skiros2_task.core.partial_order import GOAL, INIT, CausalLink, PartialOrder, changes_of, reasons
from skiros2_task.core.task import PlanningTask


@dataclass(frozen=True)
class Place:
    """A fact about the robot that a step needs, and that the robot can bring about by moving.

    :param number: of its predicate.
    :param place: of the robot among the terms.
    """

    number: int
    place: int
    terms: tuple[str, ...]


@dataclass
class Part:
    """Steps that one robot has to do together.

    :param steps: their indices in the plan.
    :param places: for each step where the robot has to be, and the like.
    :param after: the indices of the parts that have to be done before.
    :param pinned: it has to be done by the robot that the plan gave it to.
    :param last: it says where its robot has to be in the end.
    """

    steps: list[int] = field(default_factory=list)
    places: dict[int, list[Place]] = field(default_factory=dict)
    after: set[int] = field(default_factory=set)
    pinned: bool = False
    last: bool = False


#: The actions that change nothing but the robot's state, by the number of the predicate that they make true and the
#: robot's place in it, with the variables of its terms. What else they need follows from the robot.
Moves = Mapping[tuple[int, int], Sequence[tuple[GroundAction, list[int]]]]


def moves_of(actions: Collection[GroundAction], facts: Facts) -> Moves:
    """The moves among actions."""
    found: dict[tuple[int, int], list[tuple[GroundAction, list[int]]]] = {}
    for ground in actions:
        index = {v.name: i for i, v in enumerate(ground.action.variables)}
        for effect in ground.action.effects if ground.moves else ():
            terms = [index.get(t, -1) for t in effect.atom.terms]
            if effect.state and -1 not in terms and set(ground.essential) <= set(terms):
                key = facts.number(effect.atom.predicate), terms.index(ground.robot)
                found.setdefault(key, []).append((ground, terms))
    return found


def cut(
    task: PlanningTask, order: PartialOrder, actions: Mapping[str, GroundAction], moves: Moves, facts: Facts
) -> list[Part]:
    """The parts of a plan. Moves belong to none, unless it matters that it is that robot which moves."""
    return _Cutter(task, order, actions, moves, facts).parts()


class _Cutter:
    def __init__(
        self, task: PlanningTask, order: PartialOrder, actions: Mapping[str, GroundAction], moves: Moves, facts: Facts
    ) -> None:
        self._task = task
        self._order = order
        self._moves = moves
        self._facts = facts
        self._ground = [actions[step.action] for step in order.steps]
        together = list(zip(order.steps, self._ground, strict=True))
        self._robots = [step.arguments[ground.robot] for step, ground in together]
        #: The robot and its tools, and what the step is for.
        self._own = [{step.arguments[i] for i in (ground.robot, *ground.tools)} for step, ground in together]
        self._essential = [{step.arguments[i] for i in ground.essential} for step, ground in together]
        self._state = [{step.arguments[i] for i in ground.states} for step, ground in together]

    def parts(self) -> list[Part]:
        """See `cut`."""
        links = self._order.links
        pinned = {link.producer: link for link in links if self._pins(link)}
        ends = {link.producer for link in links if link.consumer == GOAL} & pinned.keys()
        moving = {id(ground) for some in self._moves.values() for ground, _ in some}
        group = {i: i for i, g in enumerate(self._ground) if i in pinned or id(g) not in moving}
        for link in links:
            if link.producer in group and link.consumer in group and self._binds(link):
                old, new = group[link.consumer], group[link.producer]
                group = {i: new if g == old else g for i, g in group.items()}
        parts = {g: Part() for g in group.values()}
        for i, g in group.items():
            parts[g].steps.append(i)
            parts[g].pinned |= i in pinned
            parts[g].last |= i in ends
        for link in links:
            if link.consumer in group and link.producer not in group:
                self._note_place(link, parts[group[link.consumer]])
        numbers = {g: number for number, g in enumerate(parts)}
        for i, j, atom in reasons(links, self._touched(group)):
            apart = i in group and j in group and group[i] != group[j]
            if apart and (self._robots[i] != self._robots[j] or not self._private(j, atom)):
                parts[group[j]].after.add(numbers[group[i]])
        return list(parts.values())

    def _private(self, index: int, atom: Atom) -> bool:
        """Whether a fact is about the robot of a step, or its tools."""
        return not self._own[index].isdisjoint(atom.terms)

    def _pins(self, link: CausalLink) -> bool:
        """Whether a link is about the robot of its producer, and somebody else relies on it."""
        i, j = link.producer, link.consumer
        return i != INIT and (j == GOAL or self._robots[i] != self._robots[j]) and self._private(i, link.atom)

    def _binds(self, link: CausalLink) -> bool:
        """Whether the consumer of a link has to be done by the robot of its producer."""
        i, j, atom = link.producer, link.consumer, link.atom
        if self._robots[i] != self._robots[j] or not self._private(j, atom):
            return False
        if not self._state[j].isdisjoint(atom.terms):
            return False
        # What was so at the start is likely to be so of other robots, too.
        return not self._essential[j].isdisjoint(atom.terms) or (atom in self._task.init) != link.state

    def _note_place(self, link: CausalLink, part: Part) -> None:
        robot, terms = self._robots[link.consumer], link.atom.terms
        if link.state and robot in terms and self._essential[link.consumer].issuperset(t for t in terms if t != robot):
            place = Place(self._facts.number(link.atom.predicate), terms.index(robot), terms)
            if (place.number, place.place) in self._moves:
                part.places.setdefault(link.consumer, []).append(place)

    def _touched(self, steps: Collection[int]) -> dict[Atom, list[tuple[int, bool]]]:
        found: dict[Atom, list[tuple[int, bool]]] = {}
        for i in steps:
            changes = changes_of(self._task, self._order.steps[i])
            for some in (changes.during, changes.made):
                for atom, state in some.items():
                    found.setdefault(atom, []).append((i, state))
        return found
