# SPDX-License-Identifier: Apache-2.0
"""Set-points refuse what contradicts itself, by number."""

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from seed_control.setpoint.setpoints import HybridSetpoint, RelativePoseSetpoint, SetpointError, WrenchSetpoint
from seed_core.spatial import Wrench, make_pose

Z = np.diag([0.0, 0.0, 1.0])


def load(force: Any = (0.0, 0.0, -5.0), torque: Any = (0.0, 0.0, 0.0)) -> Wrench:
    return Wrench(np.array(torque, dtype=float), np.array(force, dtype=float))


def test_the_default_is_all_position() -> None:
    setpoint = HybridSetpoint(np.eye(4))
    assert_allclose(setpoint.force_projector, np.zeros((3, 3)))
    assert setpoint.torque_axes == (False, False, False)
    assert_allclose(setpoint.wrench.vector(), np.zeros(6))


@pytest.mark.parametrize(
    ("code", "values"),
    [
        ("SP01", {"task_frame": "flange"}),
        ("SP01", {"task_frame": "world", "R_W_task": np.diag([1.0, -1.0, -1.0])}),
        ("SP02", {"velocity": np.zeros(2)}),
        ("SP03", {"wrench": load((0.0, 0.0, np.nan)), "force_projector": Z}),
        ("SP03", {"velocity": np.array((np.inf, 0.0, 0.0))}),
        ("SP04", {"R_W_task": 2.0 * np.eye(3), "task_frame": "surface"}),
        ("SP05", {"force_projector": 0.5 * Z}),
        ("SP05", {"force_projector": np.array([[0, 1, 0], [0, 1, 0], [0, 0, 0.0]])}),
        ("SP05", {"force_projector": np.full((3, 3), np.nan)}),
        ("SP06", {"wrench": load((1.0, 0.0, -5.0)), "force_projector": Z}),
        ("SP07", {"torque_axes": (True, False, False)}),
        ("SP08", {"approach_speed": -0.1}),
        ("SP08", {"velocity": np.array((50.0, 0.0, 0.0))}),  # in mm/s
    ],
)
def test_contradictions_are_refused(code: str, values: dict[str, Any]) -> None:
    with pytest.raises(SetpointError) as caught:
        HybridSetpoint(np.eye(4), **values)
    assert caught.value.code == code
    assert str(caught.value).startswith(f"{code}: ")


def test_poses_must_be_poses() -> None:
    with pytest.raises(SetpointError, match=r"SP04.*not finite"):
        HybridSetpoint(np.full((4, 4), np.nan))
    with pytest.raises(SetpointError, match=r"SP04.*orthonormal"):
        RelativePoseSetpoint(make_pose(1.2 * np.eye(3)))
    with pytest.raises(SetpointError, match=r"SP01.*known: world, tool"):
        WrenchSetpoint(load(), frame="surface")


def test_any_projector_is_accepted() -> None:
    n = np.array((1.0, 2.0, 2.0)) / 3.0
    setpoint = HybridSetpoint(np.eye(4), load(-6.0 * n), np.outer(n, n))
    assert_allclose(setpoint.force_projector @ n, n)


def test_values_are_copied_and_read_only() -> None:
    X = np.eye(4)
    setpoint = HybridSetpoint(X)
    X[0, 3] = 1.0
    assert setpoint.X_W_tip[0, 3] == 0.0
    with pytest.raises(ValueError, match=r"read-only"):
        setpoint.X_W_tip[0, 3] = 1.0


def test_moved_changes_the_place_alone_and_checks_it() -> None:
    setpoint = HybridSetpoint(np.eye(4), load(), Z)
    there = setpoint.moved(make_pose(p=(1.0, 0.0, 0.0)), np.array((0.1, 0.0, 0.0)))
    assert_allclose(there.X_W_tip[:3, 3], (1.0, 0.0, 0.0))
    assert there.wrench is setpoint.wrench
    with pytest.raises(SetpointError, match=r"SP04"):
        setpoint.moved(np.zeros((4, 4)), np.zeros(3))
