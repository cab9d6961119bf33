import sys
from pathlib import Path

# The skills of this folder are tested, also when the package is installed.
sys.path.insert(0, str(Path(__file__).parents[1] / "src"))

pytest_plugins = ["skiros2_skill.testing"]
