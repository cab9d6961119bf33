"""Recorded messages as objects of the ROS classes of this system, also where a type has got further fields since."""

from __future__ import annotations

import functools
from typing import Any

import genpy
import genpy.dynamic
import roslib.message
from genpy.generator import MsgGenerationException

from skiros2_bags.core.bag_file import BagError, Message
from skiros2_common.core.errors import WrongValue


def ros_message(message: Message) -> Any:
    """Returns a recorded message as an object of its ROS class. Fields that it lacks have their defaults.

    :raises BagError: this system has no such class, or one that lacks a recorded field.
    """
    try:
        cls = _message_class(message.type)
        if cls._md5sum == message.md5:
            return cls().deserialize(message.data)
        recorded = _recorded_class(message.type, message.definition)
        return _converted(recorded().deserialize(message.data), cls)
    except (WrongValue, genpy.DeserializationError, MsgGenerationException) as error:
        raise BagError(f"{message.topic} at {message.time:.3f} s: {error}") from error


@functools.cache
def _message_class(name: str) -> Any:
    """
    :raises WrongValue: it does not exist.
    """
    found = roslib.message.get_message_class(name)
    if found is None:
        raise WrongValue(f"there is no message {name} on this system; expected its package to be built")
    return found


@functools.cache
def _recorded_class(name: str, definition: str) -> Any:
    return genpy.dynamic.generate_dynamic(name, definition)[name]


def _converted(recorded: Any, cls: Any) -> Any:
    """Copies the fields of a message of a recorded class to one of a class of this system.

    :raises WrongValue: the class lacks a field, or has another type of it.
    """
    found = cls()
    types = dict(zip(cls.__slots__, cls._slot_types, strict=True))
    for name, kind in zip(recorded.__slots__, recorded._slot_types, strict=True):
        if types.get(name) != kind:
            text = f"{types[name]} {name} here" if name in types else f"no field {name} here"
            raise WrongValue(f"{recorded._type} was recorded with {kind} {name}, and has {text}")
        setattr(found, name, _value(getattr(recorded, name), kind.partition("[")[0]))
    return found


def _value(value: Any, kind: str) -> Any:
    if isinstance(value, genpy.Message):
        return _converted(value, _message_class("std_msgs/Header" if kind == "Header" else kind))
    return [_value(each, kind) for each in value] if isinstance(value, list) else value
