"""Creates tasks from requests, and previews their start. A request is checked as a whole before anything starts."""

from __future__ import annotations

import json
import logging
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from skiros2_common.core.abstract_skill import State
from skiros2_common.core.errors import (
    FOREIGN_ERRORS,
    OutOfLimits,
    Refused,
    RobotStopped,
    SkirosError,
    UnknownName,
    WrongType,
    WrongValue,
)
from skiros2_common.core.explanation import DEFAULT, GIVEN, PARAMETER, START, STOP, Explanation, Provenance
from skiros2_common.core.failure_kind import FailureKind
from skiros2_common.core.json_codec import param_texts
from skiros2_common.core.names import full_name, nearest
from skiros2_common.core.params import Origin, Param, ParamTypes
from skiros2_common.core.world_element import Element
from skiros2_common.core.world_model_port import WorldModelPort
from skiros2_skill.core.engine.elements import removal_of
from skiros2_skill.core.engine.failures import with_labels
from skiros2_skill.core.engine.learned_parameters import Learned, learned_values
from skiros2_skill.core.engine.selection import preview_start
from skiros2_skill.core.engine.skill_run import SkillRun
from skiros2_skill.core.engine.slot import Slot, format_values, is_same
from skiros2_skill.core.library.library import Implementation, SkillLibrary
from skiros2_skill.core.runtime.history import REFUSED, History, Record, one_line
from skiros2_skill.core.runtime.scheduler import Scheduler
from skiros2_skill.core.runtime.task import Task
from skiros2_skill.core.start_preview import StartPreview
from skiros2_skill.core.tree.node import Root
from skiros2_skill.core.tree.skill_node import SkillWrapper

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class JsonValues:
    """Values from JSON, whose type the skill declares. Elements are given by id or label."""

    values: Sequence[Any]


@dataclass(frozen=True)
class SkillRequest:
    """A skill to run.

    :param label: of an implementation; "" for any.
    :param params: by key.
    :param problems: errors in parameters that could not be read.
    """

    type: str
    label: str
    params: Mapping[str, Param | JsonValues]
    problems: Sequence[SkirosError] = ()


def make_nodes(
    requests: Sequence[SkillRequest], library: SkillLibrary, wmi: WorldModelPort, assumed: Collection[str] = ()
) -> list[SkillWrapper]:
    """Creates the nodes of a task that runs skills in sequence.

    :param assumed: keys of required parameters that may have no value.
    :raises Refused: the request names no skill, or a required parameter is not set.
    :raises UnknownName: a skill, a parameter or an element does not exist.
    :raises WrongType: a value is not of the declared type.
    :raises OutOfLimits: values are not allowed by their declarations, and there is no other problem.
    :raises WrongValue: there are several problems; the text names all.
    """
    if not requests:
        raise Refused("a task needs at least one skill, the list is empty")
    nodes: list[SkillWrapper] = []
    produced = set(assumed)
    all_problems: list[SkirosError] = []
    for request in requests:
        try:
            given, problems = _match(request, library, wmi, produced)
        except SkirosError as error:
            all_problems += [*request.problems, error]
            continue
        if given is None:
            all_problems += [error for _, error in problems]
            produced.update(key for implementation, _ in problems for key in implementation.declared.params)
            continue
        node = SkillWrapper(request.type, request.label, library)
        for key, values in given.items():
            node.specifyParamDefault(key, values)
        nodes.append(node)
    if all_problems:
        raise _as_one(all_problems)
    return nodes


def _as_one(problems: Sequence[SkirosError]) -> SkirosError:
    if len(problems) == 1:
        return problems[0]
    kind = OutOfLimits if all(isinstance(problem, OutOfLimits) for problem in problems) else WrongValue
    return kind("; ".join(dict.fromkeys(map(str, problems))))


def explain_refusal(
    requests: Sequence[SkillRequest],
    library: SkillLibrary,
    wmi: WorldModelPort,
    code: int,
    assumed: Collection[str] = (),
) -> Explanation | None:
    """Explains why `make_nodes` refuses: the problems of the first wrong request, for each implementation.

    :param assumed: see `make_nodes`.
    :param code: of the explanation; `OutOfLimits.CODE` is used for values that are not allowed.
    :returns: None when no single request is wrong.
    """
    produced = set(assumed)
    for request in requests:
        params = list(_provenance(request, library))
        stype = full_name(request.type)
        try:
            given, problems = _match(request, library, wmi, produced)
        except SkirosError as error:
            return Explanation(START, stype, request.label, -1, code, str(error), params=params)
        if given is None:
            tried = [
                Explanation(PARAMETER, stype, i.label, -1, _code(error, code), str(error), params=params)
                for i, error in problems
            ]
            text = "; ".join(t.message for t in tried)
            return tried[0] if len(tried) == 1 else Explanation(START, stype, "", -1, code, text, tried=tried)
    return None


def _provenance(request: SkillRequest, library: SkillLibrary) -> Iterator[Provenance]:
    """The values of a request, of which a client may have sent the defaults again."""
    try:
        declared = library.candidates(request.type, request.label)[0].declared.params.getParamMap()
    except (SkirosError, LookupError):
        declared = {}
    for key, param in request.params.items():
        values = [value for value in param.values if not _is_unspecific(value)]
        if values:
            is_default = key in declared and is_same(values, declared[key].defaults)
            yield Provenance(key, format_values(values), DEFAULT if is_default else GIVEN)


def _code(error: SkirosError, code: int) -> int:
    return OutOfLimits.CODE if isinstance(error, OutOfLimits) else code


def _match(
    request: SkillRequest, library: SkillLibrary, wmi: WorldModelPort, produced: set[str]
) -> tuple[dict[str, list[Any]] | None, list[tuple[Implementation, SkirosError]]]:
    """Finds the first implementation that accepts the values of a request.

    :param produced: the keys of the preceding skills; those of this one are added.
    :returns: the values, None when no implementation accepts them; and the problem of each rejected implementation.
    :raises UnknownName: there is no such skill.
    """
    problems: list[tuple[Implementation, SkirosError]] = []
    for implementation in library.candidates(request.type, request.label):
        try:
            given = _checked(request, implementation, wmi, produced)
        except SkirosError as error:
            problems.append((implementation, error))
            continue
        produced.update(implementation.declared.params.keys())
        return given, problems
    return None, problems


def _checked(
    request: SkillRequest, implementation: Implementation, wmi: WorldModelPort, produced: set[str]
) -> dict[str, list[Any]]:
    """Checks the values of a request against the parameters of an implementation. Returns them by key.

    :raises SkirosError: there are problems; the text names all.
    """
    declared = implementation.declared.params
    name = f"{implementation.type}-{implementation.label}"
    given: dict[str, list[Any]] = {}
    problems = [*request.problems]
    wrong: set[str] = set()
    for key, param in request.params.items():
        if not declared.hasParam(key):
            problems.append(UnknownName(f"{name} has no parameter {key!r}; it has: {', '.join(declared.keys())}"))
            continue
        try:
            values = _checked_values(declared.getParamMap()[key], param, wmi)
        except WrongType as error:
            wrong.add(key)
            problems.append(WrongType(f"{name}, parameter {error}"))
        except SkirosError as error:
            wrong.add(key)
            problems.append(error.with_text(f"{name}, parameter {key!r}: {error}"))
        else:
            if values:
                given[key] = values
    needed = [
        (key, param)
        for key, param in declared.items()
        if param.paramTypeIs(ParamTypes.Required) and not param.is_element and not param.is_bound()
        if key not in given and key not in produced and key not in wrong
    ]
    learned = learned_values(implementation.type, given, wmi) if needed else Learned({})
    for key, param in needed:
        if key in learned.values:
            try:
                values = _checked_values(param, Param(key, "", learned.values[key], ParamTypes.Required), wmi)
                given.update({} if learned.is_policy else {key: values})  # a policy is read at the start
            except SkirosError as error:
                problems.append(error.with_text(f"{name}, learned value of parameter {key!r}: {error}"))
        else:
            problems.append(Refused(f"{name}: required parameter {key!r} ({param.dataType().__name__}) is not set"))
    if problems:
        raise _as_one(problems)
    return given


def _checked_values(declared: Param, given: Param | JsonValues, wmi: WorldModelPort) -> list[Any]:
    """The values of a request for a parameter, without unspecific ones.

    :raises WrongType: a value is not of the declared type; the text begins with the key.
    :raises UnknownName: there is no such element.
    :raises WrongValue: several elements have that label.
    :raises OutOfLimits: the declaration does not allow a value.
    """
    values = list(given.values)
    if isinstance(given, JsonValues) and declared.is_element:
        values = [_named_element(value, declared.key, wmi) for value in values]
    values = [v for v in values if not _is_unspecific(v)]
    if values:
        checked = declared.clone()
        checked.assign(values)
        problem = declared.limits.problem(checked.values)
        if problem:
            raise OutOfLimits(problem)
    for value in values:
        if isinstance(value, Element) and not value.isAbstract() and wmi.find_element(value.id) is None:
            removal = removal_of(value.id, wmi)
            named = repr(value if value.label else value.id)
            raise UnknownName(f"there is no element {named} in the scene{f', it was {removal}' if removal else ''}")
    return values


def _named_element(value: Any, key: str, wmi: WorldModelPort) -> Element:
    """The element that a JSON value refers to: by id, by label, or by an object with id, label or type."""
    if isinstance(value, Mapping):
        parts = [value.get(part, "") for part in ("type", "label", "id")]
        if not all(isinstance(part, str) for part in parts) or not any(parts):
            raise WrongType(f"{key}: expected texts as id, label and type of an element, got {value!r}")
        if not parts[2]:
            return Element(*parts)
        value = parts[2]
    if not isinstance(value, str):
        raise WrongType(f"{key}: expected the id or label of an element, got {value!r}")
    element: Element | None = wmi.find_element(value)
    if element is not None:
        return element
    found: list[Element] = wmi.resolve_elements(Element("", value))
    if len(found) > 1:
        raise WrongValue(f"several elements are labelled {value!r}: {', '.join(sorted(e.id for e in found))}")
    if not found:
        labels = {name for e in wmi.get_scene()[0] for name in (e.id, e.label) if name}
        near = nearest(value, sorted(labels))
        hint = f"; near: {', '.join(near)}" if near else ""
        raise UnknownName(f"no element has the id or label {value!r}{hint}")
    return found[0]


def _is_unspecific(value: Any) -> bool:
    """Whether a value is an abstract element without label, properties and relations: "any of the type"."""
    return (
        isinstance(value, Element)
        and value.isAbstract()
        and not (value.label or value.available_properties or value.getRelations())
    )


#: The progress code of a refused task.
REFUSED_CODE = -1


class TaskRefused(Refused):
    """A task was refused; `record` has the reason."""

    def __init__(self, record: Record) -> None:
        super().__init__(record.message)
        self.record = record


class TaskStarter:
    """Creates the tasks of a manager. Any thread.

    :param library: the skill library; may be replaced later.
    :param robot: returns the robot's element, the value of `Robot` for skills without one.
    """

    def __init__(
        self,
        library: SkillLibrary,
        wmi: WorldModelPort,
        scheduler: Scheduler,
        history: History,
        robot: Callable[[], Element],
    ) -> None:
        self.library = library
        self._wmi = wmi
        self._scheduler = scheduler
        self._history = history
        self._robot = robot

    def make(self, author: str, requests: Sequence[SkillRequest], goal: str = "") -> Task:
        """Creates a task that runs skills in sequence. The scheduler has it, not started.

        :param goal: of which it is a step; "": none.
        :raises TaskRefused: the request is wrong; the history has the record.
        """
        explanation = None
        code = REFUSED_CODE
        try:
            self._wmi.catch_up()  # the client may have changed the world model just before
            try:
                return self._make(author, requests, goal)
            except RobotStopped as stopped:
                code = stopped.CODE
                raise
            except SkirosError:
                explanation = explain_refusal(requests, self.library, self._wmi, REFUSED_CODE)
                raise
        except SkirosError as error:
            text = str(error)
        except Exception as error:  # report internal errors to the client too
            log.exception("creating a task for %s", author or "unknown")
            text = f"internal error: {type(error).__name__}: {error}"
        text = one_line(text)
        if explanation is None:
            explanation = _explanation(requests, text, code)
        named = (v for r in requests for p in r.params.values() for v in p.values if isinstance(v, Element))
        with_labels(explanation, self._wmi, named)
        record = Record(REFUSED, author, State.Idle, code, text, [explanation])
        self._history.refuse(record)
        raise TaskRefused(record)

    def start(self, author: str, requests: Sequence[SkillRequest], ticks: int = 0) -> int:
        """Creates and starts a task. Returns its id.

        :param ticks: pauses after this many ticks; 0: does not.
        :raises TaskRefused: the request is wrong, or the robot is stopped; the history has the record.
        """
        task = self.make(author, requests)
        try:
            self._scheduler.start(task.id, ticks)
        except RobotStopped as stopped:  # just now
            raise self.withdraw(task, stopped) from None
        return task.id

    def withdraw(self, task: Task, stopped: RobotStopped) -> TaskRefused:
        """Discards a task that a stop has kept from its first start. Returns the refusal."""
        self._scheduler.discard(task)
        root, kind = task.root, FailureKind.SAFETY
        why = Explanation(STOP, root.type, root.label, task.id, stopped.CODE, str(stopped), kind=kind)
        record = Record(REFUSED, task.author, State.Idle, stopped.CODE, str(stopped), [why])
        self._history.refuse(record, task)
        return TaskRefused(record)

    def _make(self, author: str, requests: Sequence[SkillRequest], goal: str) -> Task:
        nodes = make_nodes(requests, self.library, self._wmi)
        self._check_stop(nodes)
        robot = self._robot()
        task = self._scheduler.new_task(self._wmi, author, goal)
        try:
            task.allowed_when_stopped = _allowed_when_stopped(nodes)
            _fill(task.root, robot, nodes)
            self._history.begin(task)
        except FOREIGN_ERRORS:
            self._scheduler.discard(task)
            raise
        return task

    def _check_stop(self, nodes: Sequence[SkillWrapper]) -> None:
        """Raises RobotStopped when the robot is stopped, unless the skills are allowed then."""
        stop = self._scheduler.stop_reason()
        if stop and not _allowed_when_stopped(nodes):
            raise RobotStopped(stop)

    def preview(self, requests: Sequence[SkillRequest], partial: bool = False) -> StartPreview:
        """Previews a start with the code that starts tasks. Starts, locks and changes nothing.

        :param partial: whether required parameters may have no value yet.
        :raises WmException: the world model does not answer.
        """
        self._wmi.catch_up()
        assumed = {key for i in self.library.implementations() for key in i.declared.params} if partial else ()
        try:
            nodes = make_nodes(requests, self.library, self._wmi, assumed)
            self._check_stop(nodes)
        except RobotStopped as stopped:
            return StartPreview(refusal=_explanation(requests, str(stopped), stopped.CODE))
        except SkirosError as error:
            refusal = explain_refusal(requests, self.library, self._wmi, REFUSED_CODE, assumed)
            return StartPreview(refusal=refusal or _explanation(requests, str(error)))
        root, first = Root("preview", self._wmi), nodes[0]
        _fill(root, self._robot(), nodes)
        run = SkillRun(first)
        refusal = preview_start(root, run, self._wmi)
        if refusal is not None:
            return StartPreview(refusal=refusal)
        found = {
            slot.key: Element(slot.param.value.type, slot.param.value.label, slot.param.value.id)
            for slot in run.slots
            if slot.is_element and slot.param.is_bound()
            if slot.origin is not Origin.GIVEN or slot.shared is not None
        }
        return StartPreview(run.implementation.label, found, _values(run.slots))


def _values(slots: Sequence[Slot]) -> dict[str, list[Any]]:
    """Returns the values of parameters as JSON data, elements by their ids; those without a JSON form are left
    out."""
    bound = {slot.key: slot for slot in slots if slot.param.is_bound()}
    elements = {key: [e.id for e in slot.param.values] for key, slot in bound.items() if slot.is_element}
    others = {key: slot.param for key, slot in bound.items() if not slot.is_element}
    return {**elements, **{data["key"]: data["values"] for data in map(json.loads, param_texts(others))}}


def _allowed_when_stopped(nodes: Sequence[SkillWrapper]) -> bool:
    """Whether each implementation of the skills may run while the robot is stopped."""
    return all(implementation.declared.allowed_when_stopped for node in nodes for implementation in node.candidates())


def _fill(root: Root, robot: Element, nodes: Sequence[SkillWrapper]) -> None:
    root.params.addParam("Robot", robot, ParamTypes.Inferred, "The manager's robot")
    root.params.getParamMap()["Robot"].set_by = "the manager"
    root(*nodes)


def _explanation(requests: Sequence[SkillRequest], text: str, code: int = REFUSED_CODE) -> Explanation:
    is_stop = code == RobotStopped.CODE
    stage, kind = (STOP, FailureKind.SAFETY) if is_stop else (START, FailureKind.RETRYABLE)
    stype, label = (requests[0].type, requests[0].label) if len(requests) == 1 else (":Root", "")
    return Explanation(stage, stype, label, -1, code, text, kind=kind)
