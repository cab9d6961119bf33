"""Selects an implementation for a node that starts, and finds its parameters."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from functools import partial

from skiros2_common.core.condition import ConditionBase
from skiros2_common.core.errors import FOREIGN_ERRORS, OutOfLimits, SkirosError
from skiros2_common.core.explanation import (
    DEFAULT,
    EXCEPTION,
    INFERENCE,
    INFERRED,
    LEARNED,
    PARAMETER,
    PRE,
    SPECIFIED,
    START,
    UNSET,
    Explanation,
)
from skiros2_common.core.limits import NO_LIMITS
from skiros2_common.core.names import ANY_TYPE
from skiros2_common.core.params import Origin, ParamHandler, ParamTypes
from skiros2_common.core.source_location import format_error
from skiros2_common.core.world_element import Element
from skiros2_common.core.world_model_port import Revisions, WorldModelPort
from skiros2_skill.core.engine.blackboard import Blackboard, make_slots, unprovided_remap
from skiros2_skill.core.engine.devices import free_devices, lock_devices
from skiros2_skill.core.engine.elements import missing_text, read_again
from skiros2_skill.core.engine.evidence import Evidence
from skiros2_skill.core.engine.failures import PRE_FAILED, START_RAISED, Failure, Failures, check_conditions
from skiros2_skill.core.engine.hook_guard import HookGuard
from skiros2_skill.core.engine.inference import failure_text, filter_candidates, infer
from skiros2_skill.core.engine.learned_parameters import learned_values
from skiros2_skill.core.engine.parameters import Parameters
from skiros2_skill.core.engine.skill_run import Node, SkillRun
from skiros2_skill.core.engine.slot import Slot, format_values, provenance_of
from skiros2_skill.core.protocols import ImplementationPort

log = logging.getLogger(__name__)

#: Gives an implementation with its parameters to a run. Returns the failure; None on success.
Claim = Callable[[SkillRun, ImplementationPort, ParamHandler, list[Slot], WorldModelPort], Failure | None]


def claim_instance(
    run: SkillRun, implementation: ImplementationPort, params: ParamHandler, slots: list[Slot], wmi: WorldModelPort
) -> Failure | None:
    """Gives an instance of an implementation to a run and locks its devices.

    :raises ConfigurationError: no instance can be created.
    """
    run.claim(implementation, params, slots)
    refused = lock_devices(run, wmi) if run.options else None
    if refused is not None:
        free_devices(run, wmi)
        run.release()
    elif run.warning:
        log.warning("%s: %s", run.name, run.warning)
    return refused


def preview(
    run: SkillRun, implementation: ImplementationPort, params: ParamHandler, slots: list[Slot], wmi: WorldModelPort
) -> Failure | None:
    """Notes an implementation and its parameters in a run that does not start."""
    run.implementation, run.slots = implementation, slots
    return None


def select(run: SkillRun, parameters: Parameters, wmi: WorldModelPort, claim: Claim = claim_instance) -> Failure | None:
    """Selects the first implementation whose parameters are found and whose pre-conditions are satisfied.

    Implementations that declare the classes of the given elements are tried first.

    :param claim: called with the implementation; `preview` does not start it.
    :returns: None; when every implementation is rejected, the failure with the reasons.
    """
    try:
        candidates, revisions = run.node.candidates(), parameters.revisions(run)
    except SkirosError as error:
        return Failure(START, START_RAISED, str(error))
    note = parameters.evidence.conditions(run, PRE) if parameters.evidence.is_on else None
    arguments = (run, candidates, wmi, revisions, parameters.blackboard, claim, note)
    return parameters.guard.call(run, "the inference of its parameters", _select, *arguments)


def preview_start(root: Node, run: SkillRun, wmi: WorldModelPort) -> Explanation | None:
    """Selects an implementation for a run and finds its parameters without starting it.

    :param root: of the tree, which is never ticked.
    :returns: why it would not start; None if it would.
    """
    parameters, failures = Parameters(wmi, HookGuard(), lambda: None, Evidence()), Failures(wmi)
    parameters.blackboard = Blackboard(root.own_blackboard)
    parameters.update_revision()
    failure = select(run, parameters, wmi, preview)
    if failure is None:
        return None
    failures.record(run.node, failure)
    return failures.explanations()[-1]


def _select(
    run: SkillRun,
    candidates: Sequence[ImplementationPort],
    wmi: WorldModelPort,
    revisions: Revisions | None,
    blackboard: Blackboard,
    claim: Claim,
    note: Callable[[ConditionBase, bool], None] | None,
) -> Failure | None:
    tried: list[Failure] = []
    if len(candidates) > 1:
        candidates = sorted(candidates, key=lambda i: _class_mismatches(run, i, wmi, blackboard))
    for implementation in candidates:
        conditions = [*implementation.declared.pre_conditions, *run.node.own_pre_conditions]
        slots: list[Slot] = []
        try:
            params, slots = make_slots(run, implementation.declared.params)
            _find_params(run, slots, params, conditions, wmi, revisions, blackboard, implementation.type, note)
            failure = claim(run, implementation, params, slots, wmi)
            if failure is None:
                return None
        except Rejected as error:
            failure = error.failure
        except SkirosError as error:
            failure = Failure(PARAMETER, PRE_FAILED, str(error))
        except FOREIGN_ERRORS as error:  # raised by a condition
            failure = Failure(EXCEPTION, START_RAISED, format_error(error, implementation.module))
        failure.label = implementation.label
        failure.provenance = partial(provenance_of, slots, conditions)
        tried.append(failure)
    if len(tried) == 1:
        return tried[0]
    return Failure(START, PRE_FAILED, "; ".join(f"{f.label}: {f.message}" for f in tried), tried=tried)


class Rejected(SkirosError):
    """An implementation is rejected.

    :param stage, text: of the failure.
    :param failure: the failure itself, instead of `stage` and `text`.
    """

    def __init__(self, stage: str, text: str, failure: Failure | None = None) -> None:
        super().__init__(text)
        self.failure = failure or Failure(stage, PRE_FAILED, text)


def _find_params(
    run: SkillRun,
    slots: list[Slot],
    params: ParamHandler,
    conditions: list[ConditionBase],
    wmi: WorldModelPort,
    revisions: Revisions | None,
    blackboard: Blackboard,
    stype: str,
    note: Callable[[ConditionBase, bool], None] | None,
) -> None:
    """Sets the parameters that are not specified: pulls them from the blackboard, infers elements, and takes learned
    values.

    :param conditions: the pre-conditions.
    :param stype: type of the skill.
    :param note: see `check_conditions`.
    :raises SkirosError: a parameter cannot be set, or a pre-condition is unsatisfied.
    """
    if run.node.suggested_values:
        _suggest(run, [slot for slot in slots if slot.is_element], wmi)
    blackboard.pull(run.node, slots, is_start=True)
    unset, has_others = [], False
    for slot in slots:
        param = slot.param
        if param.current is param.defaults:  # it stays
            slot.copy_default()
        if not slot.is_element:
            has_others = True
            continue
        gone = read_again(param.current, wmi, revisions)
        if gone:
            _drop_missing(slot, gone, wmi)
        if slot.candidate is not None and read_again(slot.candidate, wmi, revisions):
            if param.paramTypeIs(ParamTypes.Required):
                raise Rejected(PARAMETER, f"parameter {param.key!r} {missing_text(slot.candidate[0], wmi)}")
            slot.ignored, slot.candidate = slot.candidate, None
        if param.paramType is not ParamTypes.Optional and not (slot.ids and slot.ids[0]):
            unset.append(slot)
    if unset:
        _infer(run, unset, params, conditions, wmi, blackboard)
    run.warning = _take_learned(slots, stype, wmi) if has_others else ""
    outside = out_of_limits(params)
    if outside:
        raise Rejected(PARAMETER, outside, Failure(PARAMETER, OutOfLimits.CODE, outside))
    failure = check_conditions(PRE, conditions, params, wmi, run.evaluated, note)
    if failure is not None:
        raise Rejected(PRE, failure.message, failure)


def _drop_missing(slot: Slot, gone: list[Element], wmi: WorldModelPort) -> None:
    """Drops elements that are gone.

    :raises Rejected: the skill cannot start without them.
    """
    is_own, is_needed = _is_own(slot), _is_needed(slot)
    slot.drop(gone)
    slot.bind(slot.origin)
    if any(e.id for e in gone) and (is_own or (is_needed and not slot.param.current)):
        raise Rejected(PARAMETER, f"parameter {slot.param.key!r} {missing_text(gone[0], wmi)}")


def _take_learned(slots: list[Slot], stype: str, wmi: WorldModelPort) -> str:
    """Replaces defaults by learned values, and sets parameters without a value to them. Returns a warning if a feature
    of the task is outside of the range that they are validated for, else "".

    :raises WrongType: a learned value is not of the declared type.
    """
    open_slots = [slot for slot in slots if not slot.is_element and slot.provenance in (DEFAULT, UNSET)]
    if not open_slots:
        return ""
    learned = learned_values(stype, {slot.param.key: slot.param.current for slot in slots}, wmi)
    for slot in open_slots:
        if slot.param.key in learned.values:
            slot.param.current = slot.param.checked(learned.values[slot.param.key])
            slot.provenance = LEARNED
    return learned.warning


def out_of_limits(params: ParamHandler) -> str:
    """Describes the parameters with values that their declarations do not allow; "" if there are none."""
    problems = []
    for param in params.values():
        if param.limits is not NO_LIMITS and not all(map(param.limits.allows, param.current)):
            problems.append(f"parameter {param.key!r}: {param.limits.problem(param.current)}")
    return "; ".join(problems)


def _infer(
    run: SkillRun,
    slots: list[Slot],
    params: ParamHandler,
    conditions: list[ConditionBase],
    wmi: WorldModelPort,
    blackboard: Blackboard,
) -> None:
    """Infers the parameters of slots.

    :raises SkirosError: the inference fails.
    """
    for slot in slots:
        why = unprovided_remap(run.node, slot, blackboard) if slot.param.paramTypeIs(ParamTypes.Required) else ""
        if why:
            raise Rejected(PARAMETER, why)
    first = {slot.param.key: slot.suggested or slot.candidate for slot in slots}
    search = infer(params, conditions, wmi, blackboard.ids(), {key: found for key, found in first.items() if found})
    if search is not None:
        candidates = filter_candidates(search)
        text = f"Pre-condition failed: {failure_text(search, candidates)}"
        raise Rejected(INFERENCE, text, Failure(INFERENCE, PRE_FAILED, text, candidates=candidates))
    for slot in slots:
        if not slot.param.is_bound():
            continue
        slot.provenance = INFERRED
        slot.origin = Origin.INFERRED
        known = slot.candidate
        if known is not None and known[0].id == slot.param.current[0].id:
            slot.param.current = slot.shared = known  # all nodes share one list
            slot.origin = blackboard.origin(slot.key)
        slot.bind(slot.origin)
        rejected = [e for e in first[slot.param.key] or () if e.id != slot.param.current[0].id]
        if rejected:
            log.info(
                "%s: %s is %r; the pre-conditions do not hold with %s",
                run.node.printState(), slot.param.key, slot.param.current[0], format_values(rejected),
            )  # fmt: skip


def _suggest(run: SkillRun, slots: Sequence[Slot], wmi: WorldModelPort) -> None:
    """Finds the elements that a plan suggests for parameters without a value. An Optional parameter is set to them."""
    for slot in slots:
        named = [e for e in run.node.suggested_values.get(run.node.name_above(slot.param.key), ()) if e.id]
        if slot.param.is_bound() or not named:
            continue
        found = [(e, wmi.find_element(e.id)) for e in named]
        missing = [e for e, present in found if present is None]
        if missing:
            log.warning(
                "%s: %s of the plan is %s, which is no longer in the scene",
                run.node.printState(), slot.param.key, format_values(missing),
            )  # fmt: skip
        slot.suggested = [present for _, present in found if present is not None]
        if slot.suggested and slot.param.paramTypeIs(ParamTypes.Optional):
            slot.param.current = slot.suggested
            slot.bind(slot.origin)
            slot.provenance = SPECIFIED


def _is_own(slot: Slot) -> bool:
    """Whether a slot has the elements that it was given itself. It may share them with the blackboard."""
    return slot.shared is None or bool(slot.default_ids)


def _is_needed(slot: Slot) -> bool:
    """Whether a skill cannot start if all elements are gone that a slot has pulled from the blackboard."""
    return slot.param.paramTypeIs(ParamTypes.Required) or (
        slot.origin is Origin.GIVEN and not slot.param.paramTypeIs(ParamTypes.Optional)
    )


def _class_mismatches(
    run: SkillRun, implementation: ImplementationPort, wmi: WorldModelPort, blackboard: Blackboard
) -> int:
    """The number of parameters whose given elements are not of the declared class. Such elements are accepted, but an
    implementation that declares their class is preferred."""
    count = 0
    for key, param in implementation.declared.params.items():
        wanted = param.default.type if param.is_element and param.default is not None else ""
        if wanted in ANY_TYPE or param.has_bound_default():
            continue
        specified = run.node.specified_values.get(run.node.name_above(key))
        values = specified or blackboard.values(run.keys.get(key, key))
        count += any(isinstance(v, Element) and v.id and not _is_of(v.type, wanted, wmi) for v in values)
    return count


def _is_of(etype: str, wanted: str, wmi: WorldModelPort) -> bool:
    return etype == wanted or bool(wmi.is_subclass(etype, wanted))
