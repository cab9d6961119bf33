"""Two programs that change the same elements for a minute end with the same scene as the world model."""

from __future__ import annotations

import json
import random
import subprocess
import sys
from pathlib import Path

import pytest

from skiros2_world_model.ros.world_model_interface import WorldModelInterface
from support import world_editor
from support.ros import Ros

SECONDS = 8


@pytest.mark.long
@pytest.mark.timeout(SECONDS + 120)
def test_two_programs_that_change_the_same_elements_end_with_the_same_scene(ros: Ros, tmp_path: Path) -> None:
    ros.run("skiros2_world_model", "world_model_server_node", name="wm", params={"workspace_dir": str(tmp_path)})
    seed = random.randrange(1 << 32)
    print(f"seed {seed}")
    editors = [
        subprocess.Popen(
            [sys.executable, world_editor.__file__, str(SECONDS), str(seed + i)],
            env=ros.master.env, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, bufsize=1,
        )
        for i in range(2)
    ]  # fmt: skip
    try:
        assert [_line(editor) for editor in editors] == ["ready\n", "ready\n"]
        for editor in editors:
            _go_on(editor)
        counts = [json.loads(_line(editor)) for editor in editors]
        print(counts)
        for editor in editors:  # only now, when both are done
            _go_on(editor)
        seen = [json.loads(_line(editor)) for editor in editors]
        assert [editor.wait(30.0) for editor in editors] == [0, 0]
    finally:
        for editor in editors:
            editor.kill()
            editor.communicate()
    truth = json.loads(json.dumps(world_editor.scene_of(WorldModelInterface("reader"))))
    assert seen[0] == truth
    assert seen[1] == truth
    assert all(count["made"] > 10 * SECONDS for count in counts), "they hardly changed anything"
    assert len(truth) > 10


def _line(editor: subprocess.Popen[str]) -> str:
    assert editor.stdout is not None
    return editor.stdout.readline()


def _go_on(editor: subprocess.Popen[str]) -> None:
    assert editor.stdin is not None
    editor.stdin.write("\n")
    editor.stdin.flush()
