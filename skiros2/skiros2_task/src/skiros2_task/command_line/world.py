"""The world that a command plans in: the running world model, or a scene file with skill libraries."""

from __future__ import annotations

import argparse
import logging
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from skiros2_common.command_line.command import UsageError
from skiros2_common.core.abstract_skill import SkillCore
from skiros2_common.core.errors import ConfigurationError
from skiros2_common.core.names import local_name
from skiros2_common.core.primitive import PrimitiveBase
from skiros2_common.core.world_element import Element
from skiros2_common.tools.plugin_loader import PluginLoader
from skiros2_skill.command_line.local_world_model import world_model_of
from skiros2_skill.core.library.description import Described
from skiros2_skill.core.tree.compound import SkillBase
from skiros2_skill.ros.registration import Registration
from skiros2_world_model.command_line.program import connect
from skiros2_world_model.core.world_model_abstract_interface import WorldModelPort


@contextmanager
def planning_world(arguments: argparse.Namespace) -> Iterator[WorldModelPort]:
    """Yields the world model that a command plans with.

    :raises Unavailable: there is no world model.
    :raises SkirosError: the scene or a library cannot be loaded.
    """
    if arguments.scene is None:
        if arguments.libraries or arguments.skills or arguments.workspace:
            raise UsageError("--libraries, --skills and --workspace are for scene files; name one with --scene")
        yield connect(arguments.wm, arguments.author, computing=True)
        return
    if not arguments.scene.is_file():
        raise ConfigurationError(f"scene {arguments.scene}: there is no such file")
    workspace = arguments.workspace or arguments.scene.resolve().parent
    with _quiet(), world_model_of(arguments.libraries, workspace, arguments.author, arguments.scene) as wm:
        if arguments.libraries:
            _give_skills(wm, arguments)
        yield wm


@contextmanager
def _quiet() -> Iterator[None]:
    """Suppresses warnings about scenes and libraries, which other commands check."""
    loggers = [logging.getLogger(name) for name in ("skiros2_common", "skiros2_world_model", "skiros2_skill")]
    levels = [logger.level for logger in loggers]
    for logger in loggers:
        logger.setLevel(logging.ERROR)
    try:
        yield
    finally:
        for logger, level in zip(loggers, levels, strict=True):
            logger.setLevel(level)


def manager_of(robot: str) -> str:
    """Returns the node name of a robot's manager; "" for any robot."""
    return f"/{local_name(robot).lstrip('/')}" if robot else ""


def _give_skills(wm: WorldModelPort, arguments: argparse.Namespace) -> None:
    """Adds the skills of libraries to the robots of a scene, as their managers would."""
    skills = _skills_of(wm, arguments.libraries, arguments.skills)
    for robot in _robots(wm, arguments.robot):
        for skill in skills:
            element = skill.toElement()
            element.addRelation(robot, "skiros:hasSkill", "-1")
            wm.add_element(element)


def _robots(wm: WorldModelPort, wanted: str) -> list[str]:
    """Registers robots as their managers would, and returns their ids.

    :param wanted: the label, or template, of one robot; "": all robots of the scene with a label.
    :raises ConfigurationError: there is no robot.
    """
    labels = [wanted] if wanted else [e.label for e in wm.resolve_elements(Element("cora:Robot")) if e.label]
    if not labels:
        raise ConfigurationError("the scene has no robot; name one with --robot prefix:name, as its template is called")
    found = []
    for label in dict.fromkeys(labels):
        prefix, _, name = label.rpartition(":")
        registration = Registration(wm, prefix, name.lstrip("/"), manager_of(label))
        registration.register_robot()
        found.append(registration.robot_id)
    return found


def _skills_of(wm: WorldModelPort, packages: Sequence[str], names: Sequence[str]) -> list[SkillCore]:
    """Returns the skills of libraries.

    :param names: of the skill classes; empty: all.
    """
    loader = PluginLoader()
    classes = [cls for package in packages for cls in loader.find(package, (PrimitiveBase, SkillBase))]
    if names:
        known = {cls.__name__: cls for cls in classes}
        unknown = [name for name in names if name not in known]
        if unknown:
            there = ", ".join(sorted(known))
            raise ConfigurationError(f"{', '.join(packages)}: no skill {', '.join(unknown)}; there are: {there}")
        classes = [known[name] for name in names]
    found = []
    for cls in dict.fromkeys(classes):
        try:
            found.append(Described(cls, wm).skill)
        except Exception as error:  # a library may raise anything
            raise ConfigurationError(f"skill {cls.__name__} cannot be read: {type(error).__name__}: {error}") from error
    return found
