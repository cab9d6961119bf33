"""A library for jobs that take no time: `libraries_list:=[support.job_skills]`."""

from __future__ import annotations

import os
import time
from pathlib import Path

from skiros2_common.core.abstract_skill import SkillDescription, State
from support.team_skills import carry


class carry_at_once(carry):
    """Carries at once. Appends a line to the file in the variable `CARRIED` of the environment.

    The line is `PRODUCT PLACE TIME`, the time in s since the epoch.
    """

    def describe(self, description: SkillDescription) -> None:
        self.setDescription(description, type(self).__name__)

    def onStart(self) -> bool:
        return True

    def execute(self) -> State:
        with Path(os.environ["CARRIED"]).open("a") as file:
            file.write(f"{self.params['Object'].value.id} {self.params['To'].value.id} {time.time()}\n")
        self.arrive()
        return self.success("done")
