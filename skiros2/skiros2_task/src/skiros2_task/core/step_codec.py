"""Steps of plans as JSON data, so that they survive the process."""

from __future__ import annotations

from typing import Any

from skiros2_common.core.errors import WrongValue
from skiros2_common.core.params import ParamTypes
from skiros2_common.core.world_element import Element
from skiros2_task.core.formula import And, Atom, Formula, Kind, Not, Or, Predicate
from skiros2_task.core.plan import SkillCall, Step
from skiros2_task.core.semantics import GroundStep
from skiros2_task.core.skills import Skill, SkillParameter


def encode_step(step: Step) -> dict[str, Any]:
    """Returns a step as JSON data. Of the skill, only the parameters that hold elements and the duration are kept."""
    call, ground = step.call, step.ground
    return {
        "number": step.number,
        "manager": call.manager,
        "type": call.type,
        "label": call.label,
        "arguments": [[key, e.id, e.type, e.label] for key, e in call.arguments],
        "parameters": [[p.key, p.kind.name, p.element_class] for p in call.parameters],
        "duration": step.skill.duration,
        "robot": ground.robot,
        "needs": [[_atom(atom), state] for atom, state in ground.needs],
        "choices": [_formula(choice) for choice in ground.choices],
        "effects": [[_atom(atom), state] for atom, state in ground.effects.items()],
        "during": [[_atom(atom), state] for atom, state in ground.during.items()],
        "after": sorted(step.after),
        "start": step.start,
        "end": step.end,
    }


def decode_step(data: dict[str, Any]) -> Step:
    """Returns the step of `encode_step`. An element of an argument has its id, class and label only.

    :raises WrongValue: the data are not those of a step.
    """
    try:
        parameters = tuple(SkillParameter(key, ParamTypes[kind], cls) for key, kind, cls in data["parameters"])
        arguments = tuple((key, Element(etype, label, eid)) for key, eid, etype, label in data["arguments"])
        call = SkillCall(data["manager"], data["type"], data["label"], arguments, parameters)
        return Step(
            data["number"],
            call,
            Skill(call.type, call.label, parameters, (), (), (), duration=data["duration"]),
            GroundStep(
                data["robot"],
                tuple((_read_atom(atom), state) for atom, state in data["needs"]),
                tuple(_read_formula(choice) for choice in data["choices"]),
                {_read_atom(atom): state for atom, state in data["effects"]},
                {_read_atom(atom): state for atom, state in data["during"]},
            ),
            frozenset(data["after"]),
            data["start"],
            data["end"],
        )
    except (KeyError, TypeError, ValueError) as error:
        raise WrongValue(f"no step: {type(error).__name__}: {error}") from error


def _atom(atom: Atom) -> list[Any]:
    return [*atom.predicate, *atom.terms]


def _read_atom(data: list[Any]) -> Atom:
    kind, name, value, operator, *terms = data
    return Atom(Predicate(Kind(kind), name, value, operator), tuple(terms))


def _formula(formula: Formula) -> list[Any]:
    """Encodes a formula without quantifiers: those of a ground step are expanded."""
    if isinstance(formula, Atom):
        return ["atom", _atom(formula)]
    if isinstance(formula, Not):
        return ["not", _formula(formula.part)]
    if isinstance(formula, And | Or):
        return ["and" if isinstance(formula, And) else "or", *map(_formula, formula.parts)]
    raise WrongValue(f"{formula} is not ground")


def _read_formula(data: list[Any]) -> Formula:
    kind, *parts = data
    if kind == "atom":
        return _read_atom(parts[0])
    if kind == "not":
        return Not(_read_formula(parts[0]))
    formulas = tuple(map(_read_formula, parts))
    return And(formulas) if kind == "and" else Or(formulas)
