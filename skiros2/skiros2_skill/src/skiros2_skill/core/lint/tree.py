"""Checks the tree of a compound: its children, their remaps and specified values."""

from __future__ import annotations

import threading
from collections.abc import Iterable, Iterator
from typing import Any

from skiros2_common.core.errors import SkirosError, UnknownName
from skiros2_common.core.names import full_name, nearest
from skiros2_common.core.params import Param, ParamTypes
from skiros2_common.core.source_location import SourceLocation
from skiros2_skill.core.library.description import Described, Descriptions, ReadOnlyWorldModel
from skiros2_skill.core.lint.findings import ERROR, NOTE, UNKNOWN_SKILL, WARNING, Finding, finding_of, fits, type_name
from skiros2_skill.core.tree.node import SkillInterface, all_nodes
from skiros2_skill.core.tree.skill_node import SkillWrapper

_EXPAND_TIMEOUT = 0.5  # s


class _Libraries:
    """The skill library for the nodes of a checked tree. Missing skills are findings, not errors."""

    def __init__(self, wmi: ReadOnlyWorldModel, descriptions: Descriptions) -> None:
        self.wmi = wmi
        self._descriptions = descriptions

    def candidates(self, stype: str, label: str) -> list[Described]:
        """See `SkillLibrary.candidates`."""
        found = self._descriptions.options(full_name(stype), label)
        if not found:
            raise UnknownName(f"no library has a skill of type {stype}")
        return found

    def require_type(self, stype: str, label: str) -> None:
        """See `SkillLibrary.require_type`."""


class Cycles:
    """The cycles of compounds that one linter has reported."""

    def __init__(self) -> None:
        self._reported: dict[frozenset[type], tuple[type, SourceLocation | None]] = {}

    def reports(self, classes: Iterable[type], cls: type, place: SourceLocation | None) -> bool:
        """Whether to report a cycle of classes at this source location: only the first caller reports it."""
        return self._reported.setdefault(frozenset(classes), (cls, place)) == (cls, place)


def tree_findings(described: Described, descriptions: Descriptions, cycles: Cycles) -> Iterator[Finding]:
    """The findings of a compound's tree; none for a primitive, or when every start expands again."""
    if not described.is_compound or described.skill.expand_on_start:
        return
    trees = Trees(descriptions, cycles)
    root = trees.of(described)
    if root is None:
        reason = trees.reasons[described.cls]
        if reason:
            yield finding_of(described, NOTE, "not-checked", f"its tree depends on values: {reason}")
        else:
            text = f"its expand takes more than {_EXPAND_TIMEOUT} s: it delays all other tasks"
            yield finding_of(described, WARNING, "slow-expand", text)
        return
    for node in _skills_below(root):
        yield from _child_findings(described, root, node, trees)


class Trees:
    """The trees of compounds, expanded without parameter values. For one check."""

    def __init__(self, descriptions: Descriptions, cycles: Cycles) -> None:
        self.descriptions = descriptions
        self.cycles = cycles
        self.reasons: dict[type, str] = {}
        self._roots: dict[type, SkillWrapper | None] = {}
        self._names: dict[type, tuple[set[str], bool]] = {}

    def of(self, described: Described) -> SkillWrapper | None:
        """The tree of a compound, under a node for the compound; None when it cannot be expanded without values."""
        if described.cls not in self._roots:
            self._roots[described.cls] = self._expanded(described)
        return self._roots[described.cls]

    def _expanded(self, described: Described) -> SkillWrapper | None:
        # An instance of its own with a read-only world model: `expand` may still run after the timeout.
        wmi = ReadOnlyWorldModel(self.descriptions.wmi)
        skill = described.instance(wmi)
        skill.library = _Libraries(wmi, self.descriptions)
        root = SkillWrapper(skill.type, skill.label, skill.library)
        root.setInstance(skill)
        result: list[str] = []

        def expand() -> None:
            try:
                root.wrapper_expand()
                result.append("")
            except Exception as error:
                result.append(f"expand raised {type(error).__name__}: {error}")

        thread = threading.Thread(target=expand, name=f"{skill.label}.expand", daemon=True)
        thread.start()
        thread.join(_EXPAND_TIMEOUT)
        self.reasons[described.cls] = result[0] if result else ""
        return root if result == [""] else None

    def options(self, node: SkillWrapper) -> list[Described]:
        """The candidate implementations of a node."""
        return self.descriptions.options(node.type, node.asked_label)

    def cycle(self, start: Described, node: SkillWrapper, seen: set[type]) -> list[Described]:
        """The compounds on a path from a node to `start`, without alternative implementations; [] when there is none.

        :param seen: the classes visited so far; grows.
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
        for below in _skills_below(root) if root is not None else ():
            path = self.cycle(start, below, seen)
            if path:
                return [only, *path]
        return []

    # A key of a node may belong to its skill, or to a descendant that pulls it.

    def names(self, node: SkillWrapper) -> tuple[set[str], bool]:
        """The keys of a node, and whether it may have more."""
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
        self._names[described.cls] = (names, is_open)  # a recursive compound adds nothing
        if described.is_compound:
            root = self.of(described)
            below, more = self.names_in_parent(root.children) if root is not None else (set(), True)
            names, is_open = names | below, is_open or more
            self._names[described.cls] = (names, is_open)
        return names, is_open

    def names_in_parent(self, nodes: Iterable[SkillInterface]) -> tuple[set[str], bool]:
        """The names that nodes pull from their parent, and whether there may be more."""
        found: set[str] = set()
        others = False
        for node in nodes:
            skill = node if isinstance(node, SkillWrapper) else None
            names, is_open = self.names(skill) if skill is not None else self.names_in_parent(node.children)
            found |= {node.name_above(name) for name in names}
            others |= is_open
        return found, others

    def names_in_scope(self, described: Described, root: SkillWrapper, node: SkillWrapper) -> tuple[set[str], bool]:
        """The names in the trees of a compound and of those that contain it, and whether there may be more.

        :param root, node: the compound's tree, and the child whose own names are excluded.
        """
        names, is_open = self._names_in(root, node)
        names |= set(described.skill.params.keys())
        is_open |= described.is_open
        pending, seen = [described], {described.cls}
        while pending:
            inner = pending.pop()
            for outer in self.descriptions.all():
                tree = self.of(outer) if outer.is_compound and outer.cls not in seen else None
                holders = [n for n in _skills_below(tree) if inner in self.options(n)] if tree is not None else []
                if tree is None or not holders:
                    continue
                seen.add(outer.cls)
                pending.append(outer)
                outer_names, more = self._names_in(tree, holders[0] if len(holders) == 1 else None)
                names |= outer_names | set(outer.skill.params.keys())
                is_open |= more or outer.is_open
        return names, is_open

    def _names_in(self, root: SkillWrapper, excluded: SkillWrapper | None) -> tuple[set[str], bool]:
        """The names of the nodes of a tree at its root, and whether there may be more."""
        found: set[str] = set()
        is_open = False
        for node in _skills_below(root):
            if node is not excluded:
                names, others = self.names(node)
                found |= {_name_at(root, node, name) for name in names}
                found |= {_name_at(root, node, node.own_name(name)) for name in node.specified_values}
                is_open |= others
        return found, is_open


def _child_findings(described: Described, root: SkillWrapper, node: SkillWrapper, trees: Trees) -> Iterator[Finding]:
    options = trees.options(node)
    if not options:
        yield _unknown_skill(described, node, trees)
        return
    names, is_open = trees.names(node)
    child = f"{node.type}{f'-{node.asked_label}' if node.asked_label else ''}"
    location = node.source_location
    if not is_open:
        for key in node.remaps:
            if key not in names:
                text = f"remap of {key!r}: {child} has no such parameter, and no skill under it{_near(key, names)}"
                yield finding_of(described, WARNING, "unknown-remap", text, location, "loaded; the remap has no effect")
    yield from _target_findings(described, root, node, options, child, trees)
    yield from _specify_findings(described, node, options, child)
    yield from _pre_condition_findings(described, node, options, child)
    yield from _type_findings(described, root, node, options, child, trees)
    yield from _missing_findings(described, root, node, options, child, trees)
    cycle = trees.cycle(described, node, set())
    if cycle and trees.cycles.reports([step.cls for step in cycle], described.cls, location):
        through = " and ".join(step.name for step in cycle[:-1])
        text = f"it is a part of itself{f' through {through}' if through else ''}, without an alternative"
        yield finding_of(described, WARNING, "recursion", text, location)


def _skills_below(root: SkillWrapper) -> list[SkillWrapper]:
    return [node for node in all_nodes(root) if isinstance(node, SkillWrapper) and node is not root]


def _unknown_skill(described: Described, node: SkillWrapper, trees: Trees) -> Finding:
    labels = [d.skill.label for d in trees.descriptions.all() if d.skill.type == node.type]
    if labels:
        text = f"no implementation {node.asked_label!r} of {node.type}; there are: {', '.join(labels)}"
    else:
        types = {d.skill.type for d in trees.descriptions.all()}
        text = f"no library has a skill of type {node.type}{_near(node.type, types)}"
    done = "loaded; it fails unless a library provides it"
    return finding_of(described, ERROR, UNKNOWN_SKILL, text, node.source_location, done)


def _specify_findings(
    described: Described, node: SkillWrapper, options: list[Described], child: str
) -> Iterator[Finding]:
    if any(option.is_open for option in options):
        return
    location = node.source_location
    for name, values in node.specified_values.items():
        key = node.own_name(name)
        having = [param for option in options if (param := _param(option, key)) is not None]
        if not having:
            known = {node.name_above(k) for option in options for k in option.skill.params}
            text = f"specify of {name!r}: {child} has no such parameter{_near(name, known)}"
            yield finding_of(described, WARNING, "unknown-specify", text, location, "loaded; the value is ignored")
        elif all(reasons := [_refusal(param, values) for param in having]):
            text = f"specify of {name!r} for {child}: {reasons[0]}"
            yield finding_of(described, WARNING, "wrong-type", text, location, "loaded; the value is ignored")
        elif all(reasons := [_limit_problem(param, values) for param in having]):
            text = f"specify of {name!r} for {child}: {reasons[0]}"
            yield finding_of(described, WARNING, "limits", text, location, "loaded; the start of the skill is refused")


def _refusal(param: Param, values: Any) -> str:
    """Why a parameter refuses values; "" when it accepts them."""
    try:
        param.clone().assign(values)
    except SkirosError as error:
        return str(error)
    return ""


def _limit_problem(param: Param, values: Any) -> str:
    """Which values the limits of a parameter do not allow; "" when all are allowed, or of another type."""
    checked = param.clone()
    try:
        checked.assign(values)
    except SkirosError:
        return ""
    return checked.limits.problem(checked.values)


def _pre_condition_findings(
    described: Described, node: SkillWrapper, options: list[Described], child: str
) -> Iterator[Finding]:
    if any(option.is_open for option in options):
        return
    for condition in node.own_pre_conditions:
        for key in condition.getKeys():
            if all(_param(option, key) is None for option in options):
                text = f"pre-condition [{condition.label}] refers to {key!r}; {child} has no such parameter"
                done = "loaded; the child fails where it is checked"
                yield finding_of(described, WARNING, "unknown-key", text, node.source_location, done)


def _type_findings(
    described: Described, root: SkillWrapper, node: SkillWrapper, options: list[Described], child: str, trees: Trees
) -> Iterator[Finding]:
    """Findings of keys of a child that are bound to a parameter of the compound with a different type."""
    own = described.skill.params.getParamMap()
    for key in dict.fromkeys(key for option in options for key in option.skill.params):
        name = _name_at(root, node, key)
        outer = own.get(name)
        if outer is None or node.name_above(key) in node.specified_values:
            continue
        having = [param for option in options if (param := _param(option, key)) is not None]
        if not any(fits(param, outer, trees.descriptions.wmi) for param in having):
            text = f"{key!r} of {child} is {type_name(having[0])}, {name!r} of the compound is {type_name(outer)}"
            both = having[0].is_element and outer.is_element
            done = "loaded; an element of any class is passed" if both else "loaded; the child keeps its own value"
            yield finding_of(described, WARNING, "wrong-type", text, node.source_location, done)


def _target_findings(
    described: Described, root: SkillWrapper, node: SkillWrapper, options: list[Described], child: str, trees: Trees
) -> Iterator[Finding]:
    """Findings of remaps to names that no ancestor or sibling of the child has."""
    for key in node.remaps:
        having = [param for option in options if (param := _param(option, key)) is not None]
        name = _name_at(root, node, key)
        is_specified = node.name_above(key) in node.specified_values
        if is_specified or not having or all(param.paramTypeIs(ParamTypes.Optional) for param in having):
            continue
        known, is_open = trees.names_in_scope(described, root, node)
        if is_open or name in known:
            continue
        text = f"remap of {key!r} of {child} to {name!r}: no ancestor or sibling has that key{_near(name, known)}"
        done = "loaded; the child gets no value by it"
        yield finding_of(described, WARNING, "unknown-target", text, node.source_location, done)


def _missing_findings(
    described: Described, root: SkillWrapper, node: SkillWrapper, options: list[Described], child: str, trees: Trees
) -> Iterator[Finding]:
    """Findings of required values of a child that nothing in the tree sets."""
    for key in dict.fromkeys(key for option in options for key in option.skill.params):
        if not all(_must_be_given(_param(option, key)) for option in options):
            continue
        name = _name_at(root, node, key)
        if node.name_above(key) in node.specified_values or described.skill.params.hasParam(name):
            continue
        others, is_open = trees.names_in_parent([n for n in root.children if not node.inSubtreeOf(n)])
        beside = [n for n in all_nodes(root) if isinstance(n, SkillWrapper) and n not in (node, root)]
        others |= {_name_at(root, n, k) for n in beside for k in trees.names(n)[0]}
        if is_open or name in others:
            continue
        elsewhere = any(
            d.skill.params.hasParam(name) for d in trees.descriptions.all() if d.cls not in [o.cls for o in options]
        )
        text = f"{child} requires {key!r}, and nothing in the tree sets it"
        text += "; it has to come from a skill outside" if elsewhere else f" (no skill has a parameter {name!r})"
        yield finding_of(
            described, WARNING, "never-set", text, node.source_location, "loaded; a start without it fails"
        )


def _must_be_given(param: Param | None) -> bool:
    return (
        param is not None
        and param.paramTypeIs(ParamTypes.Required)
        and not param.is_element
        and not param.has_bound_default()
    )


def _name_at(root: SkillWrapper, node: SkillInterface, key: str) -> str:
    """The name of a key of a node in the compound."""
    name = node.name_above(key)
    ancestor = node.parent
    while ancestor is not None and ancestor is not root:
        name = ancestor.name_above(name)
        ancestor = ancestor.parent
    return name


def _param(described: Described, key: str) -> Param | None:
    params: dict[str, Param] = described.skill.params.getParamMap()
    return params.get(key)


def _near(name: str, known: Iterable[str]) -> str:
    near = nearest(name, known, 2)
    return f"; near: {', '.join(near)}" if near else ""
