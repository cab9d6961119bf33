"""Skills of contact and perception decide by recorded wrenches, states and images as they did in the recorded run.

`contact.bag`: the piston cell locates its displaced block, takes the piston, and inserts it twice. The first insertion
is ended by its hold-condition on the signal of the wrist, the second one succeeds.
"""

from __future__ import annotations

import itertools
import math
import threading
from copy import copy
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from skiros2_bags.core.run import Run
from skiros2_bags.testing.field_tolerances import FieldTolerances
from skiros2_bags.testing.recorded_world import world_model_with
from skiros2_bags.testing.recording import Recording, SignalMessage, TaskProgress
from skiros2_bags.testing.rerun import Settings, rerun
from skiros2_common.core.abstract_skill import State
from skiros2_common.core.world_element import Element
from skiros2_common.core.world_model_port import WorldModelPort
from skiros2_contact_skills.arms import provided_arms
from skiros2_contact_skills.contact_primitive import CONTACT_STIFFNESS
from skiros2_contact_skills.ros.impedance_arm import arm_state
from skiros2_learning.local.insertion_study import ARM, BLOCK, BORE, PISTON, SCENE, insertion_skills
from skiros2_motion.core.compliant_arm import ArmState
from skiros2_motion.core.geometry import IDENTITY, Pose, composed
from skiros2_motion.core.impact import KEPT_STIFFNESS
from skiros2_perception.camera_skill import CameraSkill
from skiros2_perception.core.transforms import difference
from skiros2_perception.core.view import View
from skiros2_perception.locating import estimate_pose
from skiros2_perception.ros.messages import depth_of, lens_of
from skiros2_runs.core.history import SkillRecord
from skiros2_runs.core.states import FAILURE, SUCCESS
from skiros2_runs.core.tolerance import Tolerance
from skiros2_skill.testing import SkillBench
from skiros2_std_reasoners.core import spatial_data as space
from skiros2_world_model.core.local_world_model import LocalWorldModel
from support.ros import ROOT

BAG = ROOT / "tests" / "bags" / "contact.bag"
STATE, WRENCH = "/piston_cell/right_arm/right_compliant/state", "/piston_cell/right_arm/wrist/wrench"
IMAGE, INFO = "/piston_cell/camera/depth/image_raw", "/piston_cell/camera/depth/camera_info"
MOTIONS = {"approach_grasp", "approach_target", "move_until_contact", "spiral_search", "insert_part", "retract_tool"}
SETTINGS = Settings(SCENE.parent, tolerances=FieldTolerances(Tolerance(0.02, 0.02)))
CAMERA = "skiros:DepthCamera-27"
TICK = 0.04  # s


@pytest.fixture(scope="module")
def recording() -> Recording:
    return Recording(BAG)


@pytest.fixture(scope="module")
def run() -> Run:
    return Run.open(BAG)


def skill_runs(run: Run, label: str) -> list[SkillRecord]:
    return [skill for skill in run.skills() if skill.label == label]


def bench_at(run: Run, time: float) -> SkillBench:
    """The world model as it was recorded at a time."""
    return SkillBench(wmi=LocalWorldModel("replay", world_model_with(run.world(time), SCENE.parent)))


def seconds(stamp: Any) -> float:
    return float(stamp.sec + stamp.nanosec / 1e9)


# -- a hold-condition on a signal -------------------------------------------------------------------------------------


def test_recorded_force_ends_the_tree_again(recording: Recording, run: Run) -> None:
    first, second = skill_runs(run, "insert_into_bore")
    assert (first.state, second.state) == (FAILURE, SUCCESS) and "ForceBelowLimit" in first.message
    assert rerun(recording, SETTINGS).divergence is None


@pytest.mark.long
def test_tree_without_the_recorded_forces_diverges_where_they_ended_it(recording: Recording) -> None:
    silent = copy(recording)
    silent.events = [event for event in recording.events if not _is_above(event, 5.0)]
    found = rerun(silent, SETTINGS).divergence
    assert found is not None
    assert "task 2" in found.where and found.what.startswith("root / insert_into_bore")
    assert found.expected.startswith("failed") and found.got.startswith("running")


@pytest.mark.long
def test_force_that_was_recorded_after_the_tick_that_it_ended_is_found(recording: Recording) -> None:
    ended = next(
        event
        for event in recording.events
        if isinstance(event, TaskProgress) and any("ForceBelowLimit" in n.message for n in event.frame.nodes.values())
    )
    late = copy(recording)
    late.events = sorted(
        (
            replace(event, order=ended.order + 0.25, time=ended.time)
            if ended.time - 0.1 < event.time and event.order < ended.order and _is_above(event, 5.0)
            else event
            for event in recording.events
        ),
        key=lambda event: event.order,
    )
    assert rerun(late, SETTINGS).divergence is None


def _is_above(event: object, limit: float) -> bool:
    if not isinstance(event, SignalMessage):
        return False
    force = event.message.wrench.force
    return math.hypot(force.x, force.y, force.z) > limit


# -- contact skills ---------------------------------------------------------------------------------------------------


class RecordedArm:
    """An arm whose states come from a bag; commands have no effect.

    :ivar time: the time of the bag (s).
    """

    def __init__(self, run: Run, mount: Pose) -> None:
        self._messages = list(run.messages(STATE))
        self._mount = mount
        self.time = 0.0

    def arm(self, wmi: WorldModelPort, robot: Element, arm: Element) -> RecordedArm:
        return self

    def now(self) -> float:
        return self._stamp()

    def state(self) -> ArmState | None:
        return arm_state(self._last().content, self._mount, self._stamp())

    def _last(self) -> Any:
        return [message for message in self._messages if message.time <= self.time][-1]

    def _stamp(self) -> float:
        return seconds(self._last().content.header.stamp)

    def _ignore(self, *values: object) -> None:
        """A command."""

    begin = end = stop_overlay = zero_sensor = start_spiral = _ignore
    set_reference = set_stiffness = set_damping = set_wrench = set_wrench_limits = _ignore


def test_insertion_decides_by_recorded_states_as_it_did(run: Run) -> None:
    begin = skill_runs(run, "insert_into_bore")[1].start
    recorded = [skill for skill in run.skills() if skill.start >= begin and skill.label in MOTIONS]
    end = max(skill.end for skill in recorded)
    with bench_at(run, begin) as bench:
        arm = RecordedArm(run, space.pose_of(bench.wmi.get_element(ARM)) or IDENTITY)
        # the push on the floor was not recorded: without it, the insertion ends as soon as the part is deep enough
        bench.load(*insertion_skills(parameters={"insert_part": {"SeatForce": 0.0}}))
        arm_element = bench.wmi.get_element(ARM)
        arm_element.setProperty(CONTACT_STIFFNESS, KEPT_STIFFNESS)  # the motions had the speeds of this one
        bench.wmi.update_element_properties(arm_element)
        elements = {key: bench.wmi.get_element(eid) for key, eid in (("Arm", ARM), ("Part", PISTON), ("Bore", BORE))}
        wrenches = iter([message for message in run.messages(WRENCH) if message.time > begin - 1.0])
        with provided_arms(arm):
            task = bench.command("InsertIntoBore", "insert_into_bore", **elements)
            while arm.time < end + 1.0 and task.state in (State.Idle, State.Running):
                arm.time = begin + TICK * len(task.trace.ticks)
                for message in itertools.takewhile(lambda m: m.time <= arm.time, wrenches):
                    bench.signals.publish(WRENCH, message.content)
                task.tick()
    assert task.state is State.Success, task.why
    ends: dict[str, float] = {}
    for tick, name, state, _ in task.trace.rows():
        if name in MOTIONS and state is State.Success:
            ends.setdefault(name, begin + TICK * (tick - 1))
    assert list(ends) == [skill.label for skill in recorded]
    for skill in recorded:
        # the driver's answers, which are in no bag, had taken some ticks
        late = 1.5 if skill.label == "insert_part" else 0.5
        assert ends[skill.label] == pytest.approx(skill.end, abs=late), skill.label


# -- a perception skill -----------------------------------------------------------------------------------------------


def view_of(run: Run, stamp: float) -> View:
    """The recorded view with this stamp (s), in the frame of the map."""
    (image,) = [m.content for m in run.messages(IMAGE) if seconds(m.content.header.stamp) == stamp]
    (info,) = [m.content for m in run.messages(INFO) if seconds(m.content.header.stamp) == stamp]
    return View(depth_of(image), *lens_of(info, image), camera_pose(run, image.header), "map", stamp)


def camera_pose(run: Run, header: Any) -> Pose:
    """The pose of a frame in the map by the recorded transforms. The arm was at rest."""
    parents: dict[str, tuple[str, Pose]] = {}
    for message in run.messages("/tf"):
        for transform in message.content.transforms:
            if abs(seconds(transform.header.stamp) - seconds(header.stamp)) < 0.05:
                t, q = transform.transform.translation, transform.transform.rotation
                pose = Pose((t.x, t.y, t.z), (q.x, q.y, q.z, q.w))
                parents[transform.child_frame_id] = transform.header.frame_id, pose
    found, frame = IDENTITY, header.frame_id
    while frame != "map":
        frame, pose = parents[frame]
        found = composed(pose, found)
    return found


class RecordedCamera:
    """Stands in for the camera's topics."""

    waiting = ""

    def __init__(self, view: View) -> None:
        self._view = view

    def poll(self) -> View:
        return self._view

    def close(self) -> None:
        """Nothing to close."""


def test_block_is_located_in_recorded_images_where_it_was(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    first, second = skill_runs(run, "estimate_pose")
    for skill, fuse in ((first, False), (second, True)):
        expected = run.world(skill.end + 0.1).element(BLOCK)
        assert expected is not None
        view = view_of(run, expected.value_of("skiros:EstimateStamp"))
        monkeypatch.setattr(CameraSkill, "open_camera", lambda self, topics, frame, view=view: RecordedCamera(view))
        with bench_at(run, skill.start) as bench:
            bench.load(estimate_pose)
            block, camera = bench.wmi.get_element(BLOCK), bench.wmi.get_element(CAMERA)
            task = bench.command("EstimatePose", "estimate_pose", Camera=camera, Object=block, Fuse=fuse)
            ended = threading.Event()
            task.waker = ended.set
            while task.tick() is State.Running:
                ended.wait(0.1)
                ended.clear()
            assert task.state is State.Success, task.why
            found = bench.wmi.get_element(BLOCK)
        error = difference(space.pose_of(found) or IDENTITY, space.pose_of(expected) or IDENTITY)
        assert np.linalg.norm(error[:3]) < 1e-4 and np.linalg.norm(error[3:]) < 1e-3
        assert found.value_of("skiros:EstimateViews") == expected.value_of("skiros:EstimateViews")
