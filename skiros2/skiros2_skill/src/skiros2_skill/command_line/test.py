"""The command test: runs the tests of a package of skills."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import NoReturn

from skiros2_common.command_line.command import UNAVAILABLE, VERSION, command_arguments, end


def run(arguments: Sequence[str] | None = None) -> NoReturn:
    """Runs pytest in the working directory, with the folder `src` first on the path, and ends the process.

    :param arguments: of pytest; None: those of this process.
    """
    given = command_arguments(arguments)
    if given == ["--version"]:
        sys.stdout.write(f"{VERSION}\n")
        sys.exit()
    try:
        import pytest
    except ModuleNotFoundError as error:
        sys.stderr.write(f"test: {error}; install it with: pip install pytest\n")
        sys.exit(UNAVAILABLE)
    sys.path.insert(0, str(Path("src").resolve()))
    end(pytest.main(given))
