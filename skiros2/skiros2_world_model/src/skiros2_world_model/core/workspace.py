"""The folder of the user's ontologies and scenes."""

from __future__ import annotations

from pathlib import Path

from skiros2_common.core.errors import WrongValue


def workspace_file(workspace: Path | None, filename: str) -> Path:
    """A file of the workspace, whether it is there or not.

    :param filename: relative to the workspace, or whole.
    :raises WrongValue: it is outside the workspace, or no name of a file.
    """
    if not filename:
        raise WrongValue("the name of the file is missing")
    if "\0" in filename or any("\ud800" <= c <= "\udfff" for c in filename):
        raise WrongValue(f"{filename!r} cannot be the name of a file")
    if workspace is None:
        raise WrongValue(f"{filename}: there is no workspace to find it in")
    folder = workspace.absolute()
    path = Path(folder, filename)
    parts = path.parts[len(folder.parts) :]
    if not path.is_relative_to(folder) or ".." in parts or not parts:
        raise WrongValue(f"{filename}: expected a file in the workspace {folder}")
    return path
