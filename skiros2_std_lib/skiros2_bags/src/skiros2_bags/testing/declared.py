"""Compares what skills declare with the recording: `~declarations` of their manager."""

from __future__ import annotations

import json
from collections.abc import Collection, Iterable, Iterator

from skiros2_skill.core.library.declaration import VERSION, Declaration, declaration
from skiros2_skill.core.library.library import Implementation


class Declared:
    """The recorded declarations of a manager's skills.

    :param text: the recorded message; "" if the recording has none.
    """

    def __init__(self, text: str) -> None:
        self._skills: dict[str, Declaration] = {}
        self._problem = ""
        if not text:
            self._problem = "the recording does not have it; record the run again"
            return
        try:
            recorded = json.loads(text)
            if recorded["version"] != VERSION:
                self._problem = f"the recording has version {recorded['version']} of it, expected {VERSION}"
                return
            for skill in recorded["skills"]:
                self._skills[skill["label"]] = {part: {**values} for part, values in skill["declares"].items()}
        except (ValueError, LookupError, TypeError, AttributeError, RecursionError) as error:
            self._skills = {}
            self._problem = f"the recorded message cannot be read: {error!r}"

    def differences(self, implementations: Iterable[Implementation], used: Collection[str]) -> list[str]:
        """Returns how the declarations of skills in use differ from the recorded ones, a line each."""
        lines: list[str] = []
        for implementation in implementations:
            recorded = self._skills.get(implementation.label)
            if recorded is not None and implementation.label in used:
                found = _differences(recorded, json.loads(json.dumps(declaration(implementation))))
                lines += [f"skill {implementation.label}: {line}" for line in found]
        return lines

    @property
    def not_compared(self) -> list[str]:
        """Says what cannot be compared, and why."""
        return [f"what skills declare: {self._problem}"] if self._problem else []


def _differences(recorded: Declaration, now: Declaration) -> Iterator[str]:
    for part in dict.fromkeys([*recorded, *now]):
        if part not in now:
            yield f"{part}: recorded, not declared now"
        elif part not in recorded:
            yield f"{part}: not recorded, declared now"
        else:
            was, is_now = recorded[part], now[part]
            for key in dict.fromkeys([*was, *is_now]):
                if was.get(key) != is_now.get(key):
                    texts = (json.dumps(values.get(key)) for values in (was, is_now))
                    yield f"{part} {key}: recorded {next(texts)}, now {next(texts)}".strip()
