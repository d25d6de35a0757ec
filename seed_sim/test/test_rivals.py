# SPDX-License-Identifier: Apache-2.0
"""Rival laws do what their documentation says, on a spring that is followed by hand."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.testing import assert_allclose

from seed_core.hand import Hand, Tool
from seed_core.spatial import inverse_pose, make_pose, rotation_from_rpy, so3_exp
from seed_sim.rivals.admittance import Admittance, AdmittanceSettings
from seed_sim.rivals.force_mode import INERTIA, ForceMode, ForceModeSettings
from seed_sim.rivals.force_pi import ForcePI, ForcePISettings
from seed_sim.rivals.impedance import MASS, PERIOD, Impedance, ImpedanceSettings, JointFriction, TorqueArm
from seed_sim.rivals.law import RivalLaw, Wanted, flange_pose
from seed_sim.rivals.sensor import IDEAL, UR_E_SERIES, ForceReader, ForceSensor

ALONG_Z = np.array((0.0, 0.0, 0.0, 0.0, 0.0, 1.0))
PRESS = Wanted(-10.0 * ALONG_Z, ALONG_Z)


def pressed(law: RivalLaw, stiffness: float, lag: float, duration: float = 4.0) -> np.ndarray:
    """Force [N] over time on a wall of that stiffness [N/m], behind an arm with a first-order lag [s]."""
    at, forces = 0.0, []
    for _ in range(round(duration / law.period)):
        force = max(-at * stiffness, 0.0)
        forces.append(force)
        commanded = law.step(PRESS, -force * ALONG_Z)[5]
        at += law.period / (lag + law.period) * (commanded - at)
    return np.array(forces)


LAWS: dict[str, Callable[[], RivalLaw]] = {
    "force mode": lambda: ForceMode(ForceModeSettings(damping=0.5, gain_scaling=0.06)),
    "admittance": lambda: Admittance(AdmittanceSettings(mass=10.0, stiffness=2.0, damping_ratio=60.0)),
    "PI": lambda: ForcePI(ForcePISettings(gain=3e-4, integral_time=0.5)),
}


@pytest.mark.parametrize("name", LAWS)
def test_a_well_set_law_comes_to_rest_at_the_wanted_force(name: str) -> None:
    assert_allclose(pressed(LAWS[name](), 20e3, 0.015)[-100:], 10.0, atol=0.3)  # [N]


def test_force_mode_bounces_on_a_rigid_body_by_default_and_damping_helps() -> None:
    """As users see (forum.universal-robots.com/t/22537): beyond 10 N, back to much less, again and again."""
    by_default = pressed(ForceMode(ForceModeSettings()), 40e3, 0.015)[1000:]
    assert by_default.max() > 15.0
    assert by_default.min() == 0.0
    damped = pressed(ForceMode(ForceModeSettings(damping=0.5, gain_scaling=0.06)), 40e3, 0.015)[1000:]
    assert np.ptp(damped) < 0.1 * np.ptp(by_default)


def test_force_mode_keeps_its_speed_without_damping_and_loses_it_at_once_with_all() -> None:
    """The script manual's words on force_mode_set_damping; the push makes dt F / m per step."""
    for damping, kept in ((0.0, 1.0), (1.0, 0.0)):
        law = ForceMode(ForceModeSettings(damping=damping))
        first = law.step(PRESS, np.zeros(6))[5]
        assert_allclose(first, -(law.period**2) * 10.0 / INERTIA)
        second = law.step(PRESS, PRESS.load)[5] - first
        assert_allclose(second, kept * first, atol=1e-15)


def test_force_mode_never_exceeds_its_speed_limit() -> None:
    law = ForceMode(ForceModeSettings(damping=0.0, speed_limit=0.02))
    way = np.array([law.step(PRESS, np.zeros(6))[5] for _ in range(500)])
    assert np.abs(np.diff(way)).max() <= 0.02 * law.period * (1.0 + 1e-9)


def test_admittance_keeps_the_error_of_its_stiffness() -> None:
    """Where the wall is d away from the reference, K d of the force is missing: M, D and the filter do not matter."""
    stiffness = 200.0
    law = Admittance(AdmittanceSettings(mass=5.0, stiffness=stiffness, damping_ratio=5.0, filter_coefficient=0.3))
    force = pressed(law, 2e3, 0.0, 4.0)[-1]
    assert_allclose(force, 10.0 * 2e3 / (2e3 + stiffness), rtol=1e-3)  # two springs in parallel


def test_admittance_without_stiffness_has_no_damping_but_that_of_its_joints() -> None:
    law = Admittance(AdmittanceSettings(mass=10.0, stiffness=0.0, damping_ratio=100.0, joint_damping=0.0))
    before, after = (law.step(PRESS, np.zeros(6))[5] for _ in range(2))
    assert_allclose(after - before, 2.0 * before, rtol=1e-9)  # evenly faster
    braked = Admittance(AdmittanceSettings(mass=10.0, stiffness=0.0, joint_damping=5.0, speed_limit=0.5))
    way = [braked.step(PRESS, np.zeros(6))[5] for _ in range(1500)]
    assert_allclose((way[-2] - way[-1]) / braked.period, 10.0 / 10.0 / 5.0, rtol=1e-2)  # F / (M b), [m/s]


def test_pi_follows_a_slope_without_an_error() -> None:
    law, at, force = ForcePI(ForcePISettings(gain=3e-4, integral_time=0.3)), 0.0, 0.0
    for i in range(2500):
        at = law.step(PRESS, -force * ALONG_Z)[5]
        force = max((2e-3 * i * law.period - at) * 20e3, 0.0)  # a surface that rises with 2 mm/s
    assert_allclose(force, 10.0, atol=0.05)


def test_held_axes_do_not_move() -> None:
    for make in LAWS.values():
        law = make()
        moved = np.array([law.step(PRESS, np.ones(6)) for _ in range(50)])
        assert_allclose(moved[:, :5], 0.0)


def test_impedance_pushes_with_the_wanted_load_and_holds_the_rest() -> None:
    law = Impedance(ImpedanceSettings(damping=100.0, integral=0.0))
    off, speed = np.full(6, 1e-3), np.zeros(6)
    load = law.step(PRESS, np.zeros(6), off, speed)
    assert_allclose(load, (-0.3, -0.3, -0.3, -3.0, -3.0, -10.0))
    speed[5] = -0.02
    assert_allclose(law.step(PRESS, np.zeros(6), off, speed)[5], -10.0 + 2.0)


def test_friction_holds_a_torque_arm_until_it_is_overcome() -> None:
    def moved(force: float) -> float:
        arm = TorqueArm(JointFriction(force=3.0, torque=0.3), np.zeros(6))
        return float(sum(arm.step(force * ALONG_Z, np.zeros(6))[5] for _ in range(500)))

    assert moved(2.0) < 1e-3 * 0.5 * (2.0 / MASS) * 0.25 * 100.0  # creeps, by a tenth of what it would go
    assert_allclose(moved(13.0), 0.5 * (10.0 / MASS) * 0.25, rtol=0.02)  # what is left accelerates it


def test_torque_arm_without_friction_obeys_newton() -> None:
    arm = TorqueArm(JointFriction(0.0, 0.0), np.zeros(6))
    arm.step(ALONG_Z, 3.0 * ALONG_Z)
    assert_allclose(arm.speed[5], -2.0 / MASS * PERIOD)


def test_sensors_are_as_far_off_as_they_state() -> None:
    readers = [ForceReader(UR_E_SERIES, seed) for seed in range(200)]
    assert_allclose([r.read(0.0, np.zeros(6)) for r in readers], 0.0)  # its delay: nothing is at hand yet
    later = np.array([r.read(UR_E_SERIES.delay, np.zeros(6)) for r in readers])
    expected = np.hypot(UR_E_SERIES.force_offset, UR_E_SERIES.force_noise)
    assert_allclose(later[:, 3:].std(), expected, rtol=0.1)


def test_gain_and_drift_stay_within_their_bounds() -> None:
    sensor = ForceSensor(gain=0.01, force_drift=0.005)
    for seed in range(20):
        reading = ForceReader(sensor, seed).read(10.0, np.full(6, 10.0))
        assert np.abs(reading[3:] - 10.0).max() <= 0.1 + 0.05


def test_the_ideal_sensor_tells_the_truth() -> None:
    load = np.arange(6.0)
    assert_allclose(ForceReader(IDEAL, 3).read(1.0, load), load)


def test_a_flange_pose_turns_about_the_tip() -> None:
    hand, tool = Hand(), Tool()
    X_W_tip = make_pose(rotation_from_rpy((np.pi, 0.0, 0.0)), (0.4, 0.1, 0.02))
    offset = np.array((0.1, 0.0, 0.0, 0.0, 0.0, -0.003))
    X_tip = flange_pose(X_W_tip, offset, np.eye(3), tool.X_Ttip, inverse_pose(hand.X_EC)) @ hand.X_EC @ tool.X_Ttip
    assert_allclose(X_tip[:3, 3], (0.4, 0.1, 0.017), atol=1e-12)
    assert_allclose(X_tip[:3, :3], X_W_tip[:3, :3] @ so3_exp(offset[:3]), atol=1e-12)
