"""Programs of others run on Debian's own Python, which has ROS but none of the packages from requirements/."""

import os
import subprocess
import sys

from support.ros import ROOT

MODULES = sorted(
    line.removeprefix("module ").strip()
    for line in (ROOT / "tests/contract/public_api.txt").read_text().splitlines()
    if line.startswith("module ")
)


#: Imports each of the named modules in a fork, and prints why those that fail do.
IMPORTS = """
import os, sys, traceback
import numpy, rospy, yaml
for module in sys.argv[1:]:
    if os.fork() == 0:
        try:
            __import__(module)
        except (Exception, SystemExit):
            print(module, traceback.format_exc())
        sys.stdout.flush()
        os._exit(0)
    os.wait()
"""


def test_public_modules_import_with_debian_packages_only() -> None:
    folders = [path for path in sys.path if path.startswith(str(ROOT)) and "/.venv/" not in path]
    done = subprocess.run(
        ["/usr/bin/python3", "-c", IMPORTS, *sorted(set(MODULES)), "skiros2_skill.testing"],
        env={**os.environ, "PYTHONPATH": ":".join(folders)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stdout) == (0, ""), done.stderr
