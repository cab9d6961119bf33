"""Choosing an implementation for a node that starts, and finding its parameters."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

from skiros2_common.core.errors import FOREIGN_ERRORS, SkirosError
from skiros2_common.core.explanation import (
    EXCEPTION,
    INFERENCE,
    INFERRED,
    PARAMETER,
    PRE,
    START,
)
from skiros2_common.core.names import ANY_TYPE
from skiros2_common.core.params import ParamHandler, ParamTypes
from skiros2_common.core.source_location import format_error
from skiros2_common.core.world_element import Element
from skiros2_skill.core.blackboard import Blackboard, Slot, make_slots, refresh, why_not_provided
from skiros2_skill.core.devices import free_devices, lock_devices
from skiros2_skill.core.emptiness import candidates_of, told
from skiros2_skill.core.failures import PRE_FAILED, START_RAISED, Failure, unmet
from skiros2_skill.core.inference import infer, inferable
from skiros2_skill.core.library import Implementation
from skiros2_skill.core.origins import origins
from skiros2_skill.core.wrapper import SkillWrapper


def choose(
    node: SkillWrapper, candidates: Sequence[Implementation], wmi: Any, present: Any, board: Blackboard
) -> Failure | None:
    """Makes the first implementation whose parameters fit and whose pre-conditions hold the node's; locks its devices.

    Implementations that declare the classes of the given elements come first.

    :param present: as in `refresh`.
    :returns: None, or why there is none, for each candidate.
    """
    tried: list[Failure] = []
    if len(candidates) > 1:
        candidates = sorted(candidates, key=lambda i: _other_classes(node, i, wmi, board))
    for implementation in candidates:
        conditions = [*implementation.declared.pre_conditions, *node.own_pre_conditions]
        slots: list[Slot] = []
        try:
            params, slots = make_slots(node, implementation.declared.params)
            _find_params(node, slots, params, conditions, wmi, present, board)
            _adopt(node, implementation, params)
        except DoesNotFit as error:
            failure = error.failure
        except SkirosError as error:
            failure = Failure(PARAMETER, PRE_FAILED, str(error))
        except FOREIGN_ERRORS as error:  # of a condition's own code
            failure = Failure(EXCEPTION, START_RAISED, format_error(error, implementation.module))
        else:
            node.slots = slots
            node.element_slots = [slot for slot in slots if slot.is_element]
            refused = lock_devices(node, wmi) if node.options else None
            if refused is None:
                return None
            free_devices(node, wmi)
            node.release()
            failure = refused
        failure.label = implementation.label
        failure.origins = partial(origins, slots, conditions)
        tried.append(failure)
    if len(tried) == 1:
        return tried[0]
    return Failure(START, PRE_FAILED, "; ".join(f"{f.label}: {f.message}" for f in tried), tried=tried)


class DoesNotFit(SkirosError):
    """An implementation cannot be a node's now.

    :param stage, text: of the failure, or the failure itself.
    """

    def __init__(self, stage: str, text: str, failure: Failure | None = None) -> None:
        super().__init__(text)
        self.failure = failure or Failure(stage, PRE_FAILED, text)


def _find_params(
    node: SkillWrapper,
    slots: list[Slot],
    params: ParamHandler,
    conditions: list[Any],
    wmi: Any,
    present: Any,
    board: Blackboard,
) -> None:
    """Sets the parameters that an implementation would run with: beside those that are fixed, from above and inferred.

    :param conditions: the pre-conditions.
    :raises SkirosError: one does not fit, or a pre-condition does not hold.
    """
    board.pull(node, slots, is_start=True)
    elements = [slot for slot in slots if slot.is_element]
    given = [(slot, slot.param._values) for slot in elements if slot.seen is None]
    if refresh(elements, wmi, present):
        for slot, values in given:
            if len(slot.param._values) < len(values):
                raise DoesNotFit(PARAMETER, f"parameter {slot.param.key!r} is {values[0]!r}, which is not in the scene")
    unset = {param.key: param for param in inferable(params)}
    if unset:
        searched = [slot for slot in elements if slot.param._key in unset]
        _infer(node, searched, params, conditions, wmi, board)
    failure = unmet(PRE, conditions, params, wmi)
    if failure is not None:
        raise DoesNotFit(PRE, failure.message, failure)


def _infer(
    node: SkillWrapper, slots: list[Slot], params: ParamHandler, conditions: list[Any], wmi: Any, board: Blackboard
) -> None:
    """Sets the parameters of some slots, which are to be inferred.

    :raises SkirosError: there are no elements for them.
    """
    for slot in slots:
        why = why_not_provided(node, slot, board) if slot.param.paramTypeIs(ParamTypes.Required) else ""
        if why:
            raise DoesNotFit(PARAMETER, why)
    first = {slot.param._key: _first_candidates(node, slot, wmi) for slot in slots}
    search = infer(params, conditions, wmi, board.ids(), {key: found for key, found in first.items() if found})
    if search is not None:
        candidates = candidates_of(search)
        text = f"Pre-condition failed: {told(search, candidates)}"
        raise DoesNotFit(INFERENCE, text, Failure(INFERENCE, PRE_FAILED, text, candidates=candidates))
    for slot in slots:
        if slot.param.is_bound():
            slot.inferred = True
            slot.origin = INFERRED
            known = slot.candidate
            if known is not None and len(known) == 1 and known[0].id == slot.param._values[0].id:
                slot.param._values = slot.seen = known  # all holders of the key share one list


def _first_candidates(node: SkillWrapper, slot: Slot, wmi: Any) -> list[Element]:
    """The elements that are tried first for a parameter: of the plan, and what another node has inferred."""
    named = [*node._suggested.get(node.name_above(slot.param._key), ()), *(slot.candidate or ())[:1]]
    return [e for e in named if e.id and wmi.find_element(e.id) is not None]


def _other_classes(node: SkillWrapper, implementation: Implementation, wmi: Any, board: Blackboard) -> int:
    """How many elements that an implementation would get are not of the classes that it declares. They are accepted;
    another implementation that declares their classes is preferred."""
    count = 0
    for key, param in implementation.declared.params.items():
        wanted = param.default.type if param.is_element and param.default is not None else ""
        if wanted in ANY_TYPE or param.has_bound_default():
            continue
        values = node._specified.get(node.name_above(key)) or board.values(node._scope.get(key, key))
        count += any(isinstance(v, Element) and v.id and not _is_of(v.type, wanted, wmi) for v in values)
    return count


def _is_of(etype: str, wanted: str, wmi: Any) -> bool:
    return etype == wanted or bool(wmi.is_subclass(etype, wanted))


def _adopt(node: SkillWrapper, implementation: Implementation, params: ParamHandler) -> None:
    """Gives the node an instance of the implementation, with these parameters.

    :raises ConfigurationError: an instance cannot be made.
    """
    if node.hasInstance() and node.implementation is implementation:
        node.getInstance()._restore_declared(params)
        node.adopt_description()
        node.rise()
        return
    node.release()
    instance = implementation.acquire()
    instance._restore_declared(params)
    node.implementation = implementation
    node.setInstance(instance)
    node.rise()
    node.expanded = False
