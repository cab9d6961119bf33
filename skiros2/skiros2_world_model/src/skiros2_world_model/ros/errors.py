"""Errors of the world model's services.

rospy transmits only a text; it ends with the error's code, and its position if it has one, in brackets.
"""

from __future__ import annotations

import functools
import re
from collections.abc import Callable
from typing import TypeVar

import rospy

from skiros2_common.core.errors import SkirosError
from skiros2_world_model.core.world_model_abstract_interface import WmException, refusal

_Request = TypeVar("_Request")
_Response = TypeVar("_Response")

_WITH_CODE = re.compile(r"(.*) \[(\w+)(?: (\d+):(\d+))?\]", re.DOTALL)


def service_handler(handler: Callable[[_Request], _Response]) -> Callable[[_Request], _Response]:
    """Wraps a service handler so that its `SkirosError`s are answered with text and code."""

    @functools.wraps(handler)
    def handle(request: _Request) -> _Response:
        try:
            return handler(request)
        except SkirosError as error:
            position = ":".join(map(str, error.position)) if any(error.position) else ""
            raise rospy.ServiceException(f"{error} [{f'{error.code} {position}'.strip()}]") from None

    return handle


def read_error(text: str) -> WmException:
    """The error of a service handler, from the text that was transmitted."""
    found = _WITH_CODE.fullmatch(text)
    if found is None:
        return WmException(text)
    return refusal(found[1], found[2], (int(found[3] or 0), int(found[4] or 0)))
