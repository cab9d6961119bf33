"""Where and how the task of a scenario is executed: its steps, the simulation, the real robot."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from skiros2_learning.core.sections import Section

#: Runs the task in the simulated world; see `local.episode`.
SIMULATED_SKILLS = "skiros2_learning.local.episode:run_episode"
#: Runs the task on running nodes; see `ros.real_robot`.
REAL_SKILLS = "skiros2_learning.ros.real_robot:run_episode"
#: Where a task runs, and by which execution.
PLATFORMS = {"simulation": SIMULATED_SKILLS, "real": REAL_SKILLS}


@dataclass(frozen=True)
class Step:
    """A skill of the task.

    :param name: prefix of its variables; by default the skill's type.
    :param parameters: fixed values by key; elements by label.
    """

    name: str
    skill: str
    label: str = ""
    parameters: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Simulation:
    """How the task is simulated.

    :param time_limit: of an execution (s of simulated time); the task is preempted then.
    :param tick_rate: of the skills (Hz).
    :param step_rate: of the physics (Hz).
    """

    time_limit: float = 30.0
    tick_rate: float = 10.0
    step_rate: int = 240


@dataclass(frozen=True)
class RealPlatform:
    """How the task is executed on running nodes.

    :param manager: node name of the skill manager; "" for the only one.
    :param reset: steps before each execution, and their timeout (s).
    :param signals: label of the signal's element for each series that rewards read.
    :param sample_rate: of the record (Hz).
    """

    manager: str = ""
    reset: tuple[Step, ...] = ()
    reset_timeout: float = 120.0
    signals: Mapping[str, str] = field(default_factory=dict)
    sample_rate: float = 10.0


def read_step(section: Section) -> Step:
    """Reads a step."""
    skill = section.text("skill")
    step = Step(section.text("name", skill), skill, section.text("label", ""), section.section("parameters").take_all())
    section.end()
    return step


def read_simulation(section: Section) -> Simulation:
    """Reads the section `simulation`."""
    simulation = Simulation(
        section.number("time_limit", 30.0, above=0.0),
        section.number("tick_rate", 10.0, low=1.0, high=240.0),
        section.whole("step_rate", 240, low=240, high=2000),
    )
    section.end()
    return simulation


def read_real(section: Section) -> RealPlatform:
    """Reads the section `real`."""
    real = RealPlatform(
        section.text("manager", ""),
        tuple(read_step(part) for part in section.listed("reset", ())),
        section.number("reset_timeout", 120.0, above=0.0),
        {name: str(label) for name, label in section.section("signals").take_all().items()},
        section.number("sample_rate", 10.0, above=0.0, high=1000.0),
    )
    section.end()
    return real
