"""Who may import whom (the architecture's layers), read from the syntax trees."""

from __future__ import annotations

import ast
import re
import sys
from graphlib import CycleError, TopologicalSorter

import grimp
import pytest

from support.packages import source_folders
from support.source import PACKAGES, WINDOW_SUBJECTS, source_files

FILES = source_files()
CORES = [file for file in FILES if file.part in ("core", "tools")]

#: What the core of a package may import beside the standard library, itself and `skiros2_common`.
OUTSIDE = {
    "skiros2_common": {"numpy", "yaml"},
    "skiros2_runs": {"numpy"},
    "skiros2_world_model": {"numpy", "rdflib", "pyoxigraph", "oxrdflib", "pyshacl"},
    "skiros2_skill": {"numpy"},
    "skiros2_task": {"numpy", "unified_planning", "up_fast_downward"},
    "skiros2_motion": {"numpy", "PyKDL"},
    "skiros2_std_reasoners": {"numpy"},
    "skiros2_live": set(),
    "skiros2_std_skills": set(),
    "skiros2_perception": {"numpy", "scipy"},
    "skiros2_bags": {"numpy", "rosbags", "lz4", "matplotlib", "mcap", "rerun"},
    "skiros2_sim": {"numpy", "scipy", "PyKDL", "pybullet", "pybullet_data", "PIL", "ompl", "shapely"},
    "skiros2_sim_skills": set(),
    "skiros2_contact_skills": {"numpy"},
    "skiros2_teaching": {"numpy", "scipy"},
    "skiros2_learning": {
        "numpy",
        "scipy",
        "torch",
        "botorch",
        "gpytorch",
        "linear_operator",
        "smac",
        "ConfigSpace",
        "threadpoolctl",
        "optuna",
        "sqlalchemy",
        "pydantic",
        "pydantic_core",
        "distributed",
        "pebble",
        "yaml",
        "matplotlib",
    },
    "skiros2_gateway": {"numpy", "pydantic", "yaml", "PIL"},
    "skiros2_gui": {"numpy"},
}
MOTION = {"skiros2_motion.core", "skiros2_std_reasoners.core"}
#: Of lower packages, only the port.
PORTS = {
    "skiros2_skill": {"skiros2_runs.core", "skiros2_world_model.core.wm_errors"},
    "skiros2_task": {
        "skiros2_world_model.core.wm_errors",
        "skiros2_world_model.core.datatypes",
        "skiros2_world_model.core.vocabulary",
        "skiros2_skill.core",
    },
    "skiros2_std_reasoners": {"skiros2_motion.core"},
    "skiros2_live": {"skiros2_runs.core", "skiros2_task.core", "skiros2_world_model.core", *MOTION},
    "skiros2_perception": MOTION,
    "skiros2_bags": {
        "skiros2_runs.core",
        "skiros2_world_model.core",
        "skiros2_skill.core",
        "skiros2_task.core",
        "skiros2_live.core",
        "skiros2_std_reasoners.core",
    },
    "skiros2_sim": {"skiros2_world_model.core", *MOTION, "skiros2_std_skills.core"},
    "skiros2_sim_skills": {"skiros2_runs.core", *MOTION},
    "skiros2_contact_skills": MOTION,
    "skiros2_teaching": {"skiros2_world_model.core", *MOTION, "skiros2_contact_skills.core"},
    "skiros2_gateway": {
        "skiros2_runs.core",
        "skiros2_skill.core",
        "skiros2_task.core",
        "skiros2_world_model.core",
        "skiros2_live.core",
        *MOTION,
        "skiros2_bags.core",
    },
    "skiros2_learning": {"skiros2_skill.core", "skiros2_sim.core", "skiros2_motion.core"},
    # Presenters are at the top; what commands show as text is plain Python too.
    "skiros2_gui": {
        "skiros2_runs.core",
        "skiros2_world_model.core",
        "skiros2_world_model.command_line",
        "skiros2_skill.core",
        "skiros2_skill.client.description",
        "skiros2_skill.command_line",
        "skiros2_task.core",
        "skiros2_task.command_line",
        "skiros2_bags.core",
        "skiros2_live.core",
        *MOTION,
        "skiros2_learning.core",
        "skiros2_teaching.core",
    },
}

#: What the parts of `skiros2_skill.core` may not import: the engine, which knows nodes and the library by protocols, is
#: below the tree, that below running tasks; what explains and checks reads the records of the parts below it.
ABOVE = {
    "engine": ("tree", "runtime", "library", "lint"),
    "tree": ("runtime", "library", "lint"),
    "library": ("engine", "runtime", "lint"),
    "runtime": ("lint",),
    "lint": ("engine", "runtime"),
}

WINDOW_CORES = tuple(f"skiros2_gui.{subject}" for subject in WINDOW_SUBJECTS)
WINDOW_ADAPTERS = tuple(f"{subject}.{folder}" for subject in WINDOW_CORES for folder in ("widgets", "ros"))
QT = {"python_qt_binding", "PyQt5", "PySide2"}
ROS = {"rospy", "rosgraph", "actionlib", "skiros2_msgs", "visualization_msgs", "interactive_markers"}


def test_every_package_is_checked() -> None:
    assert {file.package for file in FILES} == set(PACKAGES)


def test_cores_import_no_ros_and_no_higher_layer() -> None:
    wrong = []
    for file in CORES:
        allowed = sys.stdlib_module_names | OUTSIDE[file.package]
        shared = ("skiros2_common.core", "skiros2_common.tools", "skiros2_common.__version__")
        own = (*shared, f"{file.package}.core", f"{file.package}.tools")
        wrong += [
            f"{file}:{line}: {name}"
            for line, name in file.imports()
            if name.partition(".")[0] not in allowed
            and (not _under(name, (*own, *WINDOW_CORES, *PORTS.get(file.package, ()))) or _under(name, WINDOW_ADAPTERS))
        ]
    assert not wrong


def test_parts_of_skills_import_no_higher_part() -> None:
    core = "skiros2_skill.core"
    assert not [
        f"{file}:{line}: {name}"
        for file in CORES
        for part, above in ABOVE.items()
        if _under(file.module, (f"{core}.{part}",))
        for line, name in file.imports()
        if _under(name, tuple(f"{core}.{other}" for other in above))
    ]


def test_engine_assigns_nothing_to_nodes() -> None:
    """What a start, a tick or an end changes is in the skill run."""
    engine = [file for file in CORES if _under(file.module, ("skiros2_skill.core.engine",))]
    assert not [
        f"{file}:{target.lineno}: node.{target.attr}"
        for file in engine
        for target in file.nodes
        if isinstance(target, ast.Attribute) and isinstance(target.ctx, ast.Store)
        if isinstance(target.value, ast.Name | ast.Attribute) and ast.unparse(target.value).split(".")[-1] == "node"
    ]


def test_window_uses_qt_in_widgets_and_ros_in_adapters_only() -> None:
    """The programs at the top of the package, such as `standalone`, may use both."""
    wrong = []
    for file in [file for file in FILES if file.package == "skiros2_gui" and file.part]:
        modules = {name.partition(".")[0] for _, name in file.imports()}
        if (file.part != "widgets" and modules & QT) or (file.part not in ("ros", "nodes") and modules & ROS):
            wrong.append(str(file))
    assert not wrong


def test_packages_import_no_higher_package() -> None:
    order = list(PACKAGES)
    assert not [
        f"{file}:{line}: {name}"
        for file in FILES
        for line, name in file.imports()
        if name.partition(".")[0] in order[order.index(file.package) + 1 :]
    ]


def test_only_demos_import_demos() -> None:
    """But for the library of timed skills, on which others build."""
    demos = {name for name, folder in PACKAGES.items() if "/demos/" in folder} - {"skiros2_demo_skills"}
    assert demos
    assert not [
        f"{file}:{line}: {name}"
        for file in FILES
        if file.package not in demos
        for line, name in file.imports()
        if name.partition(".")[0] in demos
    ]


def test_nothing_imports_the_window() -> None:
    assert not [
        f"{file}:{line}: {name}"
        for file in FILES
        if file.package != "skiros2_gui"
        for line, name in file.imports()
        if _under(name, ("skiros2_gui",))
    ]


def test_skills_of_real_arms_need_no_simulator() -> None:
    """A robot has no PyBullet: its skills and drivers must not reach the simulator by any import."""
    graph = imports(exclude_type_checking_imports=True)
    for package in ("skiros2_motion", "skiros2_contact_skills", "skiros2_teaching"):
        for simulator in ("pybullet", "skiros2_sim", "skiros2_sim_skills"):
            chain = graph.find_shortest_chain(package, simulator, as_packages=True)
            assert chain is None, " -> ".join(chain)


def test_only_the_adapter_of_physics_uses_the_engine() -> None:
    """The test load runs in a process of its own."""
    users = {file.module for file in FILES for _, name in file.imports() if _under(name, ("pybullet",))}
    adapter = {"skiros2_sim.core.bullet", "skiros2_sim.core.bullet_connection", "skiros2_sim.core.bullet_couplings"}
    assert users == {*adapter, "skiros2_sim.core.load_test_program"}


def test_one_module_parses_urdfs() -> None:
    parse = re.compile(r"\b(fromstring|iterparse|XMLParser|URDF\.load)\(|\bxml\.parse\(")
    readers = {file.module for file in FILES if "etree" in file.text and parse.search(file.text)}
    assert readers == {"skiros2_motion.core.urdf"}


def test_imports_have_no_circles() -> None:
    """Also not through imports inside functions, or for type checkers only."""
    graph = imports()
    modules = {module: graph.find_modules_directly_imported_by(module) - {module} for module in graph.modules}
    try:
        TopologicalSorter(modules).prepare()
    except CycleError as error:
        pytest.fail(" <- ".join(error.args[1]))


def imports(exclude_type_checking_imports: bool = False) -> grimp.ImportGraph:
    """The imports of all Python packages, and of these from other projects."""
    packages = [init.parent.name for folder in source_folders() for init in folder.glob("*/__init__.py")]
    return grimp.build_graph(
        *packages,
        include_external_packages=True,
        exclude_type_checking_imports=exclude_type_checking_imports,
        cache_dir=None,
    )


def _under(name: str, modules: tuple[str, ...]) -> bool:
    return any(name == module or name.startswith(module + ".") for module in modules)
