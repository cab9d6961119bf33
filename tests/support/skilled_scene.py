"""A scene of a package of skills, with the robots and their skills as skill managers would enter them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from skiros2_skill.core.library import SkillLibrary
from skiros2_skill.ros.registration import Registration
from skiros2_world_model.core.local_world_model import LocalWorldModel
from skiros2_world_model.core.world_model import WorldModel
from support.ros import ROOT


def scene_with_skills(package: str, scene: str, robots: Mapping[str, Sequence[str]]) -> LocalWorldModel:
    """Loads the scene and enters the robots.

    :param scene: file in the package's folder `owl`.
    :param robots: the skills of each, by class; they are of the package, or standard ones.
    """
    model = WorldModel(ROOT / "ontologies", ROOT / "skiros2_std_lib" / package / "owl")
    model.load_initial(scene)
    wmi = LocalWorldModel("test", model)
    for robot, skills in robots.items():
        library = SkillLibrary(wmi)
        library.import_libraries(["skiros2_std_skills", package])
        library.load(skills)
        registration = Registration(wmi, "demo", robot, f"/{robot}")
        registration.register_robot()
        registration.register_skills(library.implementations())
    return wmi
