"""Locks on devices: a skill has the ones among its parameters with the option Lock to itself while it runs."""

from __future__ import annotations

from typing import Any

from skiros2_common.core.skill_description import DEVICE_IDLE, DEVICE_STATE, ParamOptions
from skiros2_skill.core.wrapper import SkillWrapper

#: What a locked device's state is while a skill has it.
DEVICE_BUSY = "Busy"


def lock_devices(node: SkillWrapper, wmi: Any) -> None:
    """Marks the node's devices as busy. They were idle: that is a pre-condition of the skill."""
    for key, options in node.options.items():
        param = node.params.getParamMap().get(key)
        for device in param.values if param is not None and ParamOptions.Lock in options else ():
            if not device.isAbstract():
                device.setProperty(DEVICE_STATE, DEVICE_BUSY)
                wmi.update_element(device)
                node.locked.append(device.id)


def free_devices(node: SkillWrapper, wmi: Any) -> None:
    """Marks the devices that the node has locked as idle again."""
    while node.locked:
        device = wmi.find_element(node.locked.pop())
        if device is not None:
            device.setProperty(DEVICE_STATE, DEVICE_IDLE)
            wmi.update_element(device)
