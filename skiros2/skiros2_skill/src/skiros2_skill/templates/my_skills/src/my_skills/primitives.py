"""Skills that are code. They pretend: replace them by skills for your robot."""

from my_skills.descriptions import Drive, TakePicture
from skiros2_common.core.primitive import PrimitiveBase
from skiros2_std_skills.clock import Stopwatch


class drive(PrimitiveBase):
    """Takes two seconds; then the robot is there."""

    def createDescription(self):
        self.setDescription(Drive(), "drive")

    def onStart(self):
        self._stopwatch = Stopwatch()
        return True

    def execute(self):
        """Called at each tick; must not block."""
        passed = self._stopwatch.passed()
        if passed < 2.0:
            return self.step(f"driving for {passed:.1f} s")
        robot = self.params["Robot"].value
        self.wmi.set_relation(robot.id, "skiros:at", self.params["StartLocation"].value.id, False)
        self.wmi.set_relation(robot.id, "skiros:at", self.params["TargetLocation"].value.id)
        return self.success("arrived")


class take_picture(PrimitiveBase):
    """Waits for the exposure."""

    def createDescription(self):
        self.setDescription(TakePicture(), "take_picture")

    def onStart(self):
        self._stopwatch = Stopwatch()
        return True

    def execute(self):
        if self._stopwatch.passed() < self.params["Exposure"].value:
            return self.step("exposing")
        return self.success(f"a picture of {self.params['Object'].value.label}")
