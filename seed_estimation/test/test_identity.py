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


def test_a_grasp_of_fingers_that_were_swapped_after_the_reference_is_refused() -> None:
    estimator, bubbles = held(TactileParameters(), 20)
    swapped = {"left": "right", "right": "left"}
    images = [bubbles.render(np.eye(4), 1.0 + 0.1 * i) for i in range(3)]
    with pytest.raises(EstimatorError, match="swapped"):
        estimator.initialize_grasp([{f: i[other] for f, other in swapped.items()} for i in images])
    estimator.initialize_grasp(images)
