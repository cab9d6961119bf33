"""Planning in the tests of a skill library, without nodes."""

from __future__ import annotations

from collections.abc import Sequence

from skiros2_common.core.errors import Refused
from skiros2_skill.ros.registration import Registration
from skiros2_skill.testing import SkillBench
from skiros2_task.core.engines import EngineProcesses, Limits
from skiros2_task.core.plan import SkillCall
from skiros2_task.core.planners import engine_planner
from skiros2_task.core.planning import TaskPlanner, Verdict

__all__ = ["plan"]

#: The longest search for a plan (s).
_TIMEOUT = 30.0


def plan(bench: SkillBench, goal: str, skills: Sequence[str], assume: bool = False) -> tuple[SkillCall, ...]:
    """Plans a goal with a robot's skills. Enters the robot and its skills into the bench's scene, as a manager does.

    :param goal: as for the task manager, such as `(skiros:at cora:Robot-1 skiros:Location-5)`.
    :param skills: labels of implementations; their libraries were imported with `bench.import_libraries`.
    :param assume: whether required parameters without a value are assumed to have one.
    :returns: the steps in order; () if the goal holds already.
    :raises Refused: there is no plan; the text says why.
    :raises SkirosError: the goal or a skill is unknown.
    """
    bench.load(*skills)
    prefix, _, name = bench.robot.label.rpartition(":")
    registration = Registration(bench.wmi, prefix, name, f"/{name}")
    registration.register_robot()
    registration.register_skills(bench.library.implementations())
    processes = EngineProcesses()
    try:
        result = TaskPlanner(bench.wmi, engine_planner(processes), Limits(_TIMEOUT)).plan(goal, assume=assume)
    finally:
        processes.close()
    if result.verdict not in (Verdict.PLANNED, Verdict.NOTHING_TO_DO):
        raise Refused(result.message)
    return result.calls
