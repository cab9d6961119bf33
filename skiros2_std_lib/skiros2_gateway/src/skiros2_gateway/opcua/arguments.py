"""Checks the arguments of a call against the declaration of its method, and says what is wrong with a call."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from asyncua import ua

#: The last argument of most methods, which clients may leave out.
_COMMENT = "Comment"


def wrong_arguments(declared: Sequence[tuple[Any, ...]], arguments: Sequence[ua.Variant]) -> ua.CallMethodResult | None:
    """Returns the result of a call with wrong arguments, with a text for each; None if they are right.

    :param declared: name, type (or the name of a structure) and whether it is an array, of each argument.
    """
    needed = [name for name, _, _ in declared if name != _COMMENT]
    if len(arguments) < len(needed):
        return described(ua.StatusCodes.BadArgumentsMissing, [f"missing: {', '.join(needed[len(arguments) :])}"])
    if len(arguments) > len(declared):
        names = ", ".join(name for name, _, _ in declared)
        return described(ua.StatusCodes.BadTooManyArguments, [f"{len(arguments)} arguments, expected {names}"])
    texts = [_problem(*each, argument) for each, argument in zip(declared, arguments, strict=False)]
    if not any(texts):
        return None
    result = described(ua.StatusCodes.BadInvalidArgument, texts)
    codes = (ua.StatusCodes.BadTypeMismatch if text else ua.StatusCodes.Good for text in texts)
    result.InputArgumentResults = [ua.StatusCode(code) for code in codes]
    return result


def described(status: int, texts: Sequence[str], outputs: Sequence[ua.Variant] = ()) -> ua.CallMethodResult:
    """Returns the result of a call, with a text for each argument in the diagnostic information ("" for none)."""
    result = ua.CallMethodResult(StatusCode=ua.StatusCode(status), OutputArguments=list(outputs))
    result.InputArgumentDiagnosticInfos = [ua.DiagnosticInfo(AdditionalInfo=text or None) for text in texts]
    return result


def _problem(name: str, kind: ua.VariantType | str, is_array: bool, argument: ua.Variant) -> str:
    """Returns what is wrong with an argument; "" if it is right. An empty array may come as null."""
    value = argument.Value
    if value is None and is_array:
        return ""
    values = value if isinstance(value, list) else [value]
    if isinstance(kind, str):
        expected, is_right = kind, all(type(each).__name__ == kind for each in values)
    else:
        expected, is_right = kind.name, argument.VariantType is kind and value is not None
    if is_right and isinstance(value, list) == is_array:
        return ""
    found = type(values[0]).__name__ if isinstance(kind, str) and values else argument.VariantType.name
    return f"{name}: {found}{'[]' if isinstance(value, list) else ''}, expected {expected}{'[]' if is_array else ''}"
