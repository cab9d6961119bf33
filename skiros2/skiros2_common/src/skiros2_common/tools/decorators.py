"""Class helpers for skill libraries."""

from __future__ import annotations

import functools
from abc import abstractmethod
from collections.abc import Callable
from typing import Any

__all__ = ["PrettyObject", "abstractmethod", "prevent"]


class PrettyObject:
    """An object whose `str` is its class name."""

    @property
    def class_name(self) -> str:
        return self.__class__.__name__

    def __str__(self) -> str:
        return self.class_name


def prevent(**attributes: Any) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Decorator: skips the method and returns None while the object has all these attribute values."""

    def decorate(method: Callable[..., Any]) -> Callable[..., Any]:
        @functools.wraps(method)
        def guarded(self: Any, *args: Any, **kwargs: Any) -> Any:
            if all(getattr(self, name, None) == value for name, value in attributes.items()):
                return None
            return method(self, *args, **kwargs)

        return guarded

    return decorate
