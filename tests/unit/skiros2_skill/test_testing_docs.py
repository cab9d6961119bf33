"""The examples of tests in the documentation, as authors would run them: with pytest, in a folder of their own."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]

#: The file, the heading of the section, and how many tests it shows.
SECTIONS = [("docs/skills.md", "Testing skills", 4), ("CONTRIBUTING.md", "Add a skill", 1)]
SECTIONS.append(("docs/contact.md", "Write a contact skill", 3))


@pytest.mark.parametrize(("file", "heading", "tests"), SECTIONS, ids=lambda value: str(value))
def test_documented_tests_pass(tmp_path: Path, file: str, heading: str, tests: int) -> None:
    (section,) = re.findall(rf"^## {heading}$(.*?)^## ", (ROOT / file).read_text(), re.M | re.S)
    blocks = re.findall(r"^```python\n(.*?)^```$", section, re.M | re.S)
    (tmp_path / "conftest.py").write_text('pytest_plugins = ["skiros2_skill.testing"]\n')
    (tmp_path / "test_shown.py").write_text(next(block for block in blocks if "def test_" in block))
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", str(tmp_path)],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
        cwd=tmp_path, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    assert f"{tests} passed" in done.stdout
