"""Parts of the tab "World model": vocabulary, choices, hierarchy, queries."""

from __future__ import annotations

from pathlib import Path

import pytest

from skiros2_common.core.errors import WrongValue
from skiros2_common.core.operations import ADD, RESET, UPDATE, Change
from skiros2_common.core.world_element import Element
from skiros2_gui.app.window import Window
from skiros2_gui.world.choices import CLASS, TEMPLATE, class_choices, element_choices, flat
from skiros2_gui.world.details import display_name
from skiros2_gui.world.queries import WorldQueries
from skiros2_gui.world.scene import TOP, UNPLACED, SceneHierarchy
from skiros2_world_model.core.history import changed_lines
from skiros2_world_model.core.journal import Journal
from skiros2_world_model.core.local_world_model import LocalWorldModel, source_ontologies
from skiros2_world_model.core.scene import ROOT
from skiros2_world_model.core.vocabulary import Vocabulary, read_vocabulary
from skiros2_world_model.core.world_model import WorldModel
from support.window.local_system import LocalSystem
from support.window.synchronous import make_window


@pytest.fixture(scope="module")
def wm() -> LocalWorldModel:
    return LocalWorldModel("window")


@pytest.fixture(scope="module")
def vocabulary(wm: LocalWorldModel) -> Vocabulary:
    return read_vocabulary(wm)


@pytest.mark.parametrize(
    ("key", "unit"),
    [
        ("skiros:PositionX", "m"),
        ("skiros:SizeZ", "m"),
        ("skiros:VelocityY", "m/s"),
        ("skiros:ForceX", "N"),
        ("skiros:Weight", "kg"),
        ("skiros:OrientationX", ""),
        ("skiros:CadModel", ""),
        ("skiros:nobody_knows_it", ""),
    ],
)
def test_units_are_read_from_the_ontologies(vocabulary: Vocabulary, key: str, unit: str) -> None:
    assert vocabulary.unit(key) == unit


@pytest.mark.parametrize(
    ("key", "text", "value"),
    [
        ("skiros:PositionX", " -1.5e-2 ", -0.015),
        ("skiros:PositionX", "3 m", 3.0),
        ("skiros:SizeX", "0.2", 0.2),  # no range is declared, but a unit
        ("skiros:PublishTf", "true", True),
        ("skiros:CadModel", "3 m", "3 m"),
        ("skiros:StateProperty", "", ""),
    ],
)
def test_value_is_parsed_with_the_type_of_the_property(
    vocabulary: Vocabulary, key: str, text: str, value: object
) -> None:
    parsed = vocabulary.parsed("skiros:Part", key, text)
    assert parsed == value and type(parsed) is type(value)


@pytest.mark.parametrize(
    ("key", "text"),
    [
        ("skiros:PositionX", ""),
        ("skiros:PositionX", "1,5"),
        ("skiros:PositionX", "3 mm"),
        ("skiros:PositionX", "inf"),
        ("skiros:OrientationW", "1.1"),
        ("skiros:SizeX", "-1"),
        ("skiros:PublishTf", "perhaps"),
    ],
)
def test_invalid_value_is_refused_with_the_property(vocabulary: Vocabulary, key: str, text: str) -> None:
    with pytest.raises(WrongValue, match=key.partition(":")[2]):
        vocabulary.parsed("skiros:Part", key, text)


def test_domain_and_range_are_inherited(vocabulary: Vocabulary) -> None:
    assert vocabulary.mismatch("rparts:ArmDevice", "cora:robotPart", "cora:Robot") == ""
    wrong = vocabulary.mismatch("skiros:Part", "cora:robotPart", "cora:Robot")
    assert "the subject of cora:robotPart is a sumo:Device" in wrong
    wrong = vocabulary.mismatch("rparts:ArmDevice", "cora:robotPart", "skiros:Part")
    assert "the object of cora:robotPart is a cora:Robot" in wrong
    assert vocabulary.predicate("sumo:located").domain == ("sumo:Physical",)  # of the relation above it


def test_choices_contain_all_classes_and_templates(vocabulary: Vocabulary) -> None:
    choices = class_choices(vocabulary)
    names = {kind: {c.name for c in flat(choices) if c.kind == kind} for kind in (CLASS, TEMPLATE)}
    assert names == {CLASS: set(vocabulary.classes()), TEMPLATE: set(vocabulary.templates())}
    robot = next(c for c in flat(choices) if c.name == "cora:Robot")
    assert [c.name for c in robot.children] == ["skiros:test_robot"]


def test_id_is_shown_only_where_a_label_is_missing_or_not_unique(vocabulary: Vocabulary) -> None:
    labels = ["", "tray", "bolt", "bolt", "arm"]
    elements = [Element("skiros:Part", label, f"skiros:Part-{i}") for i, label in enumerate(labels)]
    elements.append(Element("skiros:Parameter", "arm", "skiros:Parameter-9"))
    hierarchy = SceneHierarchy(elements, vocabulary.spatial)
    names = [display_name(hierarchy, f"skiros:Part-{i}") for i in range(5)]
    assert names == ["Part-0", "tray", "bolt  (Part-2)", "bolt  (Part-3)", "arm"]


def test_elements_of_preferred_class_come_first(vocabulary: Vocabulary) -> None:
    elements = [Element("skiros:Part", "", f"skiros:Part-{i}") for i in (1, 2)]
    elements.append(Element("cora:Robot", "skiros:test_robot", "cora:Robot-3"))
    hierarchy = SceneHierarchy(elements, vocabulary.spatial)
    found = element_choices(hierarchy, vocabulary)
    assert [eid for eid, _ in found][:3] == ["cora:Robot-3", "skiros:Part-1", "skiros:Part-2"]
    assert ("skiros:starter", "starter  (template)") in found[3:]
    found = element_choices(hierarchy, vocabulary, ["skiros:Manipulatable"], without="skiros:Part-2")
    assert [eid for eid, _ in found][:2] == ["skiros:Part-1", "cora:Robot-3"]


# -- a scene that is not as it should be -------------------------------------------------------------------------


def _related(src: str, pred: str, dst: str) -> Element:
    element = Element("skiros:Part", "", src)
    element.addRelation("-1", pred, dst)
    return element


def test_hierarchy_accepts_cycles_and_dangling_relations(vocabulary: Vocabulary) -> None:
    circle = [_related("skiros:Part-1", "skiros:contain", "skiros:Part-2")]
    circle += [_related("skiros:Part-2", "skiros:contain", "skiros:Part-1"), Element("", "", "odd id without number")]
    circle += [_related("skiros:Part-3", "skiros:contain", "skiros:Part-99")]
    hierarchy = SceneHierarchy(circle, vocabulary.spatial)
    assert list(hierarchy.children(TOP)) == [UNPLACED]
    assert list(hierarchy.children(UNPLACED)) == ["odd id without number", "skiros:Part-3"]
    assert not hierarchy.has_children("skiros:Part-3")
    assert hierarchy.path("skiros:Part-1") == ["skiros:Part-2"]
    assert hierarchy.find("PART-1") == ["skiros:Part-1"]


def _change(number: int, action: str, *elements: Element, before: int | None = None) -> Change:
    previous = number - 1 if before is None else before
    return Change(number, f"s-{previous}", f"s-{number}", 0.0, "vision", action, "scene", elements)


def test_gap_or_reset_requires_reading_the_scene(vocabulary: Vocabulary) -> None:
    part = _related("skiros:Part-1", "skiros:at", ROOT)
    hierarchy = SceneHierarchy([Element("skiros:Scene", "", ROOT)], vocabulary.spatial)
    assert hierarchy.follow([_change(5, ADD, part)]) is not None
    assert hierarchy.follow([_change(7, UPDATE, part)]) is None
    assert hierarchy.follow([_change(6, RESET)]) is None


def test_known_changes_are_not_applied_twice(vocabulary: Vocabulary) -> None:
    here = Element.shared("skiros:Part", "new", "skiros:Part-1", {}, (), version=9)
    hierarchy = SceneHierarchy([here], vocabulary.spatial)
    before = Element("skiros:Part", "old", "skiros:Part-1")
    update = hierarchy.follow([_change(8, ADD, before), _change(9, UPDATE, here)])
    assert update is not None and not update.elements
    node = hierarchy.scene.record("skiros:Part-1")
    assert node is not None and node.label == "new"


# -- queries ---------------------------------------------------------------------------------------------------


@pytest.fixture
def queries(tmp_path: Path) -> WorldQueries:
    model = WorldModel(source_ontologies(), tmp_path, journal=Journal(tmp_path / "journal.db"))
    window: Window = make_window(lambda event_queue: LocalSystem(event_queue, LocalWorldModel("window", model)))
    return WorldQueries(window)


def _problem(queries: WorldQueries) -> str:
    newest = queries.window.problems.newest
    return newest.line if newest is not None else ""


def test_query_returns_names_and_values(queries: WorldQueries) -> None:
    queries.ask("SELECT ?x ?n WHERE { ?x a skiros:Scene ; skiros:PositionX ?n }", "scene")
    assert queries.answer is not None
    assert (queries.answer.names, queries.answer.rows) == (("x", "n"), ((ROOT, 0.0),))
    assert queries.queries[0].startswith("SELECT ?x ?n")


@pytest.mark.parametrize(
    ("query", "line", "words"),
    [
        ("SELECT ?x WHERE {\n ?x a\n}", 3, "unexpected token"),
        ("SELECT ?x WHERE { ?x a foo:Bar }", 1, "unknown prefix"),
        ("DROP ALL", 1, ""),
    ],
)
def test_query_error_has_line(queries: WorldQueries, query: str, line: int, words: str) -> None:
    queries.ask(query)
    assert queries.answer is None and queries.diagnostic is not None
    assert queries.diagnostic.line == line and words in queries.diagnostic.text
    assert len(queries.diagnostic.text) < 150


def test_error_without_line_has_its_text(queries: WorldQueries) -> None:
    queries.ask("SELECT ?x { ?x a skiros:Part }", "no context/")
    assert queries.diagnostic is not None and queries.diagnostic.line == 0
    assert "no context/" in queries.diagnostic.text


def test_history_contains_author_and_changes(queries: WorldQueries) -> None:
    world = queries.window.system.world
    assert world is not None
    scene = world.get_element(ROOT)
    scene.label = "Cell 5"
    world.update_element(scene)
    queries.fetch_history(ROOT)
    assert queries.history.entries is not None
    newest = queries.history.entries[0]
    assert newest.author == "window" and changed_lines(newest)[-1].endswith("-> Cell 5")
    queries.fetch_history("skiros:Part-77")
    assert queries.history.entries == () and "skiros:Part-77" in queries.history.text


def test_scene_is_saved_and_loaded(queries: WorldQueries) -> None:
    queries.save("cell.ttl")
    queries.load("cell.ttl")
    assert _problem(queries) == ""
    queries.load("../outside.ttl")
    assert "loading the scene (../outside.ttl): " in _problem(queries)
