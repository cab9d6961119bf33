"""Actions of simulated devices: one goal at a time, a new one takes the place of the old, as drivers do."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

from actionlib_msgs.msg import GoalStatus

from skiros2_common.core.errors import Refused, SkirosError
from skiros2_common.ros.goal_server import GoalServer
from skiros2_sim.core.motion import Motion, Outcome, State
from skiros2_sim.core.stepper import Stepper
from skiros2_sim.core.world import RATE, World

log = logging.getLogger(__name__)

#: Steps between two feedbacks: 10 Hz of simulated time.
_FEEDBACK = RATE // 10


class Job(Protocol):
    """A goal of an action: how it is begun, and how it is told of. All in the thread that steps."""

    def begin(self, world: World) -> Motion:
        """The motion that does it; nothing has moved yet.

        :raises SkirosError: it cannot be.
        """
        ...

    def feedback(self) -> Any:
        """How it goes on."""
        ...

    def result(self, outcome: Outcome) -> Any:
        """How it ended."""
        ...


@dataclass
class _Running:
    server: DeviceServer
    handle: Any
    job: Job
    motion: Motion


class Device:
    """Something that one goal at a time can move. Belongs to the thread that steps.

    :param name: for the texts of refusals.
    """

    def __init__(self, name: str) -> None:
        self.name = name
        self.running: _Running | None = None


class DeviceServer(GoalServer):
    """One action of a device. Devices may have several: a goal of one is refused while one of another is carried out.

    :param kind: the action's class.
    :param job: makes a job of a goal; raises SkirosError when it cannot be. May wait.
    :param refusal: makes a result of the text that says why there is none.
    """

    def __init__(
        self,
        name: str,
        kind: Any,
        stepper: Stepper,
        device: Device,
        job: Callable[[Any], Job],
        refusal: Callable[[str], Any],
    ) -> None:
        super().__init__(name, kind)
        self.name = name
        self._stepper = stepper
        self._device = device
        self._job = job
        self._refusal = refusal
        stepper.add_hook(self._after_step, self.abandon)

    def _unserved_result(self, cancelled: bool, message: str) -> Any:
        return self._refusal(message)

    def _unfinished_handles(self) -> list[Any]:
        running = self._running
        return [running.handle] if running is not None else []

    @property
    def _running(self) -> _Running | None:
        running = self._device.running
        return running if running is not None and running.server is self else None

    # -- in the thread of the action -----------------------------------------------------------------------------

    def _begin(self, handle: Any) -> None:
        try:
            job = self._job(handle.get_goal())
            self._stepper.call(lambda world: self._start(world, handle, job))
        except SkirosError as error:
            log.info("%s: a goal is refused: %s", self.name, error)
            handle.set_rejected(self._refusal(str(error)), str(error))
        except Exception as error:  # the client has to hear of our own mistakes too
            log.exception("a goal of %s", self.name)
            text = f"internal error: {type(error).__name__}: {error}"
            handle.set_rejected(self._refusal(text), text)

    def _cancel(self, handle: Any) -> None:
        def cancel(_: World) -> None:
            running = self._running
            if running is not None and running.handle == handle:
                running.motion.cancel()

        try:
            self._stepper.call(cancel)
        except Refused as error:
            log.info("%s: a goal is not cancelled: %s", self.name, error)

    # -- in the thread that steps --------------------------------------------------------------------------------

    def abandon(self, reason: str) -> None:
        """Ends the goal that is carried out, for something that is no doing of its own."""
        running = self._running
        if running is not None:
            self._device.running = None
            running.handle.set_aborted(self._refusal(reason), reason)

    def _start(self, world: World, handle: Any, job: Job) -> None:
        before = self._device.running
        if before is not None and before.server is not self:
            raise Refused(f"{self._device.name} carries out a goal of {before.server.name}: cancel that first")
        motion = job.begin(world)
        outcome = motion.outcome
        if outcome is not None and outcome.state is State.REJECTED:
            log.info("%s: a goal is refused: %s", self.name, outcome.text)
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
        elif self._stepper.count % _FEEDBACK == 0 and self.has_subscribers:
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
