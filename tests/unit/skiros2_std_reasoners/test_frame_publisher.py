"""Connection of frames to their nearest ancestor on tf, without a ROS master."""

import math

import pytest
import rospy
from hypothesis import given, settings
from hypothesis import strategies as st
from tf2_msgs.msg import TFMessage

from skiros2_common.core.discrete_reasoner import reasoners
from skiros2_common.core.world_element import Element
from skiros2_motion.core.geometry import IDENTITY, Pose, composed, from_euler
from skiros2_std_reasoners.aau_spatial_reasoner import AauSpatialReasoner
from skiros2_std_reasoners.ros import frame_publisher
from skiros2_std_reasoners.ros.frame_publisher import FramePublisher
from skiros2_std_reasoners.ros.packed_transforms import IncomingMessage
from skiros2_std_reasoners.ros.transforms import transform_message
from skiros2_world_model.core.local_world_model import LocalWorldModel, source_ontologies
from skiros2_world_model.core.reasoner_world_model import ReasonerWorldModel
from skiros2_world_model.core.world_model import WorldModel
from support.fuzz import examples

SCENE = "skiros:Scene-0"
QUARTER = from_euler(0, 0, math.pi / 2)


class World:
    """A world model with a spatial reasoner, and what it publishes on tf."""

    def __init__(self):
        model = WorldModel(source_ontologies())
        self.now = 0.0
        self.wm = LocalWorldModel("tester", model)
        self.reasoner = AauSpatialReasoner()
        self.reasoner._keeper._clock = lambda: self.now
        reasoners.add(self.reasoner)
        self.reasoner.init(ReasonerWorldModel(model))
        model.add_reasoner(self.reasoner)
        keeper = self.reasoner._keeper
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(frame_publisher.rospy, "Publisher", lambda *_, **__: self)
            self.publisher = FramePublisher(keeper.tracker, self.reasoner._transforms, lambda: self.now)

    def publish(self, message):
        self.message = message

    def tf(self):
        """By frame: its base and pose on tf now."""
        self.message = None
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(rospy.Time, "now", lambda: rospy.Time(1))
            self.publisher.publish()
        transforms = IncomingMessage().deserialize(self.message.content).transforms if self.message else []
        return {t.child_frame_id: (t.header.frame_id, _pose(t.transform)) for t in transforms}

    def add(self, parent=SCENE, position=(0, 0, 0), orientation=(0, 0, 0, 1), published=True, **properties):
        element = Element("skiros:Product")
        element.setData(":Pose", (position, orientation))
        element.setProperty("skiros:PublishTf", published)
        for key, value in properties.items():
            element.setProperty(f"skiros:{key}", value)
        element.addRelation(getattr(parent, "id", parent), "skiros:contain", "-1")
        self.wm.add_element(element)
        return element

    def change(self, element, **properties):
        for key, value in properties.items():
            element.setProperty(f"skiros:{key}", value)
        self.wm.update_element(element)


def _pose(transform):
    t, r = transform.translation, transform.rotation
    return Pose((t.x, t.y, t.z), (r.x, r.y, r.z, r.w))


@pytest.fixture
def world():
    return World()


def test_child_of_unpublished_frame_is_connected_to_published_ancestor(world):
    hidden = world.add(position=(1, 0, 0), orientation=QUARTER, published=False)
    also_hidden = world.add(hidden, position=(0, 0, 1), published=False)
    cup = world.add(also_hidden, position=(2, 0, 0))
    base, pose = world.tf()[cup.id]
    assert base == "map"
    assert pose.position == pytest.approx((1.0, 2.0, 1.0))
    assert pose.orientation == pytest.approx(QUARTER)


def test_connection_follows_the_intermediate_frame(world):
    shelf = world.add(position=(1, 0, 0), published=False)
    cup = world.add(shelf, position=(2, 0, 0))
    assert world.tf()[cup.id] == ("map", Pose((3.0, 0.0, 0.0), IDENTITY.orientation))
    world.change(shelf, PositionX=5.0)
    assert world.tf()[cup.id] == ("map", Pose((7.0, 0.0, 0.0), IDENTITY.orientation))
    world.change(shelf, PublishTf=True)
    assert world.tf()[cup.id] == (shelf.id, Pose((2.0, 0.0, 0.0), IDENTITY.orientation))
    world.change(shelf, PublishTf=False)
    assert world.tf()[cup.id] == ("map", Pose((7.0, 0.0, 0.0), IDENTITY.orientation))


def test_child_of_moving_unpublished_frame_moves(world):
    belt = world.add(orientation=QUARTER, published=False, VelocityX=0.5)
    cup = world.add(belt, position=(2, 0, 0), VelocityX=1.0)
    world.now = 2.0
    base, pose = world.tf()[cup.id]
    assert base == "map"
    assert pose.position == pytest.approx((1.0, 4.0, 0.0))
    world.now = 3.0
    assert world.tf()[cup.id][1].position == pytest.approx((1.5, 5.0, 0.0))


def test_child_of_foreign_frame_stays_connected(world):
    robot = world.add(position=(1, 0, 0), published=False, FrameId="base_link")
    camera = world.add(robot, position=(2, 0, 0))
    assert world.tf()[camera.id][0] == "map"
    driver = TFMessage([transform_message("odom", "base_link", IDENTITY, rospy.Time(0))])
    world.reasoner._transforms._on_tf(driver, False)
    assert world.tf()[camera.id] == ("base_link", Pose((2.0, 0.0, 0.0), IDENTITY.orientation))


def test_child_of_frame_without_pose_stays_connected(world):
    robot = world.add(position=(1, None, 0), published=False, FrameId="base_link")
    camera = world.add(robot, position=(2, 0, 0))
    assert world.tf()[camera.id][0] == "base_link"


def test_elements_that_do_not_name_the_reasoner_are_not_published(world):
    element = Element("skiros:Product")
    for key, value in zip("XYZW", (0.0, 0.0, 0.0, 1.0), strict=True):
        element.setProperty(f"skiros:Orientation{key}", value)
        element.setProperty(f"skiros:Position{key}", value)
    element.setProperty("skiros:BaseFrameId", "map")
    element.setProperty("skiros:PublishTf", True)
    world.wm.add_element(element)
    assert world.tf() == {}
    cup = world.add()
    assert set(world.tf()) == {cup.id}
    cup.unsetReasoner("AauSpatialReasoner")
    world.wm.update_element(cup)
    assert world.tf() == {}


POSITIONS = st.tuples(*[st.integers(-3, 3)] * 3)
TURNS = st.sampled_from([(0, 0, 0, 1), QUARTER, from_euler(math.pi / 2, 0, 0)])


@settings(max_examples=examples(30))
@given(st.data())
def test_published_frames_are_connected_to_the_root(data):
    world, elements = World(), []
    for _ in range(data.draw(st.integers(1, 6), "elements")):
        parent = data.draw(st.sampled_from([SCENE, *elements]), "parent")
        elements.append(world.add(parent, data.draw(POSITIONS), data.draw(TURNS), data.draw(st.booleans())))
    for _ in range(data.draw(st.integers(0, 5), "changes")):
        element = data.draw(st.sampled_from(elements), "changed")
        if data.draw(st.booleans(), "at once"):
            world.tf()
        world.change(element, PublishTf=data.draw(st.booleans()), PositionX=float(data.draw(st.integers(-3, 3))))
    tf = world.tf()
    assert set(tf) == {element.id for element in elements if element.value_of("skiros:PublishTf")}
    for name, (base, pose) in tf.items():
        while base != "map":
            assert base in tf, f"{name} is connected to nothing"
            pose, base = composed(tf[base][1], pose), tf[base][0]
        position, orientation = world.reasoner.get_transform("map", name)
        assert pose.position == pytest.approx(position, abs=1e-6)
        dot = sum(a * b for a, b in zip(pose.orientation, orientation, strict=True))
        assert abs(dot) == pytest.approx(1.0)
