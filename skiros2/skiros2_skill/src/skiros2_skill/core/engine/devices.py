"""Locks on devices: a skill has the ones among its parameters with the option Lock to itself while it runs.

A lock is two properties of the device in the world model: its state, which is busy, and who has it. It is taken by
compare-and-set, so that one of several managers gets it, and given back by its holder alone. A device whose release is
refused, or whose lock nobody knows the outcome of, is tried again until it is free or another's.
"""

from __future__ import annotations

import logging
import threading
import weakref
from typing import Any

from skiros2_common.core.errors import Refused, SkirosError
from skiros2_common.core.explanation import PRE
from skiros2_common.core.skill_description import DEVICE_IDLE, DEVICE_STATE, ParamOptions
from skiros2_common.core.world_element import Element
from skiros2_skill.core.engine.failures import PRE_FAILED, Failure
from skiros2_skill.core.tree.skill_node import SkillWrapper
from skiros2_world_model.core.world_model_abstract_interface import WmConflict

log = logging.getLogger(__name__)

#: What a locked device's state is while a skill has it, and the property that names the program that does.
DEVICE_BUSY = "Busy"
DEVICE_HOLDER = "skiros:LockedBy"

#: How often a release that was refused is tried again (s).
RETRY_PERIOD = 1.0

#: How often a device is read again because something else of it, its pose for example, has changed meanwhile.
_ATTEMPTS = 20
#: How long a release waits for another call on the same world model that does not return (s).
_PATIENCE = 1.0


class Locks:
    """The locks that one program has in one world model. Safe to use from all threads.

    Each has an owner, which tells a node's lock from a later one on the same device. The world model is given to each
    call, not held, so that both end together.
    """

    def __init__(self) -> None:
        self._using = threading.Lock()  # one thread at a time reads and writes locks
        self._held: dict[str, Any] = {}  # the owner by the id of the device
        self._to_free: dict[str, Any] = {}  # likewise, of locks whose owner has ended
        self._again: threading.Thread | None = None

    def take(self, eid: str, owner: Any, wmi: Any) -> None:
        """Takes an idle device.

        :raises Refused: it is not idle; the text names who has it.
        :raises WmException: the world model refuses or does not answer.
        """
        with self._using:
            try:
                _lock(eid, wmi)
            except Refused:
                raise
            except SkirosError:
                self._to_free[eid] = owner  # it may have been carried out
                self._try_again(wmi)
                raise
            self._held[eid] = owner

    def give_back(self, eids: list[str], owner: Any, wmi: Any) -> None:
        """Frees devices. Those for which that fails are freed later."""
        self._to_free.update(dict.fromkeys(eids, owner))
        if self._using.acquire(timeout=_PATIENCE):
            try:
                self._free(eids, wmi)
            finally:
                self._using.release()
        if self._to_free:
            self._try_again(wmi)

    def give_back_former(self, wmi: Any) -> None:
        """Frees what an earlier life of this program has left locked.

        :raises WmException: the world model does not answer.
        """
        locked = Element("")
        locked.setProperty(DEVICE_HOLDER, wmi.author)
        with self._using:
            found = [device.id for device in wmi.resolve_elements(locked) if device.id not in self._held]
        if found:
            log.warning("%s frees what was left locked: %s", wmi.author, ", ".join(found))
            self.give_back(found, None, wmi)

    def _free(self, eids: list[str], wmi: Any) -> None:
        """Frees each device, whatever becomes of the others."""
        for eid in eids:
            if self._held.get(eid) is self._to_free.get(eid):
                self._held.pop(eid, None)
            try:
                if eid not in self._held:
                    _unlock(eid, wmi)
            except Exception as error:
                log.error("device %s stays locked, its release will be tried again: %s", eid, error)
            else:
                self._to_free.pop(eid, None)

    def _try_again(self, wmi: Any) -> None:
        if self._again is None:
            self._again = threading.Thread(target=self._go_on, args=(wmi,), name="release of devices", daemon=True)
            self._again.start()

    def _go_on(self, wmi: Any) -> None:
        """Tries again until nothing is left, in a thread of its own."""
        pause = threading.Event()
        while True:
            pause.wait(RETRY_PERIOD)
            with self._using:
                try:
                    wmi.catch_up()
                except SkirosError as error:
                    log.debug("devices stay locked: %s", error)
                    continue
                self._free(list(self._to_free), wmi)
            self._again = None  # before looking: who adds one from here on starts another thread
            if not self._to_free:
                return
            self._again = threading.current_thread()


_locks: weakref.WeakKeyDictionary[Any, Locks] = weakref.WeakKeyDictionary()
_making = threading.Lock()


def locks_in(wmi: Any) -> Locks:
    """The locks that the program has in a world model."""
    with _making:
        return _locks.setdefault(wmi, Locks())


def lock_devices(node: SkillWrapper, wmi: Any) -> Failure | None:
    """Takes the node's devices; why that failed, else None. They were idle: that is a pre-condition of the skill."""
    for key, options in node.options.items():
        if ParamOptions.Lock not in options:
            continue
        for device in node.params.getParamValues(key):
            if device.isAbstract() or device.id in node.locked:
                continue
            node.locked.append(device.id)  # before it is: the call may not return
            try:
                locks_in(wmi).take(device.id, node, wmi)
            except SkirosError as error:
                node.locked.remove(device.id)
                return Failure(PRE, PRE_FAILED, f"{node.label} does not get its {key}: {error}")
            found = wmi.find_element(device.id)
            if found is not None:
                device.adopt(found)
    return None


def free_devices(node: SkillWrapper, wmi: Any) -> None:
    """Frees the devices that the node has locked; those for which that fails are freed later. Any thread."""
    eids, node.locked = node.locked, []
    locks_in(wmi).give_back(eids, node, wmi)


def free_former_devices(wmi: Any) -> None:
    """Frees what an earlier life of this program has left locked.

    :raises WmException: the world model does not answer.
    """
    locks_in(wmi).give_back_former(wmi)


def _lock(eid: str, wmi: Any) -> None:
    for _ in range(_ATTEMPTS):
        device = wmi.find_element(eid)
        if device is None:
            raise Refused(f"device {eid} is not in the scene any more")
        if not device.hasProperty(DEVICE_STATE, DEVICE_IDLE):
            holder = device.value_of(DEVICE_HOLDER)
            state = f"is locked by {holder}" if holder else f"has the state {device.value_of(DEVICE_STATE)}"
            raise Refused(f"{device!r} {state}")
        device.setProperty(DEVICE_STATE, DEVICE_BUSY)
        device.setProperty(DEVICE_HOLDER, wmi.author)
        if _is_written(device, wmi):
            return
    raise Refused(f"device {eid} is changed by others all the time: it could not be locked")


def _unlock(eid: str, wmi: Any) -> None:
    for _ in range(_ATTEMPTS):
        device = wmi.find_element(eid)
        if device is None or not device.hasProperty(DEVICE_HOLDER, wmi.author):
            return  # another has it, or nobody
        device.setProperty(DEVICE_STATE, DEVICE_IDLE)
        device.removeProperty(DEVICE_HOLDER)
        if _is_written(device, wmi):
            return
    raise Refused(f"device {eid} is changed by others all the time: it could not be freed")


def _is_written(device: Element, wmi: Any) -> bool:
    """Writes a device; False when it was changed after it was read."""
    try:
        wmi.update_element_if_unchanged(device)
    except WmConflict:
        wmi.catch_up()
        return False
    return True
