"""Where in an author's code something was declared."""

from __future__ import annotations

import sys
from types import FrameType

#: A file and a line.
Place = tuple[str, int]

_OWN = ("skiros2_common.core.", "skiros2_skill.core.", "skiros2_skill.testing.")


def is_authors(frame: FrameType) -> bool:
    """Whether a call is not in the modules of the skill classes themselves."""
    return not frame.f_globals.get("__name__", "").startswith(_OWN)


def authors_place() -> Place | None:
    """The line of the innermost call that is not in the modules of the skill classes themselves."""
    frame = sys._getframe(1)
    while not is_authors(frame):
        if frame.f_back is None:
            return None
        frame = frame.f_back
    return frame.f_code.co_filename, frame.f_lineno
