# SPDX-License-Identifier: Apache-2.0
"""Kinematics as configured: calibration files are read strictly, and targets out of reach are refused."""

from pathlib import Path

import numpy as np
import pytest
import yaml
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from seed_core.arm.quaternion import as_quaternion
from seed_core.arm.target_checks import Target
from seed_core.errors import SeedError
from seed_core.vector3 import as_vector3
from seed_driver.config import DriverConfig
from seed_driver.motion.calibrated_kinematics import KEYS, LINKS, arm_kinematics, load_calibration, out_of_reach
from seed_ur.kinematics import URKinematics

NOMINAL = URKinematics.for_model("ur5e")


def test_a_target_out_of_reach_is_refused() -> None:
    joints = [0.0, -1.7, 2.1, -1.97, -1.57, 0.0]
    X_WE = NOMINAL.forward(joints)
    p, q = as_vector3(X_WE[:3, 3]), as_quaternion(X_WE[:3, :3])
    assert out_of_reach(Target("base", 0.0, p, q), NOMINAL, joints) == ""
    refusal = out_of_reach(Target("base", 0.0, (p[0] - 0.55, p[1], p[2]), q), NOMINAL, joints)
    assert refusal.startswith("target_frame: pose at (-0.956, -0.133, 0.3")
    assert "out of reach of the ur5e" in refusal


def calibration(tmp_path: Path, error: float) -> Path:
    """A file as ur_calibration writes it, with each nominal entry off by a random `error` [m, rad]."""
    lengths = NOMINAL.model
    rows = {
        "shoulder": (0, 0, lengths.d[0], 0, 0, 0),
        "upper_arm": (0, 0, 0, np.pi / 2, 0, 0),
        "forearm": (lengths.a[1], 0, 0, 0, 0, 0),
        "wrist_1": (lengths.a[2], 0, lengths.d[3], 0, 0, 0),
        "wrist_2": (0, -lengths.d[4], 0, np.pi / 2, 0, 0),
        "wrist_3": (0, lengths.d[5], 0, np.pi / 2, np.pi, np.pi),
    }
    rng = np.random.default_rng(9)
    data = {n: dict(zip(KEYS, map(float, np.add(rows[n], error * rng.uniform(-1, 1, 6))), strict=True)) for n in LINKS}
    file = tmp_path / "calibration.yaml"
    file.write_text(yaml.safe_dump({"kinematics": data}))
    return file


def test_nominal_calibration_is_the_dh_table(tmp_path: Path) -> None:
    arm = load_calibration(str(calibration(tmp_path, 0.0)), NOMINAL)
    for q in np.random.default_rng(1).uniform(-3, 3, (20, 6)):
        assert_allclose(arm.forward(q), NOMINAL.forward(q), atol=1e-12)


def test_calibrated_inverse_reaches_the_pose_and_follows_a_path(tmp_path: Path) -> None:
    arm = load_calibration(str(calibration(tmp_path, 5e-4)), NOMINAL)
    q = np.array([0.2, -1.7, 2.1, -1.9, -1.5, 0.3])
    X = arm.forward(q)
    assert np.linalg.norm((X - NOMINAL.forward(q))[:3, 3]) > 1e-4  # the calibration matters
    assert_allclose(arm.forward(arm.inverse(X, near=q + 0.05)), X, atol=1e-8)
    near = q.tolist()
    for i in range(200):
        step = X.copy()
        step[:3, 3] += [0.0, 2e-4 * i, 0.0]
        step[:3, :3] = X[:3, :3] @ Rotation.from_rotvec([0, 0, 1e-3 * i]).as_matrix()
        near = arm.follow(step, near)
        assert np.linalg.norm((arm.forward(near) - step)[:3, 3]) < 1e-5


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (None, "does not exist; write one with ur_calibration"),
        ("a: [", "not readable as YAML"),
        ("a: 1", "has no 'kinematics' section"),
        ("kinematics: {shoulder: {x: 0}}", "kinematics.shoulder.y = None must be a finite number"),
        ("kinematics: {shoulder: {x: .nan}}", "kinematics.shoulder.x = nan must be a finite number"),
    ],
)
def test_a_bad_calibration_file_is_named(tmp_path: Path, text: str | None, message: str) -> None:
    file = tmp_path / "c.yaml"
    if text is not None:
        file.write_text(text)
    with pytest.raises(SeedError) as caught:
        arm_kinematics(DriverConfig(robot_ip="127.0.0.9", calibration_file=str(file)))
    assert message in str(caught.value)


@pytest.mark.parametrize("path", ["/proc", "~nobody-of-that-name/c.yaml", "a" * 5000])
def test_a_calibration_file_that_cannot_be_read_is_named(path: str) -> None:
    with pytest.raises(SeedError, match=r"calibration_file = .* cannot be read"):
        arm_kinematics(DriverConfig(robot_ip="127.0.0.9", calibration_file=path))


def test_calibration_of_another_arm_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SeedError, match="wrong model or file"):
        load_calibration(str(calibration(tmp_path, 0.0)), URKinematics.for_model("ur10e"))
