"""A reference model of how values reach skills: random programs, and what each skill must see.

A program is a sequence of leaves and groups (compounds) that share the keys A and B of a blackboard. A leaf notes the
elements that it has, waits one tick, notes them again, and then does something with them. The model knows a world of
elements with a weight (which others change) and a note (which skills write); it is written from `docs/compatibility.md`
and shares no code with the engine. A run of the model is a generator that yields once for each tick.
"""

from __future__ import annotations

import random
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

GIVEN, INFERRED, ASSIGNED = "given", "inferred", "assigned"
REQUIRED, OPTIONAL, WISHED = "Required", "Optional", "Inferred"
KEYS = ("A", "B")


@dataclass
class Node:
    """A leaf, or a group with children.

    :param kinds: of the parameters, by own key.
    :param names: the name of each own key in the parent, also of keys that only nodes below have.
    :param weights: the weight that a pre-condition wants, by own key.
    :param fixed, suggested: the numbers of elements, by own key.
    :param acts: of a leaf: (what, own key or number of an element, number), in this order.
    """

    name: str
    kinds: dict[str, str]
    names: dict[str, str]
    weights: dict[str, float] = field(default_factory=dict)
    fixed: dict[str, int] = field(default_factory=dict)
    suggested: dict[str, int] = field(default_factory=dict)
    acts: list[tuple[str, Any, int]] = field(default_factory=list)
    children: list[Node] = field(default_factory=list)


class World:
    """The elements that exist: weight and note by number, which is the order of their ids."""

    def __init__(self, weights: list[float]) -> None:
        self.weight: dict[int, float] = dict(enumerate(weights))
        self.note: dict[int, str] = dict.fromkeys(self.weight, "")

    def remove(self, number: int) -> None:
        self.weight.pop(number, None)
        self.note.pop(number, None)

    def seen(self, numbers: list[int]) -> list[tuple[int, float, str]]:
        return [(n, self.weight[n], self.note[n]) for n in numbers]


class Failed(Exception):
    """A skill has failed; so has its task."""


@dataclass
class _Entry:
    numbers: list[int]  # the list that all holders of the key share
    origin: str


class _Held:
    """A parameter of a running node."""

    def __init__(self, key: str, kind: str) -> None:
        self.key, self.kind = key, kind
        self.numbers: list[int] | None = None  # None: the abstract element of the declaration
        self.origin = GIVEN
        self.bound: list[int] = []
        self.ignored: list[int] | None = None  # a list with elements that are gone
        self.is_fixed = False

    def bind(self, numbers: list[int], origin: str) -> None:
        self.numbers, self.origin, self.bound = numbers, origin, list(numbers)


class Model:
    """A task in the model.

    :param log: (node, own key, what it sees) for every look of a leaf.
    """

    def __init__(self, program: list[Node], world: World) -> None:
        self.program, self.world = program, world
        self.board: dict[str, _Entry] = {}
        self.log: list[tuple[str, str, Any]] = []
        self.failed = ""

    def run(self) -> Iterator[None]:
        try:
            for node in self.program:
                yield from self._node(node, {})
        except Failed as failure:
            self.failed = str(failure)

    def _node(self, node: Node, scope: dict[str, str]) -> Iterator[None]:
        keys = {key: scope.get(name, name) for key, name in node.names.items()}
        held = self._start(node, keys)
        self._push(held, {})
        try:
            if node.children:
                for child in node.children:
                    for _ in self._node(child, keys):
                        yield
                        self._refresh(held)  # each tick begins with the nodes above
                self._refresh(held)
            else:
                self._look(node, held)
                yield
                self._refresh(held, node.name)
                self._look(node, held)
                self._act(node, held)
        finally:
            for param in held.values():
                self._drop_missing(param)
            self._push(held, {}, ends=True)

    # -- start ---------------------------------------------------------------------------------------------------

    def _start(self, node: Node, keys: dict[str, str]) -> dict[str, _Held]:
        held = {own: _Held(keys[own], kind) for own, kind in node.kinds.items()}
        candidates: dict[str, list[int]] = {}
        suggested: dict[str, int] = {}
        for own, param in held.items():
            entry = self.board.get(param.key)
            if own in node.fixed:
                param.bind([node.fixed[own]], GIVEN)
                param.is_fixed = True
                if node.fixed[own] not in self.world.weight:
                    raise Failed(node.name)
            elif node.suggested.get(own) in self.world.weight:
                suggested[own] = node.suggested[own]
                if param.kind == OPTIONAL:
                    param.bind([suggested[own]], GIVEN)
            elif entry is None or not entry.numbers:
                pass
            elif entry.origin != GIVEN and param.kind != OPTIONAL and len(entry.numbers) == 1:
                candidates[own] = entry.numbers
            else:
                param.bind(entry.numbers, entry.origin)
                if self._drop_missing(param) and not param.numbers and param.kind != OPTIONAL:
                    raise Failed(node.name)
        for own in list(candidates):
            if candidates[own][0] not in self.world.weight:
                if held[own].kind == REQUIRED:
                    raise Failed(node.name)
                del candidates[own]
        for own, param in held.items():
            if not param.numbers and param.kind != OPTIONAL:
                self._infer(node, own, param, suggested.get(own), candidates.get(own))
        for own, weight in node.weights.items():
            numbers = held[own].numbers
            if not numbers or self.world.weight[numbers[0]] != weight:
                raise Failed(node.name)
        return held

    def _infer(self, node: Node, own: str, param: _Held, suggested: int | None, candidate: list[int] | None) -> None:
        def fits(number: int) -> bool:
            return own not in node.weights or self.world.weight[number] == node.weights[own]

        if suggested is not None and fits(suggested):
            param.bind([suggested], INFERRED)
        elif suggested is None and candidate is not None and fits(candidate[0]):
            param.bind(candidate, self.board[param.key].origin)
        else:
            on_board = {n for entry in self.board.values() for n in entry.numbers}
            found = sorted(filter(fits, self.world.weight), key=lambda n: (n not in on_board, n))
            if found:
                param.bind([found[0]], INFERRED)
            elif own in node.weights or param.kind == REQUIRED:
                raise Failed(node.name)

    # -- run -----------------------------------------------------------------------------------------------------

    def _refresh(self, held: dict[str, _Held], leaf: str = "") -> None:
        for param in held.values():
            entry = self.board.get(param.key)
            if entry is None or not entry.numbers or entry.numbers is param.ignored:
                pass
            elif entry.numbers is not param.numbers:
                same = entry.numbers == param.numbers
                keeps = param.is_fixed or (entry.origin == INFERRED and param.kind != OPTIONAL and param.numbers)
                if same or not keeps:
                    param.bind(entry.numbers, GIVEN if param.is_fixed else entry.origin)
            if self._drop_missing(param) and leaf:
                raise Failed(leaf)

    def _look(self, node: Node, held: dict[str, _Held]) -> None:
        for own, param in held.items():
            self.log.append((node.name, own, self.world.seen(param.numbers or [])))

    def _act(self, node: Node, held: dict[str, _Held]) -> None:
        assigned: dict[str, bool] = {}
        for what, where, number in node.acts:
            if what == "reweigh":
                if where in self.world.weight:
                    self.world.weight[where] = float(number)
            elif what == "remove":
                self.world.remove(where)
            elif what == "note":
                numbers = held[where].numbers
                if numbers and numbers[0] in self.world.note:
                    self.world.note[numbers[0]] = f"{node.name} {number}"
                    assigned[where] = True
            else:
                param = held[where]
                assigned[where] = True
                if what == "unset":
                    param.numbers = []
                elif number not in self.world.weight:
                    del assigned[where]
                elif what == "in place" and param.numbers:
                    param.numbers[0] = number
                else:
                    param.numbers = [number]
        for own in assigned:
            if held[own].numbers != held[own].bound:
                held[own].origin, held[own].bound = ASSIGNED, list(held[own].numbers or [])
        self._push(held, assigned)

    def _push(self, held: dict[str, _Held], assigned: dict[str, bool], ends: bool = False) -> None:
        for own, param in held.items():
            entry = self.board.get(param.key)
            if param.numbers is None:
                continue
            if not param.numbers:
                if ends or own in assigned:
                    self.board.pop(param.key, None)
            elif entry is None or entry.numbers is not param.numbers:
                self.board[param.key] = _Entry(param.numbers, param.origin)
            elif own in assigned or (param.origin == GIVEN and param.bound == param.numbers):
                entry.origin = param.origin

    def _drop_missing(self, param: _Held) -> bool:
        kept = [n for n in param.numbers or [] if n in self.world.weight]
        if param.numbers is None or len(kept) == len(param.numbers):
            return False
        param.ignored, param.numbers = param.numbers, kept
        return True


# -- random programs -------------------------------------------------------------------------------------------------


def random_program(rng: random.Random, prefix: str, elements: int, length: int = 5) -> list[Node]:
    """A program of leaves and groups; some leaves are steps of a plan of the same kind."""
    numbers = iter(range(1000))

    def node(depth: int, above: tuple[str, ...] = KEYS) -> Node:
        both = ("P", "Q") if depth else ("X", "Y")
        names = dict(zip(both, rng.sample(above, 2), strict=True))
        own = rng.sample(both, rng.choice((1, 1, 2)))
        kinds = {key: rng.choice((REQUIRED, OPTIONAL, WISHED, WISHED)) for key in own}
        made = Node(f"{prefix}{next(numbers)}", kinds, names)
        for key in own:
            way = rng.random()
            if way < 0.15:
                made.fixed[key] = rng.randrange(elements)
            elif way < 0.4 and made.kinds[key] == WISHED:
                made.suggested[key] = rng.randrange(elements)
            if rng.random() < 0.25 and made.kinds[key] != OPTIONAL:
                made.weights[key] = float(rng.randrange(2))
        if depth:
            made.children = [node(0, both) for _ in range(rng.choice((1, 2, 3)))]
            return made
        for key in own:
            made.acts.append((rng.choice(("note", "note", "in place", "anew", "unset")), key, rng.randrange(elements)))
            made.acts = made.acts if rng.random() < 0.7 else []
        if rng.random() < 0.4:
            made.acts.insert(0, ("reweigh", rng.randrange(elements), rng.randrange(2)))
        if rng.random() < 0.08:
            made.acts.insert(0, ("remove", rng.randrange(elements), 0))
        return made

    # the last one shows the blackboard; as it declares both keys, no remap is to a key that nothing provides
    last = Node(f"{prefix}last", dict.fromkeys(KEYS, OPTIONAL), {key: key for key in KEYS})
    return [*(node(int(rng.random() < 0.35)) for _ in range(length)), last]
