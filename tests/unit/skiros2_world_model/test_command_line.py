"""The commands of `rosrun skiros2_world_model`, on a world model in this process."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from skiros2_common.command_line.command import Unavailable
from skiros2_common.command_line.layout import Branch, Screen, table, tree
from skiros2_common.core.errors import WrongValue
from skiros2_world_model.command_line import program
from skiros2_world_model.command_line.program import connect
from skiros2_world_model.command_line.reading import point
from skiros2_world_model.core.journal import Journal
from skiros2_world_model.core.local_world_model import LocalWorldModel, source_ontologies
from skiros2_world_model.core.world_model import WorldModel

LAB = """@prefix : <http://rvmi.aau.dk/ontologies/skiros.owl#> .
@prefix rdfs: <http://www.w3.org/2000/01/rdf-schema#> .
@prefix xsd: <http://www.w3.org/2001/XMLSchema#> .
:Scene-0 a :Scene ; rdfs:label "Lab" ; :contain :LargeBox-80 .
:LargeBox-80 a :LargeBox ; rdfs:label "tray" ; :ContainerState "Full" ; :contain :Starter-81 ; :hasA :Part-82 ;
    :PositionX 1.0 ; :PositionY 2.5 ; :PositionZ 0.0 ; :SizeX 0.5 .
:Starter-81 a :Starter ; rdfs:label "two\\nlines" ; :Weight "0.5"^^xsd:float .
:Part-82 a :Part .
:Part-90 a :Part ; rdfs:label "stray" .
"""
ONTOLOGY = """@prefix : <http://rvmi.aau.dk/ontologies/skiros.owl#> .
@prefix owl: <http://www.w3.org/2002/07/owl#> .
@prefix rdfs: <http://www.w3.org/2000/01/rdf-schema#> .
:Code a owl:DatatypeProperty ; rdfs:range <http://www.w3.org/2001/XMLSchema#string> .
"""


class Result(NamedTuple):
    status: int
    out: str
    err: str

    @property
    def json(self) -> Any:
        return json.loads(self.out)


@pytest.fixture
def model(workspace: Path, tmp_path: Path) -> Iterator[WorldModel]:
    (workspace / "lab.ttl").write_text(LAB)
    (workspace / "lab.owl.ttl").write_text(ONTOLOGY)
    journal = Journal(tmp_path / "wm.journal")
    model = WorldModel(source_ontologies(), workspace, journal=journal, initial=[("scene", "lab.ttl")])
    yield model
    journal.close()


@pytest.fixture
def run(
    model: WorldModel, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Callable[..., Result]:
    """Runs a command to its end."""
    monkeypatch.setattr(program, "connect", lambda name, author: LocalWorldModel(author, model))

    def run(name: str, *arguments: str) -> Result:
        capsys.readouterr()
        with pytest.raises(SystemExit) as end:
            program.run(name, arguments)
        return Result(int(end.value.code or 0), *capsys.readouterr())

    return run


# -- view ----------------------------------------------------------------------------------------------------------


def test_view_shows_the_scene_as_a_tree(run) -> None:
    assert run("view").out.splitlines() == [
        "skiros:Scene-0                Lab",
        "└── skiros:LargeBox-80        tray        at (1, 2.5, 0)  ContainerState=Full",
        r"    ├── skiros:Starter-81     two\nlines  Weight=0.5",
        "    └── hasA: skiros:Part-82",
        "",
        "1 more that nothing holds (skills, parameters, ...): --all",
    ]


def test_view_all_shows_every_element_property_and_relation(run) -> None:
    run("set", "skiros:Part-90", "skiros:at", "skiros:Scene-0")
    out = run("view", "--all").out.splitlines()
    assert '└── skiros:LargeBox-80 "tray"' in out
    assert "    ├── skiros:SizeX = 0.5" in out
    assert out[-2:] == ['skiros:Part-90 "stray"', "└── skiros:at skiros:Scene-0"]


def test_view_of_an_element_shows_its_descendants(run) -> None:
    shown = run("view", "skiros:LargeBox-80", "--json").json
    assert [element["id"] for element in shown] == ["skiros:LargeBox-80", "skiros:Starter-81", "skiros:Part-82"]
    assert shown[0]["relations"] == [
        {"src": "skiros:LargeBox-80", "type": "skiros:contain", "dst": "skiros:Starter-81"},
        {"src": "skiros:LargeBox-80", "type": "skiros:hasA", "dst": "skiros:Part-82"},
        {"src": "skiros:Scene-0", "type": "skiros:contain", "dst": "skiros:LargeBox-80"},
    ]
    assert run("view", "skiros:Part-7") == (1, "", "view: there is no element 'skiros:Part-7'\n")


def test_element_in_two_places_is_expanded_at_the_first(run) -> None:
    run("set", "skiros:Scene-0", "skiros:contain", "skiros:Starter-81")
    assert run("view").out.count("Starter-81 (see above)") == 1
    assert run("view").out.count("Weight=0.5") == 1


# -- get -----------------------------------------------------------------------------------------------------------


def test_get_shows_an_element(run) -> None:
    assert run("get", "skiros:Starter-81").out.splitlines() == [
        r"skiros:Starter-81  skiros:Starter  two\nlines",
        "",
        "skiros:Weight  float  0.5",
        "",
        "skiros:LargeBox-80  skiros:contain  skiros:Starter-81",
    ]


@pytest.mark.parametrize(
    ("name", "out"),
    [
        ("skiros:SizeX", "0.5\n"),
        ("SizeX", "0.5\n"),
        ("skiros:contain", "skiros:Starter-81\n"),
        ("label", "tray\n"),
        ("type", "skiros:LargeBox\n"),
    ],
)
def test_get_of_one_property_gives_its_values_alone(run, name: str, out: str) -> None:
    assert run("get", "skiros:LargeBox-80", name) == (0, out, "")
    assert run("get", "skiros:LargeBox-80", name, "--json").status == 0


def test_unknown_element_or_property_is_named(run) -> None:
    assert run("get", "skiros:Part-7") == (1, "", "get: there is no element 'skiros:Part-7' in context 'scene'\n")
    missing = run("get", "skiros:Part-90", "Weight")
    assert missing == (1, "", "get: skiros:Part-90 has no skiros:Weight; it has: none\n")
    assert run("get", "skiros:Part-90", "--context", "nowhere").status == 1


# -- set -----------------------------------------------------------------------------------------------------------


def test_set_gives_values_the_types_of_the_ontology(run, model: WorldModel) -> None:
    assert run("set", "skiros:Part-90", "Weight", "2") == (0, "~ skiros:Part-90 skiros:Weight: (none) -> 2\n", "")
    assert run("get", "skiros:Part-90", "Weight", "--json").json == [2.0]
    assert run("set", "skiros:Part-90", "PublishTf", "true").status == 0
    assert run("get", "skiros:Part-90", "PublishTf", "--json").json == [True]
    assert run("set", "skiros:Part-90", "PositionX", "-1.5").status == 0
    assert run("set", "skiros:Part-90", "PositionY", "--", "-1e-3").status == 0
    assert run("get", "skiros:Part-90", "PositionY", "--json").json == [-0.001]
    assert model.history.changes("skiros:Part-90")[-1].author == program.user()


def test_type_of_an_undeclared_property_follows_from_the_text(run) -> None:
    texts = {"7": 7, "0.5": 0.5, "true": True, '"7"': "7", "007": "007", "[1]": "[1]", "a b": "a b"}
    for text, value in texts.items():
        run("set", "skiros:Part-90", "Odd", "--remove")
        run("set", "skiros:Part-90", "Odd", text)
        assert run("get", "skiros:Part-90", "Odd", "--json").json == [value]
    run("set", "skiros:Part-90", "SizeX", "0.5")
    assert run("set", "skiros:Part-90", "SizeX", "wide").status == 1
    assert run("set", "skiros:Part-90", "Code", "7").status == 0
    assert run("get", "skiros:Part-90", "Code", "--json").json == ["7"], "the workspace's ontology says text"


@pytest.mark.parametrize("element", ["skiros:Part-90", "skiros:Starter-81"])
@pytest.mark.parametrize(("name", "value"), [("Weight", "heavy"), ("PublishTf", "perhaps")])
def test_a_value_of_another_type_is_refused(run, element: str, name: str, value: str) -> None:
    before = run("get", element).out
    refused = run("set", element, name, value)
    assert (refused.status, refused.out) == (1, "")
    assert f"skiros:{name}" in refused.err and refused.err.count("\n") == 1 and value in refused.err
    assert run("get", element).out == before


def test_set_of_several_values_and_removal(run) -> None:
    assert run("set", "skiros:Part-90", "Odd", "a", "b", "c").status == 0
    assert run("set", "skiros:Part-90", "Odd", "--remove", "b").out == "~ skiros:Part-90 skiros:Odd: a, b, c -> a, c\n"
    assert "has no value b" in run("set", "skiros:Part-90", "Odd", "b", "--remove").err
    assert run("set", "skiros:Part-90", "Odd", "--remove").out == "~ skiros:Part-90 skiros:Odd: a, c -> (none)\n"
    assert "has no property skiros:Odd" in run("set", "skiros:Part-90", "Odd", "--remove").err
    assert "the value is missing" in run("set", "skiros:Part-90", "Odd").err


def test_set_relates_elements_and_ends_relations(run) -> None:
    related = run("set", "skiros:Scene-0", "contain", "skiros:Part-90", "skiros:Part-82")
    assert related.out == (
        "+ skiros:Scene-0 skiros:contain skiros:Part-82\n+ skiros:Scene-0 skiros:contain skiros:Part-90\n"
    )
    assert run("set", "skiros:Scene-0", "contain", "skiros:Part-90").out == "skiros:Scene-0 has these values already\n"
    assert run("set", "skiros:Scene-0", "contain", "skiros:Part-90", "--remove").status == 0
    assert run("get", "skiros:Scene-0", "contain", "--json").json == ["skiros:LargeBox-80", "skiros:Part-82"]
    gone = run("set", "skiros:Scene-0", "contain", "skiros:Part-90", "--remove")
    assert gone == (1, "", "set: there is no relation skiros:Scene-0 skiros:contain skiros:Part-90\n")
    assert "no element 'skiros:Part-7'" in run("set", "skiros:Scene-0", "contain", "skiros:Part-7").err
    run("set", "skiros:Scene-0", "skiros:likes", "skiros:Part-90")
    assert run("get", "skiros:Scene-0", "skiros:likes").out == "skiros:Part-90\n", "a relation nobody declared"


def test_set_of_label_and_type(run) -> None:
    assert run("set", "skiros:Part-90", "label", "found", "again").out == (
        "~ skiros:Part-90 label: stray -> found again\n"
    )
    assert run("set", "skiros:Part-90", "type", "Starter").out == (
        "~ skiros:Part-90 type: skiros:Part -> skiros:Starter\n"
    )


# -- query, load, save ---------------------------------------------------------------------------------------------


def test_query_shows_a_table(run) -> None:
    asked = """SELECT ?x ?l (STR(?w) AS ?weight) ?w
        { ?y skiros:contain ?x . ?x rdfs:label ?l OPTIONAL { ?x skiros:Weight ?w } } ORDER BY ?x"""
    assert run("query", asked).out.splitlines() == [
        "x                   l           weight  w",
        "------------------  ----------  ------  ---",
        "skiros:LargeBox-80  tray",
        r"skiros:Starter-81   two\nlines  0.5     0.5",
    ]
    assert run("query", asked, "--json").json == [
        {"x": "skiros:LargeBox-80", "l": "tray", "weight": None, "w": None},
        {"x": "skiros:Starter-81", "l": "two\nlines", "weight": "0.5", "w": 0.5},
    ]


def test_query_of_a_file_that_selects_all_columns(run, tmp_path: Path) -> None:
    (tmp_path / "all.rq").write_text("# all\nSELECT * WHERE { skiros:Scene-0 skiros:contain ?x }")
    assert run("query", "-f", str(tmp_path / "all.rq")).out.split() == ["x", "------------------", "skiros:LargeBox-80"]
    assert run("query", "ASK {}", "--json").json == [[True]]
    assert run("query", "SELECT ?x { ?x a skiros:Robot7 }").out == "no rows\n"


def test_refused_query_prints_one_line(run) -> None:
    refused = run("query", "SELECT ?x WHERE {\n nothing }")
    assert (refused.status, refused.out, refused.err.count("\n")) == (1, "", 1)
    assert run("query", "-f", "/no/such.rq").err == "query: /no/such.rq: cannot be read: No such file or directory\n"


def test_save_and_load(run, workspace: Path) -> None:
    assert run("save", "now.turtle") == (0, "saved context scene to now.turtle\n", "")
    run("set", "skiros:Part-90", "label", "changed")
    assert run("load", "now.turtle") == (0, "loaded now.turtle into context scene\n", "")
    assert run("get", "skiros:Part-90", "label").out == "stray\n"
    assert run("load", "now.turtle", "--context", "copy").status == 0
    assert run("get", "skiros:Part-90", "--context", "copy").status == 0
    refused = run("save", "../out.turtle")
    assert refused.status == 1 and "workspace" in refused.err
    assert run("load", "missing.ttl").status == 1


# -- history, diff -------------------------------------------------------------------------------------------------


def test_history_shows_authors_and_changes(run) -> None:
    run("set", "skiros:Part-90", "Weight", "1", "--author", "mary")
    run("set", "skiros:Part-90", "Weight", "2", "--author", "paul")
    out = run("history", "skiros:Part-90").out.splitlines()
    assert out[1::2] == [
        '    + skiros:Part-90 "stray"',
        "    ~ skiros:Part-90 skiros:Weight: (none) -> 1",
        "    ~ skiros:Part-90 skiros:Weight: 1 -> 2",
    ]
    assert [line.split()[2] for line in out[::2]] == ["wm", "mary", "paul"]
    assert run("history", "--author", "mary").out.splitlines()[1:] == out[3:4]
    assert len(run("history", "--limit", "1", "--json").json) == 1
    number = run("history", "--author", "mary", "--json").json[0]["number"]
    assert [e["author"] for e in run("history", "--since", f"#{number}", "--json").json] == ["paul"]
    assert [e["author"] for e in run("history", "--until", str(number), "--json").json] == ["wm", "mary"]
    then = run("history", "skiros:Part-90", "--at", f"#{number}").out
    assert "skiros:Weight  float  1" in then
    assert "skiros:LargeBox-80" in run("history", "--at", f"#{number}").out
    assert run("history", "--since", "0s").out == "no changes\n"
    assert run("history", "skiros:Part-90", "--since", "400d").out.splitlines() == out, "all that the journal has"


def test_history_of_large_requests_is_cut(run, model: WorldModel) -> None:
    run("set", "skiros:Part-90", "Weight", "1")
    for number in range(30):
        run("set", "skiros:Part-90", f"P{number}", "1")
    model.load("lab.ttl", "tester")
    last = run("history", "--limit", "1").out
    assert "~ skiros:Part-90 skiros:P0: 1 -> (none)" in last and "11 more: --all" in last
    assert "11 more" not in run("history", "--limit", "1", "--all").out


def test_history_names_unknown_elements_and_contexts(run) -> None:
    for arguments in (["skiros:Part-7"], ["--since", "#5"], ["--at", "sometime"], ["--at", "1m", "skiros:Part-7"]):
        refused = run("history", *arguments)
        assert (refused.status, refused.out, refused.err.count("\n")) == (1, "", 1), arguments


def test_diff_of_two_files_needs_no_world_model(run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(program, "connect", None)
    old, new = tmp_path / "old.ttl", tmp_path / "new.ttl"
    old.write_text(LAB)
    assert run("diff", str(old), str(old)) == (0, "", "")
    changed = LAB + ":Part-91 a :Part ; :Weight 1 .\n"
    for was, now in {
        '"0.5"^^xsd:float': '"0.75"',
        '"Full"': '"Full", "Open"',
        ":hasA :Part-82": ":at :Part-82",
        '"stray"': '"lost"',
        ":SizeX 0.5": ":SizeX 0.50",
    }.items():
        changed = changed.replace(was, now)
    new.write_text(changed)
    different = run("diff", str(old), str(new))
    assert different.status == 1
    assert different.out.splitlines() == [
        "~ skiros:LargeBox-80 skiros:ContainerState: Full -> Full, Open",
        "~ skiros:Part-90 label: stray -> lost",
        "~ skiros:Starter-81 skiros:Weight: 0.5 -> 0.75",
        "+ skiros:Part-91  Weight=1",
        "- skiros:LargeBox-80 skiros:hasA skiros:Part-82",
        "+ skiros:LargeBox-80 skiros:at skiros:Part-82",
    ]
    assert [e["id"] for e in run("diff", str(new), str(old), "--json").json["before"]] == [
        "skiros:LargeBox-80", "skiros:Part-90", "skiros:Part-91", "skiros:Starter-81",
    ]  # fmt: skip


def test_diff_of_a_file_or_a_time_and_the_scene_as_it_is(run, workspace: Path) -> None:
    file = str(workspace / "lab.ttl")
    start = run("history", "--json").json[-1]["number"]
    assert run("diff", file).status == run("diff", f"@#{start}").status == 0
    run("set", "skiros:Part-90", "Weight", "1")
    for arguments in ([file], [f"@#{start}"], [file, "@0s"], [f"@{start}", "@0s"]):
        assert run("diff", *arguments)[:2] == (1, "~ skiros:Part-90 skiros:Weight: (none) -> 1\n"), arguments
    assert run("diff", file, f"@{start}").status == 0


def test_diff_has_a_status_of_its_own_for_trouble(run, tmp_path: Path) -> None:
    (tmp_path / "bad.ttl").write_text("no turtle")
    for side in (str(tmp_path / "bad.ttl"), str(tmp_path / "missing.ttl"), "@never", "@400d"):
        trouble = run("diff", side)
        assert (trouble.status, trouble.out, trouble.err.count("\n")) == (2, "", 1), side


# -- the command line ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "arguments", [("get",), ("view", "a", "b"), ("query",), ("query", "a", "-f", "b"), ("view", "--odd"), ("save",)]
)
def test_wrong_usage_prints_one_line(run, arguments: tuple[str, ...]) -> None:
    wrong = run(*arguments)
    assert (wrong.status, wrong.out, wrong.err.count("\n")) == (2, "", 1)
    assert wrong.err.startswith(f"{arguments[0]}: ") and f"see {arguments[0]} --help" in wrong.err


@pytest.mark.parametrize("name", sorted(program._COMMANDS))
def test_every_command_has_help(run, name: str) -> None:
    shown = run(name, "--help")
    assert shown.status == 0 and "Exit status" in shown.out
    assert ("--wm NAME" in shown.out) == (name != "validate_scene")


def test_names_that_rosrun_gives_are_no_arguments(run) -> None:
    assert run("get", "skiros:Part-90", "label", "__name:=me", "__log:=/tmp/x").out == "stray\n"


def test_numbers_that_json_has_not_are_texts(run) -> None:
    run("set", "skiros:Part-90", "Weight", "nan")
    assert run("get", "skiros:Part-90", "Weight", "--json").out == '[\n  "nan"\n]\n'


def test_missing_master_is_reported_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_MASTER_URI", "http://localhost:1")
    with pytest.raises(Unavailable, match=r"no ROS master answers at http://localhost:1 .*refused"):
        connect("wm", "tester")
    monkeypatch.setenv("ROS_MASTER_URI", "nonsense")
    with pytest.raises(Unavailable, match="no ROS master answers at nonsense"):
        connect("wm", "tester")


def test_a_missing_world_model_has_a_status_of_its_own(run, monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(name: str, author: str) -> Any:
        raise Unavailable(f"no {name}")

    monkeypatch.setattr(program, "connect", missing)
    assert run("view", "--wm", "cell") == (3, "", "view: no cell\n")


# -- text ----------------------------------------------------------------------------------------------------------


def test_tables_fit_the_screen() -> None:
    rows = [["an identifier", "x" * 40, "y" * 30], ["b", "", "z"]]
    assert table(Screen(), rows)[0] == f"an identifier  {'x' * 40}  {'y' * 30}"
    lines = table(Screen(50), rows)
    assert [len(line) <= 50 for line in lines] == [True, True]
    assert lines[0].startswith("an identifier  xxx") and lines[0].count("..") == 2
    assert max(map(len, table(Screen(30), rows))) <= 30
    assert table(Screen(10), [["abcdefghijklmnop"]]) == ["abcdefgh.."]
    assert table(Screen(), []) == []


def test_wide_letters_and_control_characters_keep_the_columns() -> None:
    assert table(Screen(), [["漢字", "a"], ["\x1b[1m", "b"]]) == ["漢字     a", "\\x1b[1m  b"]
    assert Screen(5).fitted("漢字漢字") == "漢.."


def test_trees_are_drawn_in_ascii_too() -> None:
    root = Branch(["a"], [Branch(["b"], [Branch(["c"])]), Branch(["d"])])
    assert tree(Screen(), [root]) == ["a", "├── b", "│   └── c", "└── d"]
    assert tree(Screen(fancy=False), [root]) == ["a", "|-- b", "|   `-- c", "`-- d"]


def test_points_of_the_history() -> None:
    now = time.mktime((2026, 11, 21, 14, 0, 0, 0, 0, -1))
    assert point("10m", now) == now - 600
    assert point("1.5h", now) == now - 5400
    assert point("13:05", now) == now - 3300
    assert point("13:05:30", now) == now - 3270
    assert point("2026-11-20 14:00", now) == now - 86400
    assert point("2026-11-20T14:00:00", now) == now - 86400
    assert point("1795243845.5", now) == 1795243845.5
    assert point("#1795243845958443", now) == point("1795243845958443", now) == 1795243845958443
    for text in ("", "soon", "25:00", "10y", "-5m", "#", "9" * 30):
        with pytest.raises(WrongValue, match="expected 14:05"):
            point(text, now)


# -- validation ----------------------------------------------------------------------------------------------------


def test_the_scene_is_validated(run):
    told = run("validate")
    assert told.status == 0
    assert told.out.splitlines()[0] == "context scene: 1 warning"
    assert "skiros:Part-90" in told.out and "it is nowhere" in told.out
    run("set", "skiros:LargeBox-80", "SizeX", "--", "-1.0")
    refused = run("validate", "--json")
    assert (refused.status, refused.json["violations"]) == (1, 1)
    assert refused.json["findings"][0] == {
        "severity": "violation",
        "element": "skiros:LargeBox-80",
        "property": "skiros:SizeX",
        "text": "a size is a finite number from 0 on, not -1.0",
    }


def test_scene_files_are_validated_without_a_world_model(run, workspace, tmp_path):
    (workspace / "bad.ttl").write_text(LAB.replace(":SizeX 0.5", ":SizeX -0.5 ; :Code '7' ; :Colour 1"))
    told = run("validate_scene", str(workspace / "lab.ttl"), str(workspace / "bad.ttl"), "--json")
    assert told.status == 1
    assert [report["violations"] for report in told.json] == [0, 1]
    assert "skiros:Code" not in told.out and "skiros:Colour" in told.out  # the ontology beside the file counts
    strict = run("validate_scene", str(workspace / "bad.ttl"), "--strict")
    assert strict.status == 1 and "2 violations" in strict.out
    (tmp_path / "alone").mkdir()
    (tmp_path / "alone" / "bad.ttl").write_text((workspace / "bad.ttl").read_text())
    alone = run("validate_scene", str(tmp_path / "alone" / "bad.ttl"))
    assert "unknown property skiros:Code" in alone.out
    with_workspace = run("validate_scene", str(tmp_path / "alone" / "bad.ttl"), "--workspace", str(workspace))
    assert "skiros:Code" not in with_workspace.out


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [("none.ttl", None, "cannot be read"), ("bad.ttl", "not RDF", "line 1"), ("x.shapes.ttl", "", "holds shapes")],
)
def test_files_that_cannot_be_read_are_named(run, tmp_path, name, text, said):
    if text is not None:
        (tmp_path / name).write_text(text)
    told = run("validate_scene", str(tmp_path / name))
    assert (told.status, told.out, told.err.count("\n")) == (2, "", 1)
    assert name in told.err and said in told.err


# -- completion ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (("view", "skiros:L"), ["skiros:LargeBox-80"]),
        (("get", "skiros:Part"), ["skiros:Part-82"]),
        (("get", "skiros:Part-9"), ["skiros:Part-90"]),  # not in the tree of the scene
        (("get", "skiros:Starter-81", "skiros:W"), ["skiros:Weight"]),
        (("set", "skiros:LargeBox-80", "skiros:c"), ["skiros:contain"]),
        (("get", "skiros:Nobody-1", ""), []),
        (("history", "--a"), ["--at", "--author", "--all"]),
    ],
)
def test_shell_completes_words(run, monkeypatch, arguments, expected) -> None:
    monkeypatch.setenv("_SKIROS2_COMPLETE", "zsh")
    assert run(*arguments).out.splitlines() == expected
