"""`rosrun skiros2_bags coverage BAG... [PACKAGE]`: prints which skills, conditions, branches and failures recorded runs
have exercised, and what no run has.

Exit status: 0 success, 2 a bag or the package cannot be read, or wrong usage.
"""

from __future__ import annotations

import argparse
import importlib
import inspect
import logging
import pkgutil
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

from skiros2_bags.core.coverage import Coverage, Outcomes, SkillCoverage
from skiros2_bags.core.run import Run
from skiros2_common.command_line.command import USAGE, CommandResult, Parser, UsageError, run_command, screen
from skiros2_common.command_line.layout import Branch, Screen, table, tree
from skiros2_common.core.errors import ConfigurationError
from skiros2_common.core.primitive import PrimitiveBase
from skiros2_skill.core.tree.compound import SkillBase

log = logging.getLogger(__name__)


def main(arguments: list[str] | None = None) -> int:
    """Runs the program.

    :returns: the exit status.
    """
    parser = Parser(prog="coverage", description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("names", nargs="+", metavar="BAG|PACKAGE", help="bag files; a package of skills")
    parser.add_argument("--json", action="store_true", help="print JSON")
    given = parser.parse_args(arguments)
    return run_command("coverage", lambda: _work(given.names, screen()), given.json, refused=USAGE)


def _work(names: list[str], on: Screen) -> CommandResult:
    bags = [Path(name) for name in names if name.endswith((".bag", ".active")) or Path(name).is_file()]
    packages = [name for name in names if Path(name) not in bags]
    if not bags:
        raise UsageError("no bag is given")
    found = Coverage()
    for package in packages:
        for label, conditions in package_skills(package):
            found.declare(label, conditions)
    own = set(found.skills)
    for bag in bags:
        found.add(Run.open(bag))
    if packages:
        found.skills = {label: skill for label, skill in found.skills.items() if label in own}
    skills = sorted(found.skills.values(), key=lambda skill: (not skill.was_run, skill.label))
    lines = [*_table(skills, on), "", *_tree(skills, on)]
    if found.lacks_evidence:
        lines += ["", "a bag has no evidence of conditions: record it with --evidence"]
    return CommandResult(lines, {skill.label: _data(skill) for skill in skills})


def package_skills(package: str) -> Iterator[tuple[str, list[str]]]:
    """Yields label and conditions of each skill that the modules of a package implement; see `Coverage.declare`.

    :raises ConfigurationError: the package or a module of it cannot be imported.
    """
    try:
        root = importlib.import_module(package)
        names = [info.name for info in pkgutil.walk_packages(getattr(root, "__path__", ()), f"{package}.")]
        modules = [root, *(importlib.import_module(name) for name in names)]
    except ImportError as error:
        raise ConfigurationError(f"package {package} cannot be imported: {error}") from error
    for module in modules:
        for _, cls in inspect.getmembers(module, inspect.isclass):
            is_own = cls.__module__ == module.__name__ and issubclass(cls, SkillBase | PrimitiveBase)
            if is_own and not inspect.isabstract(cls):
                skill: Any = cls()
                try:
                    skill.createDescription()
                except Exception as error:  # library code
                    log.warning("%s.%s is left out: %s", module.__name__, cls.__name__, error)
                    continue
                stages = {"pre": skill.pre_conditions, "hold": skill.hold_conditions, "post": skill.post_conditions}
                yield skill.label, [f"{name}-condition {c.label}" for name, all_ in stages.items() for c in all_]


def _table(skills: list[SkillCoverage], on: Screen) -> list[str]:
    rows = [
        (
            skill.label,
            *map(str, (skill.outcomes.good, skill.outcomes.bad, skill.outcomes.preempted)),
            _share(skill.conditions.values()),
            _share(skill.branches.values()),
            str(skill.gaps),
        )
        for skill in skills
    ]
    return table(on, rows, ("skill", "succeeded", "failed", "preempted", "conditions", "branches", "not seen"))


def _share(outcomes: Any) -> str:
    """Returns how many were seen in both ways, of all."""
    every = list(outcomes)
    return f"{sum(each.is_covered for each in every)} of {len(every)}" if every else ""


def _tree(skills: list[SkillCoverage], on: Screen) -> list[str]:
    roots = []
    for skill in skills:
        root = _branch(skill.label, skill.outcomes, "succeeded", "failed")
        root.branches = [_branch(name, found, "held", "unsatisfied") for name, found in skill.conditions.items()]
        known = {(): root}
        for names, outcomes in sorted(skill.branches.items(), key=lambda item: _numbers(item[0])):
            known[names] = _branch(names[-1], outcomes, "succeeded", "failed")
            known.get(names[:-1], root).branches.append(known[names])
        roots.append(root)
    return tree(on, roots)


def _numbers(names: tuple[str, ...]) -> tuple[int, ...]:
    return tuple(int(name.partition(" ")[0]) for name in names)


def _branch(text: str, found: Outcomes, good: str, bad: str) -> Branch:
    seen = [
        f"{good} {found.good}" if found.good else f"never {good}",
        f"{bad} {found.bad}" if found.bad else f"never {bad}",
    ]
    marks = ("+" if found.good else "-") + ("+" if found.bad else "-")
    return Branch([text, marks, ", ".join(seen)])


def _data(skill: SkillCoverage) -> dict[str, Any]:
    branches = {" / ".join(names): asdict(found) for names, found in skill.branches.items()}
    conditions = {name: asdict(found) for name, found in skill.conditions.items()}
    return {"outcomes": asdict(skill.outcomes), "conditions": conditions, "branches": branches, "not_seen": skill.gaps}
