"""The standard skills: their descriptions, implementations and parameters, which skill libraries and plans name."""

import pytest

from skiros2_common.core.params import ParamTypes
from skiros2_common.core.world_element import Element
from skiros2_skill.core.library.library import SkillLibrary
from skiros2_world_model.core.local_world_model import LocalWorldModel

R, O, I = ParamTypes.Required, ParamTypes.Optional, ParamTypes.Inferred  # noqa: E741 - as short as the table
OBJECT = "sumo:Object"

MOVE = {
    "StartLocation": (OBJECT, I),
    "TargetLocation": (OBJECT, O),
    "Object": (OBJECT, R),
    "Relation": ("skiros:contain", R),
}

#: implementation: type, parameters with their default or type, and kind
SKILLS = {
    "wait": ("skiros:Wait", {"Duration": (0.0, R)}),
    "wm_set_relation": (
        "skiros:WmSetRelation",
        {
            "Src": (OBJECT, R),
            "Dst": (OBJECT, R),
            "Relation": (str, R),
            "RelationState": (True, R),
            "OldDstToRemove": (OBJECT, O),
            "OldSrcToRemove": (OBJECT, O),
        },
    ),
    "wm_set_properties": ("skiros:WmSetProperties", {"Src": (OBJECT, R), "Properties": (dict, R)}),
    "wm_move_object": ("skiros:WmMoveObject", MOVE),
    "wm_move_and_transform_object": ("skiros:WmMoveObject", MOVE),
    "counter": ("skiros:Counter", {"CountTarget": (int, R)}),
    "task_plan": ("skiros:TaskPlan", {"Goal": (str, R)}),
}


@pytest.fixture(scope="module")
def library():
    library = SkillLibrary(LocalWorldModel("test"))
    library.import_libraries(["skiros2_std_skills"])
    library.load(SKILLS)
    return library


@pytest.mark.parametrize("label", SKILLS)
def test_standard_skill_has_its_type_and_parameters(library, label):
    stype, expected = SKILLS[label]
    declared = library.by_label(label).declared
    assert declared.type == stype
    params = {key: param for key, param in declared.params.items() if key != "Robot"}
    assert list(params) == list(expected)
    for key, (default, kind) in expected.items():
        param = params[key]
        assert param.paramType is kind, key
        if param.is_element:
            assert isinstance(param.default, Element) and param.element_type == default, key
        elif isinstance(default, type):
            assert (param.dataType(), param.values) == (default, []), key
        else:
            assert (param.default, type(param.default)) == (default, type(default)), key


def test_moved_object_starts_at_its_location(library):
    (condition,) = library.by_label("wm_move_object").declared.pre_conditions
    assert condition.relation == "skiros:spatiallyRelated"
    assert condition.getKeys() == ["StartLocation", "Object"]


def test_type_without_label_selects_both_implementations(library):
    assert [i.label for i in library.candidates("WmMoveObject", "")] == [
        "wm_move_object",
        "wm_move_and_transform_object",
    ]
