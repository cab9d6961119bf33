"""Checks skills before they run, from their descriptions and trees alone.

Nothing that depends on parameter values, or may be added while a skill runs, is a finding. Findings do not prevent
loading: a warning states the consequence, an error means that the skill cannot run.
"""

from __future__ import annotations

import logging
from collections.abc import Iterable, Sequence
from itertools import groupby

from skiros2_common.core.errors import FOREIGN_ERRORS
from skiros2_common.core.primitive import PrimitiveBase
from skiros2_common.core.world_model_port import WorldModelPort
from skiros2_common.tools.plugin_loader import PluginLoader
from skiros2_skill.core.library.description import Descriptions, Undescribed
from skiros2_skill.core.library.library import SkillLibrary
from skiros2_skill.core.lint.findings import ERROR, NOT_DESCRIBED, NOTE, Finding, description_findings
from skiros2_skill.core.lint.preempt import preempt_findings
from skiros2_skill.core.lint.tree import Cycles, tree_findings
from skiros2_skill.core.tree.compound import SkillBase

log = logging.getLogger(__name__)


class Linter:
    """Checks the skills of libraries.

    :param classes: all classes that implement skills.
    :param wmi: the world model with the ontologies; None: names are not looked up.
    """

    def __init__(self, classes: Iterable[type], wmi: WorldModelPort | None = None) -> None:
        self.descriptions = Descriptions(wmi, classes)
        self._cycles = Cycles()

    @classmethod
    def of(cls, descriptions: Descriptions) -> Linter:
        """A linter for classes that are described already."""
        linter = cls((), descriptions.wmi)
        linter.descriptions = descriptions
        return linter

    def lint(self, cls: type, tree: bool = True) -> list[Finding]:
        """The findings of the skill that a class implements, ordered by file and line.

        :param tree: whether a compound is expanded and its tree is checked too.
        """
        found = self.descriptions.of(cls)
        if isinstance(found, Undescribed):
            text = f"describing it raised {found.reason}"
            return [Finding(ERROR, NOT_DESCRIBED, cls.__name__, text, *found.location, "the skill is skipped")]
        own = [*description_findings(found, self.descriptions.wmi), *preempt_findings(found, self.descriptions)]
        return _in_order([*own, *(tree_findings(found, self.descriptions, self._cycles) if tree else ())])


def log_findings(library: SkillLibrary, classes: Sequence[type]) -> None:
    """Logs the findings of loaded skills, in one warning for each of the library's packages. Notes are omitted.

    For `SkillLibrary.on_load`.
    """
    linter = Linter.of(library.descriptions)
    found = [(library.package_of(cls), finding) for cls in classes for finding in _loaded_findings(linter, cls)]
    for package, findings in groupby(sorted(found, key=lambda f: (f[0], f[1].file, f[1].line)), lambda f: f[0]):
        lines = list(dict.fromkeys(str(finding) for _, finding in findings))
        count = "1 problem" if len(lines) == 1 else f"{len(lines)} problems"
        log.warning("library %s has %s:\n  %s", package, count, "\n  ".join(lines))


def _loaded_findings(linter: Linter, cls: type) -> list[Finding]:
    try:
        found = linter.lint(cls)
    except FOREIGN_ERRORS:  # raised by the skill's `expand`
        log.exception("%s.%s cannot be checked", cls.__module__, cls.__name__)
        return []
    return [finding for finding in found if finding.severity != NOTE and finding.code != NOT_DESCRIBED]


def lint_libraries(
    packages: Sequence[str], wmi: WorldModelPort | None = None, used: Sequence[str] = ()
) -> list[Finding]:
    """The findings of the skills in Python packages, including modules that cannot be imported.

    :param used: further packages with skills that the trees may use.
    :raises ConfigurationError: a package does not exist or cannot be imported.
    """
    bases = (PrimitiveBase, SkillBase)
    loader, others = PluginLoader(), PluginLoader()
    for package in packages:
        loader.load(package, bases)
    for package in used:
        others.load(package, bases)
    linter = Linter(dict.fromkeys([*loader, *others]), wmi)
    findings = [
        Finding(NOTE, "needs-ros", module, failure.text, failure.file, failure.line, "skipped without ROS")
        if failure.needs_ros
        else Finding(ERROR, "not-imported", module, failure.text, failure.file, failure.line)
        for module, failure in loader.failures.items()
    ]
    return _in_order(findings + [finding for cls in loader for finding in linter.lint(cls)])


def _in_order(findings: Iterable[Finding]) -> list[Finding]:
    return sorted(dict.fromkeys(findings), key=lambda finding: (finding.file, finding.line, finding.code, finding.text))
