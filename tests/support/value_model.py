"""A reference model of how values reach skills: random programs, and what each skill must see.

A program is a sequence of leaves and groups (compounds) that share the keys A and B of a blackboard. A leaf notes the
elements that it has, waits one tick, notes them again, and then does something with them. The model knows a world of
elements with a weight and a place (which others change) and a note (which skills write); it is written from
`docs/compatibility.md` and shares no code with the engine. A run of the model is a generator that yields once for each
tick.
"""

from __future__ import annotations

import random
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass, field, replace
from typing import Any

GIVEN, INFERRED, ASSIGNED = "given", "inferred", "assigned"
REQUIRED, OPTIONAL, WISHED = "Required", "Optional", "Inferred"
KEYS = ("A", "B")
SEQUENCE, RETRY, PARALLEL = "sequence", "retry", "parallel"


@dataclass
class Node:
    """A leaf, or a group with children. Nodes with one name have one skill type.

    :param kinds: of the parameters, by own key.
    :param names: the name of each own key in the parent, also of keys that only nodes below have.
    :param weights: the weight that a pre-condition wants, by own key.
    :param fixed, suggested: the numbers of elements, by own key.
    :param acts: of a leaf: (what, own key or number of an element, number), in this order.
    :param fails: whether the leaf fails when its type ends for the first time in a task.
    :param processor: of a group.
    """

    name: str
    kinds: dict[str, str]
    names: dict[str, str]
    weights: dict[str, float] = field(default_factory=dict)
    fixed: dict[str, int] = field(default_factory=dict)
    suggested: dict[str, int] = field(default_factory=dict)
    acts: list[tuple[str, Any, int]] = field(default_factory=list)
    fails: bool = False
    children: list[Node] = field(default_factory=list)
    processor: str = SEQUENCE


@dataclass(eq=False)
class Item:
    """An element in a list of values.

    :param note: set in place, and not written; None: the world's.
    """

    number: int
    note: str | None = None


class World:
    """The elements that exist: weight, place and note by number, which is the order of their ids."""

    def __init__(self, weights: list[float]) -> None:
        self.weight: dict[int, float] = dict(enumerate(weights))
        self.place: dict[int, int] = dict.fromkeys(self.weight, 0)
        self.note: dict[int, str] = dict.fromkeys(self.weight, "")

    def remove(self, number: int) -> None:
        self.weight.pop(number, None)

    def seen(self, items: list[Item]) -> list[tuple[int, float, int, str]]:
        return [
            (i.number, self.weight[i.number], self.place[i.number], self.note[i.number] if i.note is None else i.note)
            for i in items
        ]


class Failed(Exception):
    """A skill has failed."""


@dataclass
class _Entry:
    items: list[Item]  # the list that all holders of the key share
    origin: str


def _numbers(items: list[Item] | None) -> list[int]:
    return [item.number for item in items or []]


class _Held:
    """A parameter of a running node."""

    def __init__(self, key: str, kind: str) -> None:
        self.key, self.kind = key, kind
        self.items: list[Item] | None = None  # None: the abstract element of the declaration
        self.origin = GIVEN
        self.bound: list[int] = []
        self.ignored: list[Item] | None = None  # a list with elements that are gone
        self.fixed: list[int] | None = None

    def bind(self, items: list[Item], origin: str) -> None:
        self.items, self.origin, self.bound = items, origin, _numbers(items)


class Model:
    """A task in the model.

    :param log: (node, own key, what it sees) for every look of a leaf.
    """

    def __init__(self, program: list[Node], world: World) -> None:
        self.program, self.world = program, world
        self.board: dict[str, _Entry] = {}
        self.log: list[tuple[str, str, Any]] = []
        self.failed = ""
        self._ended: set[str] = set()
        self._notes = 0

    def run(self) -> Iterator[None]:
        try:
            for node in self.program:
                yield from self._node(node, {})
        except Failed as failure:
            self.failed = str(failure)

    def _node(self, node: Node, scope: dict[str, str]) -> Iterator[None]:
        keys = {key: scope.get(name, name) for key, name in node.names.items()}
        held = self._start(node, keys)
        self._push(held, set())
        try:
            if node.children:
                with closing(self._group(node, keys)) as ticks:
                    for _ in ticks:
                        for param in held.values():
                            self._drop_missing(param)  # what a node below has removed in this tick
                        yield
                        self._refresh(held)  # each tick begins with the nodes above
            else:
                self._look(node, held)
                yield
                self._refresh(held, node.name)
                self._look(node, held)
                is_first = node.name not in self._ended
                self._ended.add(node.name)
                self._act(node, held)
                if node.fails and is_first:
                    raise Failed(node.name)
        except GeneratorExit:
            self._refresh(held)
            raise
        finally:
            if node.children:
                self._refresh(held)
            for param in held.values():
                self._drop_missing(param)
            self._push(held, set(), ends=True)

    def _group(self, node: Node, keys: dict[str, str]) -> Iterator[None]:
        if node.processor == PARALLEL:
            yield from self._parallel([self._node(child, keys) for child in node.children])
            return
        for is_last in (False, True) if node.processor == RETRY else (True,):
            try:
                for child in node.children:
                    yield from self._node(child, keys)
                return
            except Failed:
                if is_last:
                    raise
            yield

    def _parallel(self, running: list[Any]) -> Iterator[None]:
        try:
            while running:
                for each in list(running):
                    try:
                        next(each)
                    except (StopIteration, Failed) as end:
                        running.remove(each)
                        if isinstance(end, Failed):
                            raise
                if running:
                    yield
        finally:
            for each in running:
                each.close()

    # -- start ---------------------------------------------------------------------------------------------------

    def _start(self, node: Node, keys: dict[str, str]) -> dict[str, _Held]:
        held = {own: _Held(keys[own], kind) for own, kind in node.kinds.items()}
        candidates: dict[str, list[Item]] = {}
        suggested: dict[str, int] = {}
        for own, param in held.items():
            entry = self.board.get(param.key)
            if own in node.fixed:
                param.fixed = [node.fixed[own]]
                is_known = entry is not None and _numbers(entry.items) == param.fixed
                param.bind(entry.items if is_known else [Item(node.fixed[own])], GIVEN)
                if node.fixed[own] not in self.world.weight:
                    raise Failed(node.name)
            elif node.suggested.get(own) in self.world.weight:
                suggested[own] = node.suggested[own]
                if param.kind == OPTIONAL:
                    param.bind([Item(suggested[own])], GIVEN)
            elif entry is None or not entry.items:
                pass
            elif entry.origin != GIVEN and param.kind != OPTIONAL and len(entry.items) == 1:
                candidates[own] = entry.items
            else:
                param.bind(entry.items, entry.origin)
                is_needed = param.kind == REQUIRED or (param.kind != OPTIONAL and entry.origin == GIVEN)
                if self._drop_missing(param) and not param.items and is_needed:
                    raise Failed(node.name)
        for own in list(candidates):
            if candidates[own][0].number not in self.world.weight:
                if held[own].kind == REQUIRED:
                    raise Failed(node.name)
                held[own].ignored = candidates.pop(own)
        for own, param in held.items():
            if not param.items and param.kind != OPTIONAL:
                self._infer(node, own, param, suggested.get(own), candidates.get(own))
        for own, weight in node.weights.items():
            numbers = _numbers(held[own].items)
            if not numbers or self.world.weight[numbers[0]] != weight:
                raise Failed(node.name)
        return held

    def _infer(self, node: Node, own: str, param: _Held, suggested: int | None, candidate: list[Item] | None) -> None:
        def fits(number: int) -> bool:
            return own not in node.weights or self.world.weight[number] == node.weights[own]

        if suggested is not None and fits(suggested):
            param.bind([Item(suggested)], INFERRED)
        elif suggested is None and candidate is not None and fits(candidate[0].number):
            param.bind(candidate, self.board[param.key].origin)
        else:
            on_board = {n for entry in self.board.values() for n in _numbers(entry.items)}
            found = sorted(filter(fits, self.world.weight), key=lambda n: (n not in on_board, n))
            if found:
                param.bind([Item(found[0])], INFERRED)
            elif own in node.weights or param.kind == REQUIRED:
                raise Failed(node.name)

    # -- run -----------------------------------------------------------------------------------------------------

    def _refresh(self, held: dict[str, _Held], leaf: str = "") -> None:
        for param in held.values():
            entry = self.board.get(param.key)
            if entry is None or not entry.items or entry.items is param.ignored:
                pass
            elif entry.items is not param.items:
                same = _numbers(entry.items) == (param.fixed or _numbers(param.items))
                keeps = param.fixed or (entry.origin == INFERRED and param.kind != OPTIONAL and param.items)
                if same or not keeps:
                    param.bind(entry.items, GIVEN if param.fixed else entry.origin)
            if self._drop_missing(param) and leaf:
                raise Failed(leaf)

    def _look(self, node: Node, held: dict[str, _Held]) -> None:
        for own, param in held.items():
            self.log.append((node.name, own, self.world.seen(param.items or [])))

    def _act(self, node: Node, held: dict[str, _Held]) -> None:
        changed: set[str] = set()  # keys whose lists have changed or were assigned
        written: set[str] = set()  # only the latter
        for what, where, number in node.acts:
            if what in ("reweigh", "move", "remove"):
                self._act_of_others(what, where, number)
                continue
            items = held[where].items
            if what in ("note", "change"):
                if items:
                    self._notes += 1
                    items[0].note = f"{node.name} {self._notes}"
                    written |= {where} if what == "note" else set()
            elif what == "pop":
                if items:
                    items.pop(0)
                    changed.add(where)
            elif what == "unset":
                held[where].items = []
                written.add(where)
            elif number in self.world.weight:
                written.add(where)
                if what == "add" and items:
                    items.append(Item(number))
                elif what == "in place" and items:
                    items[0] = Item(number)
                else:
                    held[where].items = [Item(number)]
        for own in changed | written:
            if _numbers(held[own].items) != held[own].bound:
                held[own].origin, held[own].bound = ASSIGNED, _numbers(held[own].items)
        try:
            self._write(
                node, held, [i for own in held if own in written for i in held[own].items or [] if i.note is not None]
            )
        finally:  # also when the world refuses what the skill has written
            self._push(held, changed | written)

    def _act_of_others(self, what: str, number: int, value: int) -> None:
        if number not in self.world.weight:
            return
        if what == "reweigh":
            self.world.weight[number] = float(value)
        elif what == "move":
            self.world.place[number] = value
        else:
            self.world.remove(number)

    def _write(self, node: Node, held: dict[str, _Held], items: list[Item]) -> None:
        if any(item.number not in self.world.weight for item in items):  # all or nothing
            for param in held.values():
                for item in param.items or []:
                    item.note = None
            raise Failed(node.name)
        for item in items:
            self.world.note[item.number], item.note = str(item.note), None

    def _push(self, held: dict[str, _Held], changed: set[str], ends: bool = False) -> None:
        for own, param in held.items():
            entry = self.board.get(param.key)
            if param.items is None:
                continue
            if not param.items:
                # where its elements are gone, what another skill has set since stays
                is_own = param.ignored is None or entry is None or entry.items is param.ignored
                if own in changed or (ends and is_own):
                    self.board.pop(param.key, None)
            elif entry is None or entry.items is not param.items:
                self.board[param.key] = _Entry(param.items, param.origin)
            elif own in changed or (param.origin == GIVEN and param.bound == _numbers(param.items)):
                entry.origin = param.origin

    def _drop_missing(self, param: _Held) -> bool:
        kept = [i for i in param.items or [] if i.number in self.world.weight]
        if param.items is None or len(kept) == len(param.items):
            return False
        param.ignored, param.items = param.items, kept
        return True


# -- random programs -------------------------------------------------------------------------------------------------


def random_program(rng: random.Random, prefix: str, elements: int, length: int = 5) -> list[Node]:
    """A program of leaves and groups; some are of the type of an earlier one, as steps of a plan are."""
    numbers = iter(range(1000))
    types: dict[tuple[int, tuple[str, ...]], list[Node]] = {}

    def values(made: Node) -> Node:
        made = replace(made, fixed={}, suggested={})
        for key, kind in made.kinds.items():
            way = rng.random()
            if way < 0.15:
                made.fixed[key] = rng.randrange(elements)
            elif way < 0.4 and kind == WISHED:
                made.suggested[key] = rng.randrange(elements)
        return made

    def node(depth: int, above: tuple[str, ...] = KEYS) -> Node:
        known = types.setdefault((depth, above), [])
        if known and rng.random() < 0.3:
            return values(rng.choice(known))
        both = ("P", "Q") if depth else ("X", "Y")
        names = dict(zip(both, rng.sample(above, 2), strict=True))
        own = rng.sample(both, rng.choice((1, 1, 2)))
        kinds = {key: rng.choice((REQUIRED, OPTIONAL, WISHED, WISHED)) for key in own}
        made = Node(f"{prefix}{next(numbers)}", kinds, names)
        known.append(made)
        for key in own:
            if rng.random() < 0.25 and made.kinds[key] != OPTIONAL:
                made.weights[key] = float(rng.randrange(2))
        if depth:
            made.processor = rng.choice((SEQUENCE, SEQUENCE, RETRY, PARALLEL))
            made.children = [node(0, both) for _ in range(rng.choice((1, 2, 3)))]
            return values(made)
        for key in own:
            ways = ("note", "note", "change", "in place", "anew", "unset", "add", "pop")
            made.acts.append((rng.choice(ways), key, rng.randrange(elements)))
            made.acts = made.acts if rng.random() < 0.7 else []
        for what, share in (("reweigh", 0.3), ("move", 0.3), ("remove", 0.08)):
            if rng.random() < share:
                made.acts.insert(0, (what, rng.randrange(elements), rng.randrange(2)))
        made.fails = rng.random() < 0.08
        return values(made)

    # the last one shows the blackboard; as it declares both keys, no remap is to a key that nothing provides
    last = Node(f"{prefix}last", dict.fromkeys(KEYS, OPTIONAL), {key: key for key in KEYS})
    return [*(node(int(rng.random() < 0.35)) for _ in range(length)), last]
