"""What a window is measured with: a scene in which elements move, and a robot that tells of a large tree.

A node that stands for a skill manager, `/bench_robot`. Prints "ready" when the scene is there, and goes on until it is
told to end.
"""

from __future__ import annotations

import sys

import rospy

from skiros2_common.core.world_element import Element
from skiros2_motion.core.geometry import Pose
from skiros2_msgs import msg as msgs
from skiros2_msgs import srv as srvs
from skiros2_skill.ros.discovery_interface import DiscoverableNode
from skiros2_skill.ros.skill_layer_interface import NAMESPACE
from skiros2_std_reasoners.core import spatial_data as space
from skiros2_world_model.ros.world_model_interface import WorldModelInterface
from support.progress import IDLE, RUNNING, SUCCESS, random_tree

RATE = 25.0
NAME = "bench_robot"
#: So many nodes of the tree run at once: of them the time and the message change each time.
AT_ONCE = 20


def main(elements: int, nodes: int) -> None:
    rospy.init_node(NAME, disable_signals=True)
    world = WorldModelInterface(f"/{NAME}")
    scene = [_element(number) for number in range(elements)]
    world.add_elements(scene)
    tree = [msgs.SkillProgress(**_fields(told)) for told in random_tree(nodes)]
    rospy.Service("~get_skills", srvs.ResourceGetDescriptions, lambda _: [[]])
    monitor = rospy.Publisher("~monitor", msgs.TreeProgress, queue_size=5)
    DiscoverableNode().init_discovery(NAMESPACE, f"/{NAME}")
    rospy.Subscriber("skiros/markers", rospy.AnyMsg, lambda _: None)  # as rviz does
    print("ready", flush=True)
    rate = rospy.Rate(RATE)
    step = 0
    while not rospy.is_shutdown():
        step += 1
        moved = scene[step % elements]
        space.set_numbers(moved, space.POSITION, (step % 7, step % 11, 0.001 * step))
        world.update_element(moved)
        _advance(tree, step)
        monitor.publish(tree)
        rate.sleep()


def _advance(tree: list[msgs.SkillProgress], step: int) -> None:
    first = step % (len(tree) - AT_ONCE)
    for place, node in enumerate(tree[1:], 1):
        state = SUCCESS if place < first else RUNNING if place < first + AT_ONCE else IDLE
        node.state = state
        if state == RUNNING:
            node.progress_time = step / RATE
            node.progress_message = f"step {step} of {node.label}"
    tree[0].state = RUNNING


def _fields(told: object) -> dict[str, object]:
    return {**vars(told), "robot": f"/{NAME}"}


def _element(number: int) -> Element:
    element = Element("skiros:Product", f"part {number}")
    space.set_pose(element, Pose((number % 30, number // 30, 0.0), (0.0, 0.0, 0.0, 1.0)))
    space.set_numbers(element, space.SIZE, (0.4, 0.4, 0.4))
    space.set_text(element, space.BASE_FRAME, "map")
    element.addRelation("skiros:Scene-0", "skiros:contain", "-1")
    return element


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]))
