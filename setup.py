"""The distribution `skiros2` for pip: what works without ROS. catkin builds the packages by their own files.

The versions of the libraries are those of requirements/*.in.
"""

import re
from pathlib import Path

from setuptools import find_packages, setup

ROOT = Path(__file__).parent
#: The folders of the packages; the window needs ROS.
SOURCES = [
    f"{folder}/src"
    for folder in re.findall(r"^(?!skiros2_gui)[^#\n]+$", (ROOT / "packages.txt").read_text(), re.M)
    if (ROOT / folder / "src").is_dir()
]
#: Files that programs read: in the distribution below share/, as in catkin's install space.
SHARED = {
    "share/skiros2/ontologies": "ontologies/*.ttl",
    "share/skiros2/ontologies/shapes": "ontologies/shapes/*",
    "share/skiros2_demo_skills/owl": "skiros2_std_lib/demos/timed_skills/owl/*.ttl",
}


def requirements(name):
    """The packages that a list names, without those of other lists."""
    text = (ROOT / "requirements" / f"{name}.in").read_text()
    return re.findall(r"^([^ #\n-]\S*)", text, re.M)


packages = {package: source for source in SOURCES for package in find_packages(source)}

setup(
    packages=sorted(packages),
    package_dir={package: f"{source}/{package}" for package, source in packages.items() if "." not in package},
    package_data={"skiros2_skill": ["templates/**/*", "templates/*"]},
    data_files=[
        (folder, [str(path.relative_to(ROOT)) for path in sorted(ROOT.glob(pattern)) if path.is_file()])
        for folder, pattern in SHARED.items()
    ],
    install_requires=[*requirements("core"), *requirements("planner")],
    extras_require={
        "sim": requirements("sim"),
        "learning": [*requirements("sim"), *requirements("learning")],
        "optimisers": requirements("optimisers"),
        "bags": requirements("run"),
    },
)
