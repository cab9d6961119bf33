"""The installed test kit for skill authors, in a separate folder."""

import subprocess
import sys

from support.ros import install_environment

TEST = """
from skiros2_common.core.abstract_skill import State


def test_counter_succeeds_at_its_target(fake_clock, skill_bench):
    skill_bench.import_libraries("skiros2_std_skills")
    tray = skill_bench.add("skiros:LargeBox", "tray")
    assert "skiros:Container" in skill_bench.wmi.get_super_class(tray.type)
    task = skill_bench.command("Counter", CountTarget=3).run()
    assert task.state is State.Success, task.why
    assert len(task.trace.ticks) == 3
"""


def test_a_test_of_a_skill_passes_with_the_installed_packages(tmp_path):
    (tmp_path / "conftest.py").write_text('pytest_plugins = ["skiros2_skill.testing"]\n')
    (tmp_path / "test_counter.py").write_text(TEST)
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", str(tmp_path)],
        env=install_environment(), cwd=tmp_path, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    assert "1 passed" in done.stdout
