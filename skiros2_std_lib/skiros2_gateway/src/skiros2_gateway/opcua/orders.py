"""Translates job orders, states and responses between the gateway and the structures of OPC UA."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Any

from asyncua import ua

from skiros2_gateway.core.job import Job, State, Substate, read_order
from skiros2_gateway.core.json_text import json_text
from skiros2_gateway.core.problems import Problem, Rejected
from skiros2_gateway.core.work_masters import WorkMaster
from skiros2_gateway.opcua.resources import ACTUALS, REQUIREMENTS, add_resources, resources_data

#: The parameter of an order that has the goal text, where no work master is named.
GOAL_PARAMETER = "Goal"
#: The parameter of an order with the wanted plan quality.
QUALITY_PARAMETER = "PlanQuality"


#: The object that has the state machine of sub-states, by state.
SUBSTATES = {
    State.NOT_ALLOWED_TO_START: "NotAllowedToStartSubstates",
    State.ALLOWED_TO_START: "AllowedToStartSubstates",
    State.INTERRUPTED: "InterruptedSubstates",
    State.ENDED: "EndedSubstates",
}


def order_data(order: Any) -> dict[str, Any]:
    """Returns the JSON data of an order.

    :param order: an ISA95JobOrderDataType.
    :raises Rejected: with all problems of its fields.
    """
    problems: list[Problem] = []
    resources = resources_data(order, REQUIREMENTS, problems)
    parameters = _values(order.JobOrderParameters, "parameters", problems)
    masters = [str(master.ID) for master in order.WorkMasterID or []]
    if len(masters) > 1:
        problems.append(Problem("wrong_value", "work_master", f"{len(masters)} work masters", "one at most"))
    data: dict[str, Any] = {
        "id": order.JobOrderID,
        "description": "\n".join(text.Text or "" for text in order.Description or []),
        "priority": order.Priority or 0,
        "robots": [str(equipment.ID) for equipment in order.EquipmentRequirements or []],
        "resources": resources,
        "quality": parameters.pop(QUALITY_PARAMETER, ""),
        "earliest_start": _iso(order.StartTime),
        "due": _iso(order.EndTime),
    }
    if masters:
        data["work_master"] = masters[0]
    else:
        data["goal"] = parameters.pop(GOAL_PARAMETER, "")
    data["parameters"] = parameters
    if problems:
        try:
            read_order(data)
        except Rejected as error:
            problems += error.problems
        raise Rejected(problems)
    return data


def response_data(response: Any) -> dict[str, Any]:
    """Returns the JSON data of a response of another system; see `skiros2_gateway.core.received_responses`.

    :param response: an ISA95JobResponseDataType.
    :raises Rejected: with the problems of values that cannot be kept.
    """
    problems: list[Problem] = []
    data = {
        "id": response.JobResponseID or "",
        "job": response.JobOrderID or "",
        "description": (response.Description.Text or "") if response.Description else "",
        "started": _iso(response.StartTime),
        "ended": _iso(response.EndTime),
        "states": [state.StateText.Text or "" for state in response.JobState or [] if state.StateText],
        "values": _values(response.JobResponseData, "values", problems),
        "equipment": [str(equipment.ID) for equipment in response.EquipmentActuals or []],
        "resources": resources_data(response, ACTUALS, problems),
    }
    if problems:
        raise Rejected(problems)
    return data


def job_order(job: Job) -> Any:
    """Returns the order of a job as a structure."""
    order, make = job.order, ua.ISA95JobOrderDataType()
    make.JobOrderID = job.id
    make.Description = [ua.LocalizedText(order.description)]
    if order.work_master:
        make.WorkMasterID = [ua.ISA95WorkMasterDataType(ID=order.work_master)]
    make.StartTime, make.EndTime = order.earliest_start, order.due
    make.Priority = order.priority
    values = {**order.parameters, **({GOAL_PARAMETER: order.goal} if order.goal else {})}
    make.JobOrderParameters = [parameter(key, value) for key, value in values.items()]
    make.EquipmentRequirements = [ua.ISA95EquipmentDataType(ID=robot) for robot in job.robots]
    add_resources(make, order.resources)
    return make


def job_states(job: Job, types: int) -> list[Any]:
    """Returns the state of a job, and its sub-state if it has one, with the path to the state machine of sub-states.

    :param types: index of the namespace of the types.
    """
    states = [_state(job.state.value, job.state.number)]
    if job.substate is not Substate.NONE:
        name, component = ua.QualifiedName(SUBSTATES[job.state], types), ua.NodeId(ua.ObjectIds.HasComponent)
        path = [ua.RelativePathElement(component, False, True, name)]
        states.append(_state(job.substate.value, job.substate.number, path))
    return states


def job_order_and_state(job: Job, types: int) -> Any:
    """Returns an entry of the list of job orders.

    :param types: index of the namespace of the types.
    """
    return ua.ISA95JobOrderAndStateDataType(JobOrder=job_order(job), State=job_states(job, types))


def job_response(job: Job, types: int) -> Any:
    """Returns the response of a job. Lists are JSON texts.

    :param types: index of the namespace of the types.
    """
    response, make = job.response, ua.ISA95JobResponseDataType()
    make.JobResponseID = f"response of {job.id}"
    make.JobOrderID = job.id
    make.Description = ua.LocalizedText(response.message)
    make.StartTime, make.EndTime = _time(response.started), _time(response.ended)
    make.JobState = job_states(job, types)
    texts = {"Outcome": response.outcome, "Message": response.message, "Phase": response.phase}
    lists = {
        "Plan": response.plan, "Steps": response.steps, "Changes": response.changes, "Notes": response.notes,
        "Explanations": response.explanations,
    }  # fmt: skip
    values = {**texts, **{key: json_text(value) for key, value in lists.items()}, **response.quality}
    make.JobResponseData = [parameter(key, value) for key, value in values.items()]
    make.EquipmentActuals = [ua.ISA95EquipmentDataType(ID=robot) for robot in response.robots]
    return make


def work_master(master: WorkMaster) -> Any:
    """Returns a work master with its parameters; their values are the defaults, or their types."""
    make = ua.ISA95WorkMasterDataType()
    make.ID, make.Description = master.id, ua.LocalizedText(master.description)
    make.Parameters = [
        parameter(p.id, p.default if p.default is not None else p.type, p.description) for p in master.parameters
    ]
    return make


def parameter(key: str, value: Any, description: str = "") -> Any:
    """Returns a parameter."""
    is_plain = isinstance(value, bool | float | str) or (isinstance(value, int) and -(2**63) <= value < 2**63)
    plain = value if is_plain else json_text(value)
    texts = [ua.LocalizedText(description)] if description else []
    return ua.ISA95ParameterDataType(ID=key, Value=ua.Variant(plain), Description=texts)


def wanted_states(states: list[Any] | None) -> list[str]:
    """Returns the names of states (ISA95StateDataType), from their texts or numbers.

    :raises Rejected: a state is unknown.
    """
    names, problems = [], []
    known = {state.number: state.value for state in State}
    for state in states or []:
        name = state.StateText.Text if state.StateText is not None and state.StateText.Text else None
        name = name or known.get(state.StateNumber, "")
        if name in known.values():
            names.append(name)
        else:
            expected = f"one of {', '.join(known.values())}"
            problems.append(Problem("unknown_name", "JobOrderState", f"there is no state {name!r}", expected))
    if problems:
        raise Rejected(problems)
    return names


def _state(text: str, number: int, path: list[ua.RelativePathElement] | None = None) -> Any:
    """Returns a state; `path` leads from the receiver to the state machine of a sub-state."""
    browse_path, shown = ua.RelativePath(path or []), ua.LocalizedText(text, "en")
    return ua.ISA95StateDataType(BrowsePath=browse_path, StateText=shown, StateNumber=number)


def _values(parameters: list[Any] | None, where: str, problems: list[Problem]) -> dict[str, Any]:
    """Returns the values of parameters (ISA95ParameterDataType) by their ids; adds what cannot be kept."""
    ids = [str(each.ID) for each in parameters or []]
    for each in parameters or []:
        if each.Subparameters:
            problems.append(Problem("wrong_value", f"{where}.{each.ID}", "Subparameters", "a value"))
    for key in sorted({key for key in ids if ids.count(key) > 1}):
        problems.append(Problem("wrong_value", f"{where}.{key}", f"{ids.count(key)} values", "one"))
    values = (each.Value.Value if isinstance(each.Value, ua.Variant) else each.Value for each in parameters or [])
    return dict(zip(ids, values, strict=True))


def _iso(time: datetime | None) -> str | None:
    """Returns a time of OPC UA, which is UTC; the smallest time stands for none."""
    if time is None or time.year < 1970:
        return None
    return (time if time.tzinfo else time.replace(tzinfo=UTC)).isoformat()


def _time(seconds: float | None) -> datetime | None:
    return datetime.fromtimestamp(seconds, UTC) if seconds is not None else None
