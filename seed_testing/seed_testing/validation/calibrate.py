# SPDX-License-Identifier: Apache-2.0
"""The suite's calibration of range and cameras, from rendered captures."""

from seed_core.hand import Hand
from seed_estimation.calibration.calibrate import calibrate
from seed_estimation.calibration.file import Calibration
from seed_sim.tactile import TactileRenderer
from seed_sim.world.procedures.captures import captures


def calibration(renderer: TactileRenderer, hand: Hand) -> Calibration:
    """Range offsets and camera poses, started from the believed `hand`."""
    return calibrate(**captures(renderer), hand=hand)
