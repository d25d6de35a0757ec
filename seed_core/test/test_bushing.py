# SPDX-License-Identifier: Apache-2.0
"""The stiffness map against Drake's element, against its own energy, and there and back."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.testing import assert_allclose

from seed_core.bushing import Bushing, BushingError, Stiffness
from seed_core.config import ConfigError
from seed_core.spatial import Wrench, make_pose, pose_from_rpy, so3_exp

SOFT_HAND = Stiffness((4.0, 3.0, 4.0), (800.0, 1200.0, 800.0))
ISOTROPIC = Stiffness((4.0, 3.0, 5.0), (900.0, 900.0, 900.0))
POSES = 10_000
Drake = Callable[[np.ndarray, np.ndarray], Wrench]


def drake_element(stiffness: Stiffness) -> Drake:
    """Wrench on frame A = T about its origin, in T, of Drake's bushing with frame C at rpy and p."""
    plants = pytest.importorskip("pydrake.multibody.plant", reason="Drake is the reference here")
    math = pytest.importorskip("pydrake.math")
    tree = pytest.importorskip("pydrake.multibody.tree")
    plant = plants.MultibodyPlant(1e-3)
    inertia = tree.SpatialInertia(1.0, np.zeros(3), tree.UnitInertia(1.0, 1.0, 1.0))
    gripper = plant.AddRigidBody("gripper", inertia)
    element = plant.AddForceElement(
        tree.LinearBushingRollPitchYaw(
            plant.world_frame(),
            gripper.body_frame(),
            stiffness.rotation,
            np.zeros(3),
            stiffness.translation,
            np.zeros(3),
        )
    )
    plant.Finalize()
    context = plant.CreateDefaultContext()

    def evaluate(rpy: np.ndarray, p: np.ndarray) -> Wrench:
        plant.SetFreeBodyPose(context, gripper, math.RigidTransform(math.RollPitchYaw(*rpy), p))
        load = element.CalcBushingSpatialForceOnFrameA(context)
        return Wrench(load.rotational(), load.translational())

    return evaluate


def random_displacements(count: int, degrees: float, metres: float) -> tuple[np.ndarray, np.ndarray]:
    """rpy and p, uniform, a tenth of them within 1e-7 of nothing."""
    rng = np.random.default_rng(11)
    rpy = np.deg2rad(degrees) * rng.uniform(-1, 1, (count, 3))
    p = metres * rng.uniform(-1, 1, (count, 3))
    rpy[::10] *= 1e-7
    p[5::10] *= 1e-7
    return rpy, p


def relative(value: Wrench, reference: Wrench) -> float:
    return float(np.linalg.norm(value.vector() - reference.vector()) / max(np.linalg.norm(reference.vector()), 1e-12))


def test_midpoint_map_is_drakes_element() -> None:
    drake, bushing = drake_element(SOFT_HAND), Bushing(SOFT_HAND, "midpoint")
    worst = 0.0
    for rpy, p in zip(*random_displacements(POSES, 60.0, 0.03), strict=True):
        worst = max(worst, relative(bushing.wrench(pose_from_rpy(rpy, p)), drake(rpy, p)))
    assert worst < 1e-11


def test_plain_map_is_drakes_element_about_the_midpoint_when_isotropic() -> None:
    drake, bushing = drake_element(ISOTROPIC), Bushing(ISOTROPIC, "plain")
    worst = 0.0
    for rpy, p in zip(*random_displacements(POSES, 60.0, 0.03), strict=True):
        worst = max(worst, relative(bushing.wrench(pose_from_rpy(rpy, p)), drake(rpy, p).about(0.5 * p)))
    assert worst < 1e-12


def test_anisotropy_separates_the_two_models_by_some_percent_at_thirty_degrees() -> None:
    plain, midpoint = Bushing(SOFT_HAND, "plain"), Bushing(SOFT_HAND, "midpoint")
    rng = np.random.default_rng(3)
    off = []
    for _ in range(2000):
        axis = rng.normal(size=3)
        R = so3_exp(np.deg2rad(30.0) * axis / np.linalg.norm(axis))
        X = make_pose(R, 0.01 * rng.normal(size=3))
        a, b = plain.wrench(X).force, midpoint.wrench(X).force
        off.append(np.linalg.norm(a - b) / np.linalg.norm(b))
    assert 0.06 < np.mean(off) < 0.075
    assert np.max(off) > 0.12


@pytest.mark.parametrize(("model", "stiffness"), [("plain", SOFT_HAND), ("midpoint", ISOTROPIC)])
def test_wrench_is_the_gradient_of_the_energy(model: str, stiffness: Stiffness) -> None:
    """Power balance: a twist (w, v) of the gripper about T's origin stores torque . w + force . v per second."""
    bushing, h = Bushing(stiffness, model), 1e-6  # type: ignore[arg-type]
    rng = np.random.default_rng(5)
    for rpy, p in zip(*random_displacements(200, 40.0, 0.02), strict=True):
        X = pose_from_rpy(rpy, p)
        load, w, v = bushing.wrench(X), rng.normal(size=3), 0.05 * rng.normal(size=3)
        before, after = (bushing.energy(moved(X, s * w, s * v, model)) for s in (-h, h))
        assert_allclose((after - before) / (2 * h), load.torque @ w + load.force @ v, atol=1e-7)  # [W]; rounding


def moved(X: np.ndarray, turn: np.ndarray, shift: np.ndarray, model: str) -> np.ndarray:
    """X_TC after a small turn about T's origin and a shift; the plain model's torque does not carry C along."""
    R, p = so3_exp(turn), X[:3, 3]
    return make_pose(R @ X[:3, :3], (p if model == "plain" else R @ p) + shift)


def test_force_of_the_anisotropic_midpoint_map_is_the_gradient_of_its_energy() -> None:
    """Its torque is Drake's, which leaves out how B turns with C; the force is an exact gradient."""
    bushing, h = Bushing(SOFT_HAND), 1e-6
    for rpy, p in zip(*random_displacements(100, 40.0, 0.02), strict=True):
        X = pose_from_rpy(rpy, p)
        for i, n in enumerate(np.eye(3)):
            up, down = (bushing.energy(make_pose(X[:3, :3], p + s * n)) for s in (h, -h))
            assert_allclose((up - down) / (2 * h), bushing.wrench(X).force[i], atol=1e-6)  # [N]


@pytest.mark.parametrize(("model", "degrees", "tolerance"), [("plain", 79.9, 1e-12), ("midpoint", 30.0, 1e-9)])
def test_force_inverts_stiffness_map(model: str, degrees: float, tolerance: float) -> None:
    bushing = Bushing(SOFT_HAND, model)  # type: ignore[arg-type]
    for rpy, p in zip(*random_displacements(2000, degrees, 0.02), strict=True):
        X = pose_from_rpy(rpy, p)
        assert_allclose(bushing.pose(bushing.wrench(X)), X, atol=tolerance)


def test_pressing_on_a_tilted_grasp_by_hand() -> None:
    """3 N m/rad turned by 0.1 rad about y and 800 N/m pressed by 10 mm."""
    load = Bushing(SOFT_HAND, "plain").wrench(pose_from_rpy((0.0, 0.1, 0.0), (0.0, 0.0, 0.01)))
    assert_allclose(load.vector(), (0.0, 0.3, 0.0, 0.0, 0.0, 8.0), atol=1e-15)


@pytest.mark.parametrize("axis", range(3))
def test_a_load_within_a_plane_is_answered_as_exactly_as_any(axis: int) -> None:
    """No displacement leaves the plane, however the iteration goes on within it."""
    bushing = Bushing(SOFT_HAND)
    torque, force = 0.8 * np.eye(3)[axis], 8.0 * np.eye(3)[axis - 1]
    X_TC = bushing.pose(Wrench(torque, force))
    assert abs(X_TC[axis, 3]) < 1e-12
    assert_allclose(bushing.wrench(X_TC).vector(), (*torque, *force), atol=1e-6)


def test_force_opposes_displacement_monotonically() -> None:
    bushing = Bushing(SOFT_HAND)
    forces = [bushing.wrench(make_pose(p=(0.0, 0.0, z))).force[2] for z in np.linspace(-0.03, 0.03, 61)]
    assert np.all(np.diff(forces) > 0.0)


@pytest.mark.parametrize(
    ("torque", "axis"),
    [((0.0, 3.0 * np.pi / 2, 0.0), "pitch"), ((4.0 * np.pi, 0.0, 0.0), "roll"), ((0.0, 0.0, 13.0), "yaw")],
)
def test_torque_beyond_the_map_is_refused_with_numbers(torque: tuple[float, ...], axis: str) -> None:
    for model in ("plain", "midpoint"):
        with pytest.raises(BushingError, match=f"needs a {axis} of .* degrees"):
            Bushing(SOFT_HAND, model).pose(Wrench(np.array(torque), np.zeros(3)))  # type: ignore[arg-type]


@pytest.mark.parametrize("value", [0.0, -2.0, float("nan"), float("inf")])
def test_stiffness_that_is_not_positive_is_refused(value: float) -> None:
    with pytest.raises(ConfigError, match=r"stiffness.rotation\[1\] = .* N m/rad"):
        Stiffness((4.0, value, 4.0), (800.0, 1200.0, 800.0))


def test_refusals_tell_name_value_unit_and_bound() -> None:
    hand, ones = Bushing(SOFT_HAND), (1.0, 1.0, 1.0)
    too_far = Wrench(np.array((-2.4, 0.4, -0.1)), np.array((-23.0, 153.0, -19.0)))
    refusals = {
        "stiffness.translation[2] = 0.0 N/m must be within 0.001 and 1e+09 N/m": lambda: Stiffness(
            ones, (1.0, 1.0, 0.0)
        ),
        "stiffness.rotation[0] = -1.0 N m/rad must be within 1e-06 and 1e+06 N m/rad": lambda: Stiffness(
            (-1.0, 1.0, 1.0), ones
        ),
        "model = 'rubber' must be one of: midpoint, plain": lambda: Bushing(SOFT_HAND, "rubber"),  # type: ignore[arg-type]
        "torque [0.    4.812 0.   ] N m needs a pitch of 92 degrees; this grasp's map ends at 90: ask for less torque "
        "or a stiffer grip": lambda: hand.angles(np.array((0.0, 4.812346, 0.0))),
        "wrench [-2.40e+00  4.00e-01 -1.00e-01 -2.30e+01  1.53e+02 -1.90e+01] (N m, N): "
        "the displacement does not settle; "
        "the force bends the grasp too far: ask for less or grip more firmly": lambda: hand.pose(too_far),
    }
    for words, ask in refusals.items():
        with pytest.raises((ConfigError, BushingError)) as refused:
            ask()
        assert str(refused.value) == words


def test_a_stiffness_below_one_is_one() -> None:
    assert Stiffness((0.01, 0.02, 0.03), (0.5, 0.6, 0.7)).scaled(10.0).translation == (5.0, 6.0, 7.0)


def test_a_firmer_grip_scales_every_axis() -> None:
    assert SOFT_HAND.scaled(2.0) == Stiffness((8.0, 6.0, 8.0), (1600.0, 2400.0, 1600.0))


@pytest.mark.parametrize("model", ["midpoint", "plain"])
def test_translation_and_its_stiffness_are_the_parts_of_the_map(model: str) -> None:
    bushing = Bushing(SOFT_HAND, model)  # type: ignore[arg-type]
    X_TC = pose_from_rpy((0.2, -0.3, 0.4), (3e-3, -2e-3, 4e-3))
    force = bushing.wrench(X_TC).force
    assert_allclose(bushing.translation(force, X_TC[:3, :3]), X_TC[:3, 3], atol=1e-15)
    assert_allclose(bushing.translation_stiffness(X_TC[:3, :3]) @ X_TC[:3, 3], force, atol=1e-12)
