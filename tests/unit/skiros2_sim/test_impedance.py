"""The law of the Cartesian impedance controller, on an ideal arm: a point mass with three slides and three hinges."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from skiros2_common.core.errors import WrongValue
from skiros2_motion.core.geometry import Pose, from_euler
from skiros2_motion.core.impedance import TORQUE_RATE, ArmState, Impedance, rotation_matrix, rotation_vector
from skiros2_motion.core.wrench_guard import Limits

DT = 0.001
EFFORTS = [1000.0] * 3 + [100.0] * 3


def state(positions=(0.0,) * 6, velocities=(0.0,) * 6, mass: float = 2.0, orientation=(0.0, 0.0, 0.0, 1.0)) -> ArmState:
    x, y, z = (float(value) for value in positions[:3])
    return ArmState(
        np.array(positions, dtype=float),
        np.array(velocities, dtype=float),
        Pose((x, y, z), orientation),
        np.eye(6),
        np.diag([mass] * 3 + [0.5] * 3),
        np.zeros(6),
    )


def controller(**settings) -> Impedance:
    impedance = Impedance(EFFORTS)
    impedance.restart(state(**settings))
    return impedance


def settled(impedance: Impedance, measured: ArmState, seconds: float = 2.0) -> np.ndarray:
    """The torques after the filters have settled, at a state that does not change."""
    for _ in range(round(seconds / DT)):
        torques = impedance.torques(measured, DT)
    return torques


def simulated(impedance: Impedance, seconds: float, force=(0.0,) * 6, mass: float = 2.0) -> list[np.ndarray]:
    """The positions of the point mass under the controller and an external force."""
    inertia = np.array([mass] * 3 + [0.5] * 3)
    q, dq, track = np.zeros(6), np.zeros(6), []
    for _ in range(round(seconds / DT)):
        pose = Pose(tuple(q[:3]), from_euler(*q[3:]))
        dq = dq + (impedance.torques(state(q, dq, mass)._replace(tool=pose), DT) + np.array(force)) / inertia * DT
        q = q + dq * DT
        track.append(q)
    return track


def test_resting_arm_at_its_reference_needs_no_force() -> None:
    assert settled(controller(), state()) == pytest.approx(0.0)


def test_force_is_stiffness_times_distance() -> None:
    impedance = controller()
    impedance.set_stiffness((500.0, 1000.0, 200.0, 20.0, 30.0, 10.0))
    force = settled(impedance, state((0.01, -0.02, 0.03, 0.0, 0.0, 0.0)))
    assert force[:3] == pytest.approx([-5.0, 20.0, -6.0], abs=0.01)


def test_stiffness_holds_along_the_axes_of_the_tool() -> None:
    turned = from_euler(0.0, 0.0, math.pi / 2)  # the tool's x is the base's y
    impedance = Impedance(EFFORTS)
    impedance.restart(state(orientation=turned))
    impedance.set_stiffness((1000.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    force = settled(impedance, state((0.01, 0.01, 0.0, 0.0, 0.0, 0.0), orientation=turned))
    assert force[:3] == pytest.approx([0.0, -10.0, 0.0], abs=0.01)


def test_arm_yields_to_a_push_by_force_over_stiffness() -> None:
    impedance = controller()
    impedance.set_stiffness((500.0, 500.0, 500.0, 20.0, 20.0, 20.0))
    track = simulated(impedance, 3.0, force=(10.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    assert track[-1][0] == pytest.approx(10.0 / 500.0, rel=0.01)


def test_critically_damped_arm_reaches_its_reference_without_overshoot() -> None:
    impedance = controller(mass=1.0)
    impedance.set_reference(Pose((0.05, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)))
    track = np.array(simulated(impedance, 2.0, mass=1.0))[:, 0]
    assert track[-1] == pytest.approx(0.05, abs=1e-4)
    assert track.max() < 0.0501


def test_damping_is_twice_the_factor_times_the_root_of_the_stiffness() -> None:
    impedance = controller()
    impedance.set_stiffness((400.0, 400.0, 400.0, 20.0, 20.0, 20.0))
    impedance.set_damping_factors((0.5, 1.0, 1.0, 1.0, 1.0, 1.0))
    force = settled(impedance, state(velocities=(0.1, 0.1, 0.0, 0.0, 0.0, 0.0)))
    assert force[:2] == pytest.approx([-2 * 0.5 * 20.0 * 0.1, -2 * 20.0 * 0.1], rel=0.01)


def test_arm_without_stiffness_is_damped() -> None:
    impedance = controller()
    impedance.set_stiffness((0.0, 0.0, 500.0, 0.0, 0.0, 20.0))
    impedance.set_damping_factors((0.0,) * 6)
    force = settled(impedance, state(velocities=(0.1, 0.0, 0.1, 1.0, 0.0, 0.0)))
    assert force[:4] == pytest.approx([-4.0, 0.0, 0.0, -3.0], abs=0.01), "40 Ns/m, 3 Nms/rad"


def test_reference_of_a_guided_arm_is_its_pose() -> None:
    impedance = controller()
    impedance.set_stiffness((0.0,) * 6)
    assert settled(impedance, state((0.1, 0.0, 0.0, 0.0, 0.0, 0.0))) == pytest.approx(0.0)
    assert impedance.reference.position == (0.1, 0.0, 0.0)


def test_commanded_wrench_is_exerted_in_the_frame_of_the_tool() -> None:
    turned = from_euler(math.pi, 0.0, 0.0)  # the hand points down
    impedance = Impedance(EFFORTS)
    impedance.restart(state(orientation=turned))
    impedance.set_wrench((0.0, 0.0, 12.0, 0.0, 0.0, 1.0))
    force = settled(impedance, state(orientation=turned))
    assert force == pytest.approx([0.0, 0.0, -12.0, 0.0, 0.0, -1.0], abs=0.01)


def test_torques_change_by_at_most_one_newton_metre_per_millisecond() -> None:
    impedance = controller()
    impedance.set_stiffness((2000.0, 2000.0, 2000.0, 300.0, 300.0, 300.0))
    impedance.set_reference(Pose((0.1, 0.1, 0.1), (0.0, 0.0, 0.0, 1.0)))
    torques = np.array([impedance.torques(state(), DT).copy() for _ in range(500)])
    assert np.abs(np.diff(torques, axis=0)).max() <= TORQUE_RATE * DT + 1e-9
    assert torques.max() > 50.0


def test_torques_stay_within_the_limits_of_the_joints() -> None:
    impedance = Impedance([5.0] * 6)
    impedance.restart(state())
    impedance.set_reference(Pose((0.1, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)))
    assert settled(impedance, state())[0] == pytest.approx(5.0)


def test_far_reference_produces_a_limited_force() -> None:
    impedance = controller()
    impedance.set_reference(Pose((100.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)))
    assert settled(impedance, state())[0] == pytest.approx(600.0 * 0.15, rel=0.01)


def test_change_of_stiffness_is_smooth() -> None:
    impedance = controller()
    away = state((0.02, 0.0, 0.0, 0.0, 0.0, 0.0))
    settled(impedance, away)
    impedance.set_stiffness((2000.0,) * 3 + (40.0,) * 3)
    force = np.array([impedance.torques(away, DT)[0] for _ in range(1000)])
    assert abs(force[0] + 12.0) < 0.5
    assert force[-1] == pytest.approx(-40.0, rel=0.01)
    assert np.abs(force[10:] - force[:-10]).max() < 5.0


def test_light_wrist_stays_stable_at_the_maximum_stiffness() -> None:
    impedance = controller()
    impedance.set_stiffness((2000.0, 2000.0, 2000.0, 300.0, 300.0, 300.0))
    q, dq = np.zeros(6), np.zeros(6)
    inertia = np.array([2.0] * 3 + [0.005] * 3)
    dq[5] = 1.0
    for _ in range(1000):
        measured = ArmState(q, dq, Pose(tuple(q[:3]), from_euler(*q[3:])), np.eye(6), np.diag(inertia), np.zeros(6))
        dq = dq + impedance.torques(measured, DT) / inertia * DT
        q = q + dq * DT
    assert np.abs(dq).max() < 0.01


def test_reference_leads_by_the_force_limit_over_the_stiffness_only() -> None:
    impedance = controller()
    impedance.limits = Limits(40.0, 3.0)
    impedance.set_reference(Pose((0.1, 0.1, 0.0), from_euler(0.0, 0.0, 0.4)))
    impedance.set_wrench((0.0, 0.0, 15.0, 0.0, 0.0, 2.0))
    torques = settled(impedance, state())
    assert np.linalg.norm(torques[:3]) == pytest.approx(40.0, rel=0.01)
    assert np.linalg.norm(torques[3:]) == pytest.approx(3.0, rel=0.01)
    impedance.set_reference(Pose((0.01, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)))
    impedance.cancel_wrench()
    assert settled(impedance, state())[0] == pytest.approx(6.0, rel=0.01), "below the limit, the law is unchanged"


@pytest.mark.parametrize("part", ["positions", "velocities", "tool", "jacobian", "masses", "bias"])
def test_state_that_is_not_finite_is_refused_and_keeps_the_torques(part: str) -> None:
    impedance = controller()
    before = settled(impedance, state((0.01, 0.0, 0.0, 0.0, 0.0, 0.0)))
    broken = {"tool": Pose((0.0, 0.0, 0.0), (0.0, math.nan, 0.0, 1.0))}
    broken |= {name: np.full_like(getattr(state(), name), math.nan) for name in ("positions", "velocities", "bias")}
    broken |= {name: np.full((6, 6), math.inf) for name in ("jacobian", "masses")}
    with pytest.raises(WrongValue, match=part):
        impedance.torques(state()._replace(**{part: broken[part]}), DT)
    assert impedance.commanded_torques == pytest.approx(before)


@pytest.mark.parametrize(
    "command",
    [
        lambda law: law.set_reference(Pose((0.0, 0.0, math.inf), (0.0, 0.0, 0.0, 1.0))),
        lambda law: law.set_reference(Pose((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, math.nan))),
        lambda law: law.set_damping_factors((math.nan,) * 6),
        lambda law: law.set_wrench((0.0, 0.0, 0.0, 0.0, 0.0, math.nan)),
    ],
)
def test_command_that_is_not_finite_is_refused_and_changes_nothing(command) -> None:
    impedance = controller()
    with pytest.raises(WrongValue):
        command(impedance)
    assert settled(impedance, state()) == pytest.approx(0.0)


def test_load_and_overlay_that_are_not_finite_produce_no_torques() -> None:
    impedance = controller()
    with pytest.raises(WrongValue, match="torques"):
        impedance.torques(state(), DT, np.array([0.0, math.nan, 0.0]))
    impedance.overlay = np.array([math.nan, 0.0, 0.0])
    with pytest.raises(WrongValue, match="torques"):
        impedance.torques(state(), DT)


def test_braking_arm_rests_within_a_fifth_of_a_second_and_holds_its_pose() -> None:
    impedance = controller()
    impedance.brake()
    inertia = np.array([2.0] * 3 + [0.5] * 3)
    q, dq, track = np.zeros(6), np.array([0.5, 0.0, 0.0, 0.0, 0.0, 1.0]), []
    for _ in range(1000):
        pose = Pose(tuple(q[:3]), from_euler(*q[3:]))
        dq = dq + impedance.torques(state(q, dq)._replace(tool=pose), DT) / inertia * DT
        q = q + dq * DT
        track.append(np.abs(dq).max())
    assert max(track[200:]) < 0.02
    assert impedance.reference.position[0] == pytest.approx(q[0], abs=1e-3)
    assert not impedance.is_braking


@pytest.mark.parametrize("bad", [(3000.0, 0, 0, 0, 0, 0), (-1.0, 0, 0, 0, 0, 0), (math.nan, 0, 0, 0, 0, 0), (0, 0, 0)])
def test_invalid_stiffness_is_refused_and_changes_nothing(bad) -> None:
    impedance = controller()
    with pytest.raises(WrongValue):
        impedance.set_stiffness(bad)
    assert settled(impedance, state((0.01, 0.0, 0.0, 0.0, 0.0, 0.0)))[0] == pytest.approx(-6.0, rel=0.01)


def test_refused_wrench_names_all_axes_out_of_range() -> None:
    with pytest.raises(WrongValue, match=r"wrench 31 of x: expected -30 to 30; wrench -11 of rz: expected -10 to 10"):
        controller().set_wrench((31.0, 0.0, 0.0, 0.0, 0.0, -11.0))


@pytest.mark.parametrize("angles", [(0.0, 0.0, 0.0), (0.3, -0.2, 1.0), (1e-13, 0.0, 0.0), (0.0, 0.0, -3.1)])
def test_rotation_matrix_and_vector_agree_with_scipy(angles) -> None:
    quaternion = from_euler(*angles)
    expected = Rotation.from_quat(quaternion)
    assert rotation_matrix(quaternion) == pytest.approx(expected.as_matrix())
    assert rotation_vector(quaternion) == pytest.approx(expected.as_rotvec())
    assert rotation_vector([-value for value in quaternion]) == pytest.approx(expected.as_rotvec())
