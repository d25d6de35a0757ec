# SPDX-License-Identifier: Apache-2.0
"""The wrench from the membranes' motion: mirrors, frames, slopes, covariance, ranges, pressures, and its file."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from seed_core.config import ConfigError
from seed_core.estimate import MembraneMotion, RelativePoseEstimate
from seed_core.membrane.features import MIRROR, NAMES, SCALES, by_finger, features, gripper_rates
from seed_core.membrane.map import GRASPED, LEVER, UNLEARNED, MembraneMap, pressure_reason
from seed_core.membrane.map_file import GripMap, MembraneMapFile, format_rows, load_membrane_map, save_membrane_map
from seed_core.spatial import Array, Wrench, inverse_pose, pose_from_rpy, so3_exp
from seed_core.wrench_model import WithMemory

MIDDLES = np.array([[0.001, 0.012, 0.002], [0.001, -0.012, 0.002]])
LINEAR = ("roll-", "pitch+", "yaw-", "x+", "y-", "z+")
STIFFNESS = (2.0, 0.5, 1.0, 800.0, 1200.0, 900.0)  # [N m/rad, N/m]
PRODUCTS = ("x+ * y-", "x+ * x+ * x+", "z+ * roll- * y-", "x by u+ * x+")
AT_GRASP = 1030.0  # [hPa]


def made(products: tuple[str, ...] = PRODUCTS, gas: bool = False, width: float = 0.02) -> MembraneMapFile:
    """A map whose diagonal stiffness is STIFFNESS where the patches stick, with some products on top."""
    terms = LINEAR + products
    C = np.zeros((6, len(terms)))
    for i, (name, k) in enumerate(zip(LINEAR, STIFFNESS, strict=True)):
        C[i, i] = -k * SCALES[NAMES.index(name)]
    rng = np.random.default_rng(3)
    C[:3, 6:], C[3:, 6:] = 0.003 * rng.normal(size=(3, len(products))), 0.2 * rng.normal(size=(3, len(products)))
    rise = np.zeros((2, len(terms)))
    rise[1, terms.index("y-")] = 0.5  # [2 hPa] at 2 mm
    grip = GripMap(
        pressure_hpa=AT_GRASP,
        width_m=width,
        left_middle=tuple(MIDDLES[0]),
        right_middle=tuple(MIDDLES[1]),
        torque_std=(0.002,) * 3,
        force_std=(0.1,) * 3,
        coefficients=format_rows(C),
        spread=format_rows(0.1 * np.eye(len(terms))),
        pressure_rise=format_rows(rise) if gas else (),
        pressure_std=(0.02, 0.02),
    )
    return MembraneMapFile("h", "t", "2026-01-31", tuple(SCALES.tolist()), terms, (3.0,) * len(NAMES), 2.0, (grip,))


def stuck(
    X_CT: Array, pressures: tuple[float, float] = (np.nan, np.nan), variance: float = 0.0
) -> RelativePoseEstimate:
    """Patches that stick to the tool, which has gone to X_CT."""
    covariance = variance * np.diag([1.0] * 3 + [1e-4] * 3)
    both = [
        MembraneMotion(f, X_CT, covariance, deformation=np.zeros(9), pressure=p)
        for f, p in zip(("right", "left"), pressures[::-1], strict=True)
    ]
    return RelativePoseEstimate(0.0, X_CT, membrane=tuple(both))


def about_C(X_CT: Array, wrench: Wrench) -> Array:
    R = X_CT[:3, :3]
    return np.concatenate([R @ wrench.torque + np.cross(X_CT[:3, 3], R @ wrench.force), R @ wrench.force])


def test_a_linear_map_pulls_the_tool_back_with_its_stiffness() -> None:
    X_CT = pose_from_rpy((0.0, 0.0, 0.0), (0.001, -0.002, 0.0015))
    w = MembraneMap(made(())).spring(stuck(X_CT)).wrench
    assert_allclose(w.force, -np.array(STIFFNESS[3:]) * X_CT[:3, 3], rtol=1e-9)


def test_the_mirror_swaps_the_fingers() -> None:
    rng = np.random.default_rng(0)
    left, right = (
        MembraneMotion(f, pose_from_rpy(rng.normal(0, 0.05, 3), rng.normal(0, 1e-3, 3)), deformation=rng.normal(size=9))
        for f in ("left", "right")
    )
    S = np.diag([1.0, -1.0, 1.0, 1.0])

    def seen(m: MembraneMotion, finger: str) -> MembraneMotion:
        return replace(m, finger=finger, X_CM=S @ m.X_CM @ S)

    z = features((left, right), MIDDLES, (1.0, 3.0))
    mirrored = features((seen(right, "left"), seen(left, "right")), (MIDDLES @ S[:3, :3])[::-1], (3.0, 1.0))
    assert_allclose(mirrored[:16], z[:16], atol=1e-12)
    assert_allclose(mirrored[16:], -z[16:], atol=1e-12)
    assert len(MIRROR) == 16


def test_the_wrench_is_that_of_C_moved_to_the_tool() -> None:
    X_CT = pose_from_rpy((0.1, -0.15, 0.2), (0.003, 0.002, -0.004))
    model = MembraneMap(made())
    still = replace(stuck(X_CT), X_CT=np.eye(4))
    assert_allclose(about_C(X_CT, model.spring(stuck(X_CT)).wrench), model.spring(still).wrench.vector(), atol=1e-12)


def test_an_axis_that_is_not_observed_does_not_turn_the_wrench() -> None:
    X_CT = pose_from_rpy((0.0, 0.3, 0.0), (0.003, 0.002, -0.004))
    unseen = replace(stuck(X_CT), observed=(True, True, True, True, False, True))
    upright = replace(unseen, X_CT=pose_from_rpy((0.0, 0.0, 0.0), X_CT[:3, 3]))
    wrench = MembraneMap(made()).spring(unseen).wrench
    assert_allclose(wrench.vector(), MembraneMap(made()).spring(upright).wrench.vector(), atol=1e-12)
    assert np.linalg.norm(wrench.force) > 1.0  # [N]


@pytest.mark.parametrize("gas", [False, True])
def test_local_stiffness_is_the_derivative_by_the_grippers_motion(gas: bool) -> None:
    X_CT = pose_from_rpy((0.03, -0.02, 0.04), (0.002, 0.001, -0.003))
    file = made((*PRODUCTS, "pressure-") if gas else PRODUCTS, gas)

    def pressures(X: Array) -> tuple[float, float]:
        z = features(by_finger(stuck(X).membrane), MIDDLES)
        half = 2.0 * 0.5 * z[NAMES.index("y-")] if gas else 0.0
        return AT_GRASP + half, AT_GRASP - half

    def load(X: Array) -> Array:
        model = MembraneMap(file)
        model.grasped(AT_GRASP, AT_GRASP)
        return model.spring(stuck(X, pressures(X))).wrench.vector()

    model = MembraneMap(file)
    model.grasped(AT_GRASP, AT_GRASP)
    model.spring(stuck(X_CT, pressures(X_CT)))
    X_TC, h, K = inverse_pose(X_CT), 1e-6, []
    for i in range(6):
        ends = []
        for sign in (1.0, -1.0):
            step = np.zeros(6)
            step[i] = sign * h
            X = X_TC.copy()  # C turns and shifts, both written in T
            X[:3, :3], X[:3, 3] = so3_exp(step[:3]) @ X_TC[:3, :3], X_TC[:3, 3] + step[3:]
            ends.append(load(inverse_pose(X))[i])
        K.append((ends[0] - ends[1]) / (2 * h))
    assert_allclose(model.stiffness.vector(), K, rtol=5e-3)  # the turn's inverse Jacobian ends at its second term


def test_a_band_that_follows_by_half_makes_the_local_stiffness_half() -> None:
    file, X_CT = made(()), pose_from_rpy((0.03, -0.02, 0.04), (0.002, 0.001, -0.003))
    at_rest = stuck(np.eye(4)).membrane
    whole = -gripper_rates(by_finger(at_rest), MIDDLES)  # while C stays and the tool moves
    half = replace(file, grips=(replace(file.grips[0], follow=format_rows(0.5 * whole)),))
    assert_allclose(MembraneMap(half).stiffness.vector(), 0.5 * MembraneMap(file).stiffness.vector(), rtol=1e-5)
    models = MembraneMap(file), MembraneMap(half)
    for model in models:
        model.spring(stuck(X_CT))
    assert (models[1].stiffness.vector() < 0.7 * models[0].stiffness.vector()).all()


def test_covariance_has_the_estimates_the_coefficients_and_the_residuals_share() -> None:
    X_CT, model = pose_from_rpy((0.02, 0.01, -0.03), (0.001, 0.001, 0.002)), MembraneMap(made())
    alone = model.spring(stuck(X_CT)).covariance
    assert alone[3, 3] > 0.1**2
    more = model.spring(stuck(X_CT, variance=1e-4)).covariance - alone
    rng, loads = np.random.default_rng(1), []
    for _ in range(4000):
        both = []
        for m in stuck(X_CT).membrane:
            e = rng.normal(size=6) * np.repeat([1e-2, 1e-4], 3)
            X = m.X_CM.copy()
            X[:3, :3], X[:3, 3] = so3_exp(e[:3]) @ X[:3, :3], X[:3, 3] + e[3:]
            both.append(replace(m, X_CM=X))
        loads.append(model.spring(replace(stuck(X_CT), membrane=tuple(both))).wrench.vector())
    assert_allclose(np.diag(more), UNLEARNED * np.var(loads, axis=0), rtol=0.15)


def test_a_new_grasp_is_off_by_a_share_of_the_load_and_by_a_lever() -> None:
    file = replace(made(), motion=1e9)  # of the residual nothing grows
    X = pose_from_rpy((0, 0, 0), (0.004, 0, 0))
    told, rest = MembraneMap(file).spring(stuck(X)), MembraneMap(file).spring(stuck(np.eye(4)))
    f, more = told.wrench.force, np.diag(told.covariance - rest.covariance)
    off = rest.wrench.force
    assert (more[3:] >= 0.99 * GRASPED**2 * (f**2 - off**2)).all()
    assert (more[:3] >= 0.99 * LEVER**2 * (f @ f - off @ off)).all()


def test_the_residual_grows_with_the_motion() -> None:
    file = replace(made(), motion=4.0)
    small, large = (pose_from_rpy((0, 0, 0), (x, 0, 0)) for x in (0.0005, 0.008))  # squares 1/16 and 16 scales
    for X, growth in ((small, 0.1), (large, 4.0)):
        more = MembraneMap(file).spring(stuck(X)).covariance - MembraneMap(made()).spring(stuck(X)).covariance
        assert_allclose(more[4, 4], 0.1**2 * (growth - 1.0), rtol=1e-6)


def test_without_motion_of_both_membranes_there_is_no_wrench() -> None:
    model, good = MembraneMap(made()), stuck(np.eye(4))
    lost = replace(good.membrane[0], deformation=np.zeros(0))
    wild = replace(good.membrane[0], X_CM=np.full((4, 4), np.nan))
    for membrane in (
        (),
        good.membrane[:1],
        (good.membrane[0],) * 2,
        (lost, good.membrane[1]),
        (wild, good.membrane[1]),
    ):
        told = model.spring(replace(good, membrane=membrane))
        assert told.covariance.shape == (6, 6)
        assert np.isinf(told.covariance).all()
        assert np.isfinite(told.wrench.vector()).all()
        assert "no wrench from the membranes" in told.reason


def test_beyond_the_identified_range_it_says_so() -> None:
    file = replace(made(), leverage=1e6)
    assert MembraneMap(file).spring(stuck(pose_from_rpy((0, 0, 0), (0.008, 0, 0)))).reason == ""
    assert (
        "x+ is 0.01, identified up to 0.006"
        in MembraneMap(file).spring(stuck(pose_from_rpy((0, 0, 0), (0.010, 0, 0)))).reason
    )
    assert (
        "motions were not identified together (x+ is 0.004 of 0.006, the largest)"
        in MembraneMap(replace(file, leverage=1e-3)).spring(stuck(pose_from_rpy((0, 0, 0), (0.004, 0, 0)))).reason
    )


@pytest.mark.parametrize(
    ("pressure", "words"),
    [
        (1035.0, ""),
        (17.0, "above the ambient one"),
        (103.0, "looks like kPa"),
        (103000.0, "looks like Pa"),
        (1.03, "looks like bar"),
        (1100.0, "another membrane, another grip, or a leak"),
    ],
)
def test_pressures_of_another_grip_or_unit_are_named(pressure: float, words: str) -> None:
    reason = pressure_reason("left", pressure, AT_GRASP)
    assert (words in reason) if words else reason == ""
    assert (reason == "") or f"{pressure:.4g} hPa" in reason


def test_a_pressure_that_does_not_follow_the_motion_is_named() -> None:
    pushed = pose_from_rpy((0, 0, 0), (0, 0.004, 0))
    model = MembraneMap(made(gas=True))
    model.spring(stuck(np.eye(4), (AT_GRASP, AT_GRASP)))
    assert model.spring(stuck(pushed, (AT_GRASP + 2.0, AT_GRASP - 2.0))).reason == ""
    silent = model.spring(stuck(pushed, (AT_GRASP, AT_GRASP))).reason
    assert "[0.0, 0.0] hPa rise in common and apart, [0.0, 2.0] hPa expected; it hardly changes: silent or st" in silent
    assert "look for a leak" in model.spring(stuck(pushed, (AT_GRASP - 1.0, AT_GRASP - 4.0))).reason


def test_pressures_that_creep_while_the_tool_hangs_count_from_there() -> None:
    hanging, pushed = pose_from_rpy((0, 0, 0), (0, 0.0, 0.0008)), pose_from_rpy((0, 0, 0), (0, 0.004, 0.0008))
    model = MembraneMap(made(gas=True))
    model.spring(stuck(np.eye(4), (AT_GRASP, AT_GRASP)))
    for i in range(300):
        crept = AT_GRASP - 1.5 * (1.0 - np.exp(-i / 90.0))
        assert model.spring(stuck(hanging, (crept, crept))).reason == ""
    assert model.spring(stuck(pushed, (crept + 2.0, crept - 2.0))).reason == ""
    falls = [model.spring(stuck(pushed, (crept + 2.0 - p, crept - 2.0 - p))).reason for p in (0.4, 1.5)]
    assert falls[0] == ""
    assert "look for a leak" in falls[1]


def test_pressures_that_a_light_load_raises_are_not_those_at_the_grasp() -> None:
    model, most = MembraneMap(made(gas=True)), 0.0011  # [m] along y
    for i in range(400):
        y = most * min(i / 300, 1.0)
        rise = 500.0 * y  # [hPa]
        assert model.spring(stuck(pose_from_rpy((0, 0, 0), (0, y, 0)), (AT_GRASP + rise, AT_GRASP - rise))).reason == ""
    assert model.spring(stuck(np.eye(4), (AT_GRASP, AT_GRASP))).reason == ""


def test_an_estimate_that_was_none_leaves_the_pressures_at_the_grasp() -> None:
    pushed, model = pose_from_rpy((0, 0, 0), (0, 0.004, 0)), MembraneMap(made(gas=True))
    model.spring(stuck(np.eye(4), (AT_GRASP, AT_GRASP)))
    model.spring(stuck(pushed, (AT_GRASP + 2.0, AT_GRASP - 2.0)))
    model.take_back()
    assert "silent or stuck" in model.spring(stuck(pushed, (AT_GRASP, AT_GRASP))).reason


def test_pressures_count_from_the_newest_grasp() -> None:
    pushed, after = pose_from_rpy((0, 0, 0), (0, 0.004, 0)), AT_GRASP + 3.0
    model = MembraneMap(made(gas=True))
    assert isinstance(model, WithMemory)
    model.spring(stuck(np.eye(4), (AT_GRASP, AT_GRASP)))
    assert "do not go with the motion" in model.spring(stuck(np.eye(4), (after, after))).reason
    model.reset()
    model.spring(stuck(np.eye(4), (AT_GRASP, AT_GRASP)))
    model.take_back()  # that was none
    assert model.spring(stuck(np.eye(4), (after, after))).reason == ""
    assert model.spring(stuck(pushed, (after + 2.0, after - 2.0))).reason == ""


def test_more_is_left_to_pressures_where_the_motion_is_larger_than_at_the_identification() -> None:
    far = pose_from_rpy((0, 0, 0), (0, 0.004, 0))
    told = []
    for motion in (2.0, 0.05):  # mean square of the identification's motions [scales]
        model = MembraneMap(replace(made(gas=True), motion=motion))
        model.grasped(AT_GRASP, AT_GRASP)
        told.append(model.spring(stuck(far, (AT_GRASP + 2.8, AT_GRASP - 2.8))).reason)
    assert "do not go with the motion" in told[0]
    assert told[1] == ""


def test_between_grips_the_map_is_straight(tmp_path: Path) -> None:
    wide, narrow = made(width=0.03).grips[0], made(width=0.01).grips[0]
    narrow = replace(narrow, coefficients=format_rows(2.0 * narrow.matrix), pressure_hpa=1050.0)
    file = replace(made(), grips=(wide, narrow))
    path = tmp_path / "membrane_map.yaml"
    save_membrane_map(path, file)
    assert load_membrane_map(path) == file
    X = pose_from_rpy((0.01, 0.02, 0.01), (0.001, 0.002, 0.001))
    loads = [MembraneMap.load(path).at_width(w).spring(stuck(X)).wrench.force for w in (0.04, 0.03, 0.015, 0.01, 0.0)]
    assert_allclose(loads[0], loads[1])
    assert_allclose(loads[2], 1.75 * loads[1], rtol=1e-4)
    assert_allclose(loads[3], loads[4])
    assert_allclose(loads[4], 2.0 * loads[1], rtol=1e-4)
    between = MembraneMap(file).at_width(0.015).grip
    assert_allclose((between.width_m, between.pressure_hpa), (0.015, 1045.0))
    for unknown in ((replace(wide, pressure_hpa=0.0), narrow), (wide, replace(narrow, pressure_hpa=0.0))):
        assert MembraneMap(replace(file, grips=unknown)).at_width(0.015).grip.pressure_hpa == 0.0
    with pytest.raises(ConfigError, match="width = nan m must be finite"):
        MembraneMap(file).at_width(float("nan"))


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("- x+ * y-", "- x+ * yaw", "'x\\+ \\* yaw' is no product of at most 3 features"),
        ("version: 3", "version: 2", "version = 2 must be 3: the map is of another estimator; identify again"),
        ("  follow: []", "  follow: [0 1 2 3 4 5]", "follow is \\(1, 6\\); 32 rows of 6 are needed"),
        ("- x+ * y-\n", "", "coefficients is 6 by 10; 6 rows of 9"),
        ("scales:\n- 0.07", "scales:\n- 0.08", "scales are not those of this program"),
        ("force_std:\n  - 0.1", "force_std:\n  - -0.1", "must be within 0 and 1000"),
        ("hand: h\n", "", "'hand' is missing"),
    ],
)
def test_bad_files_are_refused(tmp_path: Path, old: str, new: str, words: str) -> None:
    path = tmp_path / "membrane_map.yaml"
    save_membrane_map(path, made())
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    with pytest.raises(ConfigError, match=words):
        load_membrane_map(path)


@pytest.mark.parametrize("name", ["coefficients", "spread"])
def test_a_matrix_without_rows_is_refused(name: str) -> None:
    file = made()
    with pytest.raises(ConfigError, match=f"{name} has no rows"):
        replace(file, grips=(replace(file.grips[0], **{name: ()}),))
    bare = replace(file.grips[0], coefficients=("",) * 6, spread=("",))
    with pytest.raises(ConfigError, match="terms is empty"):
        replace(file, terms=(), grips=(bare,))


def test_a_map_that_pushes_is_refused() -> None:
    file = made()
    with pytest.raises(ConfigError, match="must be > 0"):
        MembraneMap(replace(file, grips=(replace(file.grips[0], coefficients=format_rows(-file.grips[0].matrix)),)))
