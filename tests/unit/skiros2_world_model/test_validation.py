"""Validation of scenes: everything that loading would refuse or warn of, and the findings of the shapes."""

import logging

import pytest

from skiros2_common.core.errors import ConfigurationError, WrongValue
from skiros2_common.core.limits import Limits
from skiros2_common.core.params import Param, ParamTypes
from skiros2_common.core.world_element import Element
from skiros2_world_model.core.knowledge_base import KnowledgeBase
from skiros2_world_model.core.local_world_model import LocalWorldModel, source_ontologies
from skiros2_world_model.core.report import INFO, VIOLATION, WARNING, Finding, Report
from skiros2_world_model.core.validation import validate_file
from skiros2_world_model.core.world_model import WorldModel
from support.ros import ROOT

HEAD = """@prefix skiros: <http://rvmi.aau.dk/ontologies/skiros.owl#> .
@prefix cora: <http://www.inf.ufrgs.br/phi-group/ontologies/cora.owl#> .
@prefix rdfs: <http://www.w3.org/2000/01/rdf-schema#> .
@prefix sh: <http://www.w3.org/ns/shacl#> .
@prefix xsd: <http://www.w3.org/2001/XMLSchema#> .
"""
POSE = """skiros:PositionX 0.0 ; skiros:PositionY 0.0 ; skiros:PositionZ 0.0 ;
    skiros:OrientationX 0.0 ; skiros:OrientationY 0.0 ; skiros:OrientationZ 0.0 ; skiros:OrientationW 1.0"""
BOX = f"skiros:Scene-0 a skiros:Scene ; skiros:contain skiros:LargeBox-1 . skiros:LargeBox-1 a skiros:LargeBox ; {POSE}"
COLOUR = "unknown property skiros:colour; did you mean skiros:MeanColour?"
#: A shape of a user: a box needs a weight.
WEIGHED = """<urn:Weighed> a sh:PropertyShape ; sh:targetClass skiros:Container ;
    sh:path skiros:Weight ; sh:minCount 1 ; sh:message "a box is weighed" ."""


@pytest.fixture
def validate(workspace):
    """Validates a scene of that text, in a workspace with the shapes that `shapes` writes."""

    def validate(text, strict=False):
        path = workspace / "scene.ttl"
        path.write_text(HEAD + text)
        return validate_file(path, KnowledgeBase(source_ontologies(), workspace), strict=strict)

    return validate


@pytest.fixture
def shapes(workspace):
    def shapes(text, name="cell.shapes.ttl"):
        (workspace / name).write_text(HEAD + text)

    return shapes


def told(report):
    return {(f.severity, f.element, f.property, f.text) for f in report.findings}


# -- what is in order ---------------------------------------------------------------------------------------------


def test_a_scene_in_order_has_no_findings(validate):
    assert validate(BOX + " .").findings == []


def test_the_scene_of_the_demo_is_in_order():
    folder = ROOT / "skiros2_std_lib/demos/timed_skills/owl"
    report = validate_file(folder / "pick_place_scene.ttl", KnowledgeBase(source_ontologies(), folder))
    assert report.summary == "nothing found"


def test_elements_of_skill_managers_are_valid(tmp_path):
    wm = LocalWorldModel("test", WorldModel(source_ontologies(), tmp_path))
    parameter = Element("skiros:Parameter", "Robot")
    parameter.setProperty("skiros:ParameterType", 2)
    parameter.setProperty("skiros:DataType", "cora:Robot")
    speed = Param("Speed", "How fast", 0.5, ParamTypes.Optional, Limits("m/s", 0.1, 2.0, (0.5, 1.0)))
    skill = Element("skiros:Skill", "drive")
    skill.addRelation("-1", "skiros:hasParam", parameter)
    skill.addRelation("-1", "skiros:hasParam", speed.toElement())
    skill.addRelation("skiros:Scene-0", "skiros:sceneProperty", "-1")
    wm.add_element(skill)
    assert wm.validate().findings == []


# -- the checks of loading ----------------------------------------------------------------------------------------


def test_all_flaws_that_loading_refuses_are_reported(validate):
    report = validate(
        BOX
        + """ ; skiros:contain skiros:Nothing-7 .
        skiros:LargeBox-2 a skiros:LargeBox ; skiros:PositionX "far" ; skiros:contain skiros:LargeBox-2 ."""
    )
    assert told(report) >= {
        (VIOLATION, "skiros:LargeBox-1", "skiros:contain", "there is no element 'skiros:Nothing-7'"),
        (VIOLATION, "skiros:LargeBox-2", "skiros:PositionX", "expected xsd:float, got str 'far'"),
        (VIOLATION, "skiros:LargeBox-2", "",
         "elements that contain themselves: skiros:LargeBox-2 in skiros:LargeBox-2"),
    }  # fmt: skip
    assert report.count(VIOLATION) == 3


def test_too_many_values_are_reported(validate):
    report = validate(BOX + ' ; skiros:FrameId "a", "b" .')
    assert any(f.severity == VIOLATION and f.property == "skiros:FrameId" and "allowed are 1" in f.text
               for f in report.findings)  # fmt: skip


@pytest.mark.parametrize(("strict", "severity"), [(False, WARNING), (True, VIOLATION)])
def test_unknown_names_are_warnings_or_when_strict_violations(validate, strict, severity):
    report = validate(
        BOX
        + """ ; skiros:colour "red" ; skiros:feeds skiros:Pump-3 .
        skiros:Pump-3 a skiros:Pump . skiros:Pump-4 a skiros:Pump .""",
        strict,
    )
    assert told(report) == {
        (severity, "skiros:LargeBox-1", "skiros:colour", COLOUR),
        (severity, "skiros:LargeBox-1", "skiros:feeds", "unknown relation skiros:feeds"),
        (severity, "skiros:Pump-3", "", "unknown class skiros:Pump (1 more have it)"),
    }


def test_an_element_is_in_one_place(validate):
    report = validate(
        BOX
        + """ ; skiros:hasA skiros:LargeBox-2 . skiros:Scene-0 skiros:contain skiros:LargeBox-2 .
        skiros:LargeBox-2 a skiros:LargeBox . skiros:LargeBox-3 a skiros:LargeBox ."""
    )
    assert told(report) == {
        (WARNING, "skiros:LargeBox-2", "", "it is in several places: skiros:LargeBox-1, skiros:Scene-0"),
        (WARNING, "skiros:LargeBox-3", "", "it is nowhere: no element contains it or has it"),
    }


@pytest.mark.parametrize(
    ("shelf", "cup", "told_of"),
    [
        ("skiros:PublishTf true", f"skiros:PublishTf true ; {POSE}", ["skiros:LargeBox-3"]),
        ("skiros:PublishTf false", POSE, ["skiros:LargeBox-3"]),
        ("skiros:PublishTf false", f'skiros:BaseFrameId "skiros:LargeBox-2" ; {POSE}', ["skiros:LargeBox-3"]),
        ("skiros:PublishTf true", f'skiros:BaseFrameId "camera" ; {POSE}', []),
        ("skiros:PublishTf true", f"skiros:PublishTf false ; {POSE}", []),
        ("skiros:PublishTf true", "skiros:PublishTf true", []),
        (f"skiros:PublishTf false ; {POSE}", POSE, []),
        ('skiros:FrameId "base_link"', POSE, []),
        ('skiros:LinkedToFrameId "gripper"', POSE, []),
    ],
)
def test_a_published_frame_in_one_that_nobody_publishes_is_reported(validate, shelf, cup, told_of):
    named = 'a skiros:LargeBox ; skiros:DiscreteReasoner "AauSpatialReasoner"'
    report = validate(
        f"""skiros:Scene-0 a skiros:Scene ; skiros:contain skiros:LargeBox-2 .
        skiros:LargeBox-2 {named} ; {shelf} ; skiros:contain skiros:LargeBox-3 .
        skiros:LargeBox-3 {named} ; {cup} ."""
    )
    found = [f for f in report.findings if f.property == "skiros:PublishTf"]
    assert [f.element for f in found] == told_of
    assert all("skiros:LargeBox-2" in f.text and f.severity == WARNING for f in found)


def test_a_frame_in_a_hidden_one_in_one_that_nobody_publishes_is_reported(validate):
    named = 'a skiros:LargeBox ; skiros:DiscreteReasoner "AauSpatialReasoner"'
    report = validate(
        f"""skiros:Scene-0 a skiros:Scene ; skiros:contain skiros:LargeBox-2 .
        skiros:LargeBox-2 {named} ; skiros:contain skiros:LargeBox-3 .
        skiros:LargeBox-3 {named} ; skiros:PublishTf false ; {POSE} ; skiros:contain skiros:LargeBox-4 .
        skiros:LargeBox-4 {named} ; {POSE} ."""
    )
    assert [f.element for f in report.findings if f.property == "skiros:PublishTf"] == ["skiros:LargeBox-4"]


# -- the shapes of the package ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("changed", "severity", "properties", "text"),
    [
        ('skiros:PositionY ""', WARNING, {"skiros:PositionY"}, "a position has finite"),
        ('skiros:PositionY "NaN"^^xsd:float', WARNING, {"skiros:PositionY"}, "a position has finite"),
        ('skiros:OrientationX ""', WARNING, {"skiros:OrientationX"}, "an orientation is a quaternion"),
        ("skiros:OrientationX 7.0", WARNING, {"skiros:OrientationX"}, "an orientation is a quaternion"),
        ("skiros:OrientationW 0.0", VIOLATION, {""}, "is not a rotation"),
        ('skiros:SizeX "-1"', VIOLATION, {"skiros:SizeX"}, "from 0 on"),
        ("skiros:SizeZ -0.5", VIOLATION, {"skiros:SizeZ"}, "from 0 on"),
        ('skiros:SizeZ "wide"', VIOLATION, {"skiros:SizeZ"}, "from 0 on"),
        ("skiros:Weight -1.0", VIOLATION, {"skiros:Weight"}, "from 0 on"),
        ("skiros:PublishTf true, false", WARNING, {"skiros:PublishTf"}, "published on tf or not"),
    ],
)
def test_poses_sizes_and_weights(validate, changed, severity, properties, text):
    name = changed.partition(" ")[0]
    kept = [p.strip() for p in POSE.split(";") if not p.strip().startswith(f"{name} ")]
    box = BOX.replace(POSE, " ; ".join([*kept, changed]))
    report = validate(box + " .")
    assert {f.property for f in report.findings} == properties
    assert {(f.severity, f.element) for f in report.findings} == {(severity, "skiros:LargeBox-1")}
    assert all(text in f.text for f in report.findings)


@pytest.mark.parametrize(
    "fine", ['skiros:SizeX "0.5"', 'skiros:SizeX ""', "skiros:SizeX 0", 'skiros:PublishTf "True"', 'skiros:Weight "2"']
)
def test_numbers_and_bools_as_texts_are_in_order(validate, fine):
    assert validate(f"{BOX} ; {fine} .").findings == []


def test_a_position_with_x_alone_is_a_warning_for_the_others(validate):
    report = validate(BOX.replace(POSE, "skiros:PositionX 1.0 ."))
    assert {(f.severity, f.property) for f in report.findings} == {
        (WARNING, "skiros:PositionY"), (WARNING, "skiros:PositionZ")
    }  # fmt: skip


def test_a_robot_has_a_start_location(validate):
    scene = "skiros:Scene-0 a skiros:Scene ; skiros:contain cora:Robot-1 . cora:Robot-1 a cora:Robot"
    assert {f.property for f in validate(f"{scene} .").findings} == {"skiros:hasStartLocation"}
    assert validate(f"{scene} ; skiros:hasStartLocation skiros:unknown_location .").findings == []
    wrong = validate(f"{scene} ; skiros:hasStartLocation skiros:Parameter-5 . skiros:Parameter-5 a skiros:Parameter ;"
                     ' rdfs:label "x" ; skiros:ParameterType 1 ; skiros:DataType "str" .')  # fmt: skip
    assert [(f.element, f.property) for f in wrong.findings] == [("cora:Robot-1", "skiros:hasStartLocation")]
    assert "not skiros:Parameter-5" in wrong.findings[0].text


def test_parameters_and_conditions_of_skills_are_well_formed(validate):
    report = validate("""skiros:Skill-1 a skiros:Skill ;
        skiros:hasParam skiros:Parameter-2 ; skiros:hasPreCondition skiros:ConditionHasProperty-3 .
        skiros:Parameter-2 a skiros:Parameter ; skiros:ParameterType "7" ;
            skiros:LowerBound 2.0 ; skiros:UpperBound 1.0 .
        skiros:ConditionHasProperty-3 a skiros:ConditionHasProperty .""")
    assert {(f.element, f.property) for f in report.findings if "unknown" not in f.text} == {
        ("skiros:Parameter-2", "rdfs:label"), ("skiros:Parameter-2", "skiros:ParameterType"),
        ("skiros:Parameter-2", "skiros:LowerBound"), ("skiros:ConditionHasProperty-3", "skiros:desiredState"),
    }  # fmt: skip


# -- the shapes of users ------------------------------------------------------------------------------------------


def test_shapes_in_the_workspace_and_below_count_too_and_see_the_classes_above(validate, shapes, workspace):
    (workspace / "shapes").mkdir()
    shapes(WEIGHED, "shapes/cell.owl.shapes.ttl")  # not taken for an ontology, either
    report = validate(BOX + " .")
    assert told(report) == {(VIOLATION, "skiros:LargeBox-1", "skiros:Weight", "a box is weighed")}


def test_findings_have_severity_and_value(validate, shapes):
    shapes("""<urn:S> a sh:PropertyShape ; sh:targetClass skiros:LargeBox ; sh:path rdfs:label ;
        sh:pattern "^box" ; sh:severity sh:Info ; sh:message "call it box" .""")
    assert told(validate(BOX + ' ; rdfs:label "tray" .')) == {
        (INFO, "skiros:LargeBox-1", "rdfs:label", "call it box, not tray")
    }


def test_findings_outside_the_scene_are_ignored(validate, shapes):
    shapes("""<urn:S> a sh:PropertyShape ; sh:targetClass cora:Robot ; sh:path skiros:Weight ; sh:minCount 1 .""")
    assert validate(BOX + " .").findings == []  # the templates of the ontologies include a robot


def test_shapes_may_use_sparql(validate, shapes):
    shapes("""<urn:S> a sh:NodeShape ; sh:targetClass skiros:LargeBox ; sh:sparql [ sh:message "it holds itself up" ;
        sh:select "SELECT $this WHERE { $this <http://rvmi.aau.dk/ontologies/skiros.owl#Weight> ?w . FILTER(?w > 9) }"
        ] .""")
    assert told(validate(BOX + " ; skiros:Weight 12.0 .")) == {
        (VIOLATION, "skiros:LargeBox-1", "", "it holds itself up")
    }


def test_shapes_that_do_not_parse_are_named_with_their_line(shapes, workspace):
    shapes("<urn:S> a sh:NodeShape ;\n  sh:path ; .")
    with pytest.raises(ConfigurationError, match=r"shapes .*cell\.shapes\.ttl, line 7"):
        KnowledgeBase(source_ontologies(), workspace)


def test_shapes_that_make_no_sense_are_named(validate, shapes):
    shapes("<urn:S> a sh:PropertyShape ; sh:targetClass skiros:LargeBox ; sh:minCount 1 .")
    with pytest.raises(WrongValue, match=r"cell\.shapes\.ttl"):
        validate(BOX + " .")


def test_a_file_of_shapes_is_no_scene(wm, workspace, shapes):
    shapes(WEIGHED)
    with pytest.raises(Exception, match=r"cell\.shapes\.ttl: expected a scene"):
        wm.load("cell.shapes.ttl")
    with pytest.raises(WrongValue, match="expected a scene"):
        validate_file(workspace / "cell.shapes.ttl", wm.model.knowledge_base)


# -- world models -------------------------------------------------------------------------------------------------


def test_a_strict_world_model_refuses_violations_and_keeps_its_scene(workspace, shapes):
    shapes(WEIGHED)
    model = WorldModel(source_ontologies(), workspace, strict=True)
    before = len(model.scene()), model.number
    (workspace / "scene.ttl").write_text(HEAD + BOX + " .")
    with pytest.raises(WrongValue, match=r"scene\.ttl.*skiros:LargeBox-1 skiros:Weight: a box is weighed"):
        model.load("scene.ttl", "test")
    assert (len(model.scene()), model.number) == before


def test_strict_world_model_loads_a_scene_with_warnings_only(workspace):
    (workspace / "scene.ttl").write_text(HEAD + BOX.replace(POSE, "skiros:PositionX 1.0 ."))
    model = WorldModel(source_ontologies(), workspace, strict=True)
    model.load("scene.ttl", "test")
    assert "skiros:LargeBox-1" in model.scene()


def test_current_scene_is_validated(wm, caplog):
    box = Element("skiros:LargeBox", "tray")
    box.setProperty("skiros:SizeX", -2.0)
    with caplog.at_level(logging.WARNING):
        eid = wm.add_element(box).id
        report = wm.validate()
    assert report.origin == "context scene"
    assert (VIOLATION, eid, "skiros:SizeX", "a size is a finite number from 0 on, not -2.0") in told(report)
    assert not caplog.messages


# -- reports ------------------------------------------------------------------------------------------------------


def test_a_report_counts_sorts_and_shortens():
    findings = [Finding(WARNING, "f", f"e{i}", "", "odd") for i in range(3)]
    findings.append(Finding(VIOLATION, "f", "z", "p", "bad"))
    report = Report("f", findings + findings)
    assert report.summary == "1 violation, 3 warnings"
    assert report.lines(2) == ["violation: z p: bad", "warning: e0: odd", "and 2 more"]
    with pytest.raises(WrongValue, match="f: violation: z p: bad"):
        report.refuse_violations()
    Report("f", findings[:3]).refuse_violations()
