"""Locks on devices: a running skill has exclusive use of the elements in its parameters with the option Lock.

A lock consists of two properties of the device in the world model: the state Busy, and the holder. It is acquired by
compare-and-set, so that one of several managers gets it, and released by its holder alone. A release that was refused,
or an acquisition with an unknown outcome, is retried until the device is free or held by another manager.
"""

from __future__ import annotations

import logging
import threading
import time
import weakref
from typing import Any

from skiros2_common.core.errors import Refused, SkirosError
from skiros2_common.core.explanation import PRE
from skiros2_common.core.skill_description import DEVICE_IDLE, DEVICE_STATE, ParamOptions
from skiros2_common.core.world_element import Element
from skiros2_common.core.world_model_port import WorldModelPort
from skiros2_skill.core.engine.failures import PRE_FAILED, Failure
from skiros2_skill.core.engine.skill_run import SkillRun
from skiros2_world_model.core.wm_errors import WmConflict

log = logging.getLogger(__name__)

#: The state of a locked device, and the property that names the program that holds it.
DEVICE_BUSY = "Busy"
DEVICE_HOLDER = "skiros:LockedBy"

#: Time between retries of a refused release (s).
RETRY_PERIOD = 1.0

#: Time between two log lines about the same device that stays locked (s).
LOG_PERIOD = 60.0

#: How many times a write is tried when other properties of the device, such as its pose, change meanwhile.
_ATTEMPTS = 20
#: How long a release waits for a call of another thread (s).
_RELEASE_TIMEOUT = 1.0
#: How long an acquisition waits for one (s).
_ACQUIRE_TIMEOUT = 5.0


class Locks:
    """The locks that one program holds in one world model. Any thread.

    Each lock has an owner, which distinguishes a node's lock from a later one on the same device. The world model is an
    argument of each call, not an attribute: `_locks` refers to it weakly.
    """

    def __init__(self) -> None:
        self._access = threading.Lock()  # one thread at a time reads and writes locks
        self._held: dict[str, Any] = {}  # owner by device id
        self._to_free: dict[str, Any] = {}  # owner by device id, of locks to release
        self._retrying: threading.Thread | None = None
        self._logged: dict[str, tuple[str, float]] = {}  # last refused release and its time (s), by device id

    def acquire(self, eid: str, owner: Any, wmi: WorldModelPort) -> None:
        """Locks an idle device.

        :raises Refused: it is not idle, and the text names the holder; or the world model does not answer another call.
        :raises WmException: the world model refuses or does not answer.
        """
        if not self._access.acquire(timeout=_ACQUIRE_TIMEOUT):
            raise Refused(f"device {eid}: the world model has not answered another request for {_ACQUIRE_TIMEOUT:g} s")
        try:
            _lock(eid, wmi)
            self._held[eid] = owner
        except Refused:
            raise
        except SkirosError:
            self._to_free[eid] = owner  # the lock may have been acquired
            self._retry_later(wmi)
            raise
        finally:
            self._access.release()

    def release(self, eids: list[str], owner: Any, wmi: WorldModelPort) -> None:
        """Releases devices; failed releases are retried later."""
        self._to_free.update(dict.fromkeys(eids, owner))
        if self._access.acquire(timeout=_RELEASE_TIMEOUT):
            try:
                self._free(eids, wmi)
            finally:
                self._access.release()
        if self._to_free:
            self._retry_later(wmi)

    def release_stale(self, wmi: WorldModelPort) -> None:
        """Releases the devices that a former process of this program has left locked.

        :raises WmException: the world model does not answer.
        """
        locked = Element("")
        locked.setProperty(DEVICE_HOLDER, wmi.author)
        with self._access:
            found = [device.id for device in wmi.resolve_elements(locked) if device.id not in self._held]
        if found:
            log.warning("%s releases devices that a former process has locked: %s", wmi.author, ", ".join(found))
            self.release(found, None, wmi)

    def _free(self, eids: list[str], wmi: WorldModelPort) -> None:
        """Releases each device, even if others fail."""
        for eid in eids:
            if self._held.get(eid) is self._to_free.get(eid):
                self._held.pop(eid, None)
            try:
                if eid not in self._held:
                    _unlock(eid, wmi)
            except Exception as error:
                self._log_refusal(eid, str(error))
            else:
                self._to_free.pop(eid, None)
                self._logged.pop(eid, None)

    def _log_refusal(self, eid: str, reason: str) -> None:
        """Logs a refused release, unless it was logged shortly before: it is tried for as long as it takes."""
        known, now = self._logged.get(eid), time.monotonic()
        if known is None or known[0] != reason or now - known[1] >= LOG_PERIOD:
            self._logged[eid] = reason, now
            log.error("device %s stays locked, its release will be tried again: %s", eid, reason)

    def _retry_later(self, wmi: WorldModelPort) -> None:
        if self._retrying is None:
            self._retrying = threading.Thread(target=self._retry, args=(wmi,), name="release of devices", daemon=True)
            self._retrying.start()

    def _retry(self, wmi: WorldModelPort) -> None:
        """Retries until all devices are released, in a thread of its own."""
        pause = threading.Event()
        while True:
            pause.wait(RETRY_PERIOD)
            with self._access:
                try:
                    wmi.catch_up()
                except SkirosError as error:
                    log.debug("devices stay locked: %s", error)
                    continue
                self._free(list(self._to_free), wmi)
            self._retrying = None  # before the check: a release added after it starts another thread
            if not self._to_free:
                return
            self._retrying = threading.current_thread()


_locks: weakref.WeakKeyDictionary[Any, Locks] = weakref.WeakKeyDictionary()
_creation = threading.Lock()


def locks_in(wmi: WorldModelPort) -> Locks:
    """The locks of this program in a world model."""
    with _creation:
        return _locks.setdefault(wmi, Locks())


def lock_devices(run: SkillRun, wmi: WorldModelPort) -> Failure | None:
    """Locks the devices of a run, which a pre-condition requires to be idle. Returns the failure; None on success."""
    for key, options in run.options.items():
        if ParamOptions.Lock not in options:
            continue
        for device in run.params.getParamValues(key):
            if device.isAbstract() or device.id in run.locks:
                continue
            run.locks = [*run.locks, device.id]  # before the call, which may not return
            try:
                locks_in(wmi).acquire(device.id, run.node, wmi)
            except SkirosError as error:
                run.locks = run.locks[:-1]
                return Failure(PRE, PRE_FAILED, f"{run.label} does not get its {key}: {error}")
            found = wmi.find_element(device.id)
            if found is not None:
                device.adopt(found)
    return None


def free_devices(run: SkillRun, wmi: WorldModelPort) -> None:
    """Releases the devices that the run has locked; failed releases are retried later. Any thread."""
    eids, run.locks = [*run.locks], ()
    locks_in(wmi).release(eids, run.node, wmi)


def release_stale_devices(wmi: WorldModelPort) -> None:
    """Releases the devices that a former process of this program has left locked.

    :raises WmException: the world model does not answer.
    """
    locks_in(wmi).release_stale(wmi)


def _lock(eid: str, wmi: WorldModelPort) -> None:
    for _ in range(_ATTEMPTS):
        device = wmi.find_element(eid)
        if device is None:
            raise Refused(f"device {eid} is no longer in the scene")
        if not device.hasProperty(DEVICE_STATE, DEVICE_IDLE):
            holder = device.value_of(DEVICE_HOLDER)
            state = f"is locked by {holder}" if holder else f"has the state {device.value_of(DEVICE_STATE)}"
            raise Refused(f"{device!r} {state}")
        device.setProperty(DEVICE_STATE, DEVICE_BUSY)
        device.setProperty(DEVICE_HOLDER, wmi.author)
        if _is_written(device, wmi):
            return
    raise Refused(f"device {eid} is changed by others all the time: it could not be locked")


def _unlock(eid: str, wmi: WorldModelPort) -> None:
    for _ in range(_ATTEMPTS):
        device = wmi.find_element(eid)
        if device is None or not device.hasProperty(DEVICE_HOLDER, wmi.author):
            return  # it is free, or another manager holds it
        device.setProperty(DEVICE_STATE, DEVICE_IDLE)
        device.removeProperty(DEVICE_HOLDER)
        if _is_written(device, wmi):
            return
    raise Refused(f"device {eid} is changed by others all the time: it could not be freed")


def _is_written(device: Element, wmi: WorldModelPort) -> bool:
    """Writes a device. Returns False if it was changed since it was read."""
    try:
        wmi.update_element_if_unchanged(device)
    except WmConflict:
        wmi.catch_up()
        return False
    return True
