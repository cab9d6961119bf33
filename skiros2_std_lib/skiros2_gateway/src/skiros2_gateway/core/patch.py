"""JSON Merge Patch (RFC 7396): the difference of two documents as a document.

Values that are None mean "removed", so documents must not have members with the value None.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any


def merge_patch(before: Mapping[str, Any], after: Mapping[str, Any]) -> dict[str, Any]:
    """Returns the patch that makes `after` of `before`; empty if they are equal.

    :param after: JSON data without None.
    """
    patch: dict[str, Any] = dict.fromkeys(before.keys() - after.keys())
    for key, new in after.items():
        old = before.get(key)
        if isinstance(new, dict) and isinstance(old, dict):
            if part := merge_patch(old, new):
                patch[key] = part
        elif type(new) is not type(old) or new != old:
            patch[key] = new
    return patch


def apply_patch(document: dict[str, Any], patch: Mapping[str, Any]) -> None:
    """Applies a patch to a document in place."""
    for key, new in patch.items():
        if new is None:
            document.pop(key, None)
        elif isinstance(new, dict):
            old = document.get(key)
            if not isinstance(old, dict):
                old = document[key] = {}
            apply_patch(old, new)
        else:
            document[key] = new


def without_none(data: Any) -> Any:
    """Returns JSON data without the members of objects that are None, and without numbers that JSON lacks."""
    if isinstance(data, dict):
        return {str(key): without_none(value) for key, value in data.items() if value is not None}
    if isinstance(data, list | tuple):
        return [without_none(value) for value in data]
    if isinstance(data, float) and (data != data or data in (float("inf"), float("-inf"))):
        return str(data)
    return data
