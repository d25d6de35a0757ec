# SPDX-License-Identifier: Apache-2.0
"""Images that are turned, or another finger's, are told by their dots."""

from dataclasses import replace

import numpy as np
import pytest
from rendered import held

from seed_estimation import EstimatorError
from seed_sim.tactile.parameters import TactileParameters


def test_images_turned_or_swapped_are_named() -> None:
    estimator, bubbles = held(TactileParameters(), 18)
    images = bubbles.render(np.eye(4), 0.1)
    turned = {f: replace(i, ir=np.ascontiguousarray(i.ir[::-1, ::-1])) for f, i in images.items()}
    assert "180" in estimator.update(turned, 0.1).reason
    swapped = {"left": images["right"], "right": images["left"]}
    assert "swapped" in estimator.update(swapped, 0.2).reason


def test_a_reference_of_the_other_finger_is_refused() -> None:
    estimator, bubbles = held(TactileParameters(), 19)
    images = bubbles.no_contact(0.1)
    with pytest.raises(EstimatorError, match="swapped"):
        estimator.capture_reference([{"left": images["right"], "right": images["left"]}])
