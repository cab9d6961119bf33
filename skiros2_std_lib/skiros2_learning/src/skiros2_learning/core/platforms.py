"""Where and how the task of a scenario is executed: its steps, the simulation, the real robot."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field

from skiros2_learning.core.sections import Keyed, Number, Positive, Section, Text, Whole

#: Runs the task in the simulated world; see `local.episode`.
SIMULATED_SKILLS = "skiros2_learning.local.episode:run_episode"
#: Runs the task on running nodes; see `ros.real_robot`.
REAL_SKILLS = "skiros2_learning.ros.real_robot:run_episode"
Platform = Literal["simulation", "real"]
#: Where a task runs, and by which execution.
PLATFORMS: dict[str, str] = {"simulation": SIMULATED_SKILLS, "real": REAL_SKILLS}


@dataclass(frozen=True)
class Step(Section):
    """A skill of the task.

    :param name: prefix of its variables; by default the skill's type.
    :param parameters: fixed values by key; elements by label.
    """

    name: Text
    skill: Text
    label: Text = ""
    parameters: Keyed[Any] = field(default_factory=dict)

    @classmethod
    def completed(cls, data: dict[str, Any]) -> dict[str, Any]:
        return {"name": str(data.get("skill")), **data}


@dataclass(frozen=True)
class Simulation(Section):
    """How the task is simulated.

    :param time_limit: of an execution (s of simulated time); the task is preempted then.
    :param tick_rate: of the skills (Hz).
    :param step_rate: of the physics (Hz).
    """

    time_limit: Positive = 30.0
    tick_rate: Annotated[Number, Field(ge=1.0, le=240.0)] = 10.0
    step_rate: Annotated[Whole, Field(ge=240, le=2000)] = 240


@dataclass(frozen=True)
class RealPlatform(Section):
    """How the task is executed on running nodes.

    :param manager: node name of the skill manager; "" for the only one.
    :param reset: steps before each execution, and their timeout (s).
    :param signals: label of the signal's element for each series that rewards read.
    :param sample_rate: of the record (Hz).
    """

    manager: Text = ""
    reset: tuple[Step, ...] = ()
    reset_timeout: Positive = 120.0
    signals: Keyed[Annotated[str, BeforeValidator(str)]] = field(default_factory=dict)
    sample_rate: Annotated[Positive, Field(le=1000.0)] = 10.0
