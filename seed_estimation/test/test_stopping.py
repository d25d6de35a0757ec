# SPDX-License-Identifier: Apache-2.0
"""Material that was dragged and stops: on a tool that slides, or with a tool that stops."""

import numpy as np
import pytest

from seed_estimation.slip.stopping import Drag, stops_as_it_slips

PERIOD = 1.0 / 45.0  # [s]


def patch(speed: float, sliding: float) -> np.ndarray:
    """Speeds [m/s] of points of a patch: a share of them slides, and is up to a third slower than the rest."""
    n = 40
    behind = np.clip((np.arange(n) + 1.0 - (1.0 - sliding) * n) / n, 0.0, None)
    return speed * (1.0 - 0.5 * behind)


def dragged(left: list[float], right: list[float], sliding: float, start: float = 0.0) -> list[Drag]:
    """Steps in which each finger's material moves at such speeds [m/s], from `start` [m] on."""
    places = start + np.cumsum(np.maximum(left, right)) * PERIOD
    return [Drag([patch(a, sliding), patch(b, sliding)], float(z)) for a, b, z in zip(left, right, places, strict=True)]


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_fingers_that_let_go_one_after_the_other_show_a_slip(sign: float) -> None:
    left, right = [0.06, 0.06, 0.015, 0.003], [0.06, 0.06, 0.05, 0.012]
    seen = dragged([sign * v for v in left], [sign * v for v in right], 0.6)
    assert stops_as_it_slips(seen)
    assert not stops_as_it_slips(seen[:-1])  # the right finger still holds it


@pytest.mark.parametrize(
    ("left", "right", "sliding", "start"),
    [
        ([0.06, 0.06, 0.0], [0.06, 0.06, 0.0], 0.9, 0.0),  # a tool that stops at once
        ([0.018, 0.025, 0.017, 0.009, 0.004], [0.018, 0.022, 0.018, 0.009, 0.004], 0.9, 0.0),  # a press that ends
        ([0.06, 0.06, 0.03, 0.0], [0.06, 0.06, 0.03, 0.0], 0.9, 0.0),  # the same between two images
        ([0.015, 0.015, 0.002, 0.001], [0.015, 0.015, 0.012, 0.002], 0.6, 0.0),  # too slow to be told
        ([0.06, 0.06, 0.015, 0.003], [0.06, 0.06, 0.05, 0.012], 0.6, -0.02),  # goes back, without a load
        ([0.06, 0.06, 0.06, 0.06], [0.06, 0.06, 0.06, 0.06], 0.9, 0.0),  # is dragged on
        ([0.06, 0.06, -0.06], [0.06, 0.06, -0.06], 0.9, 0.0),  # is set free, and goes back
    ],
)
def test_what_is_no_slip(left: list[float], right: list[float], sliding: float, start: float) -> None:
    assert not stops_as_it_slips(dragged(left, right, sliding, start))
