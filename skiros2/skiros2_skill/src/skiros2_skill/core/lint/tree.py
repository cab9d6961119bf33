"""What can be wrong with the tree of a compound: its children, their remaps and their fixed values."""

from __future__ import annotations

import threading
from collections.abc import Iterable, Iterator
from typing import Any

from skiros2_common.core.errors import SkirosError, UnknownName
from skiros2_common.core.names import full_name, nearest
from skiros2_common.core.params import Param, ParamTypes
from skiros2_skill.core.lint.description import fits, type_name
from skiros2_skill.core.lint.linter import ERROR, NOTE, UNKNOWN_SKILL, WARNING, Described, Fault, Linter, OnlyReads
from skiros2_skill.core.tree.node import SkillInterface, all_nodes
from skiros2_skill.core.tree.skill_node import SkillWrapper

_PATIENCE = 0.5  # s that an `expand` may take when nothing runs


class _Libraries:
    """What the nodes of a tree that is only tried have for a library: skills that are not there are faults of it."""

    def __init__(self, wmi: Any, linter: Linter) -> None:
        self.wmi = wmi
        self._linter = linter

    def candidates(self, stype: str, label: str) -> list[Described]:
        """See `SkillLibrary.candidates`."""
        found = self._linter.options(full_name(stype), label)
        if not found:
            raise UnknownName(f"no library has a skill of type {stype}")
        return found

    def require_type(self, stype: str, label: str) -> None:
        """See `SkillLibrary.require_type`."""


def tree_faults(described: Described, linter: Linter) -> Iterator[Fault]:
    """The faults of a compound's tree; none for a primitive, or when each start may make another one."""
    if not described.is_compound or described.skill.expand_on_start:
        return
    trees = Trees(linter)
    root = trees.of(described)
    if root is None:
        reason = trees.reasons[described.cls]
        if reason:
            yield described.fault(NOTE, "not-checked", f"its tree depends on values: {reason}")
        else:
            text = f"its expand takes more than {_PATIENCE} s: it holds up what runs beside it"
            yield described.fault(WARNING, "slow-expand", text)
        return
    for node in _skills_under(root):
        yield from _child_faults(described, root, node, trees)


class Trees:
    """The trees of compounds, made without values. For one check."""

    def __init__(self, linter: Linter) -> None:
        self.linter = linter
        self.reasons: dict[type, str] = {}
        self._roots: dict[type, SkillWrapper | None] = {}
        self._names: dict[type, tuple[set[str], bool]] = {}

    def of(self, described: Described) -> SkillWrapper | None:
        """The tree of a compound under a node for itself; None when it cannot be made without values."""
        if described.cls not in self._roots:
            self._roots[described.cls] = self._expanded(described)
        return self._roots[described.cls]

    def _expanded(self, described: Described) -> SkillWrapper | None:
        # An instance for this alone, which never has more of the world model than this: `expand` may go on.
        wmi = OnlyReads(self.linter.wmi)
        skill = described.instance(wmi)
        skill._instanciator = _Libraries(wmi, self.linter)
        root = SkillWrapper(skill.type, skill.label, skill._instanciator)
        root._instance = skill
        root.adopt_description()
        outcome: list[str] = []

        def expand() -> None:
            try:
                root.wrapper_expand()
                outcome.append("")
            except Exception as error:
                outcome.append(f"expand raised {type(error).__name__}: {error}")

        thread = threading.Thread(target=expand, name=f"{skill.label}.expand", daemon=True)
        thread.start()
        thread.join(_PATIENCE)
        self.reasons[described.cls] = outcome[0] if outcome else ""
        return root if outcome == [""] else None

    def options(self, node: SkillWrapper) -> list[Described]:
        """The implementations that a node may take."""
        return self.linter.options(node.type, node.asked_label)

    def way_back(self, start: Described, node: SkillWrapper, seen: set[type]) -> list[Described]:
        """The compounds by which a node leads to that one again where none has an alternative, and that one; or none.

        :param seen: the classes that were followed before; grows.
        """
        options = self.options(node)
        if len(options) != 1 or options[0].cls in seen:
            return []
        (only,) = options
        seen.add(only.cls)
        if only.cls is start.cls:
            return [only]
        if not only.is_compound or only.skill.expand_on_start:
            return []
        root = self.of(only)
        for below in _skills_under(root) if root is not None else ():
            way = self.way_back(start, below, seen)
            if way:
                return [only, *way]
        return []

    # A key of a node may be one of its skill, or one that a skill under it takes from above.

    def names(self, node: SkillWrapper) -> tuple[set[str], bool]:
        """The keys of a node, and whether there may be others."""
        found: set[str] = set()
        others = False
        options = self.options(node)
        for option in options:
            names, is_open = self._names_of(option)
            found |= names
            others |= is_open
        return found, others or not options

    def _names_of(self, described: Described) -> tuple[set[str], bool]:
        known = self._names.get(described.cls)
        if known is not None:
            return known
        names, is_open = set(described.skill.params.keys()), described.is_open
        self._names[described.cls] = (names, is_open)  # of a compound in itself nothing more is known
        if described.is_compound:
            root = self.of(described)
            below, more = self.names_above(root._children) if root is not None else (set(), True)
            names, is_open = names | below, is_open or more
            self._names[described.cls] = (names, is_open)
        return names, is_open

    def names_above(self, nodes: Iterable[Any]) -> tuple[set[str], bool]:
        """The names that some nodes take from the node above, and whether there may be others."""
        found: set[str] = set()
        others = False
        for node in nodes:
            names, is_open = self.names(node) if isinstance(node, SkillWrapper) else self.names_above(node._children)
            found |= {node.name_above(name) for name in names}
            others |= is_open
        return found, others

    def names_around(self, described: Described, root: SkillWrapper, node: SkillWrapper) -> tuple[set[str], bool]:
        """The names that a compound, those that contain it, and what else is in their trees have; whether there may be
        others.

        :param root, node: the compound's tree, and the child whose own names do not count.
        """
        names, is_open = self._names_in(root, node)
        names |= set(described.skill.params.keys())
        is_open |= described.is_open
        around, seen = [described], {described.cls}
        while around:
            inner = around.pop()
            for outer in self.linter.all():
                tree = self.of(outer) if outer.is_compound and outer.cls not in seen else None
                holders = [n for n in _skills_under(tree) if inner in self.options(n)] if tree is not None else []
                if tree is None or not holders:
                    continue
                seen.add(outer.cls)
                around.append(outer)
                above, more = self._names_in(tree, holders[0] if len(holders) == 1 else None)
                names |= above | set(outer.skill.params.keys())
                is_open |= more or outer.is_open
        return names, is_open

    def _names_in(self, root: SkillWrapper, but: SkillWrapper | None) -> tuple[set[str], bool]:
        """The names that the nodes of a tree have at its root, and whether there may be others."""
        found: set[str] = set()
        is_open = False
        for node in _skills_under(root):
            if node is not but:
                names, others = self.names(node)
                found |= {_name_at(root, node, name) for name in names}
                found |= {_name_at(root, node, node.own_name(name)) for name in node._specified}
                is_open |= others
        return found, is_open


def _child_faults(described: Described, root: SkillWrapper, node: SkillWrapper, trees: Trees) -> Iterator[Fault]:
    options = trees.options(node)
    if not options:
        yield _unknown_skill(described, node, trees)
        return
    names, is_open = trees.names(node)
    child = f"{node.type}{f'-{node.asked_label}' if node.asked_label else ''}"
    if not is_open:
        for key in node._remaps:
            if key not in names:
                text = f"remap of {key!r}: {child} has no such parameter, and no skill under it{_near(key, names)}"
                yield described.fault(WARNING, "unknown-remap", text, node.place, "loaded; the remap has no effect")
    yield from _target_faults(described, root, node, options, child, trees)
    yield from _fixed_faults(described, node, options, child)
    yield from _pre_condition_faults(described, node, options, child)
    yield from _type_faults(described, root, node, options, child, trees.linter.wmi)
    yield from _missing(described, root, node, options, child, trees)
    way = trees.way_back(described, node, set())
    if way and trees.linter.tells_cycle([step.cls for step in way], described.cls, node.place):
        through = " and ".join(step.name for step in way[:-1])
        text = f"it is a part of itself{f' through {through}' if through else ''}, without an alternative"
        yield described.fault(WARNING, "recursion", text, node.place)


def _skills_under(root: SkillWrapper) -> list[SkillWrapper]:
    return [node for node in all_nodes(root) if isinstance(node, SkillWrapper) and node is not root]


def _unknown_skill(described: Described, node: SkillWrapper, trees: Trees) -> Fault:
    labels = [d.skill.label for d in trees.linter.all() if d.skill.type == node.type]
    if labels:
        text = f"no implementation {node.asked_label!r} of {node.type}; there are: {', '.join(labels)}"
    else:
        text = (
            f"no library has a skill of type {node.type}{_near(node.type, {d.skill.type for d in trees.linter.all()})}"
        )
    return described.fault(ERROR, UNKNOWN_SKILL, text, node.place, "loaded; it fails unless a library brings it")


def _fixed_faults(described: Described, node: SkillWrapper, options: list[Described], child: str) -> Iterator[Fault]:
    if any(option.is_open for option in options):
        return
    for name, values in node._specified.items():
        key = node.own_name(name)
        having = [param for option in options if (param := _param(option, key)) is not None]
        if not having:
            known = {node.name_above(k) for option in options for k in option.skill.params}
            text = f"specify of {name!r}: {child} has no such parameter{_near(name, known)}"
            yield described.fault(WARNING, "unknown-specify", text, node.place, "loaded; the value is ignored")
        elif all(reasons := [_refusal(param, values) for param in having]):
            text = f"specify of {name!r} for {child}: {reasons[0]}"
            yield described.fault(WARNING, "wrong-type", text, node.place, "loaded; the value is ignored")


def _refusal(param: Param, values: Any) -> str:
    """Why a parameter does not take these values; "" when it does."""
    try:
        param.clone().assign(values)
    except SkirosError as error:
        return str(error)
    return ""


def _pre_condition_faults(
    described: Described, node: SkillWrapper, options: list[Described], child: str
) -> Iterator[Fault]:
    if any(option.is_open for option in options):
        return
    for condition in node.own_pre_conditions:
        for key in condition.getKeys():
            if all(_param(option, key) is None for option in options):
                text = f"pre-condition [{condition.label}] speaks of {key!r}; {child} has no such parameter"
                done = "loaded; the child fails where it is checked"
                yield described.fault(WARNING, "unknown-key", text, node.place, done)


def _type_faults(
    described: Described, root: SkillWrapper, node: SkillWrapper, options: list[Described], child: str, wmi: Any
) -> Iterator[Fault]:
    """Keys of a child that stand for a parameter of the compound of another type."""
    own = described.skill.params.getParamMap()
    for key in dict.fromkeys(key for option in options for key in option.skill.params):
        name = _name_at(root, node, key)
        outer = own.get(name)
        if outer is None or node.name_above(key) in node._specified:
            continue
        having = [param for option in options if (param := _param(option, key)) is not None]
        if not any(fits(param, outer, wmi) for param in having):
            text = f"{key!r} of {child} is {type_name(having[0])}, {name!r} of the compound is {type_name(outer)}"
            both = having[0].is_element and outer.is_element
            done = "loaded; an element of any class is passed" if both else "loaded; the child keeps its own value"
            yield described.fault(WARNING, "wrong-type", text, node.place, done)


def _target_faults(
    described: Described, root: SkillWrapper, node: SkillWrapper, options: list[Described], child: str, trees: Trees
) -> Iterator[Fault]:
    """Remaps to names that nothing above or beside the child has: it takes nothing from there."""
    for key in node._remaps:
        having = [param for option in options if (param := _param(option, key)) is not None]
        name = _name_at(root, node, key)
        fixed = node.name_above(key) in node._specified
        if fixed or not having or all(param.paramTypeIs(ParamTypes.Optional) for param in having):
            continue
        known, is_open = trees.names_around(described, root, node)
        if is_open or name in known:
            continue
        text = f"remap of {key!r} of {child} to {name!r}: no skill above or beside it has that{_near(name, known)}"
        yield described.fault(WARNING, "unknown-target", text, node.place, "loaded; the child gets no value by it")


def _missing(
    described: Described, root: SkillWrapper, node: SkillWrapper, options: list[Described], child: str, trees: Trees
) -> Iterator[Fault]:
    """Required values of a child that nothing in the tree can set."""
    for key in dict.fromkeys(key for option in options for key in option.skill.params):
        if not all(_has_to_be_given(_param(option, key)) for option in options):
            continue
        name = _name_at(root, node, key)
        if node.name_above(key) in node._specified or described.skill.params.hasParam(name):
            continue
        others, is_open = trees.names_above([n for n in root._children if not node.inSubtreeOf(n)])
        beside = [n for n in all_nodes(root) if isinstance(n, SkillWrapper) and n not in (node, root)]
        others |= {_name_at(root, n, k) for n in beside for k in trees.names(n)[0]}
        if is_open or name in others:
            continue
        elsewhere = any(
            d.skill.params.hasParam(name) for d in trees.linter.all() if d.cls not in [o.cls for o in options]
        )
        text = f"{child} requires {key!r}, and nothing in the tree sets it"
        text += "; it has to come from a skill outside" if elsewhere else f" (no skill has a parameter {name!r})"
        yield described.fault(WARNING, "never-set", text, node.place, "loaded; a start without it fails")


def _has_to_be_given(param: Param | None) -> bool:
    return (
        param is not None
        and param.paramTypeIs(ParamTypes.Required)
        and not param.is_element
        and not param.has_bound_default()
    )


def _name_at(root: SkillWrapper, node: SkillInterface, key: str) -> str:
    """The name that a key of a node has at the compound."""
    name = node.name_above(key)
    above = node.parent
    while above is not None and above is not root:
        name = above.name_above(name)
        above = above.parent
    return name


def _param(described: Described, key: str) -> Param | None:
    params: dict[str, Param] = described.skill.params.getParamMap()
    return params.get(key)


def _near(name: str, known: Iterable[str]) -> str:
    near = nearest(name, known, 2)
    return f"; near: {', '.join(near)}" if near else ""
