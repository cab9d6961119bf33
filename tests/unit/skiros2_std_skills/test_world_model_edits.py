"""The skills that edit the world model."""

from __future__ import annotations

from typing import Any

import pytest

from skiros2_common.core.abstract_skill import State
from skiros2_common.core.world_element import Element
from skiros2_skill.testing import SkillBench
from skiros2_std_skills import utility_primitives


@pytest.fixture
def bench(skill_bench: SkillBench) -> SkillBench:
    """A robot, three trays and a product in the first."""
    trays = [skill_bench.add("skiros:Container", f"tray {i}", ContainerState="Empty") for i in (1, 2, 3)]
    skill_bench.add("skiros:Product", "product", trays[0], Weight=0.3)
    return skill_bench.import_libraries("skiros2_std_skills")


def run(bench: SkillBench, skill: str, **params: Any) -> Any:
    """The node of a skill that has run."""
    return bench.command(skill, **params).run().skill


def at(bench: SkillBench, label: str) -> set[str]:
    """The labels of the places that an element is at."""
    return set(bench.related(label, "skiros:at"))


class TestWmSetRelation:
    def set(self, bench: SkillBench, target: str, state: bool = True, **old: str) -> Any:
        elements = {key: bench.element(label) for key, label in old.items()}
        source = bench.element("skiros:robot")
        return run(
            bench,
            "WmSetRelation",
            Src=source,
            Dst=bench.element(target),
            Relation="skiros:at",
            RelationState=state,
            **elements,
        )

    def test_a_relation_is_added_beside_others(self, bench: SkillBench) -> None:
        for tray in ("tray 1", "tray 2"):
            assert self.set(bench, tray).state is State.Success
        assert at(bench, "skiros:robot") == {"tray 1", "tray 2"}

    def test_a_relation_is_removed(self, bench: SkillBench) -> None:
        self.set(bench, "tray 1")
        assert self.set(bench, "tray 1", state=False).state is State.Success
        assert at(bench, "skiros:robot") == set()

    def test_the_relation_to_an_old_object_goes_in_the_same_change(self, bench: SkillBench) -> None:
        self.set(bench, "tray 1")
        changes: list[Any] = []
        bench.wmi.add_listener(changes.append)
        assert self.set(bench, "tray 2", OldDstToRemove="tray 1").state is State.Success
        assert at(bench, "skiros:robot") == {"tray 2"}
        assert len(changes) == 1

    def test_the_relation_from_an_old_subject_goes_in_the_same_change(self, bench: SkillBench) -> None:
        old = bench.add("cora:Robot", "old robot")
        bench.wmi.set_relation(old.id, "skiros:at", bench.element("tray 1").id)
        changes: list[Any] = []
        bench.wmi.add_listener(changes.append)
        assert self.set(bench, "tray 1", OldSrcToRemove="old robot").state is State.Success
        assert (at(bench, "old robot"), at(bench, "skiros:robot")) == (set(), {"tray 1"})
        assert len(changes) == 1

    def test_an_old_object_that_is_the_new_one_keeps_the_relation(self, bench: SkillBench) -> None:
        assert self.set(bench, "tray 1", OldDstToRemove="tray 1").state is State.Success
        assert at(bench, "skiros:robot") == {"tray 1"}

    def test_rejected_change_fails_with_reason(self, bench: SkillBench) -> None:
        robot = bench.element("skiros:robot")
        product, tray = bench.element("product"), bench.element("tray 1")
        node = run(bench, "WmSetRelation", Src=product, Dst=tray, Relation="skiros:contain")
        assert node.state is State.Failure
        assert "tray 1" in node.progress_msg or tray.id in node.progress_msg
        assert bench.holder("product") == "tray 1"
        assert bench.wmi.get_element(robot.id)


class TestWmSetProperties:
    def test_all_properties_are_set_in_one_change(self, bench: SkillBench) -> None:
        changes: list[Any] = []
        bench.wmi.add_listener(changes.append)
        wanted = {"skiros:Weight": 0.5, "StateProperty": "Idle"}
        assert run(bench, "WmSetProperties", Src=bench.element("product"), Properties=wanted).state is State.Success
        product = bench.element("product")
        assert product.value_of("skiros:Weight") == 0.5
        assert product.value_of("skiros:StateProperty") == "Idle"
        assert len(changes) == 1

    def test_several_values_are_given_as_a_list(self, bench: SkillBench) -> None:
        run(bench, "WmSetProperties", Src=bench.element("product"), Properties={"CadModel": ["a", "b"]})
        assert bench.element("product").getProperty("CadModel").values == ["a", "b"]

    def test_value_of_wrong_type_fails_without_change(self, bench: SkillBench) -> None:
        wanted = {"StateProperty": "Idle", "skiros:Weight": "heavy"}
        node = run(bench, "WmSetProperties", Src=bench.element("product"), Properties=wanted)
        assert node.state is State.Failure
        assert "skiros:Weight takes values of type float, got 'heavy'" in node.progress_msg
        assert not bench.element("product").hasProperty("skiros:StateProperty")

    def test_set_properties_keeps_relations(self, bench: SkillBench) -> None:
        run(bench, "WmSetProperties", Src=bench.element("product"), Properties={"skiros:Weight": 0.5})
        assert bench.holder("product") == "tray 1"


class TestWmMoveObject:
    @pytest.fixture(autouse=True)
    def load(self, bench: SkillBench) -> None:
        bench.library.load(["wm_move_object"])

    def test_move_object_changes_the_container(self, bench: SkillBench) -> None:
        node = run(bench, "WmMoveObject", Object=bench.element("product"), TargetLocation=bench.element("tray 2"))
        assert node.state is State.Success
        assert bench.holder("product") == "tray 2"

    def test_move_object_updates_container_states(self, bench: SkillBench) -> None:
        run(bench, "WmMoveObject", Object=bench.element("product"), TargetLocation=bench.element("tray 2"))
        states = [bench.element(f"tray {i}").value_of("skiros:ContainerState") for i in (1, 2, 3)]
        assert states == ["Empty", "Full", "Empty"]

    def test_move_object_without_target_returns_to_the_start(self, bench: SkillBench) -> None:
        node = run(bench, "WmMoveObject", Object=bench.element("product"))
        assert node.state is State.Success
        assert bench.holder("product") == "tray 1"
        assert bench.element("tray 1").value_of("skiros:ContainerState") == "Full"

    def test_move_object_may_change_the_relation(self, bench: SkillBench) -> None:
        run(
            bench,
            "WmMoveObject",
            Object=bench.element("product"),
            TargetLocation=bench.element("tray 2"),
            Relation="skiros:hasA",
        )
        product = bench.element("product")
        assert [r["type"] for r in product.getRelations("", [], "-1")] == ["skiros:hasA"]
        assert bench.holder("product") == "tray 2"

    def test_move_object_infers_and_clears_the_start(self, bench: SkillBench) -> None:
        task = bench.commands(
            ("WmMoveObject", "", {"Object": bench.element("product"), "TargetLocation": bench.element("tray 2")}),
            ("WmMoveObject", "", {"Object": bench.element("product"), "TargetLocation": bench.element("tray 3")}),
        ).run()
        assert task.state is State.Success
        assert bench.holder("product") == "tray 3"
        assert not task.root.children[0].params["StartLocation"].isSpecified()

    def test_move_object_from_wrong_start_fails_without_change(self, bench: SkillBench) -> None:
        node = run(
            bench,
            "WmMoveObject",
            Object=bench.element("product"),
            StartLocation=bench.element("tray 3"),
            TargetLocation=bench.element("tray 2"),
        )
        assert node.state is State.Failure
        assert "ObjectAtStart" in node.progress_msg
        assert bench.holder("product") == "tray 1"


class FakeReasoner:
    """Stands in for the spatial reasoner: moves an element by a metre in each transform that it knows."""

    def __init__(self, *frames: str) -> None:
        self.frames = frames

    def transform(self, element: Element, frame: str) -> bool:
        if frame not in self.frames:
            return False
        element.setProperty("skiros:PositionX", 1.0)
        element.setProperty("skiros:BaseFrameId", frame)
        return True


class TestWmMoveAndTransformObject:
    def move(self, bench: SkillBench, target: str = "") -> Any:
        bench.library.load(["wm_move_and_transform_object"])
        params = {"Object": bench.element("product")}
        if target:
            params["TargetLocation"] = bench.element(target)
        return run(bench, "WmMoveObject", **params)

    def test_the_pose_is_written_in_the_frame_of_the_target(
        self, bench: SkillBench, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        frame = bench.element("tray 2").id
        monkeypatch.setattr(Element, "_getReasoner", lambda self, code: FakeReasoner(frame))
        assert self.move(bench, "tray 2").state is State.Success
        product = bench.element("product")
        assert bench.holder("product") == "tray 2"
        assert (product.value_of("skiros:PositionX"), product.value_of("skiros:BaseFrameId")) == (1.0, frame)

    def test_pose_without_target_is_in_the_frame_of_the_start(
        self, bench: SkillBench, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        frame = bench.element("tray 1").id
        monkeypatch.setattr(Element, "_getReasoner", lambda self, code: FakeReasoner(frame))
        assert self.move(bench).state is State.Success
        assert bench.element("product").value_of("skiros:BaseFrameId") == frame

    def test_missing_transform_fails_without_change(self, bench: SkillBench, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(Element, "_getReasoner", lambda self, code: FakeReasoner())
        node = self.move(bench, "tray 2")
        assert node.state is State.Failure
        assert "no transform to frame" in node.progress_msg
        assert bench.holder("product") == "tray 1"


def test_skill_descriptions_match_the_contract() -> None:
    expected = {
        "Wait": {"Duration": (float, 0.0, "Required")},
        "Counter": {"CountTarget": (int, None, "Required")},
        "WmSetProperties": {"Src": ("sumo:Object", None, "Required"), "Properties": (dict, None, "Required")},
        "WmSetRelation": {
            "Src": ("sumo:Object", None, "Required"),
            "Dst": ("sumo:Object", None, "Required"),
            "Relation": (str, None, "Required"),
            "RelationState": (bool, True, "Required"),
            "OldDstToRemove": ("sumo:Object", None, "Optional"),
            "OldSrcToRemove": ("sumo:Object", None, "Optional"),
        },
        "WmMoveObject": {
            "StartLocation": ("sumo:Object", None, "Inferred"),
            "TargetLocation": ("sumo:Object", None, "Optional"),
            "Object": ("sumo:Object", None, "Required"),
            "Relation": (str, "skiros:contain", "Required"),
        },
    }
    for name, params in expected.items():
        description = getattr(utility_primitives, name)()
        found = {
            key: (
                param.element_type if param.is_element else param.dataType(),
                None if param.is_element else param.default,
                param.paramType.name,
            )
            for key, param in description.params.items()
        }
        assert found.pop("Robot") == ("sumo:Agent", None, "Inferred")
        assert found == params
