"""Error answers of the world model's services."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

import rospy

from skiros2_common.core.errors import SkirosError


def service_handler(handler: Callable[[Any], Any]) -> Callable[[Any], Any]:
    """Wraps a service handler so that its `SkirosError`s are answered as error texts."""

    @functools.wraps(handler)
    def handle(request: Any) -> Any:
        try:
            return handler(request)
        except SkirosError as error:
            raise rospy.ServiceException(str(error)) from None

    return handle
