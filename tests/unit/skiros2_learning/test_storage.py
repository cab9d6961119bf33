"""Studies whose storage fails, and studies that several processes share in a PostgreSQL database."""

from __future__ import annotations

import os
import re
import resource
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from skiros2_common.core.errors import ConfigurationError, Refused
from skiros2_learning.command_line.program import main
from skiros2_learning.core import study as study_module
from skiros2_learning.core.evaluation import Evaluation, evaluate
from skiros2_learning.core.scenario import Scenario, load_scenario
from skiros2_learning.core.storage import JOURNAL_FILE, StorageFailed
from skiros2_learning.core.study import LearningStudy
from skiros2_learning.core.workers import Runner
from support.learning_scenarios import scenario_text
from support.postgres import Postgres, find_programs, postgres
from support.ros import wait_until

TEXT = scenario_text("NAME", "parabola", evaluations=8, initial=3, settings="{folder: FOLDER}")
_MAIN = "import sys; from skiros2_learning.command_line.program import main; sys.exit(main())"


@pytest.fixture
def file(tmp_path: Path, request: pytest.FixtureRequest) -> Path:
    file = tmp_path / "parabola.yaml"
    file.write_text(TEXT.replace("NAME", re.sub(r"\W+", "_", request.node.name)).replace("FOLDER", str(tmp_path)))
    return file


@pytest.fixture
def scenario(file: Path) -> Scenario:
    return load_scenario(file)


def learn(*arguments: str, limit: int = 0) -> subprocess.Popen[str]:
    """Starts the program.

    :param limit: largest size of a file that it may write (bytes); 0: any.
    """
    path = os.pathsep.join(sys.path)
    before: Callable[[], None] | None = None
    if limit:
        before = lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))  # noqa: E731
    return subprocess.Popen(
        [sys.executable, "-c", _MAIN, *arguments, "--workers", "1"], env={**os.environ, "PYTHONPATH": path},
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, preexec_fn=before,
    )  # fmt: skip


def results_match(study: LearningStudy) -> bool:
    """Whether all results are those of this process."""
    found = study.results()
    return all(each == evaluate(study.scenario, each.configuration, each.seed) for each in found.values())


# -- the journal -------------------------------------------------------------------------------------------------------


@pytest.mark.long
def test_a_full_disk_is_one_line_and_loses_no_finished_evaluation(file: Path, tmp_path: Path) -> None:
    folder = tmp_path / "study"
    output, error = learn("run", str(file), "--study", str(folder), limit=6000).communicate(timeout=120)
    assert error.count("\n") == 1, error
    line = error.strip()
    assert line == f"learn: {folder / JOURNAL_FILE}: File too large"
    finished = output.count("| ")
    assert 1 <= finished < 8
    study = LearningStudy.open(folder)
    known = study.results()
    assert len(known) >= finished
    _, error = learn("resume", str(folder)).communicate(timeout=120)
    assert error == ""
    study = LearningStudy.open(folder)
    assert study.counted == 8
    assert {number: study.results()[number] for number in known} == known
    assert results_match(study)


@pytest.mark.long
def test_a_hanging_worker_ends_with_the_run_that_is_killed(file: Path, tmp_path: Path) -> None:
    file.write_text(file.read_text().replace(":parabola", ":hangs"))
    with learn("run", str(file), "--study", str(tmp_path / "study")) as run:
        wait_until((tmp_path / "hanging").exists)
        worker = Path("/proc") / (tmp_path / "hanging").read_text()
        assert worker.exists()
        run.kill()
    wait_until(lambda: not worker.exists())


def test_an_entry_that_was_written_in_part_is_removed(scenario: Scenario, tmp_path: Path) -> None:
    study = LearningStudy.create(scenario, tmp_path / "study")
    number, configuration, seed = study.ask()
    study.tell(number, evaluate(study.scenario, configuration, seed))
    with open(tmp_path / "study" / JOURNAL_FILE, "a", encoding="utf-8") as journal:
        journal.write('{"op_code": 4, "worker')
    again = LearningStudy.open(tmp_path / "study")
    assert again.results() == study.results()
    again.ask()
    assert LearningStudy.open(tmp_path / "study").running_count == 1


def test_of_a_damaged_journal_the_readable_part_is_kept(
    scenario: Scenario, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    study = LearningStudy.create(scenario, tmp_path / "study")
    Runner(study, 1).run()
    whole, journal = study.results(), tmp_path / "study" / JOURNAL_FILE
    lines = journal.read_bytes().splitlines(keepends=True)
    middle = len(lines) // 2
    damaged = b"".join([*lines[:middle], b"\x00\xff\n", *lines[middle + 1 :]])
    journal.write_bytes(damaged)
    again = LearningStudy.open(tmp_path / "study")
    (line,) = caplog.messages
    assert f"line {middle + 1} is damaged" in line
    assert (tmp_path / "study/journal.damaged").read_bytes() == damaged
    assert 0 < again.counted < len(whole)
    again.requeue_interrupted()
    Runner(again, 1).run()
    assert again.results() == whole


def test_lock_of_a_journal_in_a_relative_folder_refers_to_the_journal(
    scenario: Scenario, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """So a lock that a kill has left can be seen to be old; one that refers to nothing was waited for without end."""
    monkeypatch.chdir(tmp_path)
    made: list[bool] = []
    link = os.symlink

    def linked(target: str, name: str) -> None:
        link(target, name)
        made.append(Path(name).exists())

    monkeypatch.setattr(os, "symlink", linked)
    LearningStudy.create(scenario, Path("study")).ask()
    assert made and all(made)


def test_a_folder_that_cannot_be_written_is_one_line(
    file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "taken").touch()
    assert main(["run", str(file), "--study", str(tmp_path / "taken/study")]) == 1
    assert capsys.readouterr().err == f"learn: {tmp_path / 'taken/study'}: Not a directory\n"


def test_a_resumed_study_does_not_draw_the_same_configurations_again(scenario: Scenario, tmp_path: Path) -> None:
    LearningStudy.create(scenario.derived(optimiser="random"), tmp_path / "study").ask()
    again = LearningStudy.open(tmp_path / "study")
    again.requeue_interrupted()
    first, second = again.ask()[1], again.ask()[1]
    assert first != second


# -- a database --------------------------------------------------------------------------------------------------------

PROGRAMS = find_programs()
needs_postgres = pytest.mark.skipif(PROGRAMS is None, reason="PostgreSQL is not installed: apt install postgresql")


@pytest.fixture(scope="module")
def server() -> Iterator[Postgres]:
    assert PROGRAMS is not None
    with postgres(PROGRAMS) as server:
        yield server


@pytest.mark.long
@pytest.mark.timeout(900)
@needs_postgres
def test_several_runs_work_on_one_study_also_if_one_is_killed(file: Path, tmp_path: Path, server: Postgres) -> None:
    file.write_text(file.read_text().replace(":parabola", ":waits_for_go"))
    names = ("one", "two", "killed")
    runs = [learn("run", str(file), "--study", str(tmp_path / name), "--storage", server.url) for name in names]
    wait_until(lambda: all((tmp_path / f"run-{run.pid}").exists() for run in runs), 300, "each run evaluates")
    runs[-1].kill()
    runs[-1].communicate()
    (tmp_path / "go").touch()
    ended = [run.communicate(timeout=300) for run in runs[:-1]]
    assert [(run.returncode, error) for run, (_, error) in zip(runs, ended, strict=False)] == [(0, ""), (0, "")]
    study = LearningStudy.open(tmp_path / "one", server.url)
    assert study.running_count == 1
    assert all(output.count("| ") >= 1 for output, _ in ended)
    rest = learn("resume", str(tmp_path / "two"), "--storage", server.url, "--alone")
    assert (rest.communicate(timeout=300)[1], rest.returncode) == ("", 0)
    found = study.results()
    assert 8 <= len(found) <= 9  # two runs may take the last one
    assert len({each.seed for each in found.values()}) == len(found)
    assert results_match(study)
    assert study.running_count == 0


@needs_postgres
def test_the_study_of_another_scenario_is_refused(scenario: Scenario, tmp_path: Path, server: Postgres) -> None:
    LearningStudy.create(scenario, tmp_path / "one", server.url)
    with pytest.raises(ConfigurationError, match=r"of another scenario: different repetitions; give") as found:
        LearningStudy.create(scenario.derived(repetitions=3), tmp_path / "two", server.url)
    assert "secret" not in str(found.value)
    with pytest.raises(Refused, match="has a study of another scenario: different repetitions"):
        LearningStudy.create(scenario.derived(repetitions=3), tmp_path / "one", server.url)
    LearningStudy.create(scenario.derived(evaluations=9), tmp_path / "one", server.url)


@needs_postgres
def test_a_run_survives_a_restart_of_the_database(scenario: Scenario, tmp_path: Path, server: Postgres) -> None:
    study = LearningStudy.create(scenario, tmp_path / "study", server.url)

    def restart(number: int, result: Evaluation) -> None:
        if number == 2:
            server.stop()
            server.start()

    Runner(study, 1, restart).run()
    assert study.counted == 8
    assert results_match(study)


@needs_postgres
def test_results_are_kept_when_the_database_goes_away(
    scenario: Scenario, tmp_path: Path, server: Postgres, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(study_module, "RECONNECT_TIMEOUT", 0.1)
    study = LearningStudy.create(scenario, tmp_path / "study", server.url)
    number, configuration, seed = study.ask()
    result = evaluate(study.scenario, configuration, seed)
    server.stop()
    try:
        with pytest.raises(StorageFailed, match=r"learner:\*\*\*@127\.0\.0\.1.*connection failed") as failure:
            study.tell(number, result)
        assert "\n" not in str(failure.value)
        with pytest.raises(StorageFailed):
            LearningStudy.open(tmp_path / "study", server.url)
    finally:
        server.start()
    again = LearningStudy.open(tmp_path / "study", server.url)
    assert again.save_unsaved() == 1
    assert again.results() == {number: result}
    assert again.save_unsaved() == 0


@needs_postgres
def test_the_evaluation_of_a_dead_run_is_repeated(
    scenario: Scenario, tmp_path: Path, server: Postgres, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("skiros2_learning.core.storage.GRACE_PERIOD", 1)
    dead = LearningStudy.create(scenario, tmp_path / "study", server.url)
    number, configuration, seed = dead.ask()
    other = LearningStudy.open(tmp_path / "study", server.url)
    results: dict[int, Evaluation] = {}

    def collect(number: int, result: Evaluation) -> None:
        results[number] = result

    monkeypatch.setattr(study_module, "HEARTBEAT", 0)
    while other.optuna.get_trials(deepcopy=False)[number].state.name == "RUNNING":
        other.beat()
    Runner(other, 1, collect).run()
    assert (configuration, seed) in [(each.configuration, each.seed) for each in results.values()]
    assert len(results) == other.counted == 8


@pytest.mark.parametrize(
    ("url", "text"),
    [
        ("postgresql://nobody@127.0.0.1:1/none", "connection refused"),
        ("mysql://nobody@127.0.0.1/none", "its driver is not installed: No module named 'MySQLdb'"),
        ("nonsense", "Could not parse SQLAlchemy URL"),
        ("oracel://x", "Can't load plugin: sqlalchemy.dialects:oracel"),
    ],
)
def test_a_database_that_cannot_be_opened_is_one_line(
    file: Path, tmp_path: Path, url: str, text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["run", str(file), "--study", str(tmp_path / "study"), "--storage", url]) == 1
    error = capsys.readouterr().err
    assert text.lower() in error.lower()
    assert error.count("\n") == 1
