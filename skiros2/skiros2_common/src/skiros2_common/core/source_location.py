"""File and line of a declaration or an error in user code: code outside the modules of the skill classes."""

from __future__ import annotations

import sys
import traceback
from enum import EnumMeta
from types import FrameType

#: A file and a line.
SourceLocation = tuple[str, int]

_SKILL_CLASSES = ("skiros2_common.core.", "skiros2_skill.core.", "skiros2_skill.testing.")


def is_user_code(frame: FrameType) -> bool:
    """Whether a frame is outside the modules of the skill classes."""
    return not frame.f_globals.get("__name__", "").startswith(_SKILL_CLASSES)


def caller_location() -> SourceLocation | None:
    """The location of the innermost call in user code."""
    frame = sys._getframe(1)
    while not is_user_code(frame):
        if frame.f_back is None:
            return None
        frame = frame.f_back
    return frame.f_code.co_filename, frame.f_lineno


def error_location(error: BaseException, module: str = "") -> SourceLocation | None:
    """The innermost location in a library that an error passed through; None when it passed through no user code.

    :param module: any module of the library; "" searches all code outside the standard library and the skill classes.
    """
    found = _frame_of(error, module)
    return (found[0].f_code.co_filename, found[1]) if found is not None else None


def format_error_line(error: BaseException) -> str:
    """The error in one line. For an unknown member of an enumeration, it lists the known members."""
    lines = "".join(traceback.format_exception_only(type(error), error)).splitlines()
    text = " ".join(line.strip() for line in lines)
    known = getattr(error, "obj", None) if isinstance(error, AttributeError) else None
    if isinstance(known, EnumMeta):
        text += f"; {known.__name__} has: {', '.join(known.__members__)}"
    return text


def format_error(error: BaseException, module: str = "") -> str:
    """The error with its location in the library in one line, followed by the traceback.

    :param module: as in `error_location`.
    """
    found = _frame_of(error, module)
    location = ""
    if found is not None:
        code = found[0].f_code
        location = f" ({code.co_filename}, line {found[1]}, in {code.co_name})"
    return f"{format_error_line(error)}{location}\n{''.join(traceback.format_exception(error))}"


def _frame_of(error: BaseException, module: str) -> tuple[FrameType, int] | None:
    package = module.partition(".")[0]
    user_code = [(frame, line) for frame, line in traceback.walk_tb(error.__traceback__) if is_user_code(frame)]
    own = [(frame, line) for frame, line in user_code if _package_of(frame) == package]
    found = own or [(frame, line) for frame, line in user_code if _package_of(frame) not in sys.stdlib_module_names]
    return found[-1] if found else None


def _package_of(frame: FrameType) -> str:
    return str(frame.f_globals.get("__name__", "")).partition(".")[0]
