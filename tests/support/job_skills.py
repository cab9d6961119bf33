"""A library for jobs that take no time, and for stops: `libraries_list:=[support.job_skills]`."""

from __future__ import annotations

import os
import time
from pathlib import Path

from skiros2_common.core.abstract_skill import SkillDescription, State
from skiros2_common.core.params import ParamTypes
from skiros2_common.core.primitive import PrimitiveBase
from support.team_skills import carry


class carry_once(carry):
    """Carries in a third of a second. Appends a line `PRODUCT PLACE TIME` to the file once the world model has it."""

    def describe(self, description: SkillDescription) -> None:
        self.setDescription(description, type(self).__name__)
        self.addParam("Duration", 0.3, ParamTypes.Optional)

    def execute(self) -> State:
        state = super().execute()
        if state is State.Success:
            _note(self.params["Object"].value.id, self.params["To"].value.id)
        return state


class carry_at_once(carry):
    """Carries at once. Appends a line to the file in the variable `CARRIED` of the environment.

    The line is `PRODUCT PLACE TIME`, the time in s since the epoch.
    """

    def describe(self, description: SkillDescription) -> None:
        self.setDescription(description, type(self).__name__)
        self.addParam("Options", {"gentle": True}, ParamTypes.Optional)

    def onStart(self) -> bool:
        return True

    def execute(self) -> State:
        _note(self.params["Object"].value.id, self.params["To"].value.id)
        self.arrive()
        return self.success("done")


class carry_when_released(carry_at_once):
    """Runs until there is a file `released` beside that of `CARRIED`; fails if its text is `fail`."""

    def execute(self) -> State:
        released = Path(os.environ["CARRIED"]).with_name("released")
        if not released.exists():
            return self.step("waiting")
        return self.fail("dropped", -1) if released.read_text() == "fail" else super().execute()


class Wait(SkillDescription):
    pass


class wait_for_stop(PrimitiveBase):
    """Runs until it is preempted, as a motion would. Appends the time of its stop command to the file `STOPPED`.

    The time is that of the monotonic clock (s).
    """

    def createDescription(self) -> None:
        self.setDescription(Wait(), type(self).__name__)

    def execute(self) -> State:
        return self.step("moving")

    def onPreempt(self) -> State:
        now = time.monotonic()
        with Path(os.environ["STOPPED"]).open("a") as file:
            file.write(f"{now}\n")
        return self.fail("stopped", -1)


def _note(product: str, place: str) -> None:
    with Path(os.environ["CARRIED"]).open("a") as file:
        file.write(f"{product} {place} {time.time()}\n")
