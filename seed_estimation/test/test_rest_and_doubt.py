# SPDX-License-Identifier: Apache-2.0
"""What a membrane at rest tells of its camera, what is known of a micro-slip, depth of frames not locked."""

import numpy as np
import pytest

from seed_core.spatial import Array
from seed_estimation.contact.surface import at_rest
from seed_estimation.rigid_fit.micro_slip import START_DEVIATION, MicroSlip
from seed_estimation.slip.gross import _gone_on, _with_depth
from seed_estimation.slip.markers import UNSEEN, Depth, Seen

SHAPE = (90, 120)
V, U = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(np.float32)
DOME = np.asarray(0.09 + 4e-6 * (U - 50) ** 2 + 6e-6 * (V - 40) ** 2, np.float32)
INSIDE = np.asarray((U - 60) ** 2 / 55**2 + (V - 45) ** 2 / 40**2 < 1.0)


def test_a_parabola_is_its_own_surface_up_to_the_rim() -> None:
    assert np.abs(at_rest(DOME, INSIDE, 20.0) - DOME)[INSIDE].max() < 1e-6


def test_what_a_camera_gets_wrong_over_a_centimetre_is_not_the_membranes_shape() -> None:
    """A blur as narrow as the pixel pattern would leave all of a ripple of 25 px in the surface."""
    ripple = np.asarray(3e-4 * np.sin(2.0 * np.pi * U / 25.0), np.float32)
    middle = slice(30, 60), slice(40, 80)
    left = (at_rest(DOME + ripple, INSIDE, 20.0) - DOME)[middle]
    assert left.std() < 0.05 * ripple[middle].std()


def test_nothing_is_said_beside_the_membrane() -> None:
    out = at_rest(DOME, INSIDE, 20.0)
    assert np.isnan(out[~INSIDE]).all()
    assert np.isfinite(out[INSIDE]).all()


def _learnt(demands: Array, information: float) -> MicroSlip:
    slip = MicroSlip(0.5)
    for demand in demands:
        slip.update(float(demand) - slip.value, information, 1.0 / 45.0)
    return slip


def test_a_slip_that_depth_hardly_sees_stays_in_doubt() -> None:
    """One bubble: five seconds of demands that err alike by as much as the slip itself."""
    for seed in range(5):
        alike = np.repeat(np.random.default_rng(seed).normal(0.1, 0.1, 10), 23)
        slip = _learnt(alike, 50.0)
        assert abs(slip.value - 0.1) < 2.0 * slip.deviation
        assert slip.deviation > 0.4 * START_DEVIATION


def test_a_slip_of_three_per_cent_is_corrected_and_none_is_not_invented() -> None:
    noise = np.random.default_rng(4).normal(0.0, 0.03, 180)
    assert 0.02 < _learnt(0.03 + noise, 3000.0).value < 0.035
    assert _learnt(np.abs(noise) - 0.02, 3000.0).value < 0.002


def test_doubt_is_never_less_than_the_error_of_a_slip_that_is_seen_well() -> None:
    for seed in range(5):
        alike = np.repeat(np.random.default_rng(seed).normal(0.15, 0.05, 20), 12)
        slip = _learnt(alike, 3000.0)
        assert abs(slip.value - 0.15) < 3.0 * slip.deviation < 0.12


@pytest.mark.parametrize("unlocked", [(), (4,), (0, 3)])
def test_frames_without_a_lock_do_not_tear_depth_from_dots(unlocked: tuple[int, ...]) -> None:
    """A tool that moves on, dots and depth as one, while some frames are not locked: nothing has gone on alone."""
    seen = []
    for i in range(7):
        way = np.array((0.0, 4e-3 + 2.5e-4 * i, 0.0))
        depth = UNSEEN if i in unlocked else Depth(way, np.full(3, 5e-5))
        seen.append(Seen(i / 45.0, way, float(way[1]), depth, 0.0, False))
    assert not _gone_on(_with_depth(seen))
