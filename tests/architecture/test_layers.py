"""Who may import whom (the architecture's layers), read from the syntax trees."""

from __future__ import annotations

import sys

import pytest

from support.source import PACKAGES, WINDOW_SUBJECTS, SourceFile, source_files

FILES = source_files()
CORES = [file for file in FILES if file.part in ("core", "tools")]

#: What the core of a package may import beside the standard library, itself and `skiros2_common`.
OUTSIDE = {
    "skiros2_common": {"numpy"},
    "skiros2_world_model": {"numpy", "rdflib", "pyoxigraph", "oxrdflib", "pyshacl"},
    "skiros2_skill": {"numpy"},
    "skiros2_task": {"numpy", "unified_planning", "up_fast_downward"},
    "skiros2_std_reasoners": {"numpy"},
    "skiros2_bags": {"numpy", "rosbags", "matplotlib"},
    "skiros2_sim": {"numpy", "pybullet", "pybullet_data", "PIL"},
    "skiros2_sim_skills": set(),
    "skiros2_gui": {"numpy"},
}
#: Of lower packages, only the port.
PORTS = {
    "skiros2_skill": {"skiros2_world_model.core.world_model_abstract_interface"},
    "skiros2_task": {"skiros2_world_model.core.world_model_abstract_interface", "skiros2_skill.core"},
    "skiros2_bags": {
        "skiros2_world_model.core",
        "skiros2_skill.core",
        "skiros2_task.core",
        "skiros2_std_reasoners.core",
    },
    "skiros2_sim": {"skiros2_world_model.core", "skiros2_std_reasoners.core"},
    "skiros2_sim_skills": {"skiros2_sim.core.names", "skiros2_std_reasoners.core"},
    # Presenters are at the top; what commands show as text is plain Python too.
    "skiros2_gui": {
        "skiros2_world_model.core",
        "skiros2_world_model.command_line",
        "skiros2_skill.core",
        "skiros2_skill.command_line",
        "skiros2_task.core",
        "skiros2_task.command_line",
        "skiros2_bags.core",
        "skiros2_std_reasoners.core",
    },
}

WINDOW_CORES = tuple(f"skiros2_gui.{subject}" for subject in WINDOW_SUBJECTS)
WINDOW_ADAPTERS = tuple(f"{subject}.{folder}" for subject in WINDOW_CORES for folder in ("widgets", "ros"))
QT = {"python_qt_binding", "PyQt5", "PySide2"}
ROS = {"rospy", "rosgraph", "actionlib", "skiros2_msgs", "visualization_msgs", "interactive_markers"}


def test_every_package_is_looked_at() -> None:
    assert {file.package for file in FILES} == set(PACKAGES)


@pytest.mark.parametrize("file", CORES, ids=str)
def test_a_core_imports_only_its_own_layer_and_those_below(file: SourceFile) -> None:
    allowed = sys.stdlib_module_names | OUTSIDE[file.package]
    own = ("skiros2_common.core", "skiros2_common.tools", f"{file.package}.core", f"{file.package}.tools")
    wrong = [
        f"{file}:{line}: {name}"
        for line, name in file.imports()
        if name.partition(".")[0] not in allowed
        and (not _under(name, (*own, *WINDOW_CORES, *PORTS.get(file.package, ()))) or _under(name, WINDOW_ADAPTERS))
    ]
    assert not wrong, "a core has no ROS and no layer above it"


@pytest.mark.parametrize("file", [f for f in FILES if f.package == "skiros2_gui" and f.part], ids=str)
def test_window_uses_qt_in_widgets_and_ros_in_adapters_only(file: SourceFile) -> None:
    """The programs at the top of the package, such as `standalone`, may use both."""
    modules = {name.partition(".")[0] for _, name in file.imports()}
    assert file.part == "widgets" or not modules & QT
    assert file.part in ("ros", "nodes") or not modules & ROS


@pytest.mark.parametrize("file", FILES, ids=str)
def test_no_package_imports_one_that_stands_above_it(file: SourceFile) -> None:
    order = list(PACKAGES)
    above = order[order.index(file.package) + 1 :]
    assert not [f"{file}:{line}: {name}" for line, name in file.imports() if name.partition(".")[0] in above]


def _under(name: str, modules: tuple[str, ...]) -> bool:
    return any(name == module or name.startswith(module + ".") for module in modules)
