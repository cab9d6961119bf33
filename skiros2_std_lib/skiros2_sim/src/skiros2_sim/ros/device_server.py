"""Action servers of simulated devices. A device has one active goal; a new goal preempts it, as with real drivers."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from actionlib.server_goal_handle import ServerGoalHandle
from actionlib_msgs.msg import GoalStatus
from genpy import Message

from skiros2_common.core.errors import Refused, SkirosError
from skiros2_common.ros.goal_server import GoalServer
from skiros2_motion.core.motion import Motion, Outcome, State
from skiros2_sim.core.stepper import Stepper
from skiros2_sim.core.world import World

log = logging.getLogger(__name__)

#: Rate of feedback messages (Hz of simulated time).
_FEEDBACK_RATE = 10


class Job(Protocol):
    """A goal of an action. All methods are called in the stepping thread."""

    def begin(self, world: World) -> Motion:
        """Creates the motion for the goal; nothing has moved yet.

        :raises SkirosError: the goal is invalid.
        """
        ...

    def feedback(self) -> Message:
        """Returns a feedback message."""
        ...

    def result(self, outcome: Outcome) -> Message:
        """Returns the result message."""
        ...


@dataclass
class _Running:
    server: DeviceServer
    handle: ServerGoalHandle
    job: Job
    motion: Motion


class Device:
    """A device that executes one goal at a time. Used only in the stepping thread.

    :param name: for error texts.
    """

    def __init__(self, name: str) -> None:
        self.name = name
        self.running: _Running | None = None


class DeviceServer(GoalServer):
    """An action of a device. If a device has several actions, a goal of one is rejected while another is active.

    :param kind: the action's class.
    :param job: creates a job from a goal; may block; raises SkirosError for an invalid goal.
    :param refusal: creates the result of a rejected goal from the reason.
    """

    def __init__(
        self,
        name: str,
        kind: type[Message],
        stepper: Stepper,
        device: Device,
        job: Callable[[Message], Job],
        rejection: Callable[[str], Message],
    ) -> None:
        super().__init__(name, kind)
        self.name = name
        self._stepper = stepper
        self._device = device
        self._job = job
        self._rejection = rejection
        stepper.add_hook(self._after_step, self.abandon)

    def _unserved_result(self, cancelled: bool, message: str) -> Message:
        return self._rejection(message)

    def _unfinished_handles(self) -> list[ServerGoalHandle]:
        running = self._running
        return [running.handle] if running is not None else []

    @property
    def _running(self) -> _Running | None:
        running = self._device.running
        return running if running is not None and running.server is self else None

    # -- in the thread of the action -----------------------------------------------------------------------------

    def _begin(self, handle: ServerGoalHandle) -> None:
        try:
            job = self._job(handle.get_goal())
            self._stepper.call(lambda world: self._start(world, handle, job))
        except SkirosError as error:
            log.info("%s: a goal is rejected: %s", self.name, error)
            handle.set_rejected(self._rejection(str(error)), str(error))
        except Exception as error:  # clients must get a result after internal errors too
            log.exception("a goal of %s", self.name)
            text = f"internal error: {type(error).__name__}: {error}"
            handle.set_rejected(self._rejection(text), text)

    def _cancel(self, handle: ServerGoalHandle) -> None:
        def cancel(_: World) -> None:
            running = self._running
            if running is not None and running.handle == handle:
                running.motion.cancel()

        try:
            self._stepper.call(cancel)
        except Refused as error:
            log.info("%s: a cancellation failed: %s", self.name, error)

    # -- in the thread that steps --------------------------------------------------------------------------------

    def abandon(self, reason: str) -> None:
        """Aborts the active goal for an external reason."""
        running = self._running
        if running is not None:
            self._device.running = None
            running.handle.set_aborted(self._rejection(reason), reason)

    def _start(self, world: World, handle: ServerGoalHandle, job: Job) -> None:
        before = self._device.running
        if before is not None and before.server is not self:
            raise Refused(f"{self._device.name} is executing a goal of {before.server.name}; cancel it first")
        motion = job.begin(world)
        outcome = motion.outcome
        if outcome is not None and outcome.state is State.REJECTED:
            log.info("%s: a goal is rejected: %s", self.name, outcome.text)
            handle.set_rejected(job.result(outcome), outcome.text)
            return
        if before is not None:
            world.motions.remove(before.motion)
            text = "another goal took its place"
            before.handle.set_canceled(before.job.result(Outcome(State.PREEMPTED, text)), text)
        handle.set_accepted()
        self._device.running = _Running(self, handle, job, motion)
        if outcome is not None:
            self._answer(outcome)
            return
        if handle.get_goal_status().status == GoalStatus.PREEMPTING:  # cancelled just now
            motion.cancel()
        world.motions.add(motion)

    def _after_step(self) -> None:
        running = self._running
        if running is None:
            return
        if running.motion.outcome is not None:
            self._answer(running.motion.outcome)
        elif self._stepper.count % (self._stepper.step_rate // _FEEDBACK_RATE) == 0 and self.has_subscribers:
            running.handle.publish_feedback(running.job.feedback())

    def _answer(self, outcome: Outcome) -> None:
        running = self._device.running
        assert running is not None
        self._device.running = None
        result, handle = running.job.result(outcome), running.handle
        log.info("%s: %s %s", self.name, outcome.state.name.lower(), outcome.text)
        if outcome.state is State.SUCCEEDED:
            handle.set_succeeded(result, outcome.text)
        elif outcome.state is State.PREEMPTED:
            handle.set_canceled(result, outcome.text)
        else:
            handle.set_aborted(result, outcome.text)
