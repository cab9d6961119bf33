"""Functions of the tab "Learning". They block; the window calls them in jobs.

The modules of studies are imported when they are first used: they take seconds to import, and are optional.
"""

from __future__ import annotations

import datetime
import io
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from skiros2_common.core.errors import MissingPackage, SkirosError
from skiros2_common.core.world_element import Element
from skiros2_common.core.world_model_port import WorldModelPort
from skiros2_skill.core.engine.learned_parameters import PARAMETER_SET

if TYPE_CHECKING:
    from skiros2_learning.core.study import LearningStudy

#: How deep below a folder studies are searched.
_DEPTH = 3
#: Timeout of a replay (s).
_REPLAY_TIMEOUT = 600.0
_MAIN = "import sys; from skiros2_learning.command_line.program import main; sys.exit(main())"


@dataclass(frozen=True)
class ListedStudy:
    """A study in a list.

    :param success: best success rate of the search, which is optimistic.
    :param validated: the success of the validated configuration with its interval; "" if the study is not validated.
    :param problem: why it cannot be read; "" if it can.
    """

    folder: Path
    name: str
    counted: int = 0
    budget: int = 0
    success: float = 0.0
    validated: str = ""
    problem: str = ""


@dataclass(frozen=True)
class Configuration:
    """An evaluation in a table.

    :param success: its success in the search.
    :param values: its objectives, then its configuration, as texts.
    """

    number: int
    success: str
    is_optimal: bool
    values: tuple[str, ...]


@dataclass(frozen=True)
class StudyView:
    """A study with its evaluations, the best ones first.

    :param headers: of `Configuration.values`.
    :param pictures: PNG files by title.
    :param validation: lines for people.
    """

    folder: Path
    headers: tuple[str, ...]
    configurations: tuple[Configuration, ...]
    pictures: dict[str, bytes]
    validation: tuple[str, ...]


@dataclass(frozen=True)
class AppliedSet:
    """A parameter set in the world model."""

    id: str
    label: str
    study: str


def list_studies(folder: Path) -> list[ListedStudy]:
    """Returns the studies in a folder and below it, by name.

    :raises MissingPackage: Optuna is not installed.
    """
    found = [f.parent for depth in range(_DEPTH + 1) for f in folder.glob("*/" * depth + "scenario.yaml")]
    return [_listed(each) for each in sorted(found)]


def read_study(folder: Path) -> StudyView:
    """Reads a study and draws its pictures.

    :raises SkirosError: it cannot be read.
    """
    study = _open(folder)
    from skiros2_learning.core import report
    from skiros2_learning.core.pictures import draw_pictures
    from skiros2_learning.core.validation import stored_validation, validation_lines

    ranked = study.ranked()  # before the results, since other processes add some meanwhile
    results = study.results()
    optimal = study.best(results)
    objectives = [objective.name for objective in study.scenario.objectives]
    names = [variable.name for variable in study.scenario.variables]
    rows = []
    for number in ranked:
        result = results[number]
        values = [f"{result.objectives[name]:.4g}" for name in objectives]
        values += [report.format_value(result.configuration.get(name)) for name in names]
        rows.append(Configuration(number, report.search_share(result), number in optimal, tuple(values)))
    pictures = {title: _png(figure) for title, figure in draw_pictures(study).items()}
    found = stored_validation(study)
    text = f"not validated: the rates are optimistic; run: learn validate {folder}"
    lines = (text,) if found is None else tuple(validation_lines(study.scenario, found))
    return StudyView(folder, (*objectives, *names), tuple(rows), pictures, lines)


def replay(folder: Path, number: int) -> str:
    """Runs an evaluation again, in a process of its own, and compares it. Returns a text for people.

    :raises SkirosError: it cannot be run.
    """
    command = [sys.executable, "-c", _MAIN, "replay", str(folder), str(number)]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=_REPLAY_TIMEOUT, check=False)
    except subprocess.TimeoutExpired:
        raise SkirosError(f"the replay has not ended within {_REPLAY_TIMEOUT:g} s") from None
    if not done.stdout:
        raise SkirosError(done.stderr.strip().removeprefix("learn: ") or f"exit status {done.returncode}")
    return done.stdout.strip()


def apply_configuration(wmi: WorldModelPort, folder: Path, number: int) -> list[str]:
    """Stores a configuration in the world model. Returns the ids of the parameter sets.

    :raises SkirosError: the study or the world model refuses, such as if the configuration is not validated.
    """
    study = _open(folder)
    from skiros2_learning.core.parameter_sets import apply_result
    from skiros2_learning.core.validation import applicable

    _, result, sample = applicable(study, number)
    date = datetime.datetime.now().astimezone().isoformat(timespec="seconds")
    added = apply_result(wmi, study.scenario, number, result, date, str(folder.resolve()), sample)
    return [each.id for each in added]


def revert(wmi: WorldModelPort, eid: str) -> None:
    """Removes a parameter set.

    :raises SkirosError: there is no such set, or the world model refuses.
    """
    from skiros2_learning.core.parameter_sets import remove_set

    remove_set(wmi, eid)


def applied_sets(wmi: WorldModelPort) -> list[AppliedSet]:
    """Returns the parameter sets in the world model, the newest first."""
    found = sorted(wmi.resolve_elements(Element(PARAMETER_SET)), key=lambda e: e.getIdNumber(), reverse=True)
    return [AppliedSet(each.id, each.label, str(each.value_of("skiros:Study") or "")) for each in found]


def _listed(folder: Path) -> ListedStudy:
    try:
        study = _open(folder)
        rates: Sequence[float] = [each.success_rate for each in study.results().values()]
        from skiros2_learning.core.validation import share_text, stored_validation

        found = stored_validation(study)
    except MissingPackage:
        raise
    except SkirosError as error:
        return ListedStudy(folder, folder.name, problem=str(error))
    validated = "" if found is None else share_text(found.learned)
    budget, best = study.scenario.budget.evaluations, max(rates, default=0.0)
    return ListedStudy(folder, folder.name, study.counted, budget, best, validated)


def _open(folder: Path) -> LearningStudy:
    try:
        from skiros2_learning.core.study import LearningStudy
    except ImportError as error:
        raise MissingPackage(f"studies need requirements/learning.txt: {error}") from error
    return LearningStudy.open(folder)


def _png(figure: Any) -> bytes:
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=100)
    return buffer.getvalue()
