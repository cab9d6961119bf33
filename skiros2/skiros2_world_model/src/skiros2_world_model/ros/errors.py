"""Errors of the world model as answers of services."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

import rospy

from skiros2_common.core.errors import SkirosError


def service_handler(handler: Callable[[Any], Any]) -> Callable[[Any], Any]:
    """A service handler whose refusals reach the client as text."""

    @functools.wraps(handler)
    def handle(request: Any) -> Any:
        try:
            return handler(request)
        except SkirosError as error:
            raise rospy.ServiceException(str(error)) from None

    return handle
