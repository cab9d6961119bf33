"""The file of other cells."""

from __future__ import annotations

from pathlib import Path

import pytest

from skiros2_common.core.errors import ConfigurationError
from skiros2_gateway.core.other_cells import read_cells


def test_file_of_cells_is_read_and_its_mistakes_are_named(tmp_path: Path) -> None:
    path = tmp_path / "cells.yaml"
    path.write_text("cells: [{name: Line 2, address: 'https://line2:8765', token: abc}]")
    path.chmod(0o644)
    with pytest.raises(ConfigurationError, match="may be read by others"):
        read_cells(path)
    path.chmod(0o600)
    assert [(cell.name, cell.address) for cell in read_cells(path)] == [("Line 2", "https://line2:8765")]
    for text in ("cells: [{name: a, address: 'line2:8765', token: b}]", "cells: 1", "a: [", "cells: [{name: a}]"):
        path.write_text(text)
        with pytest.raises(ConfigurationError, match="cells"):
            read_cells(path)
    with pytest.raises(ConfigurationError, match="missing"):
        read_cells(tmp_path / "missing.yaml")
