"""The skill MySkill."""

from skiros2_common.core.abstract_skill import SkillDescription
from skiros2_common.core.params import ParamTypes
from skiros2_common.core.primitive import PrimitiveBase


class MySkill(SkillDescription):
    """One sentence that says what the skill does: users see it."""

    def createDescription(self):
        self.addParam("Times", 3, ParamTypes.Required, description="How many ticks it takes", minimum=1)


class my_skill(PrimitiveBase):
    """How it does it."""

    def createDescription(self):
        self.setDescription(MySkill(), "my_skill")

    def onStart(self):
        """Called once at the start. Return False to fail."""
        self._ticks = 0
        return True

    def execute(self):
        """Called at each tick; must not block."""
        self._ticks += 1
        if self._ticks < self.params["Times"].value:
            return self.step(f"{self._ticks} of {self.params['Times'].value}")
        return self.success("done")

    def onPreempt(self):
        """Called when the task is stopped."""
        return self.fail("stopped", -1)
