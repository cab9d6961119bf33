"""The errors of a world model's calls."""

from __future__ import annotations

from types import TracebackType

from skiros2_common.core.errors import Conflict, SkirosError


class WmException(SkirosError):
    """The world model does not answer, or refuses a request for the reason in the text. Nothing has changed.

    :param code: the code of the world model's error; "error": it does not answer.
    """

    def __init__(
        self, text: str = "", code: str = SkirosError.code, position: tuple[int, int] = SkirosError.position
    ) -> None:
        super().__init__(text)
        self.code = code
        self.position = position


class WmConflict(WmException):
    """A request was refused because an element has changed since it was read; the text names the author."""


def refusal(text: str, code: str = "refused", position: tuple[int, int] = SkirosError.position) -> WmException:
    """The exception for an error of the world model, given by its text, code and position."""
    return (WmConflict if code == Conflict.code else WmException)(text, code, position)


def wm_error(error: SkirosError) -> WmException:
    """The `WmException` for an error of the world model; the error itself if it is one."""
    return error if isinstance(error, WmException) else refusal(str(error), error.code, error.position)


class _WmErrors:
    """Converts errors of the world model to `WmException`."""

    def __enter__(self) -> None:
        """No preparation."""

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        if isinstance(error, SkirosError) and not isinstance(error, WmException):
            raise wm_error(error) from error


_WM_ERRORS = _WmErrors()  # stateless, shared by all calls


def wm_errors() -> _WmErrors:
    """A context manager that converts errors of the world model to `WmException`."""
    return _WM_ERRORS
