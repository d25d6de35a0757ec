# SPDX-License-Identifier: Apache-2.0
"""How a surface may move: transitions against finite differences and the equations of motion."""

import numpy as np
from numpy.testing import assert_allclose

from seed_control.law.surface_models import RESTING, SurfaceModels

MODELS = SurfaceModels()
MOTION = np.tile((2e-3, 0.01, 0.1), (MODELS.count, 1))
SWINGS = slice(RESTING + 1, None)
MOTION[: RESTING + 1, 2] = 0.0  # what does not swing has no frequency
DT = 0.05


def carried(motion: np.ndarray, dt: float) -> np.ndarray:
    u, v = MODELS.after(motion, dt)
    return np.stack([u, v, motion[:, 2]], axis=1)


def test_some_rest_and_the_next_goes_on_at_its_speed() -> None:
    u, v = MODELS.after(MOTION, DT)
    assert_allclose((u[RESTING], v[RESTING]), (2e-3 + 0.01 * DT, 0.01))
    assert not MODELS.prior()[:RESTING].any()
    assert_allclose(MODELS.after(0.0 * MOTION, DT), 0.0)


def test_two_steps_are_one_and_a_swing_keeps_its_energy() -> None:
    assert_allclose(carried(carried(MOTION, DT), DT), carried(MOTION, 2.0 * DT), atol=1e-12)
    small = 1e-5
    for motion in (MOTION, carried(MOTION, 0.3)):
        u, v = MODELS.after(motion, 0.0)
        later = MODELS.after(motion, small)[1]
        w_squared = -(later - v)[SWINGS] / small / u[SWINGS]
        if motion is MOTION:
            first = w_squared
    assert_allclose(w_squared, first, rtol=2e-2)


def test_the_transition_is_the_derivative_of_the_motion() -> None:
    F = MODELS.transition(MOTION, DT)
    for i, small in enumerate((1e-7, 1e-7, 1e-5)):
        ahead, back = MOTION.copy(), MOTION.copy()
        ahead[:, i] += small
        back[:, i] -= small
        measured = (carried(ahead, DT) - carried(back, DT)) / (2.0 * small)
        assert_allclose(F[SWINGS, :, i], measured[SWINGS], atol=1e-7)


def test_a_frequency_stays_near_its_own() -> None:
    bounded = MODELS.bounded(np.full(MODELS.count, 100.0))
    assert not bounded[: RESTING + 1].any()
    assert np.all((bounded[SWINGS] > 0.0) & (bounded[SWINGS] < 100.0))
