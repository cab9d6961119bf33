"""Collision-free trajectories of simulated arms: around obstacles, with held objects and other arms, within limits."""

from __future__ import annotations

import dataclasses
import threading
import time
from collections.abc import Iterator

import numpy as np
import pytest

from skiros2_motion.core.geometry import Pose
from skiros2_motion.core.motion import State
from skiros2_sim.core import arm_planning as codes
from skiros2_sim.core.arm_controller import ArmController
from skiros2_sim.core.arm_planning import ArmPlanning, PlanningGoal
from skiros2_sim.core.joint_motion import JointGoal, JointMotion
from skiros2_sim.core.planning_scene import PlanningScene, held_objects
from skiros2_sim.core.scene_spec import ArmSpec, GripperSpec, RobotSpec, SceneSpec
from skiros2_sim.core.world import World
from support.moved_robot import DOWN, MovedRobot, succeeded
from support.simulated_cell import ARM, PANDA, PRODUCTS, ROBOT, TRAYS, at, bench, box, with_body

WALL = "test:Wall-1"
#: To the right and to the left of the wall.
RIGHT = (-0.7, -0.2, 0.0, -2.2, 0.0, 2.0, 0.785)
LEFT = (0.7, -0.2, 0.0, -2.2, 0.0, 2.0, 0.785)
#: s of CPU time of a step.
MOST_PER_STEP = 0.05


def walled() -> SceneSpec:
    """A Panda before a wall that a straight joint motion from RIGHT to LEFT hits."""
    return with_body(dataclasses.replace(bench(), bodies=()), box(WALL, at(0.5, 0.0, 0.35), (0.5, 0.04, 0.7)))


class Planner(MovedRobot):
    """A robot with plans."""

    def __init__(self, world: World, scene: PlanningScene) -> None:
        super().__init__(world)
        self.scene = scene

    def planning(self, positions: tuple[float, ...] = (), **options: object) -> ArmPlanning:
        joints = self.joints if positions else ()
        goal = PlanningGoal(joints, positions, **options)  # type: ignore[arg-type]
        return ArmPlanning(self.controller, goal, self.scene)

    def planned(self, positions: tuple[float, ...] = (), **options: object) -> ArmPlanning:
        search = self.planning(positions, **options)
        succeeded(self.run(search))
        return search

    def fails(self, positions: tuple[float, ...] = (), **options: object) -> tuple[int, str]:
        outcome = self.run(self.planning(positions, **options))
        assert outcome.state in (State.ABORTED, State.REJECTED), outcome
        return outcome.code, outcome.text

    def execution(self, search: ArmPlanning) -> JointMotion:
        return JointMotion(self.controller, JointGoal(search.plan.joints, search.plan.points))

    def go(self, positions: tuple[float, ...]) -> None:
        """Moves to joint positions without a plan."""
        self.world.step(10)
        succeeded(self.run(self.trajectory(positions)))

    def is_free(self, positions: object, clearance: float = 0.0) -> bool:
        checks = self.scene.collisions_of(self.world, ROBOT, ARM, clearance)
        return checks.is_free(positions)  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def shared() -> Iterator[tuple[World, PlanningScene]]:
    with World(walled()) as world:
        scene = PlanningScene(world.scene)
        yield world, scene
        scene.close()


@pytest.fixture
def arm(shared: tuple[World, PlanningScene]) -> Planner:
    """A Panda to the right of a wall."""
    world, scene = shared
    world.reset(0)
    planner = Planner(world, scene)
    planner.go(RIGHT)
    return planner


@pytest.fixture
def table() -> Iterator[Planner]:
    """A Panda before a product on a tray."""
    with World(bench()) as world:
        scene = PlanningScene(world.scene)
        world.step(60)
        yield Planner(world, scene)
        scene.close()


def test_straight_motion_hits_the_wall(arm: Planner) -> None:
    outcome = arm.run(arm.trajectory(LEFT))
    assert outcome.state is State.ABORTED
    assert WALL in outcome.text


def test_planned_motion_goes_around_the_wall(arm: Planner) -> None:
    search = arm.planned(LEFT)
    touched: list[str] = []
    motion = arm.execution(search)
    succeeded(arm.run(motion, lambda: touched.extend(map(str, arm.world.contacts(WALL)))))
    assert not touched
    assert arm.arm.positions() == pytest.approx(LEFT, abs=0.005)


def test_trajectory_keeps_the_clearance(arm: Planner) -> None:
    search = arm.planned(LEFT, clearance=0.03)
    points = np.array([point.positions for point in search.plan.points])
    assert all(arm.is_free(q, 0.02) for q in points)
    assert not all(arm.is_free(q, 0.5) for q in points), "the wall is there"


def test_tool_pose_is_reached(arm: Planner) -> None:
    target = Pose((0.4, 0.35, 0.6), DOWN)
    succeeded(arm.run(arm.execution(arm.planned(tool=target))))
    assert arm.arm.tool_pose().position == pytest.approx(target.position, abs=0.003)


def test_trajectory_is_within_the_limits_of_velocity_and_acceleration(arm: Planner) -> None:
    for scaling in (0.2, 1.0):
        plan = arm.planned(LEFT, velocity_scaling=scaling, acceleration_scaling=scaling).plan
        times = np.array([point.time for point in plan.points])
        velocities = np.array([point.velocities for point in plan.points])
        positions = np.array([point.positions for point in plan.points])
        limits = np.array([joint.velocity for joint in arm.arm.joints]) * scaling
        assert np.all(np.abs(velocities) <= limits + 1e-9)
        accelerations = np.diff(velocities, axis=0) / np.diff(times)[:, None]
        assert np.all(np.abs(accelerations) <= limits / 0.4 * 1.02)
        means = np.diff(positions, axis=0) / np.diff(times)[:, None]
        assert np.all(np.abs(means) <= limits + 1e-6)
        assert velocities[0] == pytest.approx(0.0)
        assert velocities[-1] == pytest.approx(0.0)
        fast = np.max(np.abs(velocities) / limits, axis=1)
        hard = np.max(np.abs(accelerations) / (limits / 0.4), axis=1)
        assert np.mean(np.maximum(fast[1:], hard) > 0.5) > 0.8, "it uses the limits"


def test_same_seed_gives_the_same_trajectory(shared: tuple[World, PlanningScene]) -> None:
    world, scene = shared

    def planned(seed: int) -> ArmPlanning:
        world.reset(0)
        arm = Planner(world, scene)
        arm.go(RIGHT)
        return arm.planned(LEFT, seed=seed)

    first, other, again = planned(3), planned(4), planned(3)
    assert first.plan == again.plan
    assert first.spent == again.spent
    assert first.plan != other.plan


def test_unreachable_pose_fails_with_the_distance(arm: Planner) -> None:
    code, text = arm.fails(tool=Pose((2.0, 0.0, 0.5), DOWN))
    assert code == codes.UNREACHABLE
    assert "off by" in text


def test_goal_in_the_wall_fails_with_the_pair(arm: Planner) -> None:
    code, text = arm.fails((0.0, -0.2, 0.0, -2.2, 0.0, 2.0, 0.785))
    assert code == codes.GOAL_IN_COLLISION
    assert WALL in text
    assert "stationary/arm/panda_" in text


def test_start_in_collision_fails_with_the_pair(arm: Planner) -> None:
    x, y, z = arm.arm.tool_pose().position
    arm.world.set_pose(WALL, Pose((x, y, z), (0.0, 0.0, 0.0, 1.0)))
    code, text = arm.fails(LEFT)
    assert code == codes.START_IN_COLLISION
    assert WALL in text
    assert "hand" in text or "finger" in text


def test_self_collision_is_found(arm: Planner) -> None:
    code, text = arm.fails((-0.7, 1.7, 0.0, -3.0, 0.0, 0.0, 0.785))
    assert code == codes.GOAL_IN_COLLISION
    assert text.count("stationary/arm/panda_") >= 2


def test_search_ends_after_its_planning_time(arm: Planner) -> None:
    for number, x, z in ((2, 0.7, 1.0), (3, -0.7, 1.0), (4, 0.0, 2.15)):  # all of y = 0, except around the base
        arm.world.add_body(box(f"test:Wall-{number}", at(x, 0.0, z), (1.0, 0.04, 2.0)))
    search = arm.planning(LEFT, planning_time=0.2)
    outcome = arm.run(search)
    assert (outcome.state, outcome.code) == (State.ABORTED, codes.NO_PATH)
    assert "no collision-free path" in outcome.text
    assert 0.2 <= search.spent < 0.3


def test_invalid_goal_lists_all_problems(arm: Planner) -> None:
    search = arm.planning((9.0, *LEFT[1:]), planning_time=-1.0, clearance=float("nan"), velocity_scaling=2.0)
    assert search.outcome is not None
    assert search.outcome.state is State.REJECTED
    assert search.outcome.code == codes.INVALID_GOAL
    for text in ("planning time", "clearance", "velocity scaling", "panda_joint1"):
        assert text in search.outcome.text
    assert arm.planning().outcome is not None
    assert arm.planning(LEFT, tool=Pose((0.4, 0.3, 0.6), DOWN)).outcome is not None


def test_cancelled_search_ends_its_thread(arm: Planner) -> None:
    before = threading.active_count()
    search = arm.planning(LEFT)
    arm.world.motions.add(search)
    arm.world.step(3)
    assert search.outcome is None
    search.cancel()
    assert search.outcome is not None
    assert search.outcome.state is State.PREEMPTED
    assert threading.active_count() == before


def test_planning_does_not_hold_up_the_world_and_changes_nothing(arm: Planner) -> None:
    before = arm.arm.positions()
    search = arm.planning(LEFT)
    arm.world.motions.add(search)
    longest = 0.0
    while search.outcome is None:
        start = time.process_time()
        arm.world.step()
        longest = max(longest, time.process_time() - start)
    assert longest < MOST_PER_STEP
    assert arm.arm.positions() == pytest.approx(before, abs=1e-4)


def test_held_object_is_carried_around_an_obstacle(table: Planner) -> None:
    grasp = (0.5, 0.05, 0.445)
    for motion in (
        lambda: table.grip(0.08),
        lambda: table.line((0.5, 0.05, 0.55)),
        lambda: table.line(grasp),
        lambda: table.grip(0.0),
    ):
        succeeded(table.run(motion()))
    assert held_objects(table.world, table.robot, table.arm) == [PRODUCTS[0]]
    # from its support: contacts at the start are accepted
    succeeded(table.run(table.execution(table.planned(tool=Pose((0.5, 0.05, 0.6), DOWN)))))
    assert table.world.pose_of(PRODUCTS[0]).position == pytest.approx((0.5, 0.05, 0.6), abs=0.01)
    # free for the fingers, but the held object would be inside
    table.world.add_body(box("test:Shelf-1", at(0.5, -0.2, 0.5), (0.06, 0.06, 0.1)))
    table.world.step()
    code, text = table.fails(tool=Pose((0.5, -0.2, 0.572), DOWN))
    assert code == codes.GOAL_IN_COLLISION
    assert PRODUCTS[0] in text
    assert "test:Shelf-1" in text
    assert "panda_hand" not in text
    succeeded(table.run(table.execution(table.planned(tool=Pose((0.5, -0.2, 0.62), DOWN)))))
    assert table.world.pose_of(PRODUCTS[0]).position == pytest.approx((0.5, -0.2, 0.62), abs=0.01)


def test_objects_that_moved_are_avoided_where_they_are(table: Planner) -> None:
    target = Pose((0.5, 0.09, 0.46), DOWN)
    code, text = table.fails(tool=target)
    assert code == codes.GOAL_IN_COLLISION
    assert PRODUCTS[0] in text
    table.world.remove_body(PRODUCTS[0])
    table.planned(tool=target)
    assert TRAYS[0] in table.world.bodies


def test_other_arm_is_avoided() -> None:
    arms = tuple(
        ArmSpec(f"rparts:ArmDevice-{n}", name, PANDA, at(0.0, y, 0.3), GripperSpec(f"rparts:GripperEffector-{n}0", g))
        for n, name, y, g in ((3, "arm", 0.0, "gripper"), (4, "other", 0.5, "other_gripper"))
    )
    with World(SceneSpec((), (RobotSpec(ROBOT, "twin", arms=arms),))) as world:
        scene = PlanningScene(world.scene)
        planner = Planner(world, scene)
        world.step(60)
        x, y, z = world.arms["rparts:ArmDevice-4"].tool_pose().position
        code, text = planner.fails(tool=Pose((x, y, z + 0.05), DOWN))
        assert code == codes.GOAL_IN_COLLISION
        assert "twin/arm/panda" in text
        assert "twin/other/panda" in text
        # two searches at the same time: one after the other, neither disturbs the other one
        both = [
            ArmPlanning(
                ArmController(world, world.robots[ROBOT], world.arms[eid]),
                PlanningGoal(tool=Pose((0.5, y, 0.6), DOWN)),
                scene,
            )
            for eid, y in (("rparts:ArmDevice-3", -0.2), ("rparts:ArmDevice-4", 0.7))
        ]
        for search in both:
            world.motions.add(search)
        for _ in range(2400):
            world.step()
        for search in both:
            assert search.outcome is not None
            succeeded(search.outcome)
        scene.close()
