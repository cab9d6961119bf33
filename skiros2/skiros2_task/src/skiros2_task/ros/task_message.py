"""Converts plans to tasks for skill managers."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from skiros2_common.core.params import Param, ParamHandler, ParamTypes
from skiros2_common.core.world_element import Element
from skiros2_skill.ros.utils import SkillHolder
from skiros2_task.core.plan import SkillCall

#: Returns the parameters of a call's skill as its manager lists them; None if the manager does not list it.
Offered = Callable[[SkillCall], ParamHandler | None]


def task_holder(calls: Iterable[SkillCall], offered: Offered) -> SkillHolder:
    """Returns a task that runs the skills in sequence."""
    return SkillHolder("", "Processor", "Sequential", children=[skill_holder(call, offered) for call in calls])


def skill_holder(call: SkillCall, offered: Offered) -> SkillHolder:
    """Returns the skill with all its parameters, with the values of the call.

    If the manager does not list the skill, the parameters are those in the world model.
    """
    listed = offered(call)
    params = (
        dict(listed.items())
        if listed is not None
        else {p.key: Param(p.key, "", Element(p.element_class or ""), p.kind) for p in call.parameters}
    )
    for key, element in call.arguments:
        params.setdefault(key, Param(key, "", Element(element.type), ParamTypes.Required)).assign(element)
    return SkillHolder(call.manager, call.type, call.label, params)
