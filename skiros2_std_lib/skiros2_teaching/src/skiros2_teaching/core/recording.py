"""Records the path of a tool that is guided by hand."""

from __future__ import annotations

from collections.abc import Sequence

from skiros2_common.core.errors import WrongValue
from skiros2_motion.core.compliant_arm import ArmState
from skiros2_motion.core.geometry import Pose
from skiros2_motion.core.gripper import GripperEvent
from skiros2_teaching.core.taught_path import MAX_SAMPLES, Sample, TaughtPath

#: Time without a new state after which the sensor counts as stale (s).
STALE = 1.0


class Recording:
    """The samples of a path so far, in the base frame of the arm. Used by one thread."""

    def __init__(self) -> None:
        self._samples: list[Sample] = []

    def __len__(self) -> int:
        return len(self._samples)

    @property
    def duration(self) -> float:
        """s."""
        return self._samples[-1].time - self._samples[0].time if self._samples else 0.0

    def add(self, state: ArmState) -> None:
        """Adds a state, unless it was added already.

        :raises WrongValue: the recording has as many samples as a path may have.
        """
        if self._samples and state.stamp <= self._samples[-1].time:
            return
        if len(self._samples) == MAX_SAMPLES:
            raise WrongValue(f"the recording has {MAX_SAMPLES} samples: a path may have no more")
        self._samples.append(Sample(state.stamp, state.pose))

    def path(self, frame: Pose, commands: Sequence[GripperEvent] = ()) -> TaughtPath:
        """Returns the smoothed path.

        :param frame: the pose of the arm's base frame in the frame of the path.
        :param commands: to the gripper; those during the recording become events.
        :raises WrongValue: the recording is not a path; the text lists all problems.
        """
        if not self._samples:
            raise WrongValue("the recording is empty: the arm has sent no state")
        first, last = self._samples[0].time, self._samples[-1].time
        events = [command for command in commands if first <= command.time <= last]
        return TaughtPath.from_samples(self._samples, events).transformed(frame).smoothed()
