"""Choosing an implementation for a node that starts, and finding its parameters."""

from __future__ import annotations

import traceback
from collections.abc import Sequence
from functools import partial
from typing import Any

from skiros2_common.core.errors import FOREIGN_ERRORS, SkirosError
from skiros2_common.core.explanation import EXCEPTION, INFERENCE, PARAMETER, PRE, START
from skiros2_common.core.names import ANY_TYPE
from skiros2_common.core.params import ParamHandler
from skiros2_skill.core import blackboard
from skiros2_skill.core.blackboard import Slot, Source
from skiros2_skill.core.devices import free_devices, lock_devices
from skiros2_skill.core.emptiness import candidates_of, told
from skiros2_skill.core.failures import PRE_FAILED, START_RAISED, Failure, unmet
from skiros2_skill.core.inference import infer, inferable
from skiros2_skill.core.library import Implementation
from skiros2_skill.core.origins import origins
from skiros2_skill.core.wrapper import SkillWrapper


def choose(node: SkillWrapper, candidates: Sequence[Implementation], wmi: Any, present: Any = None) -> Failure | None:
    """Makes the first implementation whose parameters fit and whose pre-conditions hold the node's; locks its devices.

    :param present: as in `blackboard.renew`.
    :returns: None, or why there is none, for each candidate.
    """
    tried: list[Failure] = []
    for implementation in candidates:
        params = implementation.declared.params.at_defaults(but=[node.own_name(name) for name in node._specified])
        conditions = [*implementation.declared.pre_conditions, *node.own_pre_conditions]
        slots: list[Slot] = []
        try:
            slots += blackboard.fix(node, params)
            _find_params(node, slots, params, conditions, wmi, present)
            _adopt(node, implementation, params)
        except DoesNotFit as error:
            failure = error.failure
        except SkirosError as error:
            failure = Failure(PARAMETER, PRE_FAILED, str(error))
        except FOREIGN_ERRORS:  # of a condition's own code
            failure = Failure(EXCEPTION, START_RAISED, traceback.format_exc())
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
        failure.origins = partial(origins, node, slots, conditions)
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
) -> None:
    """Sets the parameters that an implementation would run with: beside those that are fixed, from above and inferred.

    :param conditions: the pre-conditions.
    :raises SkirosError: one does not fit, or a pre-condition does not hold.
    """
    blackboard.take(node, slots)
    fixed = [(slot, slot.param.value) for slot in slots if slot.is_element and slot.source is Source.Fixed]
    blackboard.renew(slots, wmi, present)
    for slot, value in fixed:
        if value is not None and not slot.param._values:
            raise DoesNotFit(PARAMETER, f"parameter {slot.param.key!r} is {value!r}, which is not in the scene")

    _check_classes(slots, wmi)
    unset = {param.key for param in inferable(params)}
    if unset:
        search = infer(params, conditions, wmi, _ids_above(node))
        if search is not None:
            candidates = candidates_of(search)
            text = f"Pre-condition failed: {told(search, candidates)}"
            raise DoesNotFit(INFERENCE, text, Failure(INFERENCE, PRE_FAILED, text, candidates=candidates))
        _check_classes(slots, wmi)
    for slot in slots:
        if unset and slot.param.key in unset and slot.param.isSpecified():
            slot.source = Source.Inferred
        slot.known = slot.param._values
    failure = unmet(PRE, conditions, params, wmi)
    if failure is not None:
        raise DoesNotFit(PRE, failure.message, failure)


def _check_classes(slots: list[Slot], wmi: Any) -> None:
    """
    :raises DoesNotFit: an element is of a class that its parameter does not allow.
    """
    for slot in slots:
        default = slot.param._default
        if not slot.is_element or not default:
            continue
        wanted = default[0].type
        for value in slot.param._values if wanted not in ANY_TYPE else ():
            if not (value.isAbstract() or value.type == wanted or wmi.is_subclass(value.type, wanted)):
                raise DoesNotFit(PARAMETER, f"parameter {slot.param.key!r} is {value!r}, expected a {wanted}")


def _ids_above(node: SkillWrapper) -> set[str]:
    """The ids of the elements that the nodes above have as parameters."""
    ids: set[str] = set()
    above = node.parent
    while above is not None:
        for param in above.params.values():
            if param.is_element:
                ids.update(v.id for v in param.values)
        above = above.parent
    return ids


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
