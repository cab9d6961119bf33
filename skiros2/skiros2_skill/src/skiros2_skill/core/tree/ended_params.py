"""What threads of a skill have for its parameters when the skill has ended."""

from __future__ import annotations

from typing import Any

from skiros2_common.core.params import ParamHandler


class EndedParams(ParamHandler):
    """What the code of a skill has that runs on after the skill's end: copies, so that it changes nothing of the task.

    They are made when they are first asked for.
    """

    def __init__(self, params: ParamHandler) -> None:
        self._ended = params
        self._is_strict = True

    def __getattr__(self, name: str) -> Any:
        if name != "_params":
            raise AttributeError(name)
        self._params = self._ended.getCopy()
        return self._params
