# SPDX-License-Identifier: Apache-2.0
"""The normal is found from track, force and lean, with an honest covariance; a path carried along goes on straight."""

from collections.abc import Callable, Iterator
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from numpy.typing import ArrayLike

from seed_control.law.surface_normal import SurfaceNormal
from seed_control.setpoint.setpoints import HybridSetpoint
from seed_control.tasks import load_task
from seed_control.tasks.steps import steps_of
from seed_control.tasks.surface_run import SurfaceRun, carried
from seed_core.spatial import Array, Wrench, make_pose, rotation_from_rpy, so3_exp

DT, SPEED, LOOP = 1.0 / 45.0, 0.05, 0.08  # [s], [m/s], [s]
NOISE = 3e-4  # [m]
STIFFNESS = 900.0  # [N/m]
FRICTION = 0.4
WIPE, SETTLED = 2.4, 0.6  # [s]
Place = Callable[[float], tuple[Array, Array, Array]]


def measurement(
    t: float, tip: Array, n: Array, v: Array, rng: np.random.Generator, R_WT: Array, friction: float = FRICTION
) -> SimpleNamespace:
    """An image of a tip that slides with v on a surface of normal n, pressed with 10 N; noise of a grasp."""
    force = 10.0 * (-n + friction * v / np.linalg.norm(v)) + STIFFNESS * NOISE * rng.standard_normal(3)
    return SimpleNamespace(
        stamp=t,
        tip=tip + NOISE * rng.standard_normal(3),
        undeflected=tip - 10.0 / STIFFNESS * n,
        X_WC=make_pose(None, tip + np.array((0.0, 0.0, 0.09))),
        X_WT=make_pose(R_WT, tip),
        on_environment=Wrench(np.zeros(3), force),
        variance=NOISE**2,
        rotation_deviation=0.01,
    )


def constant(_: Array) -> float:
    return FRICTION


def wiped(
    place: Place, seed: int, friction: Callable[[Array], float] = constant
) -> Iterator[tuple[float, SurfaceNormal]]:
    """Times of images [s] and the filter after each; place: tip, normal and velocity (3,) by time; friction: by tip."""
    rng, filter_ = np.random.default_rng(seed), SurfaceNormal()
    for i in range(round(WIPE / DT)):
        tip, n, v = place(i * DT)
        m = measurement(i * DT, tip, n, v, rng, np.eye(3), friction(tip))
        if i == 0:
            filter_.expect(np.array((0.0, 0.0, 1.0)))
            filter_.start(m)  # type: ignore[arg-type]
        s = HybridSetpoint(make_pose(None, tip), task_frame="found", velocity=v)
        filter_.image(m, s, STIFFNESS, LOOP)  # type: ignore[arg-type]
        yield i * DT, filter_


def off(found: Array, n: Array) -> float:
    """Angle [rad] between unit normals."""
    return float(np.arccos(np.clip(found @ n, -1.0, 1.0)))


def along(radius: float, heading: float, seed: int) -> tuple[list[float], SurfaceNormal]:
    """Errors [rad] of the normal ahead over a way across a cylinder along y, at a heading [rad] from x."""
    start = -0.15

    def place(t: float) -> tuple[Array, Array, Array]:
        angle = start + SPEED * np.cos(heading) * t / radius
        n = np.array((np.sin(angle), 0.0, np.cos(angle)))
        tip = radius * n + np.array((0.0, SPEED * np.sin(heading) * t, -radius))
        v = SPEED * np.array((np.cos(heading) * np.cos(angle), np.sin(heading), -np.cos(heading) * np.sin(angle)))
        return tip, n, v

    errors = []
    for t, filter_ in wiped(place, seed):
        if t > SETTLED:
            errors.append(off(filter_.ahead, place(t + LOOP)[1]))
    return errors, filter_


def deviation(filter_: SurfaceNormal) -> float:
    """Of the normal [rad], in its worse direction, as the filter has it."""
    return float(np.sqrt(np.linalg.eigvalsh(filter_.P[1:3, 1:3])[-1]))


@pytest.mark.parametrize("radius", [0.08, 0.5, 1e3])
@pytest.mark.parametrize("heading", [0.0, 0.35])
def test_the_normal_ahead_is_found_on_cylinders_of_unknown_radius(radius: float, heading: float) -> None:
    errors = np.concatenate([along(radius, heading, seed)[0] for seed in range(4)])
    assert rms_deg(errors) < 3.0


def over_hills(height: float, seed: int, friction: Callable[[Array], float] = constant) -> list[float]:
    """Errors [rad] of the normal at the tip over hills 0.1 m long, of such a height [m]."""
    wave = 2.0 * np.pi / 0.1

    def place(t: float) -> tuple[Array, Array, Array]:
        x = SPEED * t
        slope = wave * height * np.cos(wave * x)
        n, v = np.array((-slope, 0.0, 1.0)), np.array((1.0, 0.0, slope))
        return np.array((x, 0.0, height * np.sin(wave * x))), n / np.linalg.norm(n), SPEED * v / np.linalg.norm(v)

    return [off(filter_.n, place(t)[1]) for t, filter_ in wiped(place, seed, friction) if t > SETTLED]


def rms_deg(errors: ArrayLike) -> float:
    return float(np.rad2deg(np.sqrt(np.mean(np.square(errors)))))


def test_hills_are_followed() -> None:
    rms = [rms_deg(over_hills(2e-3, seed)) for seed in range(8)]
    assert np.median(rms) < 3.5  # 3.1; 4.4 with bends that were expected to change half as fast


@pytest.mark.parametrize("friction", [0.0, 0.1, 0.8])
def test_friction_of_any_size_is_no_slope(friction: float) -> None:
    errors = np.concatenate([over_hills(0.0, seed, lambda _: friction) for seed in range(8)])
    assert rms_deg(errors) < 2.0


def test_friction_that_changes_along_the_way_is_hardly_a_slope() -> None:
    errors = [
        over_hills(0.0, seed, lambda tip: FRICTION + 0.1 * np.sin(tip[0] / 0.04 * 2.0 * np.pi)) for seed in range(8)
    ]
    assert rms_deg(np.concatenate(errors)) < 3.0


def test_the_covariance_says_how_far_off_the_normal_is() -> None:
    ratios = []
    for seed in range(12):
        errors, filter_ = along(0.2, 0.0, seed)
        ratios.append(errors[-1] / deviation(filter_))
    assert 0.1 < np.sqrt(np.mean(np.square(ratios))) < 2.0


def test_a_tip_that_stands_still_turns_no_normal() -> None:
    rng, filter_ = np.random.default_rng(1), SurfaceNormal()
    pull = np.array((0.05, 0.0, 0.0))
    for i in range(90):
        m = measurement(i * DT, np.zeros(3), np.array((0.0, 0.0, 1.0)), pull, rng, np.eye(3))
        if i == 0:
            filter_.start(m)  # type: ignore[arg-type]
        s = HybridSetpoint(np.eye(4), task_frame="found", velocity=pull)
        filter_.image(m, s, STIFFNESS, LOOP)  # type: ignore[arg-type]
    assert np.rad2deg(np.arccos(filter_.ahead[2])) < 3.0


@pytest.mark.parametrize(("leans", "slope"), [(0.4, 0.0), (0.9, 0.195)])
def test_a_tip_that_sticks_shows_a_slope_where_friction_cannot_hold_its_force(leans: float, slope: float) -> None:
    rng, filter_ = np.random.default_rng(7), SurfaceNormal()
    s = HybridSetpoint(np.eye(4), task_frame="found", velocity=np.array((0.015, 0.0, 0.0)))
    for i in range(90):
        m = measurement(i * DT, np.zeros(3), np.array((0.0, 0.0, 1.0)), s.velocity, rng, np.eye(3))
        m.on_environment.force[0] += 10.0 * (min(i / 60.0, 1.0) * leans - FRICTION)
        if i == 0:
            filter_.start(m)  # type: ignore[arg-type]
        filter_.image(m, s, STIFFNESS, LOOP)  # type: ignore[arg-type]
    assert_allclose(filter_.ahead[0] / filter_.ahead[2], -slope, atol=0.05)
    assert deviation(filter_) > 0.3  # it is a bound, and tells no more


def test_noise_across_the_path_makes_no_tip_slide() -> None:
    rng, filter_ = np.random.default_rng(8), SurfaceNormal()
    s = HybridSetpoint(np.eye(4), task_frame="found", velocity=np.array((0.015, 0.0, 0.0)))
    for i in range(45):
        place = np.array((0.0, 2e-3, -1e-3)) * (i > 40)  # as if down a steep slope
        m = measurement(i * DT, place, np.array((0.0, 0.0, 1.0)), s.velocity, rng, np.eye(3))
        if i == 0:
            filter_.start(m)  # type: ignore[arg-type]
        filter_.image(m, s, STIFFNESS, LOOP)  # type: ignore[arg-type]
    assert np.rad2deg(np.arccos(filter_.ahead[2])) < 3.0


def test_what_the_surface_sinks_by_is_no_slope() -> None:
    rng, filter_, share = np.random.default_rng(3), SurfaceNormal(), 0.2
    gives = share / (1.0 - share) / STIFFNESS  # [m/N] of the surface
    v = np.array((SPEED, 0.0, 0.0))
    for i in range(90):
        t = i * DT
        n, slid = np.array((0.0, 0.0, 1.0)), SPEED * max(t - 0.7, 0.0)
        force = min(20.0 * t + 2.0, 10.0) - 60.0 * slid  # built up while the tip sticks, and less as it slides
        m = measurement(t, np.array((slid, 0.0, -gives * force)), n, v, rng, np.eye(3))
        m.on_environment.force[:] *= force / 10.0
        m.undeflected = np.array((slid, 0.0, -(gives + 1.0 / STIFFNESS) * force))
        if i == 0:
            filter_.start(m)  # type: ignore[arg-type]
        s = HybridSetpoint(np.eye(4), task_frame="found", velocity=v)
        filter_.image(m, s, STIFFNESS, LOOP)  # type: ignore[arg-type]
    assert np.rad2deg(np.arccos(filter_.n[2])) < 2.0  # gives * 60 N/m is a slope of 1 degree, the build-up one of many
    assert filter_.share == pytest.approx(share, abs=0.05)


def test_a_tip_in_the_air_tells_nothing_of_the_surface() -> None:
    errors, filter_ = along(0.5, 0.0, 1)
    before, n = deviation(filter_), filter_.n.copy()
    rng, tip = np.random.default_rng(5), filter_.anchor.copy()
    for i in range(9):  # it falls by 9 mm
        tip = tip + DT * SPEED * filter_.tangents[0] - 1e-3 * n
        m = measurement(2.4 + i * DT, tip, n, filter_.tangents[0], rng, np.eye(3))
        m.on_environment.force[:] *= 0.1
        m.undeflected = tip - 1.0 / STIFFNESS * n
        wanted = Wrench(np.zeros(3), np.array((0.0, 0.0, -10.0)))
        s = HybridSetpoint(np.eye(4), wanted, np.diag((0.0, 0.0, 1.0)), task_frame="found")
        filter_.image(m, s, STIFFNESS, LOOP)  # type: ignore[arg-type]
    assert np.rad2deg(np.arccos(np.clip(filter_.n @ n, -1.0, 1.0))) < 3.0  # it falls at 42
    assert deviation(filter_) >= before
    assert errors


def test_the_path_slows_down_where_the_tool_cannot_turn_as_fast_as_the_surface() -> None:
    step = next(s for s in steps_of(load_task("follow")) if s.phase.name == "wipe")
    gone = []
    for degrees in (5.0, 21.0, 40.0):
        run = SurfaceRun(step, np.zeros(3), np.eye(3), np.eye(3), np.eye(3), np.eye(4))
        angle = np.deg2rad(degrees)
        state = SimpleNamespace(in_contact=True, X_W_tip=np.eye(4), R_W_task=so3_exp((0.0, angle, 0.0)))
        run.advance(0.01, state)  # type: ignore[arg-type]
        for _ in range(50):
            run.advance(0.01, state)  # type: ignore[arg-type]
        gone.append(run.share)
        assert float(np.linalg.norm(run.velocity)) <= 0.05 * run.pace + 1e-9
    assert gone[0] > gone[1] > gone[2]


def test_a_blade_that_lies_on_the_surface_shows_how_it_leans() -> None:
    rng, filter_ = np.random.default_rng(1), SurfaceNormal()
    R = so3_exp((np.deg2rad(12.0), 0.0, 0.0))  # about x: the blade's line is y
    for i in range(90):
        m = measurement(i * DT, np.zeros(3), R[:, 2], np.array((1.0, 0.0, 0.0)), rng, R)
        if i == 0:
            filter_.start(m)  # type: ignore[arg-type]
        s = HybridSetpoint(
            np.eye(4), torque_axes=(True, False, False), contact_resists=(True, False, False), task_frame="found"
        )
        filter_.image(m, s, STIFFNESS, LOOP)  # type: ignore[arg-type]
    assert_allclose(filter_.ahead, R[:, 2], atol=0.02)


def test_axes_that_are_carried_turn_with_the_normal_and_not_about_it() -> None:
    axes = np.eye(3)
    for angle in np.linspace(0.0, 1.2, 13):
        axes = carried(axes, np.array((np.sin(angle), 0.0, np.cos(angle))))
    assert_allclose(axes[:, 1], (0.0, 1.0, 0.0), atol=1e-12)
    assert_allclose(axes[:, 0], (np.cos(1.2), 0.0, -np.sin(1.2)), atol=1e-12)
    assert carried(axes, axes[:, 2]) is axes


def test_axes_are_axes_where_x_of_the_task_frame_is_the_normal() -> None:
    found = SurfaceNormal()
    x_up = np.array(((0.0, 0.0, -1.0), (0.0, 1.0, 0.0), (1.0, 0.0, 0.0)))
    for R_W_task in (x_up, x_up @ rotation_from_rpy((0.0, 1e-6, 0.0))):
        R = found.axes(R_W_task)
        assert_allclose(R.T @ R, np.eye(3), atol=1e-12)
        assert np.linalg.det(R) > 0.0
        assert_allclose(R[:, 1], R_W_task[:, 1], atol=1e-5)
