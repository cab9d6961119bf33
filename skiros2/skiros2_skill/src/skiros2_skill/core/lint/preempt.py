"""Checks the `on_preempt` of a skill: the handler, its bound parameters and its condition."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from skiros2_common.core.names import nearest
from skiros2_common.core.params import Param, ParamTypes
from skiros2_common.core.preempt_handler import PreemptHandler
from skiros2_skill.core.library.description import Described, Descriptions
from skiros2_skill.core.lint.findings import ERROR, UNKNOWN_SKILL, WARNING, Finding, finding_of, fits, parts, type_name


def preempt_findings(described: Described, descriptions: Descriptions) -> Iterator[Finding]:
    """The findings of a skill's `on_preempt`."""
    handler = described.skill.on_preempt
    if handler is None:
        return
    options = descriptions.options(handler.type, handler.label)
    if not options:
        labels = [d.skill.label for d in descriptions.all() if d.skill.type == handler.type]
        known = f"there are: {', '.join(labels)}" if labels else "no library has a skill of that type"
        text = f"on_preempt: there is no skill {handler}; {known}"
        done = "loaded; a preemption only ends the task"
        yield finding_of(described, ERROR, UNKNOWN_SKILL, text, handler.source_location, done)
    else:
        yield from _bind_findings(described, handler, options)
        yield from _param_findings(described, handler, options, descriptions)
    params = described.skill.params
    for condition, _ in parts([handler.condition] if handler.condition is not None else []):
        for key in condition.getKeys():
            if not condition.parts and not params.hasParam(key) and not described.is_open:
                text = f"the condition of on_preempt refers to {key!r}; the parameters are: {', '.join(params.keys())}"
                done = "loaded; the handler does not run"
                yield finding_of(described, WARNING, "unknown-key", text, handler.source_location, done)


def _bind_findings(described: Described, handler: PreemptHandler, options: list[Described]) -> Iterator[Finding]:
    own = described.skill.params.getParamMap()
    theirs = {key for option in options for key in option.skill.params}
    for key, source in handler.bind.items():
        if key not in theirs and not any(option.is_open for option in options):
            text = f"on_preempt binds {key!r}: {handler} has no such parameter{_near(key, theirs)}"
            yield finding_of(
                described, WARNING, "unknown-remap", text, handler.source_location, "loaded; it is ignored"
            )
        if source not in own and not described.is_open:
            text = f"on_preempt binds {key!r} to {source!r}, which {described.name} does not have{_near(source, own)}"
            done = "loaded; the handler gets no value by it"
            yield finding_of(described, WARNING, "unknown-target", text, handler.source_location, done)


def _param_findings(
    described: Described, handler: PreemptHandler, options: list[Described], descriptions: Descriptions
) -> Iterator[Finding]:
    own = described.skill.params.getParamMap()
    place = handler.source_location
    for key in dict.fromkeys(key for option in options for key in option.skill.params):
        having = [option.skill.params.getParamMap()[key] for option in options if option.skill.params.hasParam(key)]
        source = own.get(handler.source_of(key, having[0]))
        if source is None:
            if len(having) == len(options) and all(map(_must_be_given, having)) and not described.is_open:
                text = f"on_preempt: {handler} requires {key!r}, and no parameter of {described.name} is bound to it"
                yield finding_of(described, WARNING, "never-set", text, place, "loaded; the handler fails without it")
        elif not any(fits(param, source, descriptions.wmi) for param in having):
            text = f"on_preempt: {key!r} of {handler} is {type_name(having[0])}, {source.key!r} is {type_name(source)}"
            yield finding_of(described, WARNING, "wrong-type", text, place, "loaded; the handler may fail")


def _must_be_given(param: Param) -> bool:
    return param.paramTypeIs(ParamTypes.Required) and not param.is_element and not param.has_bound_default()


def _near(name: str, known: Iterable[str]) -> str:
    near = nearest(name, known, 2)
    return f"; near: {', '.join(near)}" if near else ""
