"""The public surface is frozen: every line of public_api.txt holds in the code."""

from __future__ import annotations

import enum
import importlib
import inspect
import re
import textwrap
import types
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

LISTING = Path(__file__).with_name("public_api.txt")


@dataclass(frozen=True)
class Entry:
    """A line of the listing: what kind of thing, its text, and where it belongs."""

    module: str
    owner: str
    kind: str
    text: str

    def __str__(self) -> str:
        return ".".join(part for part in (self.module, self.owner, f"{self.kind} {self.text}".strip()) if part)


def entries() -> Iterator[Entry]:
    module = owner = ""
    for line in LISTING.read_text().splitlines():
        if not line.strip() or line.startswith("#"):
            continue
        kind, _, text = line.strip().partition(" ")
        if kind == "module":
            module, owner = text, ""
            yield Entry(module, "", kind, "")
            continue
        if not line.startswith("    "):
            owner = ""
        yield Entry(module, owner, kind, text)
        if kind == "class":
            owner = re.match(r"\w+", text).group()


@pytest.mark.parametrize("entry", sorted(set(entries()), key=str), ids=str)
def test_public_name_exists_with_its_signature(entry: Entry) -> None:
    place: Any = importlib.import_module(entry.module)
    if entry.owner:
        place = getattr(place, entry.owner)
    CHECKS[entry.kind](place, entry.text)


def test_listing_covers_every_public_package() -> None:
    packages = {entry.module.partition(".")[0] for entry in entries()}
    assert packages == {
        "skiros2_common",
        "skiros2_world_model",
        "skiros2_skill",
        "skiros2_task",
        "skiros2_std_skills",
        "skiros2_std_reasoners",
    }


def check_module(module: Any, text: str) -> None:
    assert inspect.ismodule(module)


def check_names(module: Any, text: str) -> None:
    assert not [name for name in text.split() if not hasattr(module, name)]


def check_star(module: Any, text: str) -> None:
    scope: dict[str, Any] = {}
    exec(f"from {module.__name__} import *", scope)
    assert not [name for name in text.split() if name not in scope]


def check_enum(module: Any, text: str) -> None:
    name, members = text.split(": ")
    kind = getattr(module, name)
    assert issubclass(kind, enum.Enum)
    assert [member.name for member in kind] == members.split()


def check_class(module: Any, text: str) -> None:
    name, bases = re.fullmatch(r"(\w+)(?:\((.*)\))?", text).groups()
    kind = getattr(module, name)
    assert inspect.isclass(kind)
    ancestors = [base.__name__ for base in kind.__mro__]
    for base in (bases or "object").split(", "):
        assert base.rpartition(".")[2] in ancestors


def check_function(module: Any, text: str) -> None:
    name = text.partition("(")[0]
    assert_signature(inspect.signature(getattr(module, name)), text)


def check_method(kind: type, text: str) -> None:
    name = text.partition("(")[0]
    found = inspect.getattr_static(kind, name)
    signature = inspect.signature(getattr(found, "__func__", found))
    if not isinstance(found, staticmethod):
        signature = signature.replace(parameters=list(signature.parameters.values())[1:])
    assert_signature(signature, text)


def check_property(kind: type, text: str) -> None:
    """A property, or an attribute that each instance has by its class's slots."""
    assert isinstance(inspect.getattr_static(kind, text), property | types.MemberDescriptorType)


def check_attribute(kind: type, text: str) -> None:
    name, _, value = text.partition(" = ")
    if value:
        assert getattr(kind, name) == eval(value)
    else:
        assert hasattr(kind, name) or any(
            re.search(rf"\bself\.{name}\b[^=\n]*=", textwrap.dedent(inspect.getsource(base)))
            for base in kind.__mro__
            if base.__module__.startswith("skiros2_")
        )


CHECKS = {name.removeprefix("check_"): check for name, check in list(globals().items()) if name.startswith("check_")}


def assert_signature(signature: inspect.Signature, text: str) -> None:
    """Every call that the listed arguments allow is allowed, and means the same: they come first, in that order, and
    have their listed defaults; what comes after them is optional."""
    listed = arguments_of(text)
    found = list(signature.parameters.values())
    assert [argument.name for argument in found[: len(listed)]] == list(listed), f"is {signature}"
    for argument in found[: len(listed)]:
        default = listed[argument.name]
        if default is not argument.empty:
            assert same_default(argument.default, default), f"{argument}: listed with {default!r}"
    optional = (inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD)
    for argument in found[len(listed) :]:
        assert argument.default is not argument.empty or argument.kind in optional, f"is {signature}"


def arguments_of(text: str) -> dict[str, Any]:
    """Argument names of `name(a, b=1, *c)` with their defaults, evaluated."""
    import rospy

    import skiros2_msgs.srv as srvs

    scope = {"rospy": rospy, "srvs": srvs}
    if "Sequential()" in text:
        scope["Sequential"] = importlib.import_module("skiros2_skill.core.processors").Sequential
    exec(f"def listed{text[text.index('(') :]}: ...", scope)
    return {name: argument.default for name, argument in inspect.signature(scope["listed"]).parameters.items()}


def same_default(found: Any, listed: Any) -> bool:
    if type(listed).__module__.startswith("skiros2_"):  # an instance stands for itself
        return type(found) is type(listed)
    return type(found) is type(listed) and bool(found == listed)
