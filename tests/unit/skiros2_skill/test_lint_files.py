"""`lint` names mistakes in ontologies and scenes with file, line and the nearest name."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from pathlib import Path

import pytest

from skiros2_skill.command_line.lint import run

HEAD = """@prefix owl: <http://www.w3.org/2002/07/owl#> .
@prefix rdfs: <http://www.w3.org/2000/01/rdf-schema#> .
@prefix skiros: <http://rvmi.aau.dk/ontologies/skiros.owl#> .
@prefix spare: <http://example.org/spare.owl#> .

"""
ONTOLOGY = HEAD + "skiros:Mug a owl:Class ;\n    rdfs:subClassOf skiros:Produkt .\n"
SCENE = HEAD + "skiros:Scene-0 a skiros:Scene .\n\nskiros:Mug-1 a skiros:Mugg ;\n    rdfs:seeAlso owl:Class .\n"


@pytest.fixture(autouse=True)
def _log_levels() -> Iterator[None]:
    """The command sets the levels of its process."""
    loggers = [logging.getLogger(name) for name in ("skiros2_common", "skiros2_world_model")]
    levels = [logger.level for logger in loggers]
    yield
    for logger, level in zip(loggers, levels, strict=True):
        logger.setLevel(level)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "my.owl.ttl").write_text(ONTOLOGY)
    (tmp_path / "scene.ttl").write_text(SCENE)
    return tmp_path


def lint(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[list[str], object]:
    with pytest.raises(SystemExit) as ended:
        run(arguments)
    return capsys.readouterr().out.splitlines(), ended.value.code


def test_ontology_and_scene_are_checked_by_name(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    lines, status = lint(capsys, "my.owl.ttl", "scene.ttl")
    assert lines == [
        "my.owl.ttl:7: warning: [unknown-class] skiros:Mug skiros:Produkt: unknown class, after rdfs:subClassOf; "
        "did you mean skiros:Product?",
        "my.owl.ttl:4: warning: [unused-prefix] spare:: the prefix is not used",
        "scene.ttl:8: warning: [unknown-class] skiros:Mug-1: unknown class skiros:Mugg; did you mean skiros:Mug?",
        "scene.ttl:4: warning: [unused-prefix] spare:: the prefix is not used",
        "0 errors, 4 warnings; lint --explain CODE explains a code",
    ]
    assert status in (0, None)


def test_workspace_is_checked_beside_a_package(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    lines, status = lint(capsys, "skiros2_demo_skills", "--workspace", str(folder), "--strict")
    assert [line.partition(" ")[0] for line in lines[:-1]] == [
        "my.owl.ttl:7:",
        "my.owl.ttl:4:",
        "scene.ttl:8:",
        "scene.ttl:4:",
    ]
    assert status == 1


def test_broken_files_are_errors_with_line_and_column(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name in ("my.owl.ttl", "scene.ttl"):
        (folder / name).write_text(HEAD + "skiros:Mug-1 a skiros:Mug ;;\nskiros:Mug-2 b skiros:Mug .\n")
    lines, status = lint(capsys, "my.owl.ttl", "scene.ttl")
    assert len(lines) == 3
    for name, line in zip(("my.owl.ttl", "scene.ttl"), lines, strict=False):
        assert line.startswith(f"{name}:7: error: [syntax] {name}: line 7, column ")
    assert status == 1


def test_missing_file_is_an_error(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    lines, status = lint(capsys, "other.ttl")
    assert lines[0].startswith("other.ttl:0: error: [syntax] other.ttl: cannot be read")
    assert status == 1
