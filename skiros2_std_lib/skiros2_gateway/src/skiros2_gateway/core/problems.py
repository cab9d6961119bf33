"""The problems of a request, each with its place, its expectation and the nearest known names."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from pydantic import ValidationError

from skiros2_common.core.errors import SkirosError, WrongValue


@dataclass(frozen=True)
class Problem:
    """One problem of a request.

    :param code: the kind of problem, such as `unknown_name`.
    :param where: the field, as a path: `parameters.Product`.
    :param nearest: the nearest known names.
    """

    code: str
    where: str
    message: str
    expected: str = ""
    nearest: tuple[str, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        return {**asdict(self), "nearest": list(self.nearest)}

    def __str__(self) -> str:
        near = f"; near: {', '.join(self.nearest)}" if self.nearest else ""
        return f"{self.where}: {self.message}{near}" if self.where else f"{self.message}{near}"


class Rejected(WrongValue):
    """A request with problems. It has changed nothing."""

    code = "rejected"

    def __init__(self, problems: Sequence[Problem]) -> None:
        super().__init__("; ".join(str(problem) for problem in problems))
        self.problems = tuple(problems)


class WrongQuery(Rejected):
    """A query of the world model that cannot be read or answered."""

    code = "wrong_query"


class Denied(SkirosError):
    """A request of a caller without the role for it."""

    code = "denied"


class Unauthenticated(SkirosError):
    """A request without valid credentials."""

    code = "unauthenticated"


class StoreFailed(SkirosError):
    """The store has refused a change or cannot be read, for example on a full disk. Nothing has changed."""

    code = "store_failed"


class TooMany(SkirosError):
    """A request over the rate limit.

    :param retry_after: s until the next request is allowed.
    """

    code = "too_many_requests"

    def __init__(self, text: str, retry_after: float) -> None:
        super().__init__(text)
        self.retry_after = retry_after


def problems_of(error: ValidationError) -> list[Problem]:
    """Returns the problems that pydantic has found."""
    return field_problems(error.errors(include_url=False, include_context=False))


def field_problems(errors: Iterable[Any]) -> list[Problem]:
    """Returns pydantic's error records as problems."""
    return [Problem(e["type"], ".".join(str(part) for part in e["loc"]), e["msg"]) for e in errors]
