# SPDX-License-Identifier: Apache-2.0
"""The stability argument of docs/control_stability.md, with numbers over the grid of scenarios."""

from itertools import product

import numpy as np
import pytest
from stability import (
    environment_share,
    lean_crossover,
    lean_delay_limit,
    lean_phase_margin,
    surface_small_gain,
)

from seed_control.command.flange_command import BANDWIDTH
from seed_control.law.surface_observer import MAX_SHARE, SurfaceObserver
from seed_control.parameters import ControllerParameters

STIFFNESS = {"nominal": 800.0, "stiff_grip": 3200.0}  # [N/m] along z
ENVIRONMENT = {"rigid": 4e4, "soft": 500.0}  # [N/m]
DELAYS = (0.0, 0.03, 0.05, 0.1)  # [s] of the image
ARMS = {"default": (0.015, 0.0), "slow_servo": (0.06, 0.02)}  # lag, dead time [s]


def test_surface_loop_contracts_wherever_the_share_is_overestimated_or_unknown() -> None:
    """beta_hat between 0 and somewhat above beta: |m| < 1, whatever the delay."""
    for k, k_env in product(STIFFNESS.values(), ENVIRONMENT.values()):
        share = environment_share(k, k_env)
        for believed in np.linspace(0.0, min(MAX_SHARE, 0.5 * (1.0 + share) - 1e-6), 50):
            assert surface_small_gain(share, believed) < 1.0


def test_surface_loop_margin_runs_out_exactly_where_the_formula_says() -> None:
    """|m| = 1 at beta_hat = (1 + beta) / 2: half of the remaining way to one."""
    for share in (0.0, 0.2, 0.6):
        assert surface_small_gain(share, 0.5 * (1.0 + share)) == pytest.approx(1.0)


def test_estimated_share_stays_where_the_loop_contracts() -> None:
    """Pressing with noise of 0.3 mm: the filter's beta settles near the true one on hard and on soft ground."""
    p, n = ControllerParameters(), np.array((0.0, 0.0, 1.0))
    for share, seed in product((0.02, 0.074, 0.615), range(5)):
        rng = np.random.default_rng(seed)
        observer = SurfaceObserver(p)
        worst = 0.0
        for i in range(60):
            c = -0.03 * min(i / 45.0, 1.0) * min(1.0, 1.0 / (1.0 - share) / 3.0)
            tip = np.array((0.0, 0.0, share * c + 3e-4 * rng.standard_normal()))
            if i == 0:
                observer.start(0.0, n, tip, np.array((0.0, 0.0, c)))
            observer.update(i / 45.0, n, tip, np.array((0.0, 0.0, c)), 9e-8)
            worst = max(worst, surface_small_gain(share, observer.x[4]))
        assert worst < 0.9
        assert abs(observer.x[4] - share) < 0.1


@pytest.mark.parametrize("delay", DELAYS)
@pytest.mark.parametrize("arm", ARMS)
def test_lean_loop_has_margin_over_the_grid(delay: float, arm: str) -> None:
    """Its time constant follows the measured loop time, so the margin is the same for every arm and camera."""
    p, (lag, dead) = ControllerParameters(), ARMS[arm]
    waits, trails = delay + 0.5 / 45.0 + dead, lag + 2.0 / BANDWIDTH
    T = max(p.angle_feedforward, p.feedforward_ratio * (waits + trails))
    assert lean_phase_margin(T, waits, trails) > np.deg2rad(44.0)
    assert lean_phase_margin(T, waits, trails, tipping_mismatch=1.3) > np.deg2rad(25.0)  # softer than believed
    blind = max(p.angle_feedforward, p.feedforward_ratio * (waits + trails - dead - 0.5 * lag))
    assert lean_phase_margin(blind, waits, trails) > np.deg2rad(30.0)  # before the arm's lag has been learnt


def test_delay_limit_is_where_a_simulated_lean_loop_starts_to_swing() -> None:
    """The integrator with lag and delay, stepped through time: decays just below the limit, grows just above."""
    T, lag = 0.15, 0.04
    limit = lean_delay_limit(T, lag)
    assert lean_crossover(T, lag) < 1.0 / T
    assert swing(T, lag, 0.85 * limit) < 0.5 < 1.5 < swing(T, lag, 1.15 * limit)


def swing(T: float, lag: float, delay: float) -> float:
    """Late over early amplitude of theta' = -(lagged, delayed theta) / T after a push."""
    dt = 1e-3
    past = [1.0] * (round(delay / dt) + 1)
    angle = lagged = 1.0
    track = []
    for _ in range(6000):
        past.append(angle)
        lagged += dt / lag * (past[-1 - round(delay / dt)] - lagged)
        angle -= dt / T * lagged
        track.append(abs(angle))
    return max(track[-1500:]) / max(track[1000:2500])
