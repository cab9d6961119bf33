"""Texts for people: labels instead of ids, words instead of names of ontologies, and times."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Sequence

from skiros2_common.core.names import local_name

#: An id in a text, and the label that may follow it.
_ID = re.compile(r"""\b([A-Za-z_]\w*:\w+-\d+)\b(?: ?["'][^"'\n]*["'])?""")
_PREFIX = re.compile(r"^[A-Za-z_]\w*:(?=\S)")
_HUMP = re.compile(r"(?<=[a-z0-9])(?=[A-Z])")

#: A name of an ontology in a text. Ids end with a number.
_NAME = re.compile(r"\b[A-Za-z_]\w*:([A-Za-z_]\w*)\b(?!-\d)")

#: Relations in a sentence: while it holds, does not hold, and has ended.
_VERBS = {
    "contain": ("contains", "does not contain", "no longer contains"),
    "hasA": ("has", "does not have", "no longer has"),
    "at": ("is at", "is not at", "is no longer at"),
}

#: The most characters of a name that are shown: Qt lays out a longer one in seconds, or crashes.
_MAX_NAME = 200

#: Units of time: the number of seconds, and the name.
_UNITS = ((86_400, "d"), (3_600, "h"), (60, "min"), (1, "s"))


def visible(text: str, keep: str = "") -> str:
    """Returns a text with control characters, direction marks and other invisible characters as codes, such as
    `\\u202e`: they could make a text look like another one.

    :param keep: characters that stay, such as line breaks.
    """
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() or c in keep else repr(c)[1:-1] for c in text)


def short_name(text: str) -> str:
    """Returns a name from outside for people: on one line, its first 200 characters, invisible ones as codes."""
    shown = visible(text[: _MAX_NAME + 1])
    return shown if len(shown) <= _MAX_NAME else f"{shown[:_MAX_NAME]}..."


def label_text(label: str) -> str:
    """Returns a label for people, as `short_name`, without the prefix of a template."""
    return short_name(_PREFIX.sub("", label))


def verb(relation: str, state: bool = True, has_ended: bool = False) -> str:
    """Returns a relation as the verb of a sentence.

    :param state: whether the relation holds.
    :param has_ended: it held before.
    """
    name = local_name(relation)
    shown = words(name)
    return _VERBS.get(name, (shown, f"not {shown}", f"no longer {shown}"))[0 if state else 2 if has_ended else 1]


def words(name: str) -> str:
    """Returns an ontology name in words: `skiros:ContainerState` gives `container state`."""
    return _HUMP.sub(" ", local_name(name)).replace("_", " ").lower()


def in_words(text: str) -> str:
    """Returns a text with words instead of the names of ontologies: "Arm skiros:hasA Gripper" gives "Arm has Gripper".
    A name with underscores is a label and only loses its prefix.
    """
    return _NAME.sub(lambda found: found[1] if "_" in found[1] else verb(found[1]), text)


def with_names(text: str, label_of: Callable[[str], str], name_of: Callable[[str], str]) -> str:
    """Returns a text with the names of the elements whose ids are in it as `id`, `id-label` or `id "label"`.

    :param label_of: returns the label of an element by id; "" if it has none, or is unknown.
    :param name_of: returns the text that replaces an id.
    """
    parts, end = [], 0
    for found in _ID.finditer(text):
        if found.start() < end:
            continue  # in a label
        parts += [text[end : found.start()], name_of(found[1])]
        after, end = f"-{label_of(found[1])}", found.end()
        if text.startswith(after, found.end(1)) and not (after == "-" and text[end + 1 : end + 2].isalnum()):
            end = found.end(1) + len(after)
    return "".join((*parts, text[end:]))


def unrelated(relation: str, subject: str, other: str, holders: Sequence[str] = (), others: Sequence[str] = ()) -> str:
    """Returns a clause that a relation does not hold, with the one that holds instead.

    :param holders: the elements that have the relation to `other`.
    :param others: the elements that `subject` has the relation to.
    """
    name = local_name(relation)
    if name == "contain" and holders:
        return f"{other} is in {' and '.join(holders)}, not in {subject}"
    if name == "hasA" and holders:
        return f"{other} is a part of {' and '.join(holders)}, not of {subject}"
    if name == "at":
        return f"{subject} is at {' and '.join(others)}, not at {other}" if others else f"{subject} is at no place"
    return f"{subject} {verb(relation, False)} {other}"


def wrong_value(key: str, subject: str, values: str, wanted: str) -> str:
    """Returns a clause that a property does not have the wanted value.

    :param values: as text; "" for none.
    :param wanted: the value or the comparison, such as "Empty" or "not > 3"; "" for no value.
    """
    if not values:
        return f"{subject} has no {words(key)}"
    if not wanted:
        return f"{words(key)} of {subject} is {values}"
    is_compared = wanted.startswith(("not ", "<", ">"))
    return f"{words(key)} of {subject} is {values}, {'expected' if is_compared else 'not'} {wanted}"


def a(noun: str) -> str:
    """Returns a noun with its indefinite article."""
    return f"{'an' if noun[:1].lower() in 'aeiou' else 'a'} {noun}"


def ids_in(text: str) -> list[str]:
    """Returns the ids in a text."""
    return [found[1] for found in _ID.finditer(text)]


def moment(stamp: float, now: float) -> str:
    """Returns a time of day with its distance to a later time, in the largest unit that it reaches: "20:17 (3 s ago)".

    :param stamp, now: s since the epoch.
    """
    seconds = max(0.0, now - stamp)
    size, unit = next(((size, unit) for size, unit in _UNITS if seconds >= size), _UNITS[-1])
    day = "%H:%M" if seconds < _UNITS[0][0] else "%Y-%m-%d %H:%M"
    return f"{time.strftime(day, time.localtime(stamp))} ({int(seconds // size)} {unit} ago)"
