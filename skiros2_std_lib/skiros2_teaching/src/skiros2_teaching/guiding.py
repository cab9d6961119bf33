"""Arms that are guided by hand in this process: what `teach_release` and `teach_path` do, and `teach_end` ends."""

from __future__ import annotations

import threading
from dataclasses import dataclass

from skiros2_common.core.errors import Refused
from skiros2_common.core.world_element import Element
from skiros2_common.core.world_model_port import WorldModelPort
from skiros2_contact_skills.arms import give_back, take_arm
from skiros2_motion.core.compliant_arm import CompliantArm


@dataclass(eq=False)
class Guiding:
    """An arm that is guided, or only recorded.

    :param is_released: whether a skill has released it and follows it.
    :param is_recorded: whether a path is being recorded.
    :param ends_recording: whether the recording is to end.
    :param ends: whether the arm is to be held again, after the recording.
    """

    arm: CompliantArm
    is_released: bool = False
    is_recorded: bool = False
    ends_recording: bool = False
    ends: bool = False


_guided: dict[str, Guiding] = {}
_lock = threading.Lock()


def guiding_of(arm: Element) -> Guiding | None:
    """Returns the guiding of an arm; None if nothing is taught with it."""
    with _lock:
        return _guided.get(arm.id)


def start_guiding(arm: Element, driver: CompliantArm) -> Guiding:
    """Registers an arm that a skill has taken and released."""
    guiding = Guiding(driver, is_released=True)
    with _lock:
        _guided[arm.id] = guiding
    return guiding


def stop_guiding(arm: Element, guiding: Guiding) -> None:
    """Ends a guiding that was started."""
    with _lock:
        if _guided.get(arm.id) is guiding:
            del _guided[arm.id]


def start_recording(wmi: WorldModelPort, robot: Element, arm: Element, user: object) -> Guiding:
    """Registers a recording: of a released arm, or of one that is guided by other means, such as buttons at its hand.

    :param user: the skill.
    :raises Refused: a path is being recorded with the arm, or another skill moves it.
    :raises SkirosError: there is no driver for it.
    """
    guiding = guiding_of(arm)
    if guiding is None:
        guiding = Guiding(take_arm(wmi, robot, arm, user))
    with _lock:
        if guiding.is_recorded:
            raise Refused(f"a path is being recorded with arm {arm.label or arm.id}")
        guiding.is_recorded, guiding.ends_recording = True, False
        _guided[arm.id] = guiding
    return guiding


def stop_recording(arm: Element, guiding: Guiding, user: object) -> None:
    """Ends a recording that was started."""
    guiding.is_recorded = False
    if not guiding.is_released:
        stop_guiding(arm, guiding)
        give_back(user)
