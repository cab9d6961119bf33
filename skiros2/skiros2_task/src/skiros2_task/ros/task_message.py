"""A plan as the task that a skill manager runs."""

from __future__ import annotations

from collections.abc import Iterable

from skiros2_common.core.params import Param, ParamTypes
from skiros2_skill.ros.utils import SkillHolder
from skiros2_task.core.plan import SkillCall


def task_holder(calls: Iterable[SkillCall]) -> SkillHolder:
    """The task that runs the skills one after the other."""
    return SkillHolder("", "Processor", "Sequential", children=[skill_holder(call) for call in calls])


def skill_holder(call: SkillCall) -> SkillHolder:
    """The skill with its parameters."""
    params = {key: Param(key, "", element, ParamTypes.Required) for key, element in call.arguments}
    return SkillHolder(call.manager, call.type, call.label, params)
