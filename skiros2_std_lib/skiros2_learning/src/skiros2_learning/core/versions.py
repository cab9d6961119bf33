"""The versions of what a study was run with, stored with it."""

from __future__ import annotations

import platform
from contextlib import suppress
from importlib import metadata

from skiros2_common import __version__
from skiros2_learning.core.study import LearningStudy

#: Packages on which results depend.
_PACKAGES = ("optuna", "numpy", "scipy", "pybullet")
#: Attribute of the study.
_VERSIONS = "versions"


def note_versions(study: LearningStudy) -> None:
    """Stores the versions of this process with a study, unless it has them."""
    used = {"skiros2": __version__, "python": platform.python_version()}
    for name in _PACKAGES:
        with suppress(metadata.PackageNotFoundError):
            used[name] = metadata.version(name)
    if used not in (known := versions_of(study)):
        study.set_attribute(_VERSIONS, [*known, used])


def versions_of(study: LearningStudy) -> list[dict[str, str]]:
    """Returns the versions of the runs of a study, by package; [] if they are not known."""
    found = study.attribute(_VERSIONS)
    return list(found) if isinstance(found, list) else []
