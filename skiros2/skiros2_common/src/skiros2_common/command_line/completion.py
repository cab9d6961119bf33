"""Completion of command lines in bash and zsh: options and choices of a parser, and names of the running system.

The shell functions in env-hooks/ start the command itself with `_SKIROS2_COMPLETE`, and what is typed as its arguments.
`Parser` then prints the possible words, a line each, instead of running the command.
"""

from __future__ import annotations

import argparse
import glob
import os
import re
import sys
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from skiros2_common.core.errors import SkirosError

#: The variable that asks a command for completions. Its value is the shell: `bash` (the arguments are the number of
#: words in front of the command's arguments, and the line up to the cursor) or `zsh` (the arguments are the words).
VARIABLE = "_SKIROS2_COMPLETE"

#: Characters that bash breaks words at, in front of the part that it replaces.
_BREAKS = "=:"
_SPECIAL = re.compile(r"([^\w@%+=:,./-])")


@dataclass
class Typed:
    """The words in front of the one to complete.

    :param options: the values of options by destination; "" for flags.
    :param words: the positional arguments.
    """

    options: dict[str, str] = field(default_factory=dict)
    words: list[str] = field(default_factory=list)


#: Returns the possible words for an argument, given the words in front of it and its beginning.
Completer = Callable[[Typed, str], Iterable[str]]


def complete_by(action: argparse.Action, completer: Completer) -> None:
    """Sets the function that completes an argument of a parser."""
    action.completer = completer  # type: ignore[attr-defined]


def print_completions(parser: argparse.ArgumentParser, arguments: Sequence[str]) -> None:
    """Prints the completions for a shell; nothing when the system does not answer.

    :param arguments: of the command, see `VARIABLE`.
    """
    line = None
    if os.environ[VARIABLE] == "bash":
        skipped, text = arguments
        line = Line.read(text)
        arguments = line.words[int(skipped) :]
    try:
        words = completions(parser, arguments)
    except (SkirosError, ImportError, OSError):
        return
    sys.stdout.writelines(f"{word if line is None else line.completed(word)}\n" for word in words)


def completions(parser: argparse.ArgumentParser, words: Sequence[str]) -> list[str]:
    """The possible words in place of the last one, in order, without repetitions.

    :param words: the arguments up to the cursor; the last one may be "".
    """
    *before, current = words or [""]
    reader = _Reader(parser)
    for word in before:
        reader.read(word)
    return [word for word in dict.fromkeys(reader.candidates(current)) if word.startswith(current)]


class _Reader:
    """Reads the words in front of the one to complete."""

    def __init__(self, parser: argparse.ArgumentParser) -> None:
        self._parser = parser
        self._typed = Typed()
        self._option: argparse.Action | None = None  # that waits for a value

    def read(self, word: str) -> None:
        """Reads the next word."""
        name, sign, value = word.partition("=")
        action = self._parser._option_string_actions.get(name)
        if action is not None:
            self._typed.options[action.dest] = value
            self._option = action if not sign and action.nargs != 0 else None
        elif self._option is not None:
            self._typed.options[self._option.dest] = word
            self._option = self._option if self._option.nargs in ("*", "+") else None
        else:
            place = self._positional()
            if isinstance(place, argparse._SubParsersAction) and word in place.choices:
                self._parser = place.choices[word]
                self._typed.words.clear()
            else:
                self._typed.words.append(word)

    def candidates(self, current: str) -> Iterable[str]:
        """The possible words in place of a last one."""
        actions = self._parser._option_string_actions
        name, sign, value = current.partition("=")
        if self._option is not None:
            yield from self._values(self._option, current)
        elif current.startswith("--") and sign and name in actions:
            yield from (f"{name}={value}" for value in self._values(actions[name], value))
        elif current.startswith("-"):
            given = self._typed.options
            yield from (n for n, action in actions.items() if n.startswith("--") and action.dest not in given)
        else:
            place = self._positional()
            yield from self._values(place, current) if place is not None else ()

    def _positional(self) -> argparse.Action | None:
        """The positional argument that the next word is for; None when there is none."""
        places = [action for action in self._parser._actions if not action.option_strings]
        for index, action in enumerate(places):
            if index >= len(self._typed.words) or action.nargs in ("*", "+"):
                return action
        return None

    def _values(self, action: argparse.Action, current: str) -> Iterable[str]:
        completer: Completer | None = getattr(action, "completer", None)
        if completer is not None:
            return completer(self._typed, current)
        if action.choices is not None:
            return list(map(str, action.choices))
        return _files(current) if action.type is Path else ()


def _files(current: str) -> Iterable[str]:
    return sorted(f"{name}/" if os.path.isdir(name) else name for name in glob.glob(f"{glob.escape(current)}*"))


@dataclass
class Line:
    """A line of bash up to the cursor.

    :param words: without quotes and escapes; the last one is to be completed.
    :param raw: the last word as typed.
    :param quote: the quotation mark that is open at its end; "" if none is.
    """

    words: list[str]
    raw: str = ""
    quote: str = ""

    @classmethod
    def read(cls, text: str) -> Line:
        """Splits a line like the shell does, without its expansions."""
        line = cls([""])
        escaped = False
        for letter in text:
            if letter.isspace() and not escaped and not line.quote:
                if line.raw:
                    line.words.append("")
                    line.raw = ""
                continue
            line.raw += letter
            if escaped:
                line.words[-1] += letter
                escaped = False
            elif letter == "\\" and line.quote != "'":
                escaped = True
            elif letter == line.quote:
                line.quote = ""
            elif letter in "'\"" and not line.quote:
                line.quote = letter
            else:
                line.words[-1] += letter
        return line

    def completed(self, word: str) -> str:
        """The word in place of the part of the last word that bash replaces."""
        if self.quote:  # bash replaces what is behind the mark
            begun = self.raw.rpartition(self.quote)[0]
            return word[len(Line.read(begun).words[-1]) :]
        quoted = _SPECIAL.sub(r"\\\1", word)
        kept = max(map(self.raw.rfind, _BREAKS)) + 1
        return quoted[kept:] if quoted.startswith(self.raw[:kept]) else quoted
