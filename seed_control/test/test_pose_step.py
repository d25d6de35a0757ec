# SPDX-License-Identifier: Apache-2.0
"""Poses that are wrong from one image on: what a tool that stands shows, and what nothing shows while it wipes."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from quasi_static import DT, Bench

from seed_control.monitor.pose_step import PoseStep
from seed_core.estimate import RelativePoseEstimate
from seed_core.spatial import make_pose

NOISE = 3e-4  # [m]


def wrong(bench: Bench, by: float) -> None:
    """From now on the images have the tool too far from the gripper, along its z [m]."""

    def told(estimate: RelativePoseEstimate) -> RelativePoseEstimate:
        return replace(estimate, X_CT=make_pose(p=(0.0, 0.0, by)) @ estimate.X_CT)

    bench.told = told


def wipe(bench: Bench, seconds: float, speed: float = 0.05) -> None:
    """Pressed on along x, from where it is."""
    setpoint, X = bench.press(5.0), bench.start
    for _ in range(round(seconds / DT)):
        X[0, 3] += speed * DT
        bench.controller.set_setpoint(setpoint.moved(X.copy(), np.array((speed, 0.0, 0.0))), bench.t)
        bench.step()


def pressed() -> Bench:
    """With 5 N, and noise."""
    bench = Bench(noise=NOISE).enabled()
    bench.press(5.0)
    bench.run(1.6)
    assert bench.state.reason == ""
    return bench


@pytest.mark.parametrize("by", [1.5e-3, -1.5e-3])
def test_a_pose_that_steps_while_the_gripper_stands_is_told(by: float) -> None:
    """A tip that stands crosses no step of the surface: 1.5 mm are five deviations of an image, and 1.2 N."""
    bench = pressed()
    wrong(bench, by)
    bench.run(1.0)
    assert bench.state.mode == "contact"
    assert abs(bench.force - 5.0) > 0.8
    assert "though the gripper stood" in bench.state.reason


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_step_that_a_surface_might_have_holds_where_the_gripper_stands(sign: float) -> None:
    """2.6 mm are 2 N, and nearly nine deviations of an image. Once enabled again, the zero is in doubt."""
    bench = pressed()
    wrong(bench, sign * 2.6e-3)
    bench.run(0.4)
    assert bench.state.mode == "holding"
    assert "though the gripper stood" in bench.state.reason
    assert bench.force < 7.0
    bench.controller.enable(bench.t)
    bench.press(5.0)
    bench.run(0.2)
    assert "has not hung free since" in bench.state.reason


def seen(check: PoseStep, tool: float, gripper=(0.0, 0.0), tip=0.0, force: float = 5.0, images: int = 8) -> None:
    """Heights of tool and gripper [m], and places of gripper and tip across; 800 N/m, 5 N are wanted."""
    tip += gripper[1]
    n, X_WT = np.array((0.0, 0.0, 1.0)), make_pose(p=(0.0, 0.0, tool))
    X_WC = make_pose(p=(gripper[1], 0.0, 0.3 + gripper[0]))
    on_environment = SimpleNamespace(force=force * n)
    m = SimpleNamespace(X_WC=X_WC, X_WT=X_WT, on_environment=on_environment, variance=1e-8)
    for _ in range(images):
        check.update(m, n, 5.0, np.array((tip - gripper[1], 0.0, 0.1)), 800.0)  # type: ignore[arg-type]


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(
    ("tool", "gripper", "tip", "force", "told", "holds"),
    [
        (1.2e-3, (0.0, 0.0), 0.0, 5.0, "", False),  # 0.96 N, less than a fifth of what is wanted
        (1.3e-3, (0.0, 0.0), 0.0, 5.0, "1.3 mm", False),  # less than seven deviations, which are 0.2 mm at least
        (1.5e-3, (0.0, 0.0), 0.0, 5.0, "1.5 mm", True),
        (2.2e-3, (0.9e-3, 0.0), 0.0, 5.0, "1.3 mm", False),  # it gives way to the gripper
        (2.2e-3, (-0.9e-3, 0.0), 0.0, 5.0, "2.2 mm", True),
        (3.0e-3, (1.1e-3, 0.0), 0.0, 5.0, "", False),  # that presses on
        (2.2e-3, (0.0, 1.1e-3), -1.1e-3, 5.0, "2.2 mm", True),  # it turns about the tip
        (2.2e-3, (0.0, 0.0), 1.1e-3, 5.0, "2.2 mm", True),
        (2.2e-3, (0.0, 1.1e-3), 0.0, 5.0, "", False),  # both go across
        (2.2e-3, (0.0, 0.0), 0.0, 1.4, "", False),  # contact was lost
    ],
)
def test_a_step_is_what_the_gripper_does_not_explain(tool, gripper, tip, force, told, holds, sign: float) -> None:
    check = PoseStep()
    seen(check, 0.0)
    seen(check, sign * tool, (sign * gripper[0], gripper[1]), tip, force)
    assert bool(check.warning) is bool(told)
    assert told in check.warning
    assert bool(check.reason) is holds


def test_a_step_is_one_from_image_to_image_without_a_gap_and_the_largest_is_told() -> None:
    check = PoseStep()
    seen(check, 0.0)
    check.clear()
    seen(check, 2e-3)
    assert not check.warning
    for step, told in ((2e-3, "2.0 mm"), (1.5e-3, "2.0 mm"), (2.5e-3, "2.5 mm")):
        check.clear()
        seen(check, 0.0)
        seen(check, step)
        assert told in check.warning
    slow = PoseStep()
    for i in range(40):
        seen(slow, 2e-4 * i, images=1)  # 3 mm within 16 images
    assert not slow.warning


def test_a_surface_that_is_gone_is_no_step_of_the_poses() -> None:
    """3 N and 3.7 mm: no more than is told, and contact is sought again."""
    bench = Bench(noise=NOISE).enabled()
    bench.press(3.0)
    bench.run(2.0)
    bench.table = -0.02
    bench.run(0.4)
    assert bench.state.mode == "approach"
    assert "gripper stood" not in bench.state.reason


def test_a_table_that_swings_is_no_step() -> None:
    """3 mm at 1 Hz: the tool moves for longer than from one image to the next."""
    bench = pressed()
    for _ in range(round(2.0 / DT)):
        bench.table = 3e-3 * np.sin(2.0 * np.pi * bench.t)
        bench.step()
        assert "gripper stood" not in bench.state.reason


def test_a_wrong_pose_of_a_tool_that_wipes_is_measured_as_a_step_of_the_table_is() -> None:
    """The command answers what is measured, and a wrong pose changes that as a true step does: nothing else is known.

    So the arm goes the same way, and the grasp is told the same, while the forces differ.
    """
    step, told, forces = 1e-3, list[np.ndarray](), list[float]()
    for true in (False, True):
        bench = pressed()
        wipe(bench, 0.5)
        if true:  # the tip goes up by the step: the table gives way as well
            bench.table = step * (1.0 + 800.0 / bench.k_table)
        else:  # C's z points down
            wrong(bench, -step)
        wipe(bench, 1.5)
        m = bench.controller.law.measured
        assert m is not None
        assert bench.state.reason == ""
        told.append(np.array((*bench.commands, m.X_CT)))
        forces.append(float(bench.force))
    assert_allclose(told[0], told[1], rtol=0.0, atol=1e-9)
    assert abs(forces[0] - forces[1]) == pytest.approx(800.0 * step, rel=0.05)
