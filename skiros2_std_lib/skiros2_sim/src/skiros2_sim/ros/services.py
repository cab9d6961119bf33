"""The services of the simulator: inspecting and changing the world, for tests."""

from __future__ import annotations

import functools
import logging
import math
import time
from collections.abc import Callable
from typing import TypeVar

import rospy
from genpy import Message
from geometry_msgs.msg import PoseStamped
from std_msgs.msg import Header
from std_srvs.srv import SetBool, SetBoolRequest, SetBoolResponse

from skiros2_common.core.errors import SkirosError, UnknownName
from skiros2_motion.core.geometry import Pose, composed, conjugated, inverted, rotated
from skiros2_sim.core.camera import Lens, looking_at, picture_from
from skiros2_sim.core.perception import Detection, Noise, Source, detect, movable
from skiros2_sim.core.scene_spec import BodySpec
from skiros2_sim.core.stepper import Stepper
from skiros2_sim.core.world import World
from skiros2_sim.ros.frames import Frames
from skiros2_sim.ros.messages import colour_image, pose_from, pose_message, twist_message, vector_from
from skiros2_sim.ros.publishers import SimulatedClock
from skiros2_sim_msgs import msg as msgs
from skiros2_sim_msgs import srv as srvs
from skiros2_world_model.core.ontology import Ontology

log = logging.getLogger(__name__)

Q = TypeVar("Q", bound=Message)  # a request
A = TypeVar("A", bound=Message)  # a response with `ok` and `message`

#: Default size (pixels) and field of view (degrees) of an image.
_WIDTH, _HEIGHT, _FIELD_OF_VIEW = 640, 480, 60.0
#: Period of checks for a delayed measurement (s).
_POLL = 0.02


class Services:
    """Serves requests in threads of ROS; accesses the world in the stepping thread.

    An invalid request is answered with `ok` False and the reason.

    :param ontology: knows the classes of bodies.
    :param reset: resets the world, with a new seed or None; called in the stepping thread.
    :param publish_all: publishes the state of the world; called in the stepping thread.
    """

    def __init__(
        self,
        stepper: Stepper,
        clock: SimulatedClock,
        frames: Frames,
        ontology: Ontology,
        source: Source,
        noise: Noise,
        reset: Callable[[World, int | None], None],
        publish_all: Callable[[], None],
    ) -> None:
        self._stepper = stepper
        self._clock = clock
        self._frames = frames
        self._ontology = ontology
        self._source = source
        self._noise = noise
        self._reset = reset
        self._publish_all = publish_all
        self._services: list[rospy.Service] = []

    def start(self) -> None:
        """Advertises the services."""
        self._services = [
            rospy.Service("~reset", srvs.Reset, answered(srvs.ResetResponse, self._on_reset)),
            rospy.Service("~pause", SetBool, self._on_pause),
            rospy.Service("~step", srvs.Step, answered(srvs.StepResponse, self._on_step)),
            rospy.Service("~set_rate", srvs.SetRate, answered(srvs.SetRateResponse, self._on_set_rate)),
            rospy.Service("~get_pose", srvs.GetPose, answered(srvs.GetPoseResponse, self._on_get_pose)),
            rospy.Service("~set_pose", srvs.SetPose, answered(srvs.SetPoseResponse, self._on_set_pose)),
            rospy.Service("~push", srvs.Push, answered(srvs.PushResponse, self._on_push)),
            rospy.Service("~set_fault", srvs.SetFault, answered(srvs.SetFaultResponse, self._on_set_fault)),
            rospy.Service("~detect", srvs.Detect, answered(srvs.DetectResponse, self._on_detect)),
            rospy.Service("~take_picture", srvs.TakePicture, answered(srvs.TakePictureResponse, self._on_take_picture)),
        ]

    def close(self) -> None:
        """Shuts the services down."""
        for service in self._services:
            service.shutdown()

    # -- time ----------------------------------------------------------------------------------------------------

    def _on_reset(self, request: srvs.ResetRequest) -> srvs.ResetResponse:
        seed = request.seed if request.seed >= 0 else None
        self._stepper.call(lambda world: self._reset(world, seed), even_failed=True)
        return srvs.ResetResponse(ok=True)

    def _on_pause(self, request: SetBoolRequest) -> SetBoolResponse:
        try:
            self._stepper.pause(request.data)
            if request.data:
                self._stepper.call(lambda _: self._publish_all(), even_failed=True)
        except SkirosError as error:
            return SetBoolResponse(False, str(error))
        return SetBoolResponse(True, "paused" if request.data else "runs")

    def _on_step(self, request: srvs.StepRequest) -> srvs.StepResponse:
        self._stepper.step(request.steps)
        return self._stepper.call(self._stepped)

    def _stepped(self, _: World) -> srvs.StepResponse:
        self._publish_all()
        return srvs.StepResponse(ok=True, stamp=self._clock.now)

    def _on_set_rate(self, request: srvs.SetRateRequest) -> srvs.SetRateResponse:
        self._stepper.set_rate(request.factor)
        return srvs.SetRateResponse(ok=True)

    # -- where things are ----------------------------------------------------------------------------------------

    def _on_get_pose(self, request: srvs.GetPoseRequest) -> srvs.GetPoseResponse:
        reference = self._frames.reference(request.frame)

        def get(world: World) -> srvs.GetPoseResponse:
            pose = world.pose_of(request.element)
            linear, angular = world.velocity_of(request.element)
            frame = reference(world)
            back = conjugated(frame.orientation)
            return srvs.GetPoseResponse(
                ok=True,
                pose=PoseStamped(self._header(request.frame), pose_message(composed(inverted(frame), pose))),
                twist=twist_message(rotated(back, linear), rotated(back, angular)),
            )

        return self._stepper.call(get, even_failed=True)

    def _on_set_pose(self, request: srvs.SetPoseRequest) -> srvs.SetPoseResponse:
        reference = self._frames.reference(request.pose.header.frame_id)
        pose = pose_from(request.pose.pose, f"pose of {request.element!r}")

        def put(world: World) -> None:
            world.set_pose(request.element, composed(reference(world), pose))
            if self._stepper.paused:
                self._publish_all()

        self._stepper.call(put)
        return srvs.SetPoseResponse(ok=True)

    def _on_push(self, request: srvs.PushRequest) -> srvs.PushResponse:
        force = vector_from(request.wrench.force, f"push of {request.element!r}: force")
        torque = vector_from(request.wrench.torque, f"push of {request.element!r}: torque")
        duration = request.duration.to_sec()
        self._stepper.call(lambda world: world.push(request.element, force, torque, duration))
        return srvs.PushResponse(ok=True)

    def _on_set_fault(self, request: srvs.SetFaultRequest) -> srvs.SetFaultResponse:
        def put(world: World) -> None:
            if request.active:
                world.faults.set(request.kind, request.target, request.value, request.duration)
            else:
                world.faults.clear(request.kind, request.target)

        self._stepper.call(put)
        log.info("fault %s of %s %s", request.kind, request.target, "started" if request.active else "cleared")
        return srvs.SetFaultResponse(ok=True)

    # -- perception ----------------------------------------------------------------------------------------------

    def _on_detect(self, request: srvs.DetectRequest) -> srvs.DetectResponse:
        reference = self._frames.reference(request.frame)
        for kind in request.types:
            if not self._ontology.has_class(kind):
                raise UnknownName(f"there is no class {kind!r} in the ontology")

        def wanted(body: BodySpec) -> bool:
            if not request.types:
                return movable(body)
            return any(self._ontology.is_subclass(body.type, kind) for kind in request.types)

        def look(world: World) -> tuple[srvs.DetectResponse, float]:
            found = detect(world, request.camera, wanted, self._source, self._noise)
            back, header = inverted(reference(world)), self._header(request.frame)
            detections = [_detection(detection, back, header) for detection in found]
            answer = srvs.DetectResponse(ok=True, stamp=header.stamp, detections=detections)
            return answer, world.faults.lag(request.camera)

        answer, lag = self._stepper.call(look)
        if lag:
            self._wait(lag)
        return answer

    def _on_take_picture(self, request: srvs.TakePictureRequest) -> srvs.TakePictureResponse:
        pose = looking_at(vector_from(request.eye, "eye"), vector_from(request.target, "target"))
        lens = Lens(
            request.width or _WIDTH, request.height or _HEIGHT, math.radians(request.field_of_view or _FIELD_OF_VIEW)
        )

        def take(world: World) -> srvs.TakePictureResponse:
            picture = picture_from(world, pose, lens, shadow=True)
            return srvs.TakePictureResponse(ok=True, image=colour_image(picture, self._header("")))

        return self._stepper.call(take, even_failed=True)

    def _wait(self, seconds: float) -> None:
        """Waits for simulated time; returns at once if it is stopped."""
        end = self._clock.seconds + seconds
        while self._clock.seconds < end and not (self._stepper.paused or self._stepper.failure or rospy.is_shutdown()):
            time.sleep(_POLL)

    def _header(self, frame: str) -> Header:
        return Header(stamp=self._clock.now, frame_id=frame or self._frames.map)


def answered(response: type[A], serve: Callable[[Q], A]) -> Callable[[Q], A]:
    """Wraps a service handler: errors are answered with `ok` False and the reason."""

    @functools.wraps(serve)
    def answer(request: Q) -> A:
        try:
            return serve(request)
        except SkirosError as error:
            log.info("%s: %s", type(request).__name__, error)
            return response(ok=False, message=str(error))

    return answer


def _detection(detection: Detection, back: Pose, header: Header) -> msgs.Detection:
    pose = PoseStamped(header, pose_message(composed(back, detection.pose)))
    return msgs.Detection(detection.id, detection.type, detection.label, pose, detection.confidence)
