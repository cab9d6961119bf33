"""What code of a library raised, for people: the error and the library's own line first, then the traceback."""

from __future__ import annotations

import sys
import traceback
from enum import EnumMeta
from types import FrameType

from skiros2_common.core.places import Place, is_authors


def error_text(error: BaseException) -> str:
    """The error in one line; of an unknown member of an enumeration also the members that there are."""
    lines = "".join(traceback.format_exception_only(type(error), error)).splitlines()
    text = " ".join(line.strip() for line in lines)
    known = getattr(error, "obj", None) if isinstance(error, AttributeError) else None
    if isinstance(known, EnumMeta):
        text += f"; {known.__name__} has: {', '.join(known.__members__)}"
    return text


def raised_at(error: BaseException, module: str = "") -> Place | None:
    """The innermost line of the library that an error went through; None when it went through no author's code.

    :param module: of the library, any; "" takes all code that is neither Python's own nor that of the skill classes.
    """
    found = _frame_of(error, module)
    return (found[0].f_code.co_filename, found[1]) if found is not None else None


def report(error: BaseException, module: str = "") -> str:
    """The error and where the library's code raised it, in one line, and then the traceback.

    :param module: as in `raised_at`.
    """
    found = _frame_of(error, module)
    place = ""
    if found is not None:
        code = found[0].f_code
        place = f" ({code.co_filename}, line {found[1]}, in {code.co_name})"
    return f"{error_text(error)}{place}\n{''.join(traceback.format_exception(error))}"


def _frame_of(error: BaseException, module: str) -> tuple[FrameType, int] | None:
    frames = list(traceback.walk_tb(error.__traceback__))
    package = module.partition(".")[0]
    authors = [(f, line) for f, line in frames if is_authors(f)]
    own = [(f, line) for f, line in authors if _package_of(f) == package]
    others = [(f, line) for f, line in authors if _package_of(f) not in sys.stdlib_module_names]
    found = own or others
    return found[-1] if found else None


def _package_of(frame: FrameType) -> str:
    return str(frame.f_globals.get("__name__", "")).partition(".")[0]
