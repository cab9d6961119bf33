"""Base of primitives that take a view of a depth camera and compute with it."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from typing import Any

from skiros2_common.core.abstract_skill import State
from skiros2_common.core.errors import SkirosError
from skiros2_common.core.primitive import PrimitiveBase
from skiros2_common.core.world_element import Element
from skiros2_perception.core.objects import sensor_of
from skiros2_perception.core.view import Sensor, View
from skiros2_perception.ros.depth_camera import DepthCamera, Topics
from skiros2_std_skills.client_primitive import STOPPED

log = logging.getLogger(__name__)

#: Progress codes: the world model lacks data; no usable view; the estimate was refused.
NOT_KNOWN, NO_VIEW, REFUSED = -110, -111, -112


class CameraSkill(PrimitiveBase):
    """Waits for a view, computes in a thread of its own, then writes to the world model in `execute`."""

    replays_progress = True
    #: Whether the views need colours.
    needs_colours = False

    def prepare(self) -> str:
        """To override: reads the world model before the view is taken. Returns the reference frame of the view.

        :raises SkirosError: the world model lacks data.
        """
        raise NotImplementedError(f"{self.__class__.__name__} has to define prepare")

    def compute(self, view: View, sensor: Sensor) -> Any:
        """To override: called in a thread of its own.

        :raises SkirosError: there is no result.
        """
        raise NotImplementedError(f"{self.__class__.__name__} has to define compute")

    def write(self, result: Any) -> str:
        """To override: writes a result to the world model. Returns the text of the success.

        :raises SkirosError: the result is refused; nothing was written.
        """
        raise NotImplementedError(f"{self.__class__.__name__} has to define write")

    def open_camera(self, topics: Topics, frame: str) -> DepthCamera:
        """Subscribes to a camera."""
        return DepthCamera(topics, frame, self.wake)

    def element(self, key: str) -> Element:
        """Returns the element in a parameter."""
        value: Element = self.params[key].value
        return value

    def onStart(self) -> bool:
        self._camera: DepthCamera | None = None
        self._work: _Work | None = None
        self._began_at = time.monotonic()
        camera = self.element("Camera")
        keys = ("skiros:PointCloudTopic", "skiros:DepthTopic", "skiros:RgbTopic")
        cloud, depth, colour = (str(camera.value_of(key) or "") for key in keys)
        name = camera.label or camera.id
        if not cloud and not depth:
            return self.startError(
                f"camera {name!r} has no topic: expected skiros:DepthTopic or skiros:PointCloudTopic", NOT_KNOWN
            )
        try:
            self._sensor = sensor_of(camera)
            frame = self.prepare()
        except SkirosError as error:
            return self.startError(str(error), NOT_KNOWN)
        self._camera = self.open_camera(Topics(depth, cloud, colour if self.needs_colours else ""), frame)
        return True

    def execute(self) -> State:
        if self._work is None:
            return self._take_view()
        if not self._work.ended:
            return self.step("Computing")
        if self._work.error:
            return self.fail(self._work.error, REFUSED)
        try:
            return self.success(self.write(self._work.result))
        except SkirosError as error:
            return self.fail(str(error), REFUSED)

    def onPreempt(self) -> State:
        return self.fail("Stopped; the world model is unchanged", STOPPED)

    def onEnd(self) -> bool:
        if self._camera is not None:
            self._camera.close()
            self._camera = None
        return True

    def _take_view(self) -> State:
        assert self._camera is not None
        try:
            view = self._camera.poll()
        except SkirosError as error:
            return self.fail(str(error), NO_VIEW)
        if view is not None:
            self._work = _Work(lambda: self.compute(view, self._sensor), self.wake)
            return self.step("Computing")
        timeout = self.params["Timeout"].value
        if time.monotonic() - self._began_at > timeout:
            return self.fail(f"No view within {timeout:g} s: {self._camera.waiting}", NO_VIEW)
        return self.step(f"Waiting: {self._camera.waiting}")


class _Work:
    """A computation in its own thread. `result` or `error` is set before `ended`."""

    def __init__(self, compute: Callable[[], Any], on_end: Callable[[], None]) -> None:
        self.result: Any = None
        self.error = ""
        self.ended = False
        arguments = (compute, on_end)
        threading.Thread(target=self._run, args=arguments, name="perception", daemon=True).start()

    def _run(self, compute: Callable[[], Any], on_end: Callable[[], None]) -> None:
        try:
            self.result = compute()
        except SkirosError as error:
            self.error = str(error)
        except Exception as error:  # a fault of the computation: the skill fails, the log has the traceback
            log.exception("perception failed")
            self.error = f"{type(error).__name__}: {error}"
        self.ended = True
        on_end()
