"""The spatial reasoner with arbitrary property values."""

from __future__ import annotations

import tempfile
from pathlib import Path

from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule, run_state_machine_as_test

from skiros2_common.core.discrete_reasoner import reasoners
from skiros2_common.core.errors import SkirosError
from skiros2_common.core.property import Property
from skiros2_common.core.world_element import Element
from skiros2_std_reasoners.aau_spatial_reasoner import AauSpatialReasoner
from skiros2_world_model.core.local_world_model import LocalWorldModel, source_ontologies
from skiros2_world_model.core.reasoner_world_model import ReasonerWorldModel
from skiros2_world_model.core.world_model import WorldModel
from support.fuzz import examples

SCENE = "skiros:Scene-0"
AXES = [f"skiros:{name}{axis}" for name in ("Position", "Orientation", "Size", "Velocity") for axis in "XYZ"]
NUMBERS = [*AXES, "skiros:OrientationW", "skiros:TfTimeStamp"]
FRAMES = [f"skiros:{name}" for name in ("FrameId", "BaseFrameId", "LinkedToFrameId", "PushToFrameId")]
TEXTS = ["", "map", "camera", SCENE, "/", "a b", "日本", "x" * 2000, "\x00"]
CODES = [
    ":Pose",
    ":Position",
    ":Orientation",
    ":OrientationEuler",
    ":Size",
    ":PoseMsg",
    ":PoseStampedMsg",
    ":TransformMsg",
]


class Poses(RuleBasedStateMachine):
    @initialize()
    def begin(self) -> None:
        self.folder = tempfile.TemporaryDirectory()
        model = WorldModel(source_ontologies(), Path(self.folder.name))
        self.wm = LocalWorldModel("tester", model)
        self.reasoner = AauSpatialReasoner()
        reasoners.add(self.reasoner)
        self.reasoner.init(ReasonerWorldModel(model))
        model.add_reasoner(self.reasoner)

    def teardown(self) -> None:
        if hasattr(self, "reasoner"):
            self.reasoner.stop()  # a load has started its thread
            assert self.reasoner.wait_stopped(10.0)
        if hasattr(self, "folder"):
            self.folder.cleanup()

    def attempt(self, call, *arguments):
        try:
            return call(*arguments)
        except SkirosError as error:
            assert "failed to" not in str(error), error
            return None

    def draw(self, data: st.DataObject, element: Element) -> Element:
        floats = st.floats(width=32) | st.sampled_from([0.0, 1.0])
        for key in data.draw(st.lists(st.sampled_from(NUMBERS), unique=True)):
            element.put(key, Property(key, data.draw(floats)))
        for key in data.draw(st.lists(st.sampled_from(FRAMES), unique=True, max_size=2)):
            element.put(key, Property(key, data.draw(st.sampled_from(TEXTS))))
        element.setProperty("skiros:PublishTf", data.draw(st.booleans()))
        if data.draw(st.integers(0, 3)):
            element.setReasoner("AauSpatialReasoner")
        return element

    def ids(self) -> list[str]:
        return sorted(e.id for e in self.wm.resolve_elements(Element("")))

    @rule(data=st.data())
    def add(self, data: st.DataObject) -> None:
        element = self.draw(data, Element("skiros:Product"))
        element.addRelation(data.draw(st.sampled_from(self.ids())), "skiros:contain", "-1")
        self.attempt(self.wm.add_element, element)

    @rule(data=st.data())
    def update(self, data: st.DataObject) -> None:
        element = self.draw(data, self.wm.get_element(data.draw(st.sampled_from(self.ids()))))
        for key in data.draw(st.lists(st.sampled_from([*NUMBERS, *FRAMES, "skiros:DiscreteReasoner"]), max_size=3)):
            element.removeProperty(key)
        self.attempt(self.wm.update_element, element)

    @rule(data=st.data())
    def move(self, data: st.DataObject) -> None:
        element = self.wm.get_element(data.draw(st.sampled_from(self.ids())))
        element.setRelation(data.draw(st.sampled_from(self.ids())), "skiros:contain", "-1")
        self.attempt(self.wm.update_element, element)

    @rule(data=st.data())
    def remove(self, data: st.DataObject) -> None:
        self.attempt(self.wm.remove_element, self.wm.get_element(data.draw(st.sampled_from(self.ids()))))

    @rule(data=st.data())
    def ask(self, data: st.DataObject) -> None:
        """Data and relations of elements whose poses are nonsense are None, or none."""
        one, other = (self.wm.get_element(data.draw(st.sampled_from(self.ids()))) for _ in range(2))
        for code in CODES:
            one.hasData(code)
            self.attempt(one.getData, code)
        for with_metrics in (False, True):
            self.attempt(self.reasoner.computeRelations, one, other, with_metrics)
        self.attempt(self.wm.get_relations, one, ":pX", other)

    @rule()
    def save_and_load(self) -> None:
        before = self.ids()
        self.wm.save("saved.ttl")
        self.wm.load("saved.ttl")
        assert self.ids() == before

    @invariant()
    def its_elements_have_frames(self) -> None:
        if hasattr(self, "wm"):
            for element in self.wm.resolve_elements(Element("skiros:Product")):
                if element.hasProperty("skiros:DiscreteReasoner", "AauSpatialReasoner"):
                    assert element.value_of("skiros:FrameId")


def test_arbitrary_poses_are_stored_or_rejected() -> None:
    run_state_machine_as_test(Poses, settings=settings(max_examples=examples(60), stateful_step_count=20))


def test_time_out_of_message_range_is_zero() -> None:
    element = Element("skiros:Product")
    element.setProperty("skiros:DiscreteReasoner", "AauSpatialReasoner")
    reasoner = AauSpatialReasoner()
    reasoner.setData(element, ([0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]), ":Pose")
    for stamp in (float("inf"), float("nan"), 2.0**32, -1.0):
        element.setProperty("skiros:TfTimeStamp", stamp)
        assert reasoner.getData(element, ":PoseStampedMsg").header.stamp.to_sec() == 0.0
