"""The presenter of the page "Teach": what is taught of the selected object, and the skills that teach."""

from __future__ import annotations

import enum
from collections.abc import Callable, Mapping
from typing import Any

from skiros2_common.core.changeset import ChangeSet
from skiros2_common.core.errors import SkirosError, WrongValue
from skiros2_common.core.operations import Operation
from skiros2_common.core.world_element import Element
from skiros2_gui.app.events import ConnectionChanged, ElementSelected, TasksChanged
from skiros2_gui.app.problems import error_text
from skiros2_gui.app.skill_calls import SkillCalls
from skiros2_gui.app.system import MANAGER, part_of
from skiros2_gui.app.tasks import message_text
from skiros2_gui.skills.form import element_value
from skiros2_gui.teach.elements import LIFTING_POSE, PATH, POSE, Arm, Taught, arms, owner_of, taught_of
from skiros2_gui.world.presenter import WorldPresenter
from skiros2_gui.world.requests import Requests


class Action(enum.Enum):
    """An action of the user; the value is the skill that it starts, "" for a change of the scene."""

    RELEASE = "skiros:TeachRelease"
    TELEOPERATE = "skiros:TeleoperateArm"
    HOLD = "skiros:TeachEnd"
    RECORD_POSE = "skiros:TeachPose"
    RECORD_LIFTING = "skiros:TeachLiftingPose"
    RECORD_PATH = "skiros:TeachPath"
    STORE_PATH = "store"
    MOVE_TO_POSE = "skiros:MoveToTaughtPose"
    REPLAY_PATH = "skiros:ReplayTaughtPath"
    MOVE_GRIPPER = "skiros:MoveGripper"
    RENAME = "rename"
    DELETE = "delete"


#: The actions that change taught elements, and those that move the arm.
_RECORDING = (Action.RECORD_POSE, Action.RECORD_LIFTING, Action.RECORD_PATH)
_MOTIONS = (Action.MOVE_TO_POSE, Action.REPLAY_PATH)
#: The actions in which a person moves the arm.
_GUIDED = (Action.RELEASE, Action.TELEOPERATE)
#: The time in which the device has to send its first twist (s).
_FIRST_TWIST = 60.0

#: The time after a call in which its change of the scene may arrive (s).
_ARRIVAL = 5.0


class TeachPresenter:
    """Used in the window's thread. Reads the scene in `refresh` only.

    :param on_change: called when something shown may have changed.
    :ivar arm: the chosen arm; None for none.
    :ivar owner: the selected object; None for none.
    :ivar chosen: the chosen taught element of the object; None for none.
    :ivar name: the name for the next recording.
    :ivar push_problem: why forces cannot be applied; "" if they can.
    """

    def __init__(self, world: WorldPresenter, on_change: Callable[[], None]) -> None:
        self._world = world
        self._window = world.window
        self._on_change = on_change
        self._calls = SkillCalls(self._window, on_change)
        self._last_action: Action | None = None
        self._is_pushing = self._is_asking_simulator = False
        self.arms: list[Arm] = []
        self.arm: Arm | None = None
        self.owner: Element | None = None
        self.taught: list[Taught] = []
        self.chosen: Taught | None = None
        self.name = ""
        self.push_problem = "The simulator is not known yet"
        world.text_of_change = self._text_of_change
        for kind in (TasksChanged, ConnectionChanged, ElementSelected):
            self._window.subscribe(kind, lambda _: on_change())

    # -- the scene -------------------------------------------------------------------------------------------------

    def refresh(self) -> None:
        """Reads arms, object and taught elements from the replica of the scene."""
        scene = self._window.system.scene
        if scene is None:
            return
        try:
            self.arms = arms(scene, list(self._window.system.managers))
            self.owner = owner_of(scene, self._world.selected) if self._world.selected else None
            self.taught = taught_of(scene, self.owner.id) if self.owner is not None else []
        except SkirosError:  # the scene has changed meanwhile; the next refresh reads it
            return
        self.arm = next((a for a in self.arms if self.arm is not None and a.eid == self.arm.eid), None) or next(
            iter(self.arms), None
        )
        wanted = (self._world.selected, self.chosen.eid if self.chosen is not None else "")
        self.chosen = next((t for eid in wanted for t in self.taught if t.eid == eid), None)

    def choose_arm(self, eid: str) -> None:
        """Chooses the arm to teach with."""
        self.arm = next((arm for arm in self.arms if arm.eid == eid), self.arm)
        self._on_change()

    def choose(self, eid: str) -> None:
        """Chooses a taught element of the object; "" for none."""
        self.chosen = next((taught for taught in self.taught if taught.eid == eid), None)
        self._on_change()

    # -- states ----------------------------------------------------------------------------------------------------

    @property
    def is_released(self) -> bool:
        return self._is_running(Action.RELEASE)

    @property
    def is_teleoperated(self) -> bool:
        return self._is_running(Action.TELEOPERATE)

    @property
    def is_recording(self) -> bool:
        return self._is_running(Action.RECORD_PATH)

    @property
    def status(self) -> str:
        """Describes the recording, the last failure, or the release or teleoperation, in this order."""
        arm, action = self.arm, self._last_action
        if arm is None:
            return ""
        failure = self._calls.failure(arm.manager, action.value) if action is not None else ""
        recording = self._calls.running(arm.manager, Action.RECORD_PATH.value)
        guided = next((task for one in _GUIDED if (task := self._calls.running(arm.manager, one.value))), None)
        if recording is not None:
            return message_text(recording)
        if failure:
            return failure
        if guided is not None:
            return message_text(guided)
        done = self._calls.task(arm.manager, action.value) if action is not None else None
        return message_text(done) if done is not None else ""

    @property
    def has_failed(self) -> bool:
        """Whether the last action has failed."""
        arm, action = self.arm, self._last_action
        return arm is not None and action is not None and bool(self._calls.failure(arm.manager, action.value))

    def same_name(self) -> Taught | None:
        """Returns the taught element of the object with the name for the next recording; None if it is new."""
        return next((taught for taught in self.taught if taught.name == self.name), None)

    def obstacle(self, action: Action) -> str:
        """Describes why an action cannot be done now; "" if it can."""
        if action in (Action.RENAME, Action.DELETE):
            return "" if self.chosen is not None else "Choose a taught pose or path"
        if self.arm is None:
            return "The scene has no arm that is a part of a robot"
        part = part_of(self._window.tasks.cell, MANAGER, self.arm.manager)
        if part is not None and part.stop:
            return f"{self.arm.manager} is stopped: {part.stop}"
        return self._obstacle_of_state(action) or self._obstacle_of_name(action) or self._obstacle_of_skill(action)

    def _obstacle_of_state(self, action: Action) -> str:
        assert self.arm is not None
        name = self.arm.label
        if action is Action.HOLD and not (self.is_released or self.is_teleoperated or self.is_recording):
            return f"{name} is not released"
        if action is Action.STORE_PATH and not self.is_recording:
            return "No path is being recorded"
        if action in (*_MOTIONS, *_GUIDED) and self.is_recording:
            return "A path is being recorded; store it first"
        if action in (*_MOTIONS, Action.TELEOPERATE) and self.is_released:
            return f"{name} is released; hold it first"
        if action in (*_MOTIONS, *_GUIDED) and self.is_teleoperated:
            return f"{name} is teleoperated; hold it first"
        if action in _GUIDED and any(self._is_running(motion) for motion in _MOTIONS):
            return f"{name} is moving"
        if action is Action.RECORD_LIFTING or action in _MOTIONS:
            kind = PATH if action is Action.REPLAY_PATH else POSE
            if self.chosen is None or self.chosen.kind != kind:
                return f"Choose a taught {'path' if kind == PATH else 'pose'}"
        return ""

    def _obstacle_of_name(self, action: Action) -> str:
        if action not in (Action.RECORD_POSE, Action.RECORD_PATH):
            return ""
        if self.owner is None:
            return "Select the object in the scene that the taught element belongs to"
        if not self.name.strip():
            return "Enter a name"
        same, kind = self.same_name(), POSE if action is Action.RECORD_POSE else PATH
        if same is not None and same.kind != kind:
            return f"{self.owner.label or self.owner.id} has a taught {'path' if kind == POSE else 'pose'} {self.name}"
        return ""

    def _obstacle_of_skill(self, action: Action) -> str:
        assert self.arm is not None
        skill = Action.HOLD if action is Action.STORE_PATH else action
        return self._calls.obstacle(self.arm.manager, skill.value)

    def _is_running(self, action: Action) -> bool:
        return self.arm is not None and self._calls.is_running(self.arm.manager, action.value)

    # -- actions ---------------------------------------------------------------------------------------------------

    def do(self, action: Action, **values: float) -> None:
        """Starts the skill of an action; does nothing while there is an obstacle.

        :param values: numbers for parameters of the skill.
        """
        if self.obstacle(action) or self.arm is None:
            return
        given: dict[str, Any] = {"Arm": element_value(self.arm.eid, "rparts:ArmDevice"), **values}
        if action in (Action.RECORD_POSE, Action.RECORD_PATH) and self.owner is not None:
            given.update(Object=element_value(self.owner.id), Name=self.name, Replace=self.same_name() is not None)
        elif action in (Action.RECORD_LIFTING, Action.MOVE_TO_POSE) and self.chosen is not None:
            given["Pose"] = element_value(self.chosen.eid, POSE)
        elif action is Action.REPLAY_PATH and self.chosen is not None:
            given["Path"] = element_value(self.chosen.eid, PATH)
        elif action is Action.STORE_PATH:
            action = Action.HOLD
            given["KeepReleased"] = self.is_released or self.is_teleoperated
        elif action is Action.TELEOPERATE:
            given["WaitTime"] = _FIRST_TWIST
        self._start(action, given)

    def rename(self, taught: Taught, name: str) -> None:
        """Renames a taught element of the object. The error bar shows why it cannot be."""
        name = name.strip()

        def make(requests: Requests) -> list[Operation]:
            if not name:
                raise WrongValue("the name is empty")
            if any(other.name == name and other.eid != taught.eid for other in self.taught):
                raise WrongValue(f"the object has a taught pose or path {name} already")
            return requests.set_label(taught.eid, name)

        self._world.change(f"rename {taught.name} to {name or '(nothing)'}", make)

    def delete(self) -> None:
        """Deletes the chosen element, a pose with its lifting pose."""
        chosen = self.chosen
        if chosen is not None:
            self._world.change(f"delete {chosen.name}", lambda requests: requests.remove([chosen.eid]))

    def _start(self, action: Action, values: Mapping[str, Any]) -> None:
        assert self.arm is not None
        self._last_action = action
        self._calls.start(self.arm.manager, action.value, values)

    def _text_of_change(self, change: ChangeSet) -> str:
        """Returns the undo text for a change that a skill of this window has recorded."""
        records = [record for pair in change.records.values() for record in pair if record is not None]
        if not records or any(record.type not in (POSE, LIFTING_POSE, PATH) for record in records):
            return ""
        is_recorded = any(self._calls.is_recent(action.value, _ARRIVAL) for action in _RECORDING)
        return f"record {records[0].label}" if is_recorded else ""

    # -- forces of the simulator -----------------------------------------------------------------------------------

    def ask_simulator(self) -> None:
        """Asks whether a simulator runs. To be called periodically while the page is visible."""
        simulator = self._window.system.simulator
        if simulator is None or self._is_asking_simulator:
            return
        self._is_asking_simulator = True

        def done(is_up: bool) -> None:
            self._is_asking_simulator = False
            self.push_problem = "" if is_up else "No simulator runs: a real arm is guided by hand"
            self._on_change()

        self._window.jobs.run(simulator.is_up, done, lambda error: done(False))

    def push(self, force: tuple[float, float, float], duration: float) -> None:
        """Applies a force at the tool of the chosen arm. Skipped while another call is running.

        :param force: N, in the map.
        :param duration: s.
        """
        simulator, arm = self._window.system.simulator, self.arm
        if simulator is None or arm is None or self._is_pushing or self.push_problem:
            return
        self._is_pushing = True

        def done(_: object) -> None:
            self._is_pushing = False

        def failed(error: Exception) -> None:
            self._is_pushing = False
            self.push_problem = error_text(error)
            self._on_change()

        self._window.jobs.run(lambda: simulator.push(arm.tool, force, duration), done, failed)
